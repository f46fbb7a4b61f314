//! What radio knows of a material: the ITU's table, the written form, and checks.

pub mod itu;
pub mod radio_check;
pub mod radio_spec;
