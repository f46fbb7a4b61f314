//! Neural networks on the processor, as far as more than one of them needs it: tensors out of a file, maps, and layers.

mod layer;
mod safetensors;

pub(crate) use layer::{Layer, Map, MaxPool, Window};
pub(crate) use safetensors::Tensors;
