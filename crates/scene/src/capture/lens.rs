//! Cameras of captures: a pinhole with the polynomial distortion of OpenCV, and images resampled to a pinhole without.
//!
//! The distortion is Brown's: with x = X/Z, y = Y/Z and r² = x² + y²,
//!
//! ```text
//! x' = x (1 + k₁r² + k₂r⁴ + k₃r⁶) + 2p₁xy + p₂(r² + 2x²)        u = fx x' + cx
//! y' = y (1 + k₁r² + k₂r⁴ + k₃r⁶) + p₁(r² + 2y²) + 2p₂xy        v = fy y' + cy
//! ```
//!
//! as in the OpenCV documentation (Camera Calibration and 3D Reconstruction) and COLMAP's camera models.

use crate::{Error, Pinhole, Raster, Result, bounds};
use glam::DVec2;
use std::ops::RangeInclusive;

/// Coefficients of distortion: those of lenses are below ten.
const DISTORTION: RangeInclusive<f64> = -1e4..=1e4;

/// A camera with distortion; image coordinates as [`Pinhole`]'s: the centre of the top left pixel is (0.5, 0.5), as in COLMAP and nerfstudio.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lens {
    pub pinhole: Pinhole,
    /// Radial: k₁, k₂, k₃.
    pub radial: [f64; 3],
    /// Tangential: p₁, p₂.
    pub tangential: [f64; 2],
}

/// Factors of the focal length between which that of the pinhole without blank pixels is looked for.
const ZOOM: [f64; 2] = [0.25, 4.0];
/// Halvings of that interval: far below a pixel.
const HALVINGS: usize = 50;
/// Radii at which the distortion is asked whether it still rises.
const RADII: usize = 64;

impl Lens {
    /// A pinhole without distortion.
    pub fn plain(pinhole: Pinhole) -> Self {
        Self { pinhole, radial: [0.0; 3], tangential: [0.0; 2] }
    }

    /// Checks that it is a camera; `place` names it.
    ///
    /// # Errors
    /// No pixels, or a number that is not finite or that no camera has ([`bounds::pinhole`]).
    pub fn check(&self, place: &str) -> Result<()> {
        bounds::pinhole(place, &self.pinhole)?;
        let mut coefficients = self.radial.into_iter().chain(self.tangential);
        coefficients.try_for_each(|k| bounds::number(place, k, &DISTORTION, "for a coefficient of distortion"))
    }

    /// Whether it has no distortion.
    pub fn is_plain(&self) -> bool {
        self.radial == [0.0; 3] && self.tangential == [0.0; 2]
    }

