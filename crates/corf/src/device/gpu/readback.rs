//! Readback of outlines and optimiser state from the store, and restoring of that state.

use super::store::{CORE, Store, joined, parted, transposed};
use crate::{
    Gaussians, Result,
    device::{DeviceState, Outline},
};
use corf_gpu::Context;

impl Store {
    /// Reads the parameters that pruning depends on: 48 bytes of each Gaussian.
    pub fn outlines(&self, context: &Context) -> Result<Vec<Outline>> {
        let core = context.read::<f32>("reading outlines back", &[(&self.core.value.buffer, self.len() * CORE)])?;
        let outline = |row: &[f32]| Outline {
            position: [row[0], row[1], row[2]],
            largest_log_scale: row[7].max(row[8]).max(row[9]),
            opacity_logit: [row[10], row[11]],
        };
        Ok(core[0].chunks_exact(CORE).map(outline).collect())
    }

    /// The Gaussians with their optimiser.
    pub fn state(&self, context: &Context) -> Result<DeviceState> {
        let [light, radio] = self.harmonics.map(|h| h.words());
        let n = self.len();
        let sources = [
            (&self.core.moment1.buffer, n * CORE),
            (&self.core.moment2.buffer, n * CORE),
            (&self.sh[0].moments.buffer, 2 * n * light),
            (&self.sh[1].moments.buffer, 2 * n * radio),
            (&self.position_rate.buffer, n),
        ];
        let mut read = context.read::<f32>("reading the optimiser back", &sources)?;
        let position_rate = read.pop().unwrap_or_default();
        let moments =
            |which: usize| self.shaped(&read[which], [&parted(&read[2], which, light), &parted(&read[3], which, radio)]);
        Ok(DeviceState { gaussians: self.to_gaussians(context)?, moments: [moments(0), moments(1)], position_rate })
    }

    /// Holds a state; nothing may be held yet.
    pub fn restore(&mut self, context: &Context, state: &DeviceState) -> Result<()> {
        state.check(self.harmonics.map(|h| (h.channels, h.degree)), self.len())?;
        self.append(context, &state.gaussians)?;
        let [first, second] = &state.moments;
        for (rows, moments) in [(&self.core.moment1, first), (&self.core.moment2, second)] {
            context.fill(&rows.buffer, 0, &cores(moments));
        }
        for (k, shape) in self.harmonics.into_iter().enumerate() {
            let [first, second] = [first, second].map(|g| transposed([&g.light, &g.radio][k], shape));
            context.fill(&self.sh[k].moments.buffer, 0, &joined(&first, &second, shape.words()));
        }
        context.fill(&self.position_rate.buffer, 0, &state.position_rate);
        Ok(context.check("restoring Gaussians")?)
    }
}

/// Geometry and opacities, Gaussian by Gaussian.
fn cores(g: &Gaussians) -> Vec<f32> {
    let mut out = Vec::with_capacity(g.len() * CORE);
    for i in 0..g.len() {
        out.extend(g.position[i]);
        out.extend(g.rotation[i]);
        out.extend(g.log_scale[i]);
        out.extend([g.light.opacity_logit[i], g.radio.opacity_logit[i]]);
    }
    out
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use crate::{
        Device, Gaussians, OptimizerConfig, RasterConfig,
        device::{
            Outline, Planes, Step, TrainingView, ViewId,
            gpu::{GpuDevice, GpuOptions},
        },
    };
    use corf_gpu::AdapterOptions;
    use corf_scene::{Pinhole, Rigid3, Rng};

    fn some(count: usize) -> Gaussians {
        let mut rng = Rng::keyed(8, 0, 0);
        let mut g = Gaussians::empty(1, 1);
        for _ in 0..count {
            g.position.push([(rng.uniform() - 0.5) * 4.0, (rng.uniform() - 0.5) * 3.0, 2.0 + rng.uniform()]);
            g.rotation.push([0; 4].map(|_| rng.normal() as f32));
            g.log_scale.push([0; 3].map(|_| -3.0 + rng.uniform()));
            for a in [&mut g.light, &mut g.radio] {
                a.opacity_logit.push(rng.uniform());
                a.sh.extend((0..a.stride()).map(|_| rng.uniform() - 0.5));
            }
        }
        g
    }

    fn view() -> TrainingView {
        let (light_camera, radio_camera) =
            (Pinhole::from_horizontal_fov(40, 30, 90.0), Pinhole::from_horizontal_fov(24, 16, 90.0));
        let planes = |c: &Pinhole, channels: usize| Planes {
            width: c.width,
            height: c.height,
            channels,
            pixels: (0..c.width * c.height * channels).map(|i| (i % 17) as f32 / 17.0).collect(),
        };
        TrainingView {
            world_from_camera: Rigid3::IDENTITY,
            light: planes(&light_camera, 3),
            light_camera,
            radio: planes(&radio_camera, 1),
            radio_camera,
            inverse_depth: None,
            mask: None,
        }
    }

    #[test]
    #[cfg_attr(not(gpu_tests), ignore = "needs an adapter: CORF_REQUIRE_GPU=1")]
    fn a_restored_device_goes_on_to_the_same_bytes() {
        let options = GpuOptions::on(AdapterOptions { software: true, ..AdapterOptions::default() });
        if corf_gpu::adapter_name(&options.adapter).is_none() {
            assert!(std::env::var_os("CORF_REQUIRE_GPU").is_none_or(|v| v != "1"), "no adapter");
            println!("skipped: no adapter");
            return;
        }
        let g = some(300);
        let device = |g: &Gaussians| GpuDevice::new(&options, OptimizerConfig::default(), RasterConfig::default(), g).unwrap();
        let step = Step {
            view: ViewId(0),
            levels: [0; 2],
            light_weight: 1.0,
            radio_weight: 0.5,
            depth_weight: 0.0,
            train_geometry: true,
            light_background: [0.1, 0.2, 0.3],
            radio_background: [0.0; 3],
        };
        let mut first = device(&g);
        first.upload(&view(), 2).unwrap();
        first.train(&[step; 5]).unwrap();
        let state = first.state().unwrap();
        assert!(state.moments[1].position.iter().flatten().any(|v| *v > 0.0) && state.position_rate.iter().any(|r| *r < 1.0));
        assert_eq!(first.outlines().unwrap(), Outline::of(&state.gaussians));
        let mut empty = Gaussians::empty(1, 1);
        let mut second = device(&empty);
        assert!(first.restore(&state).is_err(), "it holds Gaussians");
        second.restore(&state).unwrap();
        assert!(second.state().unwrap() == state);
        // The second gets its view by way of the packer: what that builds is what upload builds.
        let packed = second.packer().unwrap()(&view(), 2).unwrap();
        second.upload_packed(packed).unwrap();
        first.train(&[step; 5]).unwrap();
        second.train(&[step; 5]).unwrap();
        assert!(second.state().unwrap() == first.state().unwrap());
        empty.light.sh_degree = 2;
        assert!(device(&empty).restore(&state).is_err(), "other harmonics");
    }
}
