//! Experiments with cheaper fine-tuning.

use super::{CpuDevice, store::Store};
use crate::{OptimizerConfig, Result, device::{Step, StepReport}};
use corf_scene::Rng;

/// Gaussians with their moments.
pub struct Snapshot(Store);

/// Tiles drawn by their residuals.
pub struct Sampler {
    /// Share of the tiles, light and radio.
    pub share: [f32; 2],
    /// Whether gradients are weighted by the inverse of the probability.
    pub unbiased: bool,
    /// Part of the probability that is the same for all.
    pub uniform: f32,
    pub seed: u64,
    /// Per view and image, residual of each tile as it was last seen.
    residuals: Vec<[Vec<f32>; 2]>,
    drawn: u64,
}

impl Sampler {
    pub fn new(share: [f32; 2], unbiased: bool, uniform: f32, seed: u64) -> Self {
        Self { share, unbiased, uniform, seed, residuals: vec![], drawn: 0 }
    }
}

impl CpuDevice {
    pub fn x_optimizer(&mut self) -> &mut OptimizerConfig {
        &mut self.optimizer
    }

    pub fn x_snapshot(&self) -> Snapshot {
        Snapshot(self.store.clone())
    }

    pub fn x_restore(&mut self, snapshot: &Snapshot) {
        self.store = snapshot.0.clone();
    }

    /// Weights of the tiles of some steps, by their residuals in an image rendered for that.
    pub fn x_tile_weights(&mut self, sampler: &mut Sampler, steps: &[Step]) -> Result<Vec<[Vec<f32>; 2]>> {
        let mut out = vec![];
        for step in steps {
            let scene = self.scene_of_step(step)?;
            self.frame.projection.tile_weights = Default::default();
            self.frame.project(self.isa, &self.store, &scene, self.raster.near_m);
            self.frame.sort(&scene);
            self.frame.blend(self.isa, &scene, self.channels(), [step.light_background, step.radio_background], [false; 2]);
            let mut rng = Rng::keyed(sampler.seed, 77, sampler.drawn);
            sampler.drawn += 1;
            out.push([0, 1].map(|g| {
                let Some(grid) = &scene.grids[g] else { return vec![] };
                let target = &self.pyramids[step.view.0].levels[step.levels[g] as usize][g].target;
                let channels = self.channels()[g];
                let r = target.residuals_of(&self.frame.images[g].color, super::tiles::tile_count(grid), channels);
                let mean = r.iter().sum::<f32>() / r.len() as f32;
                r.iter()
                    .map(|r| {
                        let p = (sampler.share[g] * (sampler.uniform + (1.0 - sampler.uniform) * r / mean.max(1e-12))).min(1.0);
                        if rng.uniform() < p { if sampler.unbiased { 1.0 / p } else { 1.0 } } else { 0.0 }
                    })
                    .collect()
            }));
        }
        Ok(out)
    }

    /// A step of Adam that sees some of the tiles.
    pub fn x_sampled(&mut self, sampler: &mut Sampler, step: &Step) -> Result<StepReport> {
        let view = step.view.0;
        if sampler.residuals.len() <= view {
            sampler.residuals.resize_with(view + 1, Default::default);
        }
        let mut rng = Rng::keyed(sampler.seed, 77, sampler.drawn);
        sampler.drawn += 1;
        let share = sampler.share;
        self.tile_weights = [0, 1].map(|g| {
            let known = &sampler.residuals[view][g];
            if known.is_empty() || share[g] >= 1.0 {
                return vec![];
            }
            let mean = known.iter().sum::<f32>() / known.len() as f32;
            let uniform = sampler.uniform;
            known
                .iter()
                .map(|r| {
                    let p = (share[g] * (uniform + (1.0 - uniform) * r / mean.max(1e-12))).min(1.0);
                    if rng.uniform() < p { if sampler.unbiased { 1.0 / p } else { 1.0 } } else { 0.0 }
                })
                .collect()
        });
        let report = self.step(step);
        for g in 0..2 {
            if share[g] >= 1.0 {
                continue;
            }
            let target = &self.pyramids[view].levels[step.levels[g] as usize][g].target;
            let now = self.scratch.losses[g].residuals(target);
            let known = &mut sampler.residuals[view][g];
            if self.tile_weights[g].is_empty() {
                *known = now;
            } else {
                for (tile, w) in self.tile_weights[g].iter().enumerate().filter(|(_, w)| **w > 0.0) {
                    let _ = w;
                    known[tile] = now[tile];
                }
            }
        }
        self.tile_weights = Default::default();
        report
    }
}
