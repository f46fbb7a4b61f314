//! Rooms built in code: the lobby, the office, and what they are made of.

pub(crate) mod builder;
pub mod draw;
pub mod lobby;
pub mod office;
