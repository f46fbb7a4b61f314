//! Punctual lights.

use super::xml::Xml;
use crate::model::{Bounds, PunctualKind, PunctualLight};
use std::collections::BTreeSet;
use std::f32::consts::PI;

/// Luminance of linear sRGB (Rec. 709 weights).
pub(super) fn luminance(c: [f32; 3]) -> f32 {
    0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
}

/// Writes the sampling weight of an emitter: proportional to its power, and never zero.
pub(super) fn sampling_weight(xml: &mut Xml, power: f32) {
    xml.float("sampling_weight", if power.is_finite() { power.max(1e-6) } else { 1.0 });
}

/// Writes all that shine; returns how many.
pub(super) fn write(
    lights: &[PunctualLight],
    bounds: Option<Bounds>,
    xml: &mut Xml,
    approximated: &mut BTreeSet<String>,
) -> usize {
    let shining = lights.iter().filter(|l| luminance(l.intensity) > 0.0);
    let mut count = 0;
    for (i, light) in shining.enumerate() {
        count += 1;
        let id = format!("light_{i}");
        let attributes = |kind| [("type", kind), ("id", id.as_str())];
        let [x, y, z] = light.position.to_array().map(|v| v.to_string());
        let towards = (light.position + light.direction).to_array();
        if light.range_m.is_some() {
            approximated.insert("lights with a range shine beyond it".into());
        }
        match light.kind {
            PunctualKind::Point => {
                xml.open("emitter", &attributes("point"));
                xml.empty("point", &[("name", "position"), ("x", &x), ("y", &y), ("z", &z)]);
                xml.rgb("intensity", light.intensity);
                sampling_weight(xml, 4.0 * PI * luminance(light.intensity));
            }
            PunctualKind::Spot { inner_rad, outer_rad } => {
                approximated.insert("a spot light falls off in its angle, not in the squared cosine between its cones".into());
                xml.open("emitter", &attributes("spot"));
                xml.open("transform", &[("name", "to_world")]);
                let words = |v: [f32; 3]| v.map(|c| c.to_string()).join(", ");
                let up = if light.direction.z.abs() < 0.9 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
                let origin = words(light.position.to_array());
                xml.empty("lookat", &[("origin", &origin), ("target", &words(towards)), ("up", &words(up))]);
                xml.close();
                xml.rgb("intensity", light.intensity);
                xml.float("cutoff_angle", outer_rad.to_degrees());
                xml.float("beam_width", inner_rad.to_degrees());
                sampling_weight(xml, 2.0 * PI * (1.0 - outer_rad.cos()) * luminance(light.intensity));
            }
            PunctualKind::Directional => {
                xml.open("emitter", &attributes("directional"));
                let [x, y, z] = light.direction.to_array().map(|v| v.to_string());
                xml.empty("vector", &[("name", "direction"), ("x", &x), ("y", &y), ("z", &z)]);
                xml.rgb("irradiance", light.intensity);
                let radius = bounds.map_or(1.0, |b| 0.5 * (b.max - b.min).length());
                sampling_weight(xml, PI * radius * radius * luminance(light.intensity));
            }
        }
        xml.close();
    }
    count
}
