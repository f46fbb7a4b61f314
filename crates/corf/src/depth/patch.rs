//! Grey images made for matching, square patches of them, and ZNCC under an affine warp.

use crate::simd::{Isa, Kernel, Lanes};
use corf_scene::Raster;
use glam::{Mat2, Vec2};
use rayon::prelude::*;

/// The local affine map of a planar patch into a neighbour.
#[derive(Clone, Copy, Debug)]
pub struct Warp {
    /// Position of the patch centre in the neighbour, pixels.
    pub center: Vec2,
    /// Its derivative by the reference pixel position.
    pub jacobian: Mat2,
}

/// Grey values in `[0, 1]` as 16-bit numbers, each beside its right neighbour: bilinear interpolation takes two loads instead of four.
#[derive(Clone, Debug)]
pub struct GreyImage {
    width: usize,
    height: usize,
    /// `value(x, y) | value(x + 1, y) << 16`; the last column stands beside itself.
    pairs: Vec<u32>,
    /// Number of pixels in the rectangle before column x and row y that do not count, at `y·(width + 1) + x`; nothing where all count.
    left_out: Vec<u32>,
    isa: Isa,
}

/// Most pixels of an image: their numbers are exact in f32.
pub const MAX_PIXELS: usize = 1 << 24;
/// Stored 16-bit value of a grey value of 1. The images are 8-bit: rounding to 16 bits is 1/257 of their own.
pub(crate) const FULL: f32 = 65535.0;

impl GreyImage {
    /// Stores an image with values in `[0, 1]`.
    pub fn new(image: &Raster<f32>) -> Self {
        let (width, height) = (image.width(), image.height());
        // To the nearest, without a call into the C library for each pixel.
        let word = |v: f32| (v.clamp(0.0, 1.0) * FULL + 0.5) as u32;
        let mut pairs = vec![0_u32; width * height];
        if width > 0 {
            let rows = pairs.par_chunks_exact_mut(width).zip(image.pixels().par_chunks_exact(width)).with_min_len(8);
            rows.for_each(|(pairs, values)| {
                pairs.iter_mut().zip(values).for_each(|(pair, v)| *pair = word(*v));
                for x in 0..width - 1 {
                    pairs[x] |= pairs[x + 1] << 16;
                }
                pairs[width - 1] |= pairs[width - 1] << 16;
            });
        }
        Self { width, height, pairs, left_out: vec![], isa: Isa::detect() }
    }

    /// The image with pixels that do not count: no patch holds one, nor lands on one.
    pub fn masked(mut self, mask: Option<&Raster<bool>>) -> Self {
        let Some(mask) = mask.filter(|m| m.pixels().contains(&false)) else { return self };
        let stride = self.width + 1;
        self.left_out = vec![0; stride * (self.height + 1)];
        for (y, row) in mask.pixels().chunks_exact(self.width).enumerate() {
            let mut sum = 0;
            for (x, counts) in row.iter().enumerate() {
                sum += u32::from(!counts);
                self.left_out[(y + 1) * stride + x + 1] = self.left_out[y * stride + x + 1] + sum;
            }
        }
        self
    }

    /// Whether there is no pixel that does not count.
    pub fn all_count(&self) -> bool {
        self.left_out.is_empty()
    }

    /// Whether all pixels of a rectangle inside the image count, from its first column and row to its last.
    pub fn counts(&self, [x0, y0]: [usize; 2], [x1, y1]: [usize; 2]) -> bool {
        let before = |x: usize, y: usize| self.left_out[y * (self.width + 1) + x];
        self.left_out.is_empty() || before(x1 + 1, y1 + 1) + before(x0, y0) == before(x0, y1 + 1) + before(x1 + 1, y0)
    }

    /// The values as 16-bit numbers row by row, each with its right neighbour in the upper half, the last column's with itself.
    pub fn pairs(&self) -> &[u32] {
        &self.pairs
    }

