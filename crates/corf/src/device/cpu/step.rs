//! One training step, stage by stage.

use super::{
    CpuDevice,
    blend::{AREA, Backward, Record},
    geometry::{Grid, Scene},
    project::Splat,
    pyramid::check_levels,
    render::{Image, tile_at},
    tiles::tile_count,
    update::{Mode, Update},
};
use crate::simd::Isa;
use crate::{
    Error, Gaussians, OptimizerConfig, Result,
    device::{DenseStep, ScreenGradient, Step, StepReport},
    loss::fused::{DepthLoss, ImageLoss, stride_of},
};
use rayon::prelude::*;
use std::time::Instant;

/// Seconds per stage, summed over steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageTimes {
    /// Steps taken.
    pub steps: usize,
    /// Projection, colours, tiles of each Gaussian.
    pub project_s: f64,
    /// Depth order and tile lists.
    pub sort_s: f64,
    /// Blending of both images.
    pub forward_s: f64,
    /// Image and depth losses with their gradients.
    pub loss_s: f64,
    /// Blending backwards.
    pub backward_s: f64,
    /// Gathering, projection backwards, Adam.
    pub update_s: f64,
}

impl StageTimes {
    /// All stages, seconds.
    pub fn total_s(&self) -> f64 {
        self.project_s + self.sort_s + self.forward_s + self.loss_s + self.backward_s + self.update_s
    }
}

/// Scratch of the gradient, kept between steps for its memory.
#[derive(Default)]
pub(crate) struct Scratch {
    losses: [ImageLoss; 2],
    depth: DepthLoss,
    /// Per image, one record per tile-list entry.
    records: [Vec<Record>; 2],
}

impl CpuDevice {
    pub(super) fn scene_of_step(&self, step: &Step) -> Result<Scene> {
        let place = || format!("training step for view {}", step.view.0);
        let Some(pyramid) = self.pyramids.get(step.view.0) else {
            let what = format!("this device holds {} views", self.pyramids.len());
            return Err(Error::invalid(place(), what, "upload the view to the device that trains on it"));
        };
        check_levels(step.levels, [pyramid.levels.len(), pyramid.radio_levels])
            .map_err(|what| Error::invalid(place(), what, "upload the view with more levels, or train on a lower one"))?;
        let weights = [step.light_weight, step.radio_weight, step.depth_weight];
        if weights.iter().any(|w| !(w.is_finite() && *w >= 0.0)) {
            return Err(Error::invalid(place(), format!("loss weights {weights:?}"), "give finite weights ≥ 0"));
        }
        let mut grids = pyramid.grids(step.levels.map(|l| l as usize), self.raster.antialias).map(Some);
        if step.light_weight == 0.0 {
            grids[0] = None;
        }
        if step.radio_weight == 0.0 {
            grids[1] = None;
        }
        Ok(Scene::new(&pyramid.world_from_camera, grids))
    }

    /// Forward, loss and backward: fills the frame and the records.
    pub(super) fn differentiate(&mut self, step: &Step, scene: &Scene) -> StepReport {
        let isa = self.isa;
        let pyramid = &self.pyramids[step.view.0];
        let at = step.levels.map(|l| l as usize);
        let depth_target = match &pyramid.depth {
            Some(levels) if step.depth_weight > 0.0 && scene.grids[0].is_some() => Some(&levels[at[0]]),
            _ => None,
        };
        let channels = [self.store.harmonics[0].channels, self.store.harmonics[1].channels];
        let weights = [step.light_weight, step.radio_weight];
        let with_depth = [depth_target.is_some(), false];
        let mut report = StepReport::default();

        let mut clock = Clock(Instant::now());
        self.frame.project(isa, &self.store, scene, self.raster.near_m);
        report.visible = self.frame.projection.visible();
        clock.lap(&mut self.times.project_s);

        self.frame.sort(scene);
        clock.lap(&mut self.times.sort_s);

        self.frame.blend(isa, scene, channels, [step.light_background, step.radio_background], with_depth);
        clock.lap(&mut self.times.forward_s);

        let scratch = &mut self.scratch;
        let [light_loss, radio_loss] = &mut scratch.losses;
        let (depth_loss, images, gamma) = (&mut scratch.depth, &self.frame.images, self.optimizer.ssim_weight);
        let run = |g: usize, loss: &mut ImageLoss| match scene.grids[g] {
            Some(_) => loss.run(isa, &images[g].color, &pyramid.levels[at[g]][g].target, weights[g], gamma),
            None => 0.0,
        };
        (report.light_loss, report.radio_loss) = rayon::join(|| run(0, light_loss), || run(1, radio_loss));
        if let Some(target) = depth_target {
            // η multiplies the depth term inside L_opt (paper Eq. (19)).
            report.depth_loss = depth_loss.run(&images[0].inverse_depth, target, step.depth_weight);
        }
        clock.lap(&mut self.times.loss_s);

        let [light, radio] = &mut scratch.records;
        let splats = &self.frame.projection.splats;
        let backward = |g: usize, records: &mut Vec<Record>, loss: &ImageLoss| {
            let Some(grid) = &scene.grids[g] else { return };
            let job = Backwards {
                isa,
                grid,
                image: &images[g],
                splats: &splats[g],
                color_gradient: &loss.gradient,
                depth_gradient: &depth_loss.gradient,
            };
            match (channels[g], with_depth[g]) {
                (1, false) => job.run::<1, false>(records),
                (1, true) => job.run::<1, true>(records),
                (_, false) => job.run::<3, false>(records),
                (_, true) => job.run::<3, true>(records),
            }
        };
        rayon::join(|| backward(0, light, light_loss), || backward(1, radio, radio_loss));
        clock.lap(&mut self.times.backward_s);
        report
    }

