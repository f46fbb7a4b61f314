//! WRF-GS+ on the processor.

use super::rule::Shape;
use super::trainer::{DeformedStep, NETWORK_ADAM, WrfGsPlusTrainer};
use super::{Deformation, WrfGsPlusConfig, WrfGsPlusModel};
use crate::mlp::Trained;
use corf::device::cpu::deformed::Rows;
use corf::device::{Device, Planes, RenderRequest, StepReport, View};
use corf::{CpuDevice, Error, Result};

/// Trains and renders with all threads of the processor.
pub struct WrfGsPlusCpuTrainer {
    device: CpuDevice,
    deformation: Deformation<f32>,
    channels: usize,
}

/// The parameters that a deformation concerns.
pub(super) fn shapes(rows: &Rows, channels: usize) -> Vec<Shape<f32>> {
    let shape = |(c, radio): (&[f32; 12], &[f32])| {
        let mut dc = [0.0; 3];
        dc[..channels].copy_from_slice(radio);
        Shape { position: [c[0], c[1], c[2]], rotation: [c[3], c[4], c[5], c[6]], log_scale: [c[7], c[8], c[9]], dc }
    };
    rows.core.iter().zip(rows.radio.chunks_exact(channels)).map(shape).collect()
}

/// Puts them in the place of those in `rows`, whose opacities stay.
pub(super) fn put<'a>(rows: &mut Rows, channels: usize, shapes: impl Iterator<Item = &'a Shape<f32>>) {
    for ((core, radio), s) in rows.core.iter_mut().zip(rows.radio.chunks_exact_mut(channels)).zip(shapes) {
        core[..3].copy_from_slice(&s.position);
        core[3..7].copy_from_slice(&s.rotation);
        core[7..10].copy_from_slice(&s.log_scale);
        radio.copy_from_slice(&s.dc[..channels]);
    }
}

impl WrfGsPlusCpuTrainer {
    /// No Gaussians yet, and a network with these parameters.
    ///
    /// # Errors
    /// A configuration out of range, or parameters of another network.
    pub fn new(config: &WrfGsPlusConfig, parameters: Vec<f32>) -> Result<Self> {
        config.validate()?;
        Trained::new(parameters.clone()).check(WrfGsPlusModel::new(config).network.parameters())?;
        let device = CpuDevice::new(config.optimizer(), config.raster(), &config.empty_field())?;
        Ok(Self { device, deformation: Deformation::new(config, parameters), channels: config.radio_target.channels() })
    }

    fn step(&mut self, step: &DeformedStep) -> Result<StepReport> {
        let mut rows = self.device.rows();
        let base = shapes(&rows, self.channels);
        let deformed = self.deformation.apply(&base, step.receiver_m);
        put(&mut rows, self.channels, deformed.iter().map(|d| &d.0));
        let (report, mut gradient) = self.device.gradients_in(&step.dense, rows)?;
        let rule = self.deformation.rule;
        let of_shapes = shapes(&gradient, self.channels);
        let pairs: Vec<_> = base
            .iter()
            .zip(&deformed)
            .zip(&of_shapes)
            .map(|((base, (_, offsets)), gradient)| rule.backward(base, offsets, gradient))
            .collect();
        put(&mut gradient, self.channels, pairs.iter().map(|p| &p.0));
        let offsets: Vec<_> = pairs.iter().map(|p| p.1).collect();
        let of_network = self.deformation.gradient(&base, step.receiver_m, &offsets);
        self.device.step_rows(&step.dense, &gradient);
        NETWORK_ADAM.step(&mut self.deformation.trained, &of_network, step.network_rate);
        Ok(report)
    }
}

impl WrfGsPlusTrainer for WrfGsPlusCpuTrainer {
    fn device(&mut self) -> &mut dyn Device {
        &mut self.device
    }

    fn train(&mut self, steps: &[DeformedStep]) -> Result<StepReport> {
        let mut report = StepReport::default();
        for step in steps {
            report = self.step(step)?;
        }
        Ok(report)
    }

    fn render(&mut self, view: &View, background: [f32; 3]) -> Result<Planes> {
        let mut rows = self.device.rows();
        let receiver_m = view.world_from_camera.translation.as_vec3().to_array();
        let deformed = self.deformation.apply(&shapes(&rows, self.channels), receiver_m);
        put(&mut rows, self.channels, deformed.iter().map(|d| &d.0));
        let request = RenderRequest { radio: Some((*view, background)), ..RenderRequest::default() };
        let rendering = self.device.render_rows(&request, rows)?;
        let layer = rendering
            .radio
            .ok_or_else(|| Error::invalid(self.device.name(), "the device rendered no RF", "this is a defect of the device"));
        Ok(layer?.color)
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
