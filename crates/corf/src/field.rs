//! A finished reconstruction: renders both modalities at any pose (paper Eq. (11)).

use crate::{
    Antialias, Device, Error, Gaussians, Result,
    device::{Layer, Planes, RenderRequest, View},
    files::ply,
    target::{RadioTarget, linear_from_scalar},
};
use corf_scene::{
    Pinhole, Raster, Rigid3,
    io::write_atomic,
    keyframe::{DbRange, Modalities},
};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _};
use serde_json::{Map, Value};
use std::path::Path;

/// Everything beside the Gaussians that a field needs to be rendered; saved beside them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self")]
pub struct FieldMeta {
    /// Encoding of the RF field's colours.
    #[serde(rename = "rf_target")]
    pub radio_target: RadioTarget,
    /// The dB range of scalar 0 and 1; of a field without radio [`Self::RANGE_WITHOUT_RADIO`].
    pub db_range: DbRange,
    /// Intrinsics of the optical images.
    #[serde(rename = "optical_camera")]
    pub light_camera: Pinhole,
    /// Intrinsics of the RF images.
    #[serde(rename = "rf_camera")]
    pub radio_camera: Pinhole,
    /// Colour behind the RF field, where it is not that of a direction without power.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "rf_background")]
    pub radio_background: Option<[f32; 3]>,
    /// What the field was trained on. Opacity and colour of the other modality are those that Gaussians are born with, and mean nothing.
    #[serde(default, skip_serializing_if = "Modalities::are_both")]
    pub modalities: Modalities,
}

/// The coupled field: `(F_opt, F_rf)` and how to look at it.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// The coupled Gaussians.
    pub gaussians: Gaussians,
    /// Cameras, target and range.
    pub meta: FieldMeta,
}

/// Optical image and spectrum rendered at a pose.
#[derive(Clone, Debug)]
pub struct FieldRendering {
    /// Light: sRGB-encoded `[0, 1]`.
    pub image: Raster<[f32; 3]>,
    /// The RF image as rendered, C_rf channels.
    pub radio: Planes,
    /// Scalar dB level in `[0, 1]`.
    pub scalar: Raster<f32>,
    /// Linear power, in the unit of the spectra that the field was trained on.
    pub spectrum: Raster<f32>,
    /// 1/z of the optical pixels, 1/m: the composited inverse depth over its coverage; 0 where nothing is.
    pub inverse_depth: Raster<f32>,
}

impl Serialize for FieldMeta {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        Self::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for FieldMeta {
    /// Earlier versions wrote `"sensor": "identity"`, the only one that there was.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let mut keys: Map<String, Value> = Map::deserialize(deserializer)?;
        if keys.get("sensor").is_some_and(|sensor| sensor == "identity") {
            keys.remove("sensor");
        }
        Self::deserialize(Value::Object(keys)).map_err(D::Error::custom)
    }
}

impl FieldMeta {
    /// The dB range that a field states which has learnt no radio: of it no number comes, and files have a range.
    pub const RANGE_WITHOUT_RADIO: DbRange = DbRange { min_db: -100.0, max_db: 0.0 };

    /// # Errors
    /// A camera without pixels or focal length, an empty dB range, or a background that is no colour.
    pub fn validate(&self) -> Result<()> {
        for (name, c) in [("optical_camera", &self.light_camera), ("rf_camera", &self.radio_camera)] {
            let focal = |f: f64| f.is_finite() && f > 0.0;
            if c.width == 0 || c.height == 0 || !focal(c.fx) || !focal(c.fy) || !c.cx.is_finite() || !c.cy.is_finite() {
                let what = format!("{}x{} pixels, fx {}, fy {}", c.width, c.height, c.fx, c.fy);
                return Err(Error::invalid(name, what, "give a pinhole camera with pixels and positive focal lengths"));
            }
        }
        let DbRange { min_db, max_db } = self.db_range;
        if !(min_db.is_finite() && max_db.is_finite() && min_db < max_db) {
            return Err(Error::invalid("db_range", format!("{min_db} to {max_db} dB is empty"), "give min_db < max_db, finite"));
        }
        if let Some(color) = self.radio_background.filter(|c| c.iter().any(|v| !(0.0..=1.0).contains(v))) {
            return Err(Error::invalid("rf_background", format!("{color:?} is no colour"), "give three numbers from 0 to 1"));
        }
        Ok(())
    }

    /// The colour behind the RF field.
    pub fn radio_background_color(&self) -> [f32; 3] {
        self.radio_background.unwrap_or(self.radio_target.floor_color())
    }

    /// What headers say of a field in the world frame that was trained with this filter.
    pub fn notes(&self, antialias: Antialias) -> ply::Notes {
        let radio_background = self.radio_background_color();
        ply::Notes {
            antialias,
            up: [0, 0, 1],
            radio_target: self.radio_target,
            db_range: self.db_range,
            radio_background,
            offset_m: None,
        }
    }

