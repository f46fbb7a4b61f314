//! A finished field: Gaussians, the network that deforms them, and how to look at them; on disk one file.

use super::{WrfGsPlusConfig, WrfGsPlusModel, WrfGsPlusTrainer};
use crate::mlp::Trained;
use corf::device::{Planes, View};
use corf::files::tensors::{self, Kind, Tensor, Tensors};
use corf::{Appearance, FieldMeta, Gaussians, Result};
use corf_scene::Rigid3;
use corf_scene::dataset::FixedArray;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A field as it is kept: all that its predictions depend on.
#[derive(Clone, Debug, PartialEq)]
pub struct WrfGsPlusField {
    /// Constants.
    pub config: WrfGsPlusConfig,
    /// Cameras, target and range.
    pub meta: FieldMeta,
    /// The array, if it stands still while the transmitter moves; the cameras mean nothing then but for their size.
    pub array: Option<FixedArray>,
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    array: Option<FixedArray>,
    gaussians: usize,
}

/// Advice to who gave a file that cannot be used.
pub(super) const HELP: &str = "make it again with the command that made it";

const KIND: Kind = Kind { name: "network", format: "corf-wrf-gs-plus/2", help: HELP, finite: true };

/// The arrays that some Gaussians are written as, under names that begin with `of`: position, rotation, ln scale, opacity and colour at 60 GHz.
pub(super) fn tensors<'a>(of: &str, g: &'a Gaussians) -> Vec<Tensor<'a>> {
    let n = g.len();
    vec![
        Tensor::new(format!("{of}.position"), &[n, 3], g.position.as_flattened()),
        Tensor::new(format!("{of}.rotation"), &[n, 4], g.rotation.as_flattened()),
        Tensor::new(format!("{of}.log_scale"), &[n, 3], g.log_scale.as_flattened()),
        Tensor::new(format!("{of}.rf.opacity_logit"), &[n], &g.radio.opacity_logit[..]),
        Tensor::new(format!("{of}.rf.color"), &[n, g.radio.stride()], &g.radio.sh[..]),
    ]
}

/// `n` Gaussians of such arrays, without light.
///
/// # Errors
/// Arrays that are missing or of other sizes, a number that is not finite.
pub(super) fn gaussians(config: &WrfGsPlusConfig, file: &Tensors, of: &str, n: usize) -> Result<Gaussians> {
    let values = |name: &str, shape: &[usize]| file.values(&format!("{of}.{name}"), shape);
    let mut out = config.empty_field();
    out.position = values("position", &[n, 3])?.as_chunks().0.to_vec();
    out.rotation = values("rotation", &[n, 4])?.as_chunks().0.to_vec();
    out.log_scale = values("log_scale", &[n, 3])?.as_chunks().0.to_vec();
    out.radio.opacity_logit = values("rf.opacity_logit", &[n])?;
    out.radio.sh = values("rf.color", &[n, out.radio.stride()])?;
    out.light = Appearance { opacity_logit: vec![0.0; n], sh: vec![0.0; n * out.light.stride()], ..out.light };
    Ok(out)
}

impl WrfGsPlusField {
    /// Makes `trainer`, which holds nothing yet, hold this field.
    ///
    /// # Errors
    /// The trainer's.
    pub fn load(&self, trainer: &mut dyn WrfGsPlusTrainer) -> Result<()> {
        trainer.restore_network(&Trained::new(self.parameters.clone()))?;
        trainer.device().append(&self.gaussians)
    }

    /// Renders a pose by a trainer that holds this field: C_rf channels, as the target has them.
    ///
    /// # Errors
    /// The trainer's.
    pub fn render(&self, trainer: &mut dyn WrfGsPlusTrainer, world_from_camera: &Rigid3) -> Result<Planes> {
        render(&self.meta, trainer, world_from_camera)
    }

    /// Writes it whole or not at all.
    ///
    /// # Errors
    /// A parameter that is not finite, a file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let header = Header { config: self.config.clone(), meta: self.meta, array: self.array, gaussians: self.gaussians.len() };
        let mut all = tensors("gaussians", &self.gaussians);
        all.push(Tensor::new("network.parameters", &[self.parameters.len()], &self.parameters[..]));
        tensors::write(path, &KIND, &header, all)
    }

    /// Reads what [`Self::write`] wrote.
    ///
    /// # Errors
    /// A file that is missing, damaged or something else.
    pub fn read(path: &Path) -> Result<Self> {
        let (file, header) = Tensors::read_kind::<Header>(path, &KIND)?;
        header.config.validate()?;
        header.meta.validate()?;
        let gaussians = gaussians(&header.config, &file, "gaussians", header.gaussians)?;
        let parameters = file.values("network.parameters", &[WrfGsPlusModel::new(&header.config).network.parameters()])?;
        Ok(Self { config: header.config, meta: header.meta, array: header.array, gaussians, parameters })
    }
}

/// Renders a pose by a trainer.
pub(super) fn render(meta: &FieldMeta, trainer: &mut dyn WrfGsPlusTrainer, world_from_camera: &Rigid3) -> Result<Planes> {
    let background = meta.radio_background.unwrap_or(meta.radio_target.floor_color());
    let view = View { camera: meta.radio_camera, world_from_camera: *world_from_camera };
    trainer.render(&view, background)
}