    /// Number of pixels in the rectangle before column x and row y that do not count, at `y·(width + 1) + x`; nothing where all count.
    pub fn left_out(&self) -> &[u32] {
        &self.left_out
    }

    /// Pixels in a row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// The value of a pixel, in `[0, 1]`.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        (self.pairs[y * self.width + x] & 0xffff) as f32 / FULL
    }
}

/// Largest radius of a patch.
const MAX_RADIUS: usize = 3;
/// Numbers of a patch, filled up with zeros to whole lanes of every width.
const PADDED: usize = 64;

/// Offsets of a patch's samples from its centre, pixels, and 1 for each sample (0 for padding).
struct Offsets {
    x: [f32; PADDED],
    y: [f32; PADDED],
    one: [f32; PADDED],
}

/// One table per radius.
static OFFSETS: [Offsets; MAX_RADIUS + 1] = [offsets(0), offsets(1), offsets(2), offsets(3)];

const fn offsets(radius: usize) -> Offsets {
    let mut out = Offsets { x: [0.0; PADDED], y: [0.0; PADDED], one: [0.0; PADDED] };
    let side = 2 * radius + 1;
    let mut i = 0;
    while i < side * side {
        out.x[i] = (i % side) as f32 - radius as f32;
        out.y[i] = (i / side) as f32 - radius as f32;
        out.one[i] = 1.0;
        i += 1;
    }
    out
}

/// A zero-mean, unit-norm square patch of the reference.
#[derive(Clone, Debug)]
pub struct Patch {
    radius: usize,
    values: [f32; PADDED],
}

/// Smallest standard deviation of a patch's grey values that can be matched: under it there is noise and 8-bit rounding only.
pub(crate) const LEAST_CONTRAST: f32 = 1.5 / 255.0;

impl Patch {
    /// The `(2·radius+1)²` patch around pixel `(x, y)`, radius 1 to 3; `None` where it leaves the image, holds a pixel that does not count, or has no
    /// texture.
    pub fn new(image: &GreyImage, x: usize, y: usize, radius: usize) -> Option<Self> {
        debug_assert!((1..=MAX_RADIUS).contains(&radius));
        if x < radius || y < radius || x + radius >= image.width || y + radius >= image.height {
            return None;
        }
        if !image.counts([x - radius, y - radius], [x + radius, y + radius]) {
            return None;
        }
        let side = 2 * radius + 1;
        let count = side * side;
        let mut values = [0.0; PADDED];
        for (i, value) in values[..count].iter_mut().enumerate() {
            *value = image.at(x - radius + i % side, y - radius + i / side);
        }
        let mean = values[..count].iter().sum::<f32>() / count as f32;
        values[..count].iter_mut().for_each(|v| *v -= mean);
        let norm = values.iter().map(|v| v * v).sum::<f32>().sqrt();
        if norm < LEAST_CONTRAST * side as f32 {
            return None;
        }
        values.iter_mut().for_each(|v| *v /= norm);
        Some(Self { radius, values })
    }

    /// Whether all samples of the warped patch lie inside `image`, and all pixels of the upright rectangle around it count.
    pub fn lands_inside(&self, image: &GreyImage, warp: &Warp) -> bool {
        let r = self.radius as f32;
        let j = warp.jacobian;
        let reach = Vec2::new(r * (j.x_axis.x.abs() + j.y_axis.x.abs()), r * (j.x_axis.y.abs() + j.y_axis.y.abs()));
        let c = index_space(warp.center);
        let (low, high) = (c - reach, c + reach);
        let inside = low.x >= 0.0 && low.y >= 0.0 && high.x < (image.width - 1) as f32 && high.y < (image.height - 1) as f32;
        // A sample lies between two columns and two rows.
        inside && image.counts([low.x as usize, low.y as usize], [high.x as usize + 1, high.y as usize + 1])
    }

