//! Plane waves at a receiver: what stands between a field of emitters and the observation a sensor forms of it.

use crate::Real;

/// A plane wave that reaches the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wave<T> {
    /// Unit direction it comes from, array frame (boresight +x).
    pub direction: [T; 3],
    /// Linear power, relative to 1 W transmitted.
    pub power: T,
    /// Variance per axis of the angle that its emitter subtends, rad²; 0 of a point.
    pub spread2: T,
}

/// Waves that a task takes; fixed, so that sums come out the same for any thread count.
pub(super) const WAVES_PER_TASK: usize = 1024;

/// a·b.
pub(super) fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
