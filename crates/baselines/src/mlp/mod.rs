//! Small networks of fully connected layers, for fields that are a function instead of a set of Gaussians.
//!
//! A [`Network`] says which layer reads what; its parameters are one array of numbers. [`Network::forward`] and [`Network::backward`] are the
//! processor's, generic over `f32` and `f64`; `gpu` has the same in WGSL. [`FrequencyEncoding`] is what coordinates go through before a
//! network sees them, [`Adam`] and [`Cosine`] are how it is trained; [`corf::files::tensors`] keeps it on disk.

mod adam;
mod encoding;
#[cfg(feature = "gpu")]
pub mod gpu;
mod network;
mod pass;

pub use adam::{Adam, Cosine, Trained};
pub use encoding::FrequencyEncoding;
pub use network::{Activation, DenseLayer, LayerInput, Network};
pub use pass::Tape;
