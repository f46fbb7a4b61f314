//! Interface of what trains a field and predicts spectra, on either device; and the field on disk.

use super::rays::{distances, view_rays};
use super::{Batch, Model, Nerf2Config, Ray};
use crate::mlp::Trained;
use corf::files::numbers;
use corf::{Error, Result};
use corf_scene::{Pinhole, Raster, Rigid3};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::Path;

/// Trains and evaluates one field.
pub trait Trainer {
    /// Takes a step: mean squared error of the rays' amplitudes, Adam with this rate. May return before the step is done.
    ///
    /// # Errors
    /// The device's; those of steps before may come with this one.
    fn step(&mut self, batch: &Batch, rate: f64) -> Result<()>;

    /// Mean squared error of the last step's rays, before the step.
    ///
    /// # Errors
    /// The device's.
    fn loss(&mut self) -> Result<f64>;

    /// Amplitudes along rays; `distances` are `rays × samples`.
    ///
    /// # Errors
    /// The device's.
    fn amplitudes(&mut self, rays: &[Ray], distances: &[f32]) -> Result<Vec<f32>>;

    /// Parameters and optimiser.
    ///
    /// # Errors
    /// The device's.
    fn state(&mut self) -> Result<Trained<f32>>;

    /// Goes on from a state.
    ///
    /// # Errors
    /// A state of another network; the device's errors.
    fn restore(&mut self, state: &Trained<f32>) -> Result<()>;
}

/// A field as it is kept: all that its predictions depend on.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Constants.
    pub config: Nerf2Config,
    /// The transmitter, metres in the world frame.
    pub transmitter_m: [f32; 3],
    /// Parameters of the network.
    pub parameters: Vec<f32>,
}

/// Header of a field on disk, with what goes before it in the header of a field in training.
#[derive(Serialize, Deserialize)]
struct Header<T> {
    tag: T,
    config: Nerf2Config,
    transmitter_m: [f32; 3],
    steps: u64,
}

impl Field {
    /// Amplitudes over the pixels of a camera at a pose, by a trainer that holds this field.
    ///
    /// # Errors
    /// The trainer's.
    pub fn render(&self, trainer: &mut dyn Trainer, camera: &Pinhole, world_from_camera: &Rigid3) -> Result<Raster<f32>> {
        let rays = view_rays(camera, world_from_camera);
        let distances = distances(&self.config, rays.len(), || 0.5);
        Ok(Raster::from_vec(camera.width, camera.height, trainer.amplitudes(&rays, &distances)?))
    }

    /// Writes it whole or not at all.
    ///
    /// # Errors
    /// Parameters that are not finite, a file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let Self { config, transmitter_m, .. } = *self;
        numbers::write(path, &Header { tag: (), config, transmitter_m, steps: 0 }, &[&self.parameters])
    }

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// A file that is missing, damaged or something else.
    pub fn read(path: &Path) -> Result<Self> {
        let (header, mut arrays) = read_header::<()>(path, 1)?;
        let parameters = arrays.pop().unwrap_or_default();
        Ok(Self { config: header.config, transmitter_m: header.transmitter_m, parameters })
    }

    /// Writes a training state with the caller's tag; the field's own parameters are left out.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn write_state(&self, path: &Path, tag: &str, state: &Trained<f32>) -> Result<()> {
        let Self { config, transmitter_m, .. } = *self;
        let [first, second] = &state.moments;
        let header = Header { tag, config, transmitter_m, steps: state.steps };
        numbers::write(path, &header, &[&state.parameters, first, second])
    }

    /// Reads what [`Self::write_state`] wrote: the tag, which the caller checks, and the state.
    ///
    /// # Errors
    /// A file that is missing, damaged or something else.
    pub fn read_state(path: &Path) -> Result<(String, Trained<f32>)> {
        let (header, arrays) = read_header::<String>(path, 3)?;
        let Ok([parameters, first, second]) = <[Vec<f32>; 3]>::try_from(arrays) else { unreachable!("three were read") };
        Ok((header.tag, Trained { parameters, moments: [first, second], steps: header.steps }))
    }
}

/// A header, and `count` arrays of the size of its network's parameters.
fn read_header<T: DeserializeOwned>(path: &Path, count: usize) -> Result<(Header<T>, Vec<Vec<f32>>)> {
    numbers::read(path, |header: &Header<T>| {
        header.config.validate()?;
        Ok(vec![Model::new(&header.config).network.parameters(); count])
    })
}

/// Refuses rays whose samples or values are not as many as they should be.
pub(super) fn check_rays(rays: usize, distances: usize, samples: usize) -> Result<()> {
    if distances == rays * samples {
        return Ok(());
    }
    let what = format!("{distances} distances for {rays} rays of {samples} samples");
    Err(Error::invalid("rays", what, "give one for each sample of each ray"))
}
