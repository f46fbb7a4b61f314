//! A finished field of both: light splatted, radio observed through its sensor, over splats where surfaces are splatted.

use super::CorfArrayConfig;
use crate::device::Backend;
use crate::methods::field::FieldPredictor;
use crate::methods::interface::{Predictor, Take};
use crate::metrics::{Prediction, RadioPrediction};
use anyhow::{Context, Result, ensure};
use corf::array_field::{ArrayField, CpuObserver, Observer};
use corf_scene::dataset::Dataset;
use corf_scene::keyframe::DbRange;
use corf_scene::{Pinhole, Raster, Rigid3, color};
use glam::DVec3;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// Poses at which emitters are observed together: a GPU is full then, and an interrupt is heard soon.
const TOGETHER: usize = 64;
/// File of a run folder with the radio field.
const FIELD: &str = "array";

/// A finished field.
pub struct ArrayPredictor {
    light: FieldPredictor,
    radio: Emitters,
    range: DbRange,
}

/// The radio field, and what observes it.
struct Emitters {
    field: Arc<ArrayField>,
    backend: Backend,
    /// Made when it is first needed.
    observer: Option<Box<dyn Observer>>,
}

impl Emitters {
    /// The field at poses, linear.
    fn observe(&mut self, poses: &[Rigid3]) -> Result<Vec<Raster<f32>>> {
        let observer = match &mut self.observer {
            Some(observer) => observer,
            none => none.insert(observer(&self.backend, &self.field)?),
        };
        Ok(observer.observe(poses)?)
    }
}

/// What observes a field on a device; the processor where the sensor needs double precision.
///
/// # Errors
/// The device's.
pub fn observer(backend: &Backend, field: &Arc<ArrayField>) -> Result<Box<dyn Observer>> {
    match backend {
        Backend::Cpu => Ok(Box::new(CpuObserver::new(Arc::clone(field)))),
        #[cfg(feature = "gpu")]
        Backend::Gpu { .. }
            if field.pattern != corf_scene::config::AntennaPattern::Iso || !corf::array_field::gpu::forms(&field.sensor) =>
        {
            Ok(Box::new(CpuObserver::new(Arc::clone(field))))
        }
        #[cfg(feature = "gpu")]
        Backend::Gpu { number, .. } => {
            use corf::array_field::gpu::GpuObserver;
            use corf_gpu::AdapterOptions;
            let options = AdapterOptions { number: *number, software: true, ..AdapterOptions::default() };
            Ok(Box::new(GpuObserver::new(&options, Arc::clone(field))?))
        }
    }
}

impl ArrayPredictor {
    /// Fields that `backend` renders.
    pub(super) fn new(light: FieldPredictor, radio: ArrayField, range: DbRange, backend: &Backend) -> Self {
        let radio = Emitters { field: Arc::new(radio), backend: backend.clone(), observer: None };
        Self { light, radio, range }
    }

    /// Reads the field of a run folder, whose configuration is `config`.
    ///
    /// # Errors
    /// A configuration of another version; a missing or damaged file, or a field of another data set's cameras.
    pub fn load(run: &Path, config: &serde_json::Value, dataset: &Dataset, backend: &Backend) -> Result<Self> {
        let config: CorfArrayConfig = serde_json::from_value(config.clone())
            .with_context(|| format!("{}: the configuration is not of this version", run.join("run.json").display()))?;
        let light = FieldPredictor::load(run, config.light.raster, dataset, backend)?;
        let radio = ArrayField::read(&run.join(FIELD))?;
        ensure!(radio.camera == dataset.radio_camera(), "{}: the radio field's camera is not the data set's", run.display());
        let range = dataset.db_range().with_context(|| format!("{}: the data set has no spectra", dataset.dir().display()))?;
        Ok(Self::new(light, radio, range, backend))
    }
}

impl Predictor for ArrayPredictor {
    fn render(&mut self, world_from_camera: &Rigid3) -> Result<Prediction> {
        let light = self.light.render(world_from_camera)?;
        let emitted = self.radio.observe(std::slice::from_ref(world_from_camera))?.pop();
        let emitted = emitted.context("a radio field was observed at no pose")?;
        let radio = match light.radio.filter(|_| self.radio.field.over_splats) {
            Some(splats) => over(splats, &emitted, self.range),
            None => {
                let scalar = emitted.map(|&s| self.range.scalar(s));
                RadioPrediction { jet: scalar.map(|&s| color::jet(s)), scalar }
            }
        };
        Ok(Prediction { radio: Some(radio), ..light })
    }

    fn spectra(&mut self, poses: &[Rigid3], take: Take<'_>) -> Result<()> {
        let Self { light, radio, range } = self;
        if !radio.field.over_splats {
            for some in poses.chunks(TOGETHER) {
                let emitted = radio.observe(some)?;
                take(emitted.par_iter().map(|emitted| emitted.map(|&s| range.scalar(s))).collect())?;
            }
            return Ok(());
        }
        let mut done = 0;
        light.spectra(poses, &mut |splats| {
            let emitted = radio.observe(&poses[done..done + splats.len()])?;
            done += splats.len();
            let both = splats.into_par_iter().zip(&emitted);
            take(both.map(|(splats, emitted)| over(RadioPrediction::from_scalar(splats), emitted, *range).scalar).collect())
        })
    }

    fn room_m(&self) -> Option<[DVec3; 2]> {
        self.light.room_m()
    }

    fn set_light_camera(&mut self, camera: Pinhole) -> Result<()> {
        self.light.set_light_camera(camera)
    }

    fn gaussians(&self) -> Option<usize> {
        self.light.gaussians()
    }

    fn save(&self, run: &Path) -> Result<()> {
        self.radio.field.write(&run.join(FIELD))?;
        self.light.save(run)
    }
}

/// What emitters add to splatted surfaces. Where they add next to nothing the splats' own colours stay.
fn over(mut splats: RadioPrediction, emitted: &Raster<f32>, range: DbRange) -> RadioPrediction {
    const NOTHING: f64 = 0.01;
    let pixels = splats.scalar.pixels_mut().iter_mut().zip(splats.jet.pixels_mut()).zip(emitted.pixels());
    for ((scalar, jet), emitted) in pixels {
        let (below, emitted) = (if *scalar > 0.0 { range.linear(*scalar) } else { 0.0 }, f64::from(*emitted));
        if emitted > NOTHING * below {
            *scalar = range.scalar((below + emitted) as f32);
            *jet = color::jet(*scalar);
        }
    }
    splats
}
