//! The TOML files a user writes: a scene's ([`SceneConfig`]) and a dataset's ([`DatasetConfig`]).
//!
//! Every table refuses unknown keys, and every complaint names file, line and key, with the nearest known spelling.

mod antenna;
mod dataset;
mod load;
mod lobe;
mod pattern;
mod scene;
mod spectrum;

pub use crate::import::UpAxis;
pub use antenna::{BeamConfig, Orientation, Polarization, RearHalfSpace, ReceiverConfig, TransmitterConfig};
pub use dataset::{DatasetConfig, Denoiser, LightConfig, LightMethod, SplitConfig};
pub use load::{from_toml, help_with_name, read_toml};
pub use pattern::{AntennaPattern, ElementGrid, ElementResponses, Elements, PatternFile, Sampled, SampledPattern};
pub use scene::{RadioConfig, SceneConfig, SceneFile};
pub use spectrum::{SpectrumConfig, SpectrumKind};
