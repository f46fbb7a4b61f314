//! Truths about radio waves in small rooms that need no reference data.

#![allow(clippy::unwrap_used)]

mod diffuse;
mod joints;
mod paths;
mod rooms;
mod search;
