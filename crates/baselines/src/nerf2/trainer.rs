//! Interface of what trains a field and predicts spectra, on either device; and the field on disk.

use super::rays::{distances, view_rays};
use super::{Batch, Nerf2Config, Nerf2Model, PixelRay, Sight};
use crate::mlp::Trained;
use corf::files::tensors::{self, Kind, Tensor, Tensors};
use corf::{Error, Result};
use corf_scene::{Raster, Rigid3};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Trains and evaluates one field.
pub trait Nerf2Trainer {
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
    fn amplitudes(&mut self, rays: &[PixelRay], distances: &[f32]) -> Result<Vec<f32>>;

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
pub struct TrainedNerf2 {
    /// Constants.
    pub config: Nerf2Config,
    /// The transmitter, metres in the world frame, where it stands still.
    pub transmitter_m: [f32; 3],
    /// Parameters of the network.
    pub parameters: Vec<f32>,
}

/// Header of a field on disk.
#[derive(Serialize, Deserialize)]
struct Header {
    config: Nerf2Config,
    transmitter_m: [f32; 3],
}

/// Header of a field in training.
#[derive(Serialize, Deserialize)]
struct StateHeader {
    tag: String,
    config: Nerf2Config,
    transmitter_m: [f32; 3],
    steps: u64,
}

const HELP: &str = "make it again with the command that made it";
const FIELD: Kind = Kind { name: "network", format: "corf-nerf2/2", help: HELP, finite: true };
const STATE: Kind = Kind { name: "checkpoint", format: "corf-nerf2-checkpoint/2", help: HELP, finite: true };
/// Names of the network's parameters and of their moments.
const NETWORK: [&str; 3] = ["network.parameters", "network.first_moment", "network.second_moment"];

impl TrainedNerf2 {
    /// Amplitudes over the pixels of a spectrum of a view, by a trainer that holds this field.
    ///
    /// # Errors
    /// The trainer's.
    pub fn render(&self, trainer: &mut dyn Nerf2Trainer, sight: &Sight, view: &Rigid3) -> Result<Raster<f32>> {
        let rays = view_rays(sight, view);
        let distances = distances(&self.config, rays.len(), || 0.5);
        let (width, height) = sight.size();
        Ok(Raster::from_vec(width, height, trainer.amplitudes(&rays, &distances)?))
    }

    /// Writes it whole or not at all.
    ///
    /// # Errors
    /// Parameters that are not finite, a file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let Self { config, transmitter_m, .. } = *self;
        let parameters = Tensor::new(NETWORK[0], &[self.parameters.len()], &self.parameters[..]);
        tensors::write(path, &FIELD, &Header { config, transmitter_m }, vec![parameters])
    }

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// A file that is missing, damaged or something else.
    pub fn read(path: &Path) -> Result<Self> {
        let (file, Header { config, transmitter_m }) = Tensors::read_kind(path, &FIELD)?;
        config.validate()?;
        let parameters = file.values(NETWORK[0], &[Nerf2Model::new(&config).network.parameters()])?;
        Ok(Self { config, transmitter_m, parameters })
    }

    /// Writes a training state with the caller's tag; the field's own parameters are left out.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn write_state(&self, path: &Path, tag: &str, state: &Trained<f32>) -> Result<()> {
        let Self { config, transmitter_m, .. } = *self;
        let [first, second] = &state.moments;
        let header = StateHeader { tag: tag.to_owned(), config, transmitter_m, steps: state.steps };
        let arrays = NETWORK.into_iter().zip([&state.parameters, first, second]);
        tensors::write(path, &STATE, &header, arrays.map(|(name, v)| Tensor::new(name, &[v.len()], &v[..])).collect())
    }

    /// Reads what [`Self::write_state`] wrote: the tag, which the caller checks, and the state.
    ///
    /// # Errors
    /// A file that is missing, damaged or something else.
    pub fn read_state(path: &Path) -> Result<(String, Trained<f32>)> {
        let (file, header) = Tensors::read_kind::<StateHeader>(path, &STATE)?;
        header.config.validate()?;
        let count = Nerf2Model::new(&header.config).network.parameters();
        let [parameters, first, second] = NETWORK.map(|name| file.values(name, &[count]));
        Ok((header.tag, Trained { parameters: parameters?, moments: [first?, second?], steps: header.steps }))
    }
}

/// Refuses rays whose samples or values are not as many as they should be.
pub(super) fn check_rays(rays: usize, distances: usize, samples: usize) -> Result<()> {
    if distances == rays * samples {
        return Ok(());
    }
    let what = format!("{distances} distances for {rays} rays of {samples} samples");
    Err(Error::invalid("rays", what, "give one for each sample of each ray"))
}
