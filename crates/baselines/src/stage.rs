//! Keys of the random streams of baselines, beside those of [`corf::stage`].

pub(crate) use corf::stage::keyed;

/// Initial parameters of a network; keyed by layer.
pub const NETWORK: u64 = 10;
/// Order of an implicit field's training rays; keyed by epoch.
pub const RAYS: u64 = 11;
/// Distances at which an implicit field is sampled; keyed by step.
pub const DISTANCES: u64 = 12;

// The three below have the numbers of the three above, and their published bytes depend on them. No run draws from both of a pair: implicit fields
// have no Gaussians, and WRF-GS+, which has a network beside them, draws for it from `NETWORK` alone, which is not keyed as `OFFLINE_EPOCHS` is.

/// Order of the views in an epoch of offline reconstruction; keyed by the stage.
pub const OFFLINE_EPOCHS: u64 = 10;
/// Places of the parts of a Gaussian that density control splits; keyed by the step.
pub const SPLITS: u64 = 11;
/// Random first Gaussians of an offline reconstruction.
pub const INITIAL_POINTS: u64 = 12;
