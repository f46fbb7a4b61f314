//! Files of the command: JSON within bounds, outputs that appear whole, inputs that stay apart from them, text inside of other notations.

pub mod ending;
pub mod escape;
pub mod json;
pub mod numbers;
pub mod output;
pub mod separation;
