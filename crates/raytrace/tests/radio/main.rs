//! Truths about radio waves in small rooms that need no reference data.

#![allow(clippy::unwrap_used)]

mod diffuse;
mod paths;
mod rooms;
mod search;
