//! The CPU device: rayon over tiles and chunks of Gaussians, lanes within them.
//!
//! One step is: project and find tiles (`project`), depth order and tile lists (`tiles`), blend (`blend`), loss ([`crate::loss`]),
//! blend backwards into one record per (Gaussian, tile), then gather each Gaussian's records, differentiate its projection and take an
//! Adam step (`update`). Every buffer belongs to the device and is used again; every sum has a fixed order, so that the bytes of a
//! result do not depend on the number of threads.

pub(crate) mod blend;
mod geometry;
pub(crate) mod project;
mod pyramid;
mod render;
pub(crate) mod simd;
mod step;
mod store;
mod tiles;
mod update;

use super::{Device, RenderRequest, Rendering, Step, StepReport, TrainingView, ViewId};
use crate::{Appearance, Gaussians, OptimizerConfig, RasterConfig, Result};
pub use step::StageTimes;
use {pyramid::Pyramid, render::Frame, simd::Isa, step::Scratch, store::Store};

/// Renders and trains on this machine's processor, with the threads of the rayon pool it is called in.
pub struct CpuDevice {
    isa: Isa,
    optimizer: OptimizerConfig,
    raster: RasterConfig,
    store: Store,
    pyramids: Vec<Pyramid>,
    frame: Frame,
    scratch: Scratch,
    times: StageTimes,
}

impl CpuDevice {
    /// A device that holds `initial`, whose channels and harmonic degrees all later Gaussians share
    /// (start from [`Gaussians::empty`] for none).
    ///
    /// # Errors
    /// A constant out of range, harmonics above degree 3, an appearance of other than 3 (or, for RF, 1) channels.
    pub fn new(optimizer: OptimizerConfig, raster: RasterConfig, initial: &Gaussians) -> Result<Self> {
        optimizer.validate()?;
        raster.validate()?;
        let mut store = Store::new(initial)?;
        store.append(initial)?;
        let isa = Isa::detect();
        Ok(Self {
            isa,
            optimizer,
            raster,
            store,
            pyramids: vec![],
            frame: Frame::default(),
            scratch: Scratch::default(),
            times: StageTimes::default(),
        })
    }

    /// Time spent in each stage of the training steps since the device was made or this was last called.
    pub fn take_stage_times(&mut self) -> StageTimes {
        std::mem::take(&mut self.times)
    }

    /// Splats listed per pixel in the last image of each modality: tile-list entries times the tile's pixels over all pixels, an upper
    /// bound of what is blended.
    pub fn overdraw(&self) -> [f64; 2] {
        [0, 1].map(|g| {
            let lists = &self.frame.images[g].lists;
            lists.entries.len() as f64 / lists.start.len().saturating_sub(1).max(1) as f64
        })
    }
}

impl Device for CpuDevice {
    fn name(&self) -> String {
        let threads = rayon::current_num_threads();
        format!("cpu ({threads} thread{})", if threads == 1 { "" } else { "s" })
    }

    fn upload(&mut self, view: &TrainingView, levels: u32) -> Result<ViewId> {
        self.check_channels(view)?;
        self.pyramids.push(Pyramid::new(self.isa, view, levels)?);
        Ok(ViewId(self.pyramids.len() - 1))
    }

    fn len(&self) -> usize {
        self.store.len()
    }

    fn append(&mut self, new: &Gaussians) -> Result<()> {
        self.store.append(new)
    }

    fn retain(&mut self, keep: &[bool]) {
        self.store.retain(keep);
    }

    fn reset_rf(&mut self, rf: &Appearance) {
        self.store.reset_rf(rf);
    }

    fn set_position_rate_m(&mut self, rate_m: f32) {
        self.optimizer.position_rate_m = rate_m;
    }

    fn render(&mut self, request: &RenderRequest) -> Result<Rendering> {
        self.render_request(request)
    }

    fn train(&mut self, steps: &[Step]) -> Result<StepReport> {
        let mut report = StepReport::default();
        for step in steps {
            report = self.step(step)?;
        }
        Ok(report)
    }

    fn gaussians(&mut self) -> Gaussians {
        self.store.to_gaussians()
    }
}
