//! What is read and written: fields as PLY ([`ply`]) and in the formats of splat viewers ([`export`]), named arrays of numbers ([`tensors`]), and
//! devices' states as such ([`state`]).

pub mod export;
pub mod ply;
pub mod state;
pub mod tensors;
