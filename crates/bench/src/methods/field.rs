//! A finished field of Gaussians as a predictor: what every method that trains Gaussians ends in.

use crate::device::Backend;
use crate::methods::interface::{NO_RADIO, Predictor, Take};
use crate::metrics::{Prediction, RadioPrediction};
use anyhow::{Result, ensure};
use corf::device::Planes;
use corf::target::RadioTarget;
use corf::{Device, Field, Gaussians, OptimizerConfig, RasterConfig};
use corf_scene::dataset::Dataset;
use corf_scene::{Pinhole, Raster, Rigid3, color};
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;
use std::thread::JoinHandle;

/// The Jet image of a rendering in a target's channels, whose scalar level is `scalar`.
pub fn jet_of(target: RadioTarget, radio: &Planes, scalar: &Raster<f32>) -> Raster<[f32; 3]> {
    match target {
        RadioTarget::Jet => {
            let colours = radio.pixels.chunks_exact(3).map(|c| [c[0], c[1], c[2]].map(|v| v.clamp(0.0, 1.0))).collect();
            Raster::from_vec(radio.width, radio.height, colours)
        }
        RadioTarget::Db => scalar.map(|&s| color::jet(s)),
    }
}

/// Share of the Gaussians that lie beyond either side of the room along an axis: reflections are learnt as what stands behind walls.
const OUTLIERS: f64 = 0.01;

/// A finished field, on a device of its own once it is rendered.
pub struct FieldPredictor {
    field: Field,
    raster: RasterConfig,
    backend: Backend,
    device: Option<Box<dyn Device>>,
    /// Gives back what the reconstruction held.
    clearing: Option<JoinHandle<()>>,
}

impl FieldPredictor {
    /// A field that `backend` renders with these settings.
    pub fn new(field: Field, raster: RasterConfig, backend: &Backend) -> Self {
        Self { field, raster, backend: backend.clone(), device: None, clearing: None }
    }

    /// The field that a reconstruction has ended with, which is looked at before anybody is told of it.
    ///
    /// # Errors
    /// A field that has diverged.
    pub fn learnt(field: Field, raster: RasterConfig, backend: &Backend) -> Result<Self> {
        field.gaussians.check_learnt()?;
        Ok(Self::new(field, raster, backend))
    }

    /// The same, while the reconstruction goes: a gigabyte of keyframes is given back to the system while the field is looked at.
    pub fn clearing(mut self, reconstruction: impl Send + 'static) -> Self {
        self.clearing = Some(std::thread::spawn(move || drop(reconstruction)));
        self
    }

    /// Waits for what the reconstruction held: memory is not to hold two devices, nor is one to be cleared while the program ends.
    fn clear(&mut self) {
        if let Some(clearing) = self.clearing.take() {
            let _ = clearing.join();
        }
    }

    fn device(&mut self) -> Result<&mut dyn Device> {
        self.clear();
        let device = match self.device.take() {
            Some(device) => device,
            None => {
                let g = &self.field.gaussians;
                let mut none = Gaussians::empty(g.radio.channels, g.light.sh_degree);
                none.radio.sh_degree = g.radio.sh_degree;
                let mut device = self.backend.make(OptimizerConfig::default(), self.raster, &none)?;
                self.field.load(device.as_mut())?;
                device
            }
        };
        Ok(self.device.insert(device).as_mut())
    }

    /// Reads the field of a run folder.
    ///
    /// # Errors
    /// A missing or damaged file, or a field of another dataset's cameras.
    pub fn load(run: &Path, raster: RasterConfig, dataset: &Dataset, backend: &Backend) -> Result<Self> {
        let field = Field::read(run)?;
        anyhow::ensure!(
            field.meta.light_camera == dataset.light_camera() && field.meta.radio_camera == dataset.radio_camera(),
            "{}: the field's cameras are not the dataset's",
            run.display()
        );
        Ok(Self::new(field, raster, backend))
    }
}

impl Drop for FieldPredictor {
    fn drop(&mut self) {
        self.clear();
    }
}

impl Predictor for FieldPredictor {
    fn render(&mut self, world_from_camera: &Rigid3) -> Result<Prediction> {
        let meta = self.field.meta;
        let p = meta.render(self.device()?, *world_from_camera)?;
        let jet = jet_of(meta.radio_target, &p.radio, &p.scalar);
        let depth_m = p.inverse_depth.map(|&i| if i > 0.0 { 1.0 / i } else { 0.0 });
        let radio = Some(RadioPrediction { jet, scalar: p.scalar });
        Ok(Prediction { image: Some(p.image), radio, depth_m: Some(depth_m) }.within(meta.modalities))
    }

    fn spectra(&mut self, poses: &[Rigid3], take: Take<'_>) -> Result<()> {
        let meta = self.field.meta;
        ensure!(meta.modalities.radio, NO_RADIO);
        // The device has errors of its own kind: what `take` says is kept here.
        let mut refused = None;
        let mut hand_over = |images: Vec<Planes>| {
            let spectra = images.par_iter().map(|image| meta.radio_target.scalar(image)).collect();
            take(spectra).map_err(|error| {
                refused = Some(error);
                corf::Error::Stopped
            })
        };
        let background = meta.radio_background_color();
        let rendered = self.device()?.render_radio(&meta.radio_camera, poses, background, &mut hand_over);
        match refused {
            Some(error) => Err(error),
            None => Ok(rendered?),
        }
    }

    fn room_m(&self) -> Option<[DVec3; 2]> {
        let positions = &self.field.gaussians.position;
        let bounds = [0, 1, 2].map(|axis| {
            let mut along: Vec<f32> = positions.iter().map(|p| p[axis]).collect();
            let beyond = (OUTLIERS * along.len() as f64) as usize;
            let last = along.len().checked_sub(1 + beyond)?;
            let least = *along.select_nth_unstable_by(beyond, f32::total_cmp).1;
            Some([least, *along.select_nth_unstable_by(last, f32::total_cmp).1].map(f64::from))
        });
        let [x, y, z] = [bounds[0]?, bounds[1]?, bounds[2]?];
        Some([0, 1].map(|end| DVec3::new(x[end], y[end], z[end])))
    }

    fn gaussians(&self) -> Option<usize> {
        Some(self.field.gaussians.len())
    }

    fn set_light_camera(&mut self, camera: Pinhole) -> Result<()> {
        self.field.meta.light_camera = camera;
        Ok(self.field.meta.validate()?)
    }

    fn save(&self, run: &Path) -> Result<()> {
        Ok(self.field.write(run, self.raster.antialias)?)
    }
}
