//! A finished field: Gaussians, the network that deforms them, and how to look at them; on disk one file.

use super::{Model, Trainer, WrfGsPlusConfig};
use crate::mlp::Trained;
use corf::device::{Planes, View};
use corf::files::numbers;
use corf::{Appearance, FieldMeta, Gaussians, Result};
use corf_scene::Rigid3;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A field as it is kept: all that its predictions depend on.
#[derive(Clone, Debug, PartialEq)]
pub struct WrfGsPlusField {
    /// Constants.
    pub config: WrfGsPlusConfig,
    /// Cameras, target and range.
    pub meta: FieldMeta,
    /// The Gaussians without deformation; their light is not used.
    pub gaussians: Gaussians,
    /// Parameters of the network.
    pub parameters: Vec<f32>,
}

/// Header of a field on disk.
#[derive(Serialize, Deserialize)]
struct Header {
    config: WrfGsPlusConfig,
    meta: FieldMeta,
    gaussians: usize,
}

/// Number of arrays that some Gaussians are written as.
pub(super) const ARRAYS: usize = 5;

/// The arrays that some Gaussians are written as: position, rotation, ln scale, opacity and colour at 60 GHz.
pub(super) fn arrays(g: &Gaussians) -> [&[f32]; ARRAYS] {
    [g.position.as_flattened(), g.rotation.as_flattened(), g.log_scale.as_flattened(), &g.rf.opacity_logit, &g.rf.sh]
}

/// Sizes of these arrays for `n` Gaussians; nothing for more than there can be.
pub(super) fn sizes(config: &WrfGsPlusConfig, n: usize) -> [usize; ARRAYS] {
    [3, 4, 3, 1, config.rf_target.channels()].map(|numbers| n.saturating_mul(numbers))
}

/// Gaussians of such arrays, without light.
pub(super) fn gaussians(config: &WrfGsPlusConfig, arrays: &[Vec<f32>]) -> Gaussians {
    let mut out = config.empty_field();
    out.position = arrays[0].as_chunks().0.to_vec();
    out.rotation = arrays[1].as_chunks().0.to_vec();
    out.log_scale = arrays[2].as_chunks().0.to_vec();
    (out.rf.opacity_logit, out.rf.sh) = (arrays[3].clone(), arrays[4].clone());
    let n = out.len();
    out.optical = Appearance { opacity_logit: vec![0.0; n], sh: vec![0.0; n * out.optical.stride()], ..out.optical };
    out
}

impl WrfGsPlusField {
    /// Makes `trainer`, which holds nothing yet, hold this field.
    ///
    /// # Errors
    /// The trainer's.
    pub fn load(&self, trainer: &mut dyn Trainer) -> Result<()> {
        trainer.restore_network(&Trained::new(self.parameters.clone()))?;
        trainer.device().append(&self.gaussians)
    }

    /// Renders a pose by a trainer that holds this field: C_rf channels, as the target has them.
    ///
    /// # Errors
    /// The trainer's.
    pub fn render(&self, trainer: &mut dyn Trainer, world_from_camera: &Rigid3) -> Result<Planes> {
        render(&self.meta, trainer, world_from_camera)
    }

    /// Writes it whole or not at all.
    ///
    /// # Errors
    /// A parameter that is not finite, a file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let header = Header { config: self.config.clone(), meta: self.meta, gaussians: self.gaussians.len() };
        let all = [&arrays(&self.gaussians)[..], &[&self.parameters]].concat();
        numbers::write(path, &header, &all)
    }

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// A file that is missing, damaged or something else.
    pub fn read(path: &Path) -> Result<Self> {
        let (header, arrays) = numbers::read(path, |header: &Header| {
            header.config.validate()?;
            header.meta.validate()?;
            let network = Model::new(&header.config).network.parameters();
            Ok([&sizes(&header.config, header.gaussians)[..], &[network]].concat())
        })?;
        let gaussians = gaussians(&header.config, &arrays);
        let parameters = arrays.into_iter().next_back().unwrap_or_default();
        Ok(Self { config: header.config, meta: header.meta, gaussians, parameters })
    }
}

/// Renders a pose by a trainer.
pub(super) fn render(meta: &FieldMeta, trainer: &mut dyn Trainer, world_from_camera: &Rigid3) -> Result<Planes> {
    let background = meta.rf_background.unwrap_or(meta.rf_target.floor_color());
    let view = View { camera: meta.rf_camera, world_from_camera: *world_from_camera };
    Ok(trainer.render(&view, background)?.color)
}
