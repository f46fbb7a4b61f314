//! The simple evaluation that the gathering is tested against.

mod quadrature;

pub use quadrature::Scattered;