    fn update<'a>(&'a self, scene: &'a Scene, mode: Mode<'a>) -> Update<'a> {
        Update {
            isa: self.isa,
            scene,
            projection: &self.frame.projection,
            records: [&self.scratch.records[0], &self.scratch.records[1]],
            places: [&self.frame.images[0].places, &self.frame.images[1].places],
            mode,
        }
    }

    pub(super) fn step(&mut self, step: &Step) -> Result<StepReport> {
        let config = self.optimizer;
        self.step_with(step, &config, None)
    }

    pub(super) fn dense_step(&mut self, dense: &DenseStep) -> Result<StepReport> {
        dense.check()?;
        if dense.screen_gradients {
            self.store.screen.resize(self.store.len(), ScreenGradient::default());
        }
        self.step_with(&dense.step, &dense.constants(&self.optimizer), Some(dense))
    }

    fn step_with(&mut self, step: &Step, config: &OptimizerConfig, dense: Option<&DenseStep>) -> Result<StepReport> {
        let scene = self.scene_of_step(step)?;
        let report = self.differentiate(step, &scene);
        let mut clock = Clock(Instant::now());
        self.update_store(&scene, Mode::Adam { config, geometry: step.train_geometry, dense });
        clock.lap(&mut self.times.update_s);
        self.times.steps += 1;
        Ok(report)
    }

    /// Updates the store that the frame was made from.
    pub(super) fn update_store(&mut self, scene: &Scene, mode: Mode<'_>) {
        let mut store = std::mem::replace(&mut self.store, super::store::Store::hollow());
        self.update(scene, mode).run(&mut store);
        self.store = store;
    }

    /// The gradient of a step's loss with respect to every parameter, in the shape of the parameters, without taking the step.
    ///
    /// # Errors
    /// Those of [`Device::train`](crate::Device::train).
    pub fn gradients(&mut self, step: &Step) -> Result<(StepReport, Gaussians)> {
        let scene = self.scene_of_step(step)?;
        let report = self.differentiate(step, &scene);
        let mut gradient = self.store.clone();
        self.update(&scene, Mode::Write { screen: false }).run(&mut gradient);
        gradient.clear_unless(&self.frame.projection.seen(self.store.len()));
        Ok((report, gradient.to_gaussians()))
    }
}

struct Clock(Instant);

impl Clock {
    fn lap(&mut self, sum: &mut f64) {
        let now = Instant::now();
        *sum += (now - self.0).as_secs_f64();
        self.0 = now;
    }
}

/// The backward pass of one image.
struct Backwards<'a> {
    isa: Isa,
    grid: &'a Grid,
    image: &'a Image,
    splats: &'a [Splat],
    color_gradient: &'a [f32],
    depth_gradient: &'a [f32],
}

impl Backwards<'_> {
    fn run<const C: usize, const DEPTH: bool>(&self, records: &mut Vec<Record>) {
        let lists = &self.image.lists;
        records.resize(lists.entries.len(), [0.0; 12]);
        let mut rest: &mut [Record] = records;
        let mut parts = Vec::with_capacity(tile_count(self.grid));
        for range in lists.start.windows(2) {
            let (part, tail) = std::mem::take(&mut rest).split_at_mut((range[1] - range[0]) as usize);
            parts.push(part);
            rest = tail;
        }
        parts.into_par_iter().enumerate().filter(|(_, records)| !records.is_empty()).for_each(|(index, records)| {
            let color = &self.image.color[index * C * AREA..(index + 1) * C * AREA];
            self.isa.dispatch(Backward::<C, DEPTH> {
                tile: tile_at(self.grid, lists, self.splats, index),
                color,
                inverse_depth: &self.image.inverse_depth[index * AREA..(index + 1) * AREA],
                color_gradient: self.color_gradient,
                depth_gradient: self.depth_gradient,
                stride: stride_of(self.grid.width),
                records,
            });
        });
    }
}
