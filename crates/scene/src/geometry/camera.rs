//! The pinhole camera, for light and for the RF image alike, and the image of the whole sphere.

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

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

/// Focal length from which on a pixel's solid angle is that at its centre to 0.1 %, pixels: the error is 1/(4f²) in the middle of the image.
const FINE_FOCAL_PX: f64 = 16.0 - 1e-9;

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

    /// The solid angle of pixel `(x, y)` in steradians: `1 / (fx·fy·(1 + x² + y²)^{3/2})` at its centre, or exactly where pixels are so
    /// large that this is off by more than 0.1 %.
    pub fn pixel_solid_angle_sr(&self, x: usize, y: usize) -> f64 {
        if self.fx.min(self.fy) < FINE_FOCAL_PX {
            // A rectangle with one corner on the axis and one at (x, y, 1) subtends atan(xy / √(1 + x² + y²)).
            let corner = |dx: usize, dy: usize| {
                let p = self.unproject((x + dx) as f64, (y + dy) as f64);
                (p.x * p.y).atan2(p.length())
            };
            return corner(1, 1) - corner(0, 1) - corner(1, 0) + corner(0, 0);
        }
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

/// The whole sphere as an equirectangular image, in the array frame (boresight +x in its middle, +y left of it, +z up): columns run from
/// azimuth +180° at the left edge to −180° at the right, rows from elevation +90° at the top to −90°; pixel centres at +0.5.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Equirectangular {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Equirectangular {
    /// The unit direction of pixel `(x, y)`'s centre in the array frame.
    pub fn pixel_direction(&self, x: usize, y: usize) -> DVec3 {
        let azimuth = PI - TAU * (x as f64 + 0.5) / self.width as f64;
        let elevation = FRAC_PI_2 - PI * (y as f64 + 0.5) / self.height as f64;
        DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin())
    }

    /// The image position (pixels) of a unit direction of the array frame.
    pub fn project(&self, direction: DVec3) -> DVec2 {
        let azimuth = direction.y.atan2(direction.x);
        let elevation = direction.z.atan2(direction.x.hypot(direction.y));
        DVec2::new((PI - azimuth) / TAU * self.width as f64, (FRAC_PI_2 - elevation) / PI * self.height as f64)
    }

    /// The solid angle of every pixel of row `y` in steradians, exactly.
    pub fn pixel_solid_angle_sr(&self, y: usize) -> f64 {
        let sine_of_edge = |row: usize| (FRAC_PI_2 - PI * row as f64 / self.height as f64).sin();
        TAU / self.width as f64 * (sine_of_edge(y) - sine_of_edge(y + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_is_whole_and_looks_ahead_in_its_middle() {
        let sphere = Equirectangular { width: 36, height: 18 };
        let sum: f64 = (0..18).map(|y| 36.0 * sphere.pixel_solid_angle_sr(y)).sum();
        assert!((sum - 4.0 * PI).abs() < 1e-12);
        assert!((sphere.project(DVec3::X) - DVec2::new(18.0, 9.0)).length() < 1e-12);
        // What is to the left and up is drawn to the left and up.
        let seen = sphere.project(DVec3::new(1.0, 0.3, 0.2).normalize());
        assert!(seen.x < 18.0 && seen.y < 9.0, "{seen}");
        for (x, y) in [(0, 0), (35, 17), (7, 11)] {
            let seen = sphere.project(sphere.pixel_direction(x, y));
            assert!((seen - DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).length() < 1e-9, "{seen}");
        }
    }

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
    fn large_pixels_have_their_exact_solid_angle() {
        let whole = Pinhole::from_horizontal_fov(1, 1, 90.0);
        // A face of the cube around the eye.
        assert!((whole.pixel_solid_angle_sr(0, 0) - 4.0 * PI / 6.0).abs() < 1e-12);
        // Either side of the change the two agree.
        let (below, above) = (Pinhole::from_horizontal_fov(31, 24, 90.0), Pinhole::from_horizontal_fov(32, 24, 90.0));
        for (camera, x) in [(below, 15), (above, 16), (above, 0)] {
            let p = camera.unproject(x as f64 + 0.5, 12.5);
            let midpoint = 1.0 / (camera.fx * camera.fy * p.length_squared().powf(1.5));
            assert!((camera.pixel_solid_angle_sr(x, 12) / midpoint - 1.0).abs() < 1.1e-3);
        }
    }

    #[test]
    fn projection_inverts_unprojection() {
        let camera = Pinhole::from_horizontal_fov(192, 108, 90.0);
        let p = camera.project(camera.unproject(12.25, 99.0) * 3.7).unwrap();
        assert!((p - DVec2::new(12.25, 99.0)).length() < 1e-9);
    }
}