    /// ZNCC in `[-1, 1]` of the patch with `image` under a warp; `None` where the warped patch does not [land inside](Self::lands_inside).
    pub fn zncc(&self, image: &GreyImage, warp: &Warp) -> Option<f32> {
        self.lands_inside(image, warp).then(|| image.isa.dispatch(Zncc { patch: self, image, warp }))
    }
}

/// Positions have pixel centres at +0.5, indices at 0.
fn index_space(position: Vec2) -> Vec2 {
    position - Vec2::splat(0.5)
}

/// Correlation of a patch that lands inside the image.
struct Zncc<'a> {
    patch: &'a Patch,
    image: &'a GreyImage,
    warp: &'a Warp,
}

impl Kernel for Zncc<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f32 {
        let c = index_space(self.warp.center);
        let (jx, jy) = (self.warp.jacobian.x_axis, self.warp.jacobian.y_axis);
        let side = 2 * self.patch.radius + 1;
        let offsets = &OFFSETS[self.patch.radius];
        let width = L::splat(self.image.width as f32);
        let (mut sum, mut square, mut cross) = (L::splat(0.0), L::splat(0.0), L::splat(0.0));
        for at in (0..side * side).step_by(L::WIDTH) {
            let (dx, dy) = (L::load(&offsets.x[at..]), L::load(&offsets.y[at..]));
            let x = L::splat(jx.x).mul_add(dx, L::splat(jy.x).mul_add(dy, L::splat(c.x)));
            let y = L::splat(jx.y).mul_add(dx, L::splat(jy.y).mul_add(dy, L::splat(c.y)));
            let (x0, y0) = (x.floor(), y.floor());
            let (fx, fy) = (x - x0, y - y0);
            // Exact: images have at most MAX_PIXELS.
            let i = y0.mul_add(width, x0);
            let (a, b) = L::gather_pairs(&self.image.pairs, i);
            let (c, d) = L::gather_pairs(&self.image.pairs, i + width);
            let top = (b - a).mul_add(fx, a);
            let bottom = (d - c).mul_add(fx, c);
            let s = (bottom - top).mul_add(fy, top);
            let counted = s * L::load(&offsets.one[at..]);
            sum = sum + counted;
            square = counted.mul_add(s, square);
            cross = s.mul_add(L::load(&self.patch.values[at..]), cross);
        }
        let [sum, square, cross, _] = L::sum4([sum, square, cross, L::splat(0.0)]);
        let n = (side * side) as f32;
        let variance = square - sum * sum / n;
        let least = n * (LEAST_CONTRAST * FULL) * (LEAST_CONTRAST * FULL);
        if variance < least { 0.0 } else { cross / variance.sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;
    use glam::Mat2;

    /// Sums of 49 products in f32, a few roundings each, and grey values rounded to 16 bits.
    const TOLERANCE: f64 = 2e-4;

    /// ZNCC by its definition, in f64, from the unrounded image.
    fn zncc(image: &Raster<f32>, patch: (usize, usize), warp: &Warp, radius: i32) -> f64 {
        let samples: Vec<(f64, f64)> = (-radius..=radius)
            .flat_map(|dy| (-radius..=radius).map(move |dx| (dx, dy)))
            .map(|(dx, dy)| {
                let reference = image[((patch.0 as i32 + dx) as usize, (patch.1 as i32 + dy) as usize)];
                let p = (warp.center - 0.5 + warp.jacobian * Vec2::new(dx as f32, dy as f32)).as_dvec2();
                let (x0, y0) = (p.x.floor() as usize, p.y.floor() as usize);
                let at = |x: usize, y: usize| f64::from(image[(x, y)]);
                let (fx, fy) = (p.x - x0 as f64, p.y - y0 as f64);
                let top = at(x0, y0) * (1.0 - fx) + at(x0 + 1, y0) * fx;
                let bottom = at(x0, y0 + 1) * (1.0 - fx) + at(x0 + 1, y0 + 1) * fx;
                (f64::from(reference), top * (1.0 - fy) + bottom * fy)
            })
            .collect();
        let n = samples.len() as f64;
        let mean = samples.iter().fold((0.0, 0.0), |m, s| (m.0 + s.0 / n, m.1 + s.1 / n));
        let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
        for s in &samples {
            let (a, b) = (s.0 - mean.0, s.1 - mean.1);
            (xx, yy, xy) = (xx + a * a, yy + b * b, xy + a * b);
        }
        xy / (xx * yy).sqrt()
    }

    #[test]
    fn the_correlation_is_its_definition_on_every_instruction_set() {
        let mut rng = Rng::keyed(4, 0, 0);
        let raster = Raster::from_fn(61, 47, |_, _| rng.uniform());
        for isa in Isa::available() {
            let mut image = GreyImage::new(&raster);
            image.isa = isa;
            for k in 0..200 {
                let radius = 2 + k % 2;
                let place = (10 + rng.below(40), 10 + rng.below(25));
                let center = Vec2::new(12.0 + 35.0 * rng.uniform(), 12.0 + 22.0 * rng.uniform());
                let jacobian = Mat2::from_cols_array(&[0; 4].map(|_| 2.0 * rng.uniform() - 1.0));
                let warp = Warp { center, jacobian };
                let patch = Patch::new(&image, place.0, place.1, radius).unwrap();
                let found = f64::from(patch.zncc(&image, &warp).unwrap());
                let truth = zncc(&raster, place, &warp, radius as i32);
                assert!((found - truth).abs() < TOLERANCE, "{isa:?}: {found} {truth}");
            }
            let patch = Patch::new(&image, 20, 20, 3).unwrap();
            let still = |x: f32, y: f32| Warp { center: Vec2::new(x, y), jacobian: Mat2::IDENTITY };
            assert!((patch.zncc(&image, &still(20.5, 20.5)).unwrap() - 1.0).abs() < TOLERANCE as f32, "a patch is itself");
            assert!(patch.zncc(&image, &still(3.4, 20.5)).is_none() && patch.zncc(&image, &still(20.5, 43.6)).is_none());
        }
    }

    #[test]
    fn what_has_no_texture_is_no_patch() {
        let flat = GreyImage::new(&Raster::filled(20, 20, 0.4));
        assert!(Patch::new(&flat, 10, 10, 3).is_none());
        assert!(Patch::new(&flat, 2, 10, 3).is_none());
    }

    #[test]
    fn no_patch_holds_or_lands_on_a_pixel_that_does_not_count() {
        let mut rng = Rng::keyed(8, 0, 0);
        let raster = Raster::from_fn(40, 30, |_, _| rng.uniform());
        let plain = GreyImage::new(&raster);
        let hole = (24, 15);
        let masked = GreyImage::new(&raster).masked(Some(&Raster::from_fn(40, 30, |x, y| (x, y) != hole)));
        for (x, y) in (3..27).flat_map(|y| (3..37).map(move |x| (x, y))) {
            let touches = hole.0.abs_diff(x) <= 3 && hole.1.abs_diff(y) <= 3;
            assert_eq!(Patch::new(&masked, x, y, 3).is_some(), !touches, "({x}, {y})");
        }
        let patch = Patch::new(&plain, 10, 10, 3).unwrap();
        // Samples lie half way between pixels: the patch rests on eight columns.
        for x in 4..35 {
            let warp = Warp { center: Vec2::new(x as f32 + 1.0, 15.5), jacobian: Mat2::IDENTITY };
            let touches = (x - 3..=x + 4).contains(&hole.0);
            assert_eq!(patch.zncc(&masked, &warp), patch.zncc(&plain, &warp).filter(|_| !touches), "{x}");
        }
        let whole = GreyImage::new(&raster).masked(Some(&Raster::filled(40, 30, true)));
        assert!(whole.left_out.is_empty(), "a mask that leaves nothing out is none");
    }
}