    /// Image position of the direction (x, y, 1).
    fn project(&self, x: f64, y: f64) -> DVec2 {
        let ([k1, k2, k3], [p1, p2]) = (self.radial, self.tangential);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let at = DVec2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        );
        DVec2::new(self.pinhole.fx * at.x + self.pinhole.cx, self.pinhole.fy * at.y + self.pinhole.cy)
    }

    /// Whether the radial polynomial rises up to a radius: beyond its turning point an image would be folded over.
    fn rises_to(&self, radius: f64) -> bool {
        let [k1, k2, k3] = self.radial;
        (0..=RADII).all(|i| {
            let r2 = (radius * i as f64 / RADII as f64).powi(2);
            1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3)) > 0.0
        })
    }

    /// Whether the centre of every pixel of a pinhole lies within this camera's outermost pixel centres. Its border tells.
    fn covers(&self, target: &Pinhole) -> bool {
        let (w, h) = (target.width, target.height);
        let border = (0..w).flat_map(|x| [(x, 0), (x, h - 1)]).chain((0..h).flat_map(|y| [(0, y), (w - 1, y)]));
        let mut radius: f64 = 0.0;
        let inside = border.into_iter().all(|(x, y)| {
            let ray = target.unproject(x as f64 + 0.5, y as f64 + 0.5);
            radius = radius.max(ray.truncate().length());
            let at = self.project(ray.x, ray.y);
            let within = |v: f64, n: usize| (0.5 - EDGE..=n as f64 - 0.5 + EDGE).contains(&v);
            within(at.x, self.pinhole.width) && within(at.y, self.pinhole.height)
        });
        inside && self.rises_to(radius)
    }

    /// Source position of a target's pixel centre, in units of this camera's pixels, (0, 0) being the centre of the top left one.
    fn source(&self, target: &Pinhole, x: usize, y: usize) -> DVec2 {
        let ray = target.unproject(x as f64 + 0.5, y as f64 + 0.5);
        let (w, h) = (self.pinhole.width as f64, self.pinhole.height as f64);
        (self.project(ray.x, ray.y) - 0.5).clamp(DVec2::ZERO, DVec2::new(w - 1.0, h - 1.0))
    }

    /// An image of this camera as the pinhole `target` sees it: bilinear in the stored (sRGB) values. The same pixels where both are the same.
    pub fn resample(&self, image: &Raster<[u8; 3]>, target: &Pinhole) -> Raster<[u8; 3]> {
        if *self == Self::plain(*target) {
            return image.clone();
        }
        Raster::from_fn(target.width, target.height, |x, y| {
            let at = self.source(target, x, y);
            let (left, top) = (at.x as usize, at.y as usize);
            let (right, below) = ((left + 1).min(image.width() - 1), (top + 1).min(image.height() - 1));
            let (s, t) = (at.x - left as f64, at.y - top as f64);
            std::array::from_fn(|c| {
                let v = |x: usize, y: usize| f64::from(image[(x, y)][c]);
                let upper = v(left, top) * (1.0 - s) + v(right, top) * s;
                let lower = v(left, below) * (1.0 - s) + v(right, below) * s;
                (upper * (1.0 - t) + lower * t).round() as u8
            })
        })
    }

    /// A map of this camera as the pinhole `target` sees it: the value of the nearest pixel, for depths must not be mixed across edges.
    pub fn resample_nearest(&self, map: &Raster<f32>, target: &Pinhole) -> Raster<f32> {
        if *self == Self::plain(*target) {
            return map.clone();
        }
        Raster::from_fn(target.width, target.height, |x, y| {
            let at = self.source(target, x, y);
            map[(at.x.round() as usize, at.y.round() as usize)]
        })
    }
}

/// Overhang of a pixel's centre over the source that is rounding, pixels.
const EDGE: f64 = 1e-6;

/// The one pinhole that all images of a capture are resampled to, and whether any is changed by it. It has the size of the images and the first
/// camera's axis, and the widest view in which no camera leaves a pixel blank.
///
/// # Errors
/// Images of different sizes, or distortion so strong that no such view is found.
pub(super) fn common_pinhole(lenses: &[(&str, Lens)]) -> Result<(Pinhole, bool)> {
    let Some(&(first_name, first)) = lenses.first() else {
        return Err(Error::invalid("the capture", "it has no image", "give a capture with images"));
    };
    for (name, lens) in lenses {
        let size = |lens: &Lens| (lens.pinhole.width, lens.pinhole.height);
        if size(lens) != size(&first) {
            let what = format!(
                "its camera has {}x{} pixels and that of {first_name} {}x{}",
                lens.pinhole.width, lens.pinhole.height, first.pinhole.width, first.pinhole.height
            );
            return Err(Error::invalid(
                format!("image {name}"),
                what,
                "all images of a data set have one size: import them as several captures",
            ));
        }
    }
    if lenses.iter().all(|(_, lens)| lens.is_plain() && *lens == first) {
        return Ok((first.pinhole, false));
    }
    let mut distinct: Vec<Lens> = Vec::new();
    for (_, lens) in lenses {
        if !distinct.contains(lens) {
            distinct.push(*lens);
        }
    }
    let zoomed = |zoom: f64| Pinhole { fx: zoom * first.pinhole.fx, fy: zoom * first.pinhole.fy, ..first.pinhole };
    let fits = |zoom: f64| distinct.iter().all(|lens| lens.covers(&zoomed(zoom)));
    let [mut blank, mut whole] = ZOOM;
    if !fits(whole) {
        let what = format!("no pinhole within its image was found (distortion {:?}, {:?})", first.radial, first.tangential);
        let help = "check the camera's parameters, or undistort the images first (`colmap image_undistorter`)";
        return Err(Error::invalid(format!("the camera of {first_name}"), what, help));
    }
    for _ in 0..HALVINGS {
        let middle = 0.5 * (blank + whole);
        if fits(middle) { whole = middle } else { blank = middle }
    }
    Ok((zoomed(whole), true))
}

#[cfg(test)]
mod tests;
