//! Documents that are written from the program: tables, help, keys.

pub mod explain;
pub mod schema;
pub mod splice;
