//! The CPU device: rayon over tiles and chunks of Gaussians, lanes within them.
//!
//! One step is: project and find tiles (`project`), depth order and tile lists (`tiles`), blend (`blend`), loss ([`crate::loss`]),
//! blend backwards into one record per (Gaussian, tile), then gather each Gaussian's records, differentiate its projection and take an
//! Adam step (`update`). Every buffer belongs to the device and is used again; every sum has a fixed order, so that the bytes of a
//! result do not depend on the number of threads.

pub(crate) mod blend;
pub mod deformed;
pub(crate) mod geometry;
pub(crate) mod project;
pub(crate) mod pyramid;
mod render;
mod step;
mod store;
mod tiles;
mod update;

use super::{
    DenseStep, Device, DeviceState, Duplicate, Modality, Outline, PackedView, Packer, RenderRequest, Rendering, ScreenGradient,
    Step, StepReport, TrainingView, ViewId,
};
use crate::simd::Isa;
use crate::{Appearance, AppearanceRates, Gaussians, OptimizerConfig, RasterConfig, Result};
use pyramid::Pyramid;
use render::Frame;
use std::sync::Arc;
use step::Scratch;
pub use step::StageTimes;
use store::Store;

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

    fn channels(&self) -> [usize; 2] {
        [self.store.harmonics[0].channels, self.store.harmonics[1].channels]
    }

    /// Mean length of a tile's list in the last image of each modality: an upper bound of the Gaussians blended per pixel.
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
        self.pyramids.push(packed(self.isa, self.channels(), view, levels)?);
        Ok(ViewId(self.pyramids.len() - 1))
    }

    fn packer(&self) -> Option<Packer> {
        let (isa, channels) = (self.isa, self.channels());
        Some(Arc::new(move |view, levels| Ok(PackedView::new(packed(isa, channels, view, levels)?))))
    }

    fn upload_packed(&mut self, view: PackedView) -> Result<ViewId> {
        let foreign = || self.lacks("packed views of other devices", "upload what its own packer has built");
        let pyramid = view.unwrap_as().ok_or_else(foreign)?;
        self.pyramids.push(pyramid);
        Ok(ViewId(self.pyramids.len() - 1))
    }

    fn len(&self) -> usize {
        self.store.len()
    }

    fn append(&mut self, new: &Gaussians) -> Result<()> {
        self.store.append(new)
    }

    fn retain(&mut self, keep: &[bool]) -> Result<()> {
        self.store.retain(keep);
        Ok(())
    }

    fn reset_radio(&mut self, radio: &Appearance) -> Result<()> {
        self.store.reset_radio(radio)
    }

    fn set_position_rate_m(&mut self, rate_m: f32) {
        self.optimizer.position_rate_m = rate_m;
    }

    fn set_radio_rates(&mut self, rates: AppearanceRates) -> Result<()> {
        let optimizer = OptimizerConfig { radio: rates, ..self.optimizer };
        optimizer.validate()?;
        self.optimizer = optimizer;
        Ok(())
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

    fn train_dense(&mut self, steps: &[DenseStep]) -> Result<StepReport> {
        let mut report = StepReport::default();
        for step in steps {
            report = self.dense_step(step)?;
        }
        Ok(report)
    }

    fn screen_gradients(&mut self) -> Result<Vec<ScreenGradient>> {
        let mut out = self.store.screen.clone();
        out.resize(self.store.len(), ScreenGradient::default());
        Ok(out)
    }

    fn set_screen_gradients(&mut self, gradients: &[ScreenGradient]) -> Result<()> {
        ScreenGradient::check_all(gradients, self.store.len())?;
        self.store.screen = gradients.to_vec();
        Ok(())
    }

    fn duplicate(&mut self, duplicates: &[Duplicate]) -> Result<()> {
        self.store.duplicate(duplicates)
    }

    fn cap_opacity(&mut self, modality: Modality, most: f32) -> Result<()> {
        self.store.cap_opacity(modality, most);
        Ok(())
    }

    fn gaussians(&mut self) -> Result<Gaussians> {
        Ok(self.store.to_gaussians())
    }

    fn outlines(&mut self) -> Result<Vec<Outline>> {
        Ok(self.store.outlines())
    }

    fn state(&mut self) -> Result<DeviceState> {
        Ok(self.store.state())
    }

    fn restore(&mut self, state: &DeviceState) -> Result<()> {
        self.store.restore(state)
    }
}

