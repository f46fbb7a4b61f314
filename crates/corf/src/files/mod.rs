//! What is read and written: fields as PLY ([`ply`]) and in the formats of splat viewers ([`export`]), the states of devices, trained numbers.

mod checksum;
pub mod export;
pub mod numbers;
pub mod ply;
pub mod state;
