//! Trains and renders the Gaussians of an array that stands still, on the processor.

use super::Lens;
use super::loss::{level, levels, loss, of_channels};
use super::raster::draw;
use crate::mlp::Trained;
use crate::wrf_gs_plus::cpu::{put, shapes};
use crate::wrf_gs_plus::trainer::NETWORK_ADAM;
use crate::wrf_gs_plus::{Deformation, DeformedStep, WrfGsPlusConfig, WrfGsPlusModel, WrfGsPlusTrainer};
use corf::device::cpu::deformed::{CORE, Rows};
use corf::device::{Device, Planes, StepReport, TrainingView, View, ViewId};
use corf::{CpuDevice, Error, Result};
use corf_scene::dataset::FixedArray;

/// Place of the logit of the opacity at 60 GHz in a row.
const LOGIT: usize = CORE - 1;

/// A [`WrfGsPlusTrainer`] whose views are places of the transmitter, and whose pictures are of the array's directions.
pub struct FixedArrayTrainer {
    /// Keeps the Gaussians with their optimiser; it renders nothing.
    device: CpuDevice,
    deformation: Deformation<f32>,
    lens: Lens,
    /// Levels of the training spectra.
    targets: Vec<Vec<f32>>,
    channels: usize,
    ssim_weight: f32,
}

impl FixedArrayTrainer {
    /// No Gaussians yet, and a network with these parameters.
    ///
    /// # Errors
    /// A configuration out of range or of other channels than the published three, or parameters of another network.
    pub fn new(config: &WrfGsPlusConfig, array: &FixedArray, parameters: Vec<f32>) -> Result<Self> {
        config.validate()?;
        let channels = config.radio_target.channels();
        if channels != 3 {
            let help = "leave it out: of an array that stands still the level is the magnitude of the published program's first two of three channels";
            return Err(Error::invalid("WRF-GS+ config, key `rf_target`", "is for receivers that move", help));
        }
        Trained::new(parameters.clone()).check(WrfGsPlusModel::new(config).network.parameters())?;
        let device = CpuDevice::new(config.optimizer(), config.raster(), &config.empty_field())?;
        let mut deformation = Deformation::new(config, parameters);
        deformation.rule.signal_is_magnitude = true;
        Ok(Self {
            device,
            deformation,
            lens: Lens::new(array, f64::from(config.near_m)),
            targets: vec![],
            channels,
            ssim_weight: config.rates.ssim_weight,
        })
    }

    fn logits(rows: &Rows) -> Vec<f32> {
        rows.core.iter().map(|core| core[LOGIT]).collect()
    }

    fn step(&mut self, step: &DeformedStep) -> Result<StepReport> {
        let mut rows = self.device.rows();
        let (base, logits) = (shapes(&rows, self.channels), Self::logits(&rows));
        let deformed = self.deformation.apply(&base, step.receiver_m);
        let as_seen: Vec<_> = deformed.iter().map(|d| d.0).collect();
        let drawing = draw(&self.lens, &as_seen, &logits);
        let image = drawing.image();
        let target = self.targets.get(step.dense.step.view.0).ok_or_else(|| {
            let what = format!("view {} was not uploaded", step.dense.step.view.0);
            Error::invalid("training step", what, "upload a view before it is trained with")
        })?;
        let (loss, of_levels) = loss(&levels(&image), target, self.lens.columns, self.ssim_weight);
        let of_image = image.iter().zip(of_levels).map(|(c, g)| of_channels(*c, g)).collect();
        let gradients = drawing.gradient(&image, &of_image);
        let visible = gradients.iter().flatten().count();
        if step.dense.screen_gradients {
            let mut sums = self.device.screen_gradients()?;
            let half = [self.lens.columns, self.lens.rows].map(|n| 0.5 * n as f32);
            for (sum, (_, _, [u, v])) in sums.iter_mut().zip(&gradients).filter_map(|(sum, g)| Some((sum, g.as_ref()?))) {
                sum.norm_sum += (u * half[0]).hypot(v * half[1]);
                sum.steps += 1;
            }
            self.device.set_screen_gradients(&sums)?;
        }
        let rule = self.deformation.rule;
        let nothing = Default::default();
        let pairs: Vec<_> = base
            .iter()
            .zip(&deformed)
            .zip(&gradients)
            .map(|((base, (_, offsets)), g)| rule.backward(base, offsets, g.as_ref().map_or(&nothing, |g| &g.0)))
            .collect();
        rows.core.fill([0.0; CORE]);
        put(&mut rows, self.channels, pairs.iter().map(|p| &p.0));
        for (core, gradient) in rows.core.iter_mut().zip(&gradients) {
            core[LOGIT] = gradient.as_ref().map_or(0.0, |g| g.1);
        }
        let offsets: Vec<_> = pairs.iter().map(|p| p.1).collect();
        let of_network = self.deformation.gradient(&base, step.receiver_m, &offsets);
        self.device.step_rows(&step.dense, &rows);
        NETWORK_ADAM.step(&mut self.deformation.trained, &of_network, step.network_rate);
        Ok(StepReport { radio_loss: loss, visible, ..StepReport::default() })
    }
}

impl WrfGsPlusTrainer for FixedArrayTrainer {
    fn device(&mut self) -> &mut dyn Device {
        &mut self.device
    }

    fn upload(&mut self, view: &TrainingView) -> Result<ViewId> {
        let Planes { width, height, channels, .. } = view.radio;
        if (width, height, channels) != (self.lens.columns, self.lens.rows, 1) {
            let what = format!("{width}x{height} pixels of {channels} channels");
            let help = format!("give levels over {}x{} directions", self.lens.columns, self.lens.rows);
            return Err(Error::invalid("training view", what, help));
        }
        self.targets.push(view.radio.pixels.clone());
        Ok(ViewId(self.targets.len() - 1))
    }

    fn train(&mut self, steps: &[DeformedStep]) -> Result<StepReport> {
        let mut report = StepReport::default();
        for step in steps {
            report = self.step(step)?;
        }
        Ok(report)
    }

    /// The levels that arrive from a transmitter at the view's place, one channel; its camera and the background mean nothing here.
    fn render(&mut self, view: &View, _background: [f32; 3]) -> Result<Planes> {
        let rows = self.device.rows();
        let transmitter_m = view.world_from_camera.translation.as_vec3().to_array();
        let deformed = self.deformation.apply(&shapes(&rows, self.channels), transmitter_m);
        let as_seen: Vec<_> = deformed.iter().map(|d| d.0).collect();
        let image = draw(&self.lens, &as_seen, &Self::logits(&rows)).image();
        let (width, height) = (self.lens.columns, self.lens.rows);
        let pixels = image.iter().map(|c| level(*c)).collect();
        Ok(Planes { width, height, channels: 1, pixels })
    }

    fn network(&mut self) -> Result<Trained<f32>> {
        Ok(self.deformation.trained.clone())
    }

    fn restore_network(&mut self, state: &Trained<f32>) -> Result<()> {
        state.check(self.deformation.trained.parameters.len())?;
        self.deformation.trained = state.clone();
        Ok(())
    }
}