/// A keyframe's pyramid, if its channels are those of the Gaussians.
fn packed(isa: Isa, channels: [usize; 2], view: &TrainingView, levels: u32) -> Result<Pyramid> {
    super::check_channels(view, channels)?;
    Pyramid::new(isa, view, levels)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::{device::Planes, gaussians::logit};
    use corf_scene::{Pinhole, Rigid3, Rng};

    /// Rounding of sums of a few hundred products, relative to the largest gradient of a class.
    const TOLERANCE: f32 = 1e-4;

    fn largest(v: &[f32]) -> f32 {
        v.iter().fold(0.0, |m, v| m.max(v.abs()))
    }

    #[test]
    fn every_instruction_set_finds_the_same_gradients() {
        let mut rng = Rng::keyed(3, 0, 0);
        let mut g = Gaussians::empty(1, 2);
        for _ in 0..400 {
            g.position.push([(rng.uniform() - 0.5) * 6.0, (rng.uniform() - 0.5) * 4.0, 2.0 + rng.uniform()]);
            g.rotation.push([0; 4].map(|_| rng.normal() as f32));
            g.log_scale.push([0; 3].map(|_| -3.0 + rng.uniform()));
            for a in [&mut g.light, &mut g.radio] {
                a.opacity_logit.push(logit(0.4));
                a.sh.extend((0..a.stride()).map(|_| (rng.uniform() - 0.5) * 0.2));
            }
        }
        let mut image = |camera: &Pinhole, channels: usize| Planes {
            width: camera.width,
            height: camera.height,
            channels,
            pixels: (0..camera.width * camera.height * channels).map(|_| rng.uniform()).collect(),
        };
        let (light_camera, radio_camera) =
            (Pinhole::from_horizontal_fov(50, 37, 90.0), Pinhole::from_horizontal_fov(23, 19, 90.0));
        let view = TrainingView {
            world_from_camera: Rigid3::IDENTITY,
            light: image(&light_camera, 3),
            light_camera,
            radio: image(&radio_camera, 1),
            radio_camera,
            inverse_depth: None,
            mask: None,
        };
        let step = Step {
            view: ViewId(0),
            levels: [0; 2],
            light_weight: 1.0,
            radio_weight: 0.5,
            depth_weight: 0.0,
            train_geometry: true,
            light_background: [0.2, 0.4, 0.6],
            radio_background: [0.0; 3],
        };
        let found: Vec<_> = Isa::available()
            .into_iter()
            .map(|isa| {
                let mut d = CpuDevice::new(OptimizerConfig::default(), RasterConfig::default(), &g).unwrap();
                d.isa = isa;
                d.upload(&view, 1).unwrap();
                let (report, gradient) = d.gradients(&step).unwrap();
                let flat = |v: &[[f32; 3]]| v.as_flattened().to_vec();
                let classes = [
                    flat(&gradient.position),
                    gradient.rotation.as_flattened().to_vec(),
                    flat(&gradient.log_scale),
                    gradient.light.opacity_logit,
                    gradient.radio.opacity_logit,
                    gradient.light.sh,
                    gradient.radio.sh,
                ];
                (isa, report, classes)
            })
            .collect();
        let (_, portable, truth) = &found[0];
        assert!(truth.iter().all(|class| largest(class) > 0.0));
        for (isa, report, classes) in &found[1..] {
            assert_eq!(report.visible, portable.visible);
            assert!(
                (report.light_loss - portable.light_loss).abs() < 1e-6 && (report.radio_loss - portable.radio_loss).abs() < 1e-6
            );
            for (class, (ours, truth)) in classes.iter().zip(truth).enumerate() {
                let worst = ours.iter().zip(truth).fold(0.0_f32, |m, (a, b)| m.max((a - b).abs()));
                assert!(worst < TOLERANCE * largest(truth), "{isa:?}, class {class}: {worst:.1e} of {:.1e}", largest(truth));
            }
        }
    }
}
