//! The pinhole camera, for light and for the RF image alike.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// A pinhole camera without distortion: `u = fx·x/z + cx`, `v = fy·y/z + cy`; pixels, pixel centres at +0.5, OpenCV axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pinhole {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Focal length along u, pixels.
    pub fx: f64,
    /// Focal length along v, pixels.
    pub fy: f64,
    /// Principal point, pixels.
    pub cx: f64,
    /// Principal point, pixels.
    pub cy: f64,
}

impl Pinhole {
    /// Square pixels, principal point in the middle, given the full horizontal field of view in degrees.
    pub fn from_horizontal_fov(width: usize, height: usize, fov_deg: f64) -> Self {
        let f = 0.5 * width as f64 / (0.5 * fov_deg.to_radians()).tan();
        Self { width, height, fx: f, fy: f, cx: 0.5 * width as f64, cy: 0.5 * height as f64 }
    }

    /// The point on the ray through image position `(u, v)` with z = 1 in the camera frame (not normalised).
    pub fn unproject(&self, u: f64, v: f64) -> DVec3 {
        DVec3::new((u - self.cx) / self.fx, (v - self.cy) / self.fy, 1.0)
    }

    /// The unit direction of pixel `(x, y)`'s centre in the camera frame.
    pub fn pixel_direction(&self, x: usize, y: usize) -> DVec3 {
        self.unproject(x as f64 + 0.5, y as f64 + 0.5).normalize()
    }

    /// The image position (pixels) of a camera-frame point in front of the camera, or `None` behind it.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        (point.z > 0.0).then(|| DVec2::new(self.fx * point.x / point.z + self.cx, self.fy * point.y / point.z + self.cy))
    }

    /// The solid angle of pixel `(x, y)` in steradians, `1 / (fx·fy·(1 + x² + y²)^{3/2})` at its centre.
    pub fn pixel_solid_angle_sr(&self, x: usize, y: usize) -> f64 {
        let p = self.unproject(x as f64 + 0.5, y as f64 + 0.5);
        1.0 / (self.fx * self.fy * p.length_squared().powf(1.5))
    }

    /// The camera of the image averaged over `2^level × 2^level` blocks (odd remainders dropped).
    pub fn downsampled(&self, level: u32) -> Self {
        let s = 1.0 / f64::from(1u32 << level);
        Self {
            width: self.width >> level,
            height: self.height >> level,
            fx: self.fx * s,
            fy: self.fy * s,
            cx: self.cx * s,
            cy: self.cy * s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixel_solid_angles_sum_to_that_of_the_image_rectangle() {
        let camera = Pinhole::from_horizontal_fov(300, 200, 90.0);
        let sum: f64 = (0..200).flat_map(|y| (0..300).map(move |x| (x, y))).map(|(x, y)| camera.pixel_solid_angle_sr(x, y)).sum();
        // A rectangle of half widths a, b at distance 1 subtends 4 asin(ab / sqrt((1+a²)(1+b²))).
        let (a, b) = (1.0_f64, 200.0 / 300.0);
        let exact = 4.0 * (a * b / ((1.0 + a * a) * (1.0 + b * b)).sqrt()).asin();
        assert!((sum - exact).abs() < 1e-4 * exact, "{sum} {exact}");
    }

    #[test]
    fn projection_inverts_unprojection() {
        let camera = Pinhole::from_horizontal_fov(192, 108, 90.0);
        let p = camera.project(camera.unproject(12.25, 99.0) * 3.7).unwrap();
        assert!((p - DVec2::new(12.25, 99.0)).length() < 1e-9);
    }
}
