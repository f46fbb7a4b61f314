//! Cameras.

use super::Views;
use super::xml::Xml;
use crate::{Error, Result, Rigid3};

/// Tolerance on the camera intrinsics: relative deviation from square pixels and from a central principal point.
const CENTRED: f64 = 1e-9;
/// Mitsuba's camera frame is x left, y up, z forward; ours x right, y down, z forward: both first axes turn.
const OURS_FROM_MITSUBA_DIAGONAL: [f64; 4] = [-1.0, -1.0, 1.0, 1.0];

/// `world_from_camera` for Mitsuba's camera frame, 4×4 by rows.
fn to_world(world_from_camera: &Rigid3) -> [[f64; 4]; 4] {
    world_from_camera.to_rows().map(|row| std::array::from_fn(|k| row[k] * OURS_FROM_MITSUBA_DIAGONAL[k] + 0.0))
}

/// One `perspective` sensor per pose, in their order.
///
/// # Errors
/// Pixels that are not square, or a principal point that is not in the middle.
pub(super) fn write(views: &Views, xml: &mut Xml) -> Result<()> {
    let c = &views.camera;
    let off = [c.fx / c.fy - 1.0, c.cx / (0.5 * c.width as f64) - 1.0, c.cy / (0.5 * c.height as f64) - 1.0];
    if off.iter().any(|o| o.is_nan() || o.abs() > CENTRED) {
        return Err(Error::invalid(
            "camera",
            format!("fx {}, fy {}, principal point ({}, {}) of {}x{}", c.fx, c.fy, c.cx, c.cy, c.width, c.height),
            "Mitsuba's perspective sensor has square pixels and is written with its principal point in the middle",
        ));
    }
    let fov_deg = 2.0 * (0.5 * c.width as f64 / c.fx).atan().to_degrees();
    for (i, pose) in views.poses.iter().enumerate() {
        xml.open("sensor", &[("type", "perspective"), ("id", &format!("view_{i:05}"))]);
        xml.value("string", "fov_axis", "x");
        xml.float("fov", fov_deg);
        xml.float("near_clip", 1e-3);
        xml.float("far_clip", 1e5);
        xml.matrix("to_world", &to_world(pose));
        xml.open("film", &[("type", "hdrfilm")]);
        xml.value("integer", "width", &c.width.to_string());
        xml.value("integer", "height", &c.height.to_string());
        xml.value("string", "pixel_format", "rgb");
        xml.value("string", "component_format", "float32");
        xml.empty("rfilter", &[("type", "box")]);
        xml.close();
        xml.open("sampler", &[("type", "independent")]);
        xml.value("integer", "sample_count", "64");
        xml.close();
        xml.close();
    }
    Ok(())
}
