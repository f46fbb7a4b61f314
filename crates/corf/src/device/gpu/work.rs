//! Memory traffic and operations of a step's kernels: a lower bound on their run time, as in a roofline model.

use super::{GpuDevice, shaders::Fixed, train::STAGES};

/// Bytes and operations of one kernel of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageWork {
    /// The kernel, one of [`STAGES`].
    pub name: &'static str,
    /// Bytes read and written, each word once.
    pub bytes: f64,
    /// Floating-point operations of its inner loops.
    pub operations: f64,
}

/// Operations per pixel and pair: forward; backward (with the sums over pixels).
const BLEND: f64 = 24.0;
const BLEND_BACKWARD: f64 = 60.0;
/// Operations per pixel, channel and blurred quantity: 11 taps along rows, 11 down columns.
const BLUR: f64 = 2.0 * 22.0;

impl GpuDevice {
    /// Pairs (Gaussian, tile) of the largest frame of the last call.
    pub fn pairs(&self) -> usize {
        self.last.pairs
    }

    /// The work of the last step: what its counts make its kernels read, write and compute.
    pub fn work(&self) -> [StageWork; STAGES.len()] {
        let c = self.last;
        let (n, v, e) = (self.store.len() as f64, c.visible as f64, c.pairs as f64);
        let fixed = &self.shapes[c.shape];
        let (pixels, area) = (c.pixels as f64, f64::from(fixed.tile[0] * fixed.tile[1]));
        let sh: f64 = self.store.harmonics.iter().map(|h| 4.0 * h.words() as f64).sum();
        let (core, splat, record) = (48.0, 48.0, if c.fused { 64.0 } else { 48.0 });
        // What a visible Gaussian's tiles take, a pair as it is emitted, an entry of a list, what is found of a Gaussian.
        let (taken, pair, entry, found) = (32.0, 16.0, 8.0, 80.0);
        // What the forward pass keeps for each bucket but a tile's first.
        let kept = e * area * 4.0 * f64::from(Fixed::state_numbers(c.fused)) / f64::from(fixed.batch);
        let tiles = c.tiles as f64;
        let work = [
            (n * core + v * (sh + 2.0 * splat + taken), n * 60.0 + v * 600.0),
            (v * (taken + splat) + e * (pair + 4.0), 0.0),
            (tiles * 24.0, 0.0),
            (e * (pair + entry), 0.0),
            (e * (2.0 * entry + 4.0), 0.0),
            (e * (entry + splat) + pixels * 20.0 + kept, e * area * BLEND),
            (pixels * 3.0 * (4.0 + 12.0) + c.target_bytes as f64, pixels * 3.0 * 5.0 * BLUR),
            (pixels * 3.0 * (4.0 + 12.0 + 4.0) + c.target_bytes as f64, pixels * 3.0 * 3.0 * BLUR),
            (e * (entry + splat + record) + pixels * 32.0 + kept, e * area * BLEND_BACKWARD),
            (e * record + v * (6.0 * sh + taken + 2.0 * splat + found), v * 500.0),
            (v * (6.0 * core + found + 4.0), v * 1000.0),
        ];
        std::array::from_fn(|k| StageWork { name: STAGES[k], bytes: work[k].0, operations: work[k].1 })
    }
}
