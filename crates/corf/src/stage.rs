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
/// Keyframe of each training step of a field that knows its array.
pub const VISITS: u64 = 0x6172_7261_795f_7669;
/// A stage's key for one trajectory frame, or step.
pub fn keyed(stage: u64, frame: usize) -> u64 {
    stage | (frame as u64 + 1) << 8
}
