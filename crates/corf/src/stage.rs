//! Keys of the random streams. Two stages of a run with one key would draw the same numbers.

/// Wave vectors of the simulated prior's smooth field.
pub const PRIOR_WAVES: u64 = 1;
/// Innovations of that field; keyed by trajectory frame.
pub const PRIOR_FIELD: u64 = 2;
/// Per-object bias of the simulated prior.
pub const PRIOR_OBJECT: u64 = 3;
/// Per-frame scale, offset and exponent of the simulated prior.
pub const PRIOR_FRAME: u64 = 4;
/// Per-pixel noise of the simulated prior; keyed by trajectory frame.
pub const PRIOR_NOISE: u64 = 5;
/// Random-number stage of the pixels that spawn a Gaussian; keyed by trajectory frame.
pub const SAMPLING: u64 = 7;
/// Keyframe and background of each optimisation step.
pub const STEPS: u64 = 8;
/// Order of the keyframes in an epoch of fine-tuning.
pub const EPOCHS: u64 = 9;
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

/// A stage's key for one trajectory frame, or step.
pub fn keyed(stage: u64, frame: usize) -> u64 {
    stage | (frame as u64 + 1) << 8
}
