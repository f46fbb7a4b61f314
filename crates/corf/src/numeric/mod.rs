//! Numbers of two precisions, and products of matrices of them.

mod matrix;
mod real;

pub use matrix::{Matrix, multiply};
pub use real::Real;
