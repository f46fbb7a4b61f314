//! What a step's kernels move and compute: the floor that no run of them can be below.

use super::{GpuDevice, train::STAGES};

/// Bytes and operations of one stage of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageWork {
    /// The stage, one of [`STAGES`].
    pub name: &'static str,
    /// Bytes read and written, each word once.
    pub bytes: f64,
    /// Floating-point operations of its inner loops.
    pub operations: f64,
}

/// Operations per pixel and pair: forward; backward (with the sums over pixels).
const BLEND: f64 = 24.0;
const BLEND_BACKWARD: f64 = 60.0;
/// Operations per pixel and channel of the loss: 11 + 11 taps of five moments, 11 + 11 of three derivatives.
const LOSS: f64 = 2.0 * 22.0 * 8.0;

impl GpuDevice {
    /// Pairs (Gaussian, tile) of the largest frame of the last call.
    pub fn pairs(&self) -> usize {
        self.last.pairs
    }

    /// The work of the last step: what its counts make its kernels read, write and compute.
    pub fn work(&self) -> [StageWork; STAGES.len()] {
        let c = self.last;
        let (n, v, e) = (self.store.len() as f64, c.visible as f64, c.pairs as f64);
        let (pixels, area) = (c.pixels as f64, f64::from(self.fixed.tile[0] * self.fixed.tile[1]));
        let sh: f64 = self.store.harmonics.iter().map(|h| 4.0 * h.words() as f64).sum();
        let (core, splat, record) = (48.0, 48.0, 64.0);
        let passes = f64::from(c.tile_passes);
        // A radix pass reads keys twice and values once and writes both.
        let pass = 20.0;
        let work = [
            (n * (core + 12.0) + v * (sh + 2.0 * splat), n * 60.0 + v * 600.0),
            (n * 8.0 + 4.0 * pass * v + e * (8.0 + pass * passes + 4.0), 0.0),
            (e * (8.0 + splat) + pixels * 20.0, e * area * BLEND),
            (pixels * (16.0 + 12.0 + 36.0 + 36.0 + 16.0 + 12.0 + 16.0), pixels * 3.0 * LOSS),
            (e * (8.0 + splat + record) + pixels * 32.0, e * area * BLEND_BACKWARD),
            (e * record + v * (6.0 * (core + sh) + 16.0 + 2.0 * splat), v * 1500.0),
        ];
        std::array::from_fn(|k| StageWork { name: STAGES[k], bytes: work[k].0, operations: work[k].1 })
    }
}