    /// Renders the Gaussians that `device` holds at a pose, both cameras at once.
    ///
    /// # Errors
    /// The device's.
    pub fn render(&self, device: &mut dyn Device, world_from_camera: Rigid3) -> Result<FieldRendering> {
        let view = |camera| View { camera, world_from_camera };
        let background = self.radio_background_color();
        let rendering = device.render(&RenderRequest {
            light: Some((view(self.light_camera), [0.0; 3])),
            radio: Some((view(self.radio_camera), background)),
            main_contributor: false,
        })?;
        let (light, radio) =
            (rendering.light.ok_or_else(|| device.left_out())?, rendering.radio.ok_or_else(|| device.left_out())?);
        let image = light.color.pixels.chunks_exact(3).map(|c| [c[0], c[1], c[2]].map(|v| v.clamp(0.0, 1.0))).collect();
        let scalar = self.radio_target.scalar(&radio.color);
        Ok(FieldRendering {
            image: Raster::from_vec(light.color.width, light.color.height, image),
            spectrum: linear_from_scalar(&scalar, &self.db_range),
            scalar,
            radio: radio.color,
            inverse_depth: normalised_inverse_depth(&light),
        })
    }
}

impl Field {
    /// Writes `optical.ply`, `rf.ply`, `coupled.ply` and `field.json` (the [`FieldMeta`]) into an existing folder, each whole or not at all.
    /// Of a modality that was not trained there is no file. `antialias` is the filter that the field was trained with, which headers name.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path, antialias: Antialias) -> Result<()> {
        let notes = self.meta.notes(antialias);
        if self.meta.modalities.light {
            ply::write_light(&folder.join("optical.ply"), &self.gaussians, &notes)?;
        }
        if self.meta.modalities.radio {
            ply::write_radio(&folder.join("rf.ply"), &self.gaussians, &notes)?;
        }
        ply::write_coupled(&folder.join("coupled.ply"), &self.gaussians, &notes)?;
        let path = folder.join("field.json");
        let text = serde_json::to_vec_pretty(&self.meta).map_err(|e| Error::Io {
            action: "write",
            path: path.clone(),
            source: e.into(),
        })?;
        Ok(write_atomic(path, &text)?)
    }

    /// Reads `coupled.ply` and `field.json` back.
    ///
    /// # Errors
    /// A file that is missing, damaged, or does not fit the other.
    pub fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("field.json");
        let text = corf_scene::io::read(&path)?;
        let meta: FieldMeta = serde_json::from_slice(&text).map_err(|e| {
            Error::invalid(path.display().to_string(), e.to_string(), "this file is written beside coupled.ply; do not edit it")
        })?;
        meta.validate()?;
        let model = folder.join("coupled.ply");
        let gaussians = ply::read_coupled(&model)?;
        if gaussians.radio.channels != meta.radio_target.channels() {
            return Err(Error::invalid(
                model.display().to_string(),
                format!("the RF colour has {} channel(s) and field.json says {:?}", gaussians.radio.channels, meta.radio_target),
                "the two files belong to different reconstructions",
            ));
        }
        Ok(Self { gaussians, meta })
    }

    /// Makes `device` hold this field's Gaussians and nothing else.
    ///
    /// # Errors
    /// The device's, when it has no memory for them.
    pub fn load(&self, device: &mut dyn Device) -> Result<()> {
        if !device.is_empty() {
            let none = vec![false; device.len()];
            device.retain(&none)?;
        }
        device.append(&self.gaussians)
    }

    /// Renders a pose on a device this field was [loaded](Self::load) to.
    ///
    /// # Errors
    /// When the device holds another number of Gaussians, or fails.
    pub fn render(&self, device: &mut dyn Device, world_from_camera: Rigid3) -> Result<FieldRendering> {
        if device.len() != self.gaussians.len() {
            return Err(Error::invalid(
                device.name(),
                format!("the device holds {} Gaussians and the field has {}", device.len(), self.gaussians.len()),
                "call Field::load on this device first",
            ));
        }
        self.meta.render(device, world_from_camera)
    }
}

/// `(Σ α T / z) / (1 − T_N)`, 0 where next to nothing covers a pixel.
pub(crate) fn over_coverage(inverse_depth: f32, transmittance: f32) -> f32 {
    let coverage = 1.0 - transmittance;
    if coverage > 1e-3 { inverse_depth / coverage } else { 0.0 }
}

fn normalised_inverse_depth(layer: &Layer) -> Raster<f32> {
    let pixels =
        layer.inverse_depth.pixels().iter().zip(layer.transmittance.pixels()).map(|(i, t)| over_coverage(*i, *t)).collect();
    Raster::from_vec(layer.inverse_depth.width(), layer.inverse_depth.height(), pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sensor_that_earlier_versions_named_is_read_over_and_written_no_more() {
        let camera = Pinhole::from_horizontal_fov(8, 6, 90.0);
        let meta = FieldMeta {
            radio_target: RadioTarget::Jet,
            db_range: FieldMeta::RANGE_WITHOUT_RADIO,
            light_camera: camera,
            radio_camera: camera,
            radio_background: Some([0.1, 0.2, 0.3]),
            modalities: Modalities::BOTH,
        };
        let mut written = serde_json::to_value(meta).unwrap();
        assert!(written.get("sensor").is_none());
        assert_eq!(serde_json::from_value::<FieldMeta>(written.clone()).unwrap(), meta);
        written["sensor"] = "identity".into();
        assert_eq!(serde_json::from_str::<FieldMeta>(&written.to_string()).unwrap(), meta);
        for (key, value) in [("sensor", "array"), ("senser", "identity")] {
            let mut other = serde_json::to_value(meta).unwrap();
            other[key] = value.into();
            let error = serde_json::from_value::<FieldMeta>(other).unwrap_err().to_string();
            assert!(error.contains(&format!("unknown field `{key}`")), "{error}");
        }
    }
}
