//! A keyframe as matching sees it, and the warp between two of them.

use super::held::HeldView;
use super::patch::{GreyImage, Warp};
use corf_scene::{Light, Pinhole, Raster, Rigid3};
use glam::{DVec3, Mat2, Mat3, Vec2, Vec3};
use rayon::prelude::*;

/// Widest image the coarse sweep works on, pixels; larger images are averaged over 2^l blocks first.
const COARSE_WIDTH: usize = 320;

/// A grey image, its camera and pose, at full and at sweep resolution.
#[derive(Clone, Debug)]
pub struct GreyView {
    /// Trajectory index of the keyframe.
    pub index: usize,
    /// Pose of the camera (OpenCV axes), metres.
    pub world_from_camera: Rigid3,
    /// Luma, sRGB-encoded.
    pub fine: GreyImage,
    /// Intrinsics of `fine`.
    pub fine_camera: Pinhole,
    /// The image the coarse sweep uses: at most 320 pixels wide; `fine` itself where that is small enough.
    pub coarse: GreyImage,
    /// Intrinsics of `coarse`.
    pub coarse_camera: Pinhole,
    /// `coarse` averages over 2^this blocks of `fine`.
    pub coarse_level: u32,
    /// Its copy where it is matched, if there is one.
    pub held: Option<HeldView>,
}

impl GreyView {
    /// Builds the view of a keyframe from its index, its pose and what its camera saw. A pixel of the coarse image counts if all of its block do.
    pub fn of(index: usize, world_from_camera: Rigid3, light: &Light, camera: Pinhole) -> Self {
        let Light { image, mask, .. } = light;
        let luma = |c: &[u8; 3]| (0.299 * f32::from(c[0]) + 0.587 * f32::from(c[1]) + 0.114 * f32::from(c[2])) / 255.0;
        let fine = image.pixels().par_iter().with_min_len(1024).map(luma).collect();
        let fine = Raster::from_vec(image.width(), image.height(), fine);
        let mut coarse_level = 0;
        while camera.width >> coarse_level > COARSE_WIDTH {
            coarse_level += 1;
        }
        let coarse_camera = camera.downsampled(coarse_level);
        let block = 1usize << coarse_level;
        // Row by row of the fine image, block by block: each block's values are added up in the order of its rows.
        let mut coarse = Raster::filled(coarse_camera.width, coarse_camera.height, 0.0);
        let (width, across) = (fine.width().max(1), coarse_camera.width.max(1));
        let rows_of_blocks = fine.pixels().chunks_exact(width * block);
        coarse.pixels_mut().chunks_exact_mut(across).zip(rows_of_blocks).for_each(|(sums, rows)| {
            for row in rows.chunks_exact(width) {
                let blocks = sums.iter_mut().zip(row.chunks_exact(block));
                blocks.for_each(|(sum, values)| values.iter().for_each(|v| *sum += v));
            }
            sums.iter_mut().for_each(|sum| *sum /= (block * block) as f32);
        });
        let counts = mask.as_ref().map(|mask| {
            let all = |x: usize, y: usize| (0..block * block).all(|i| mask[(x * block + i % block, y * block + i / block)]);
            Raster::from_fn(coarse.width(), coarse.height(), all)
        });
        let fine = GreyImage::new(&fine).masked(mask.as_ref());
        let coarse = GreyImage::new(&coarse).masked(counts.as_ref());
        Self { index, world_from_camera, fine, fine_camera: camera, coarse, coarse_camera, coarse_level, held: None }
    }
}

/// A neighbour seen from a reference view: where a reference pixel at an inverse depth lands in it.
#[derive(Clone, Copy, Debug)]
pub struct Neighbour<'a> {
    /// The neighbouring view.
    pub view: &'a GreyView,
    /// `R` of `p_neighbour = R p_reference + t`.
    rotation: Mat3,
    translation: Vec3,
    /// Distance between the two centres, metres.
    pub baseline_m: f64,
}

impl<'a> Neighbour<'a> {
    /// `view` seen from `reference`.
    pub fn new(reference: &GreyView, view: &'a GreyView) -> Self {
        let relative = view.world_from_camera.inverse().compose(&reference.world_from_camera);
        Self {
            view,
            rotation: relative.rotation.as_mat3(),
            translation: relative.translation.as_vec3(),
            baseline_m: relative.translation.length(),
        }
    }

    /// `R` and `t` of `p_neighbour = R p_reference + t`, metres.
    pub fn neighbour_from_reference(&self) -> (Mat3, Vec3) {
        (self.rotation, self.translation)
    }

    /// Warps reference position `(u, v)` of `from` at `inverse_depth` into `to`, a camera of the neighbour, as a patch parallel to the
    /// reference image; `None` behind the neighbour.
    pub fn warp(&self, from: &Pinhole, to: &Pinhole, u: f32, v: f32, inverse_depth: f32) -> Option<Warp> {
        self.warp_slanted(from, to, u, v, inverse_depth, Vec2::ZERO)
    }

    /// [`Self::warp`] for a slanted plane, whose inverse depth changes by `slope` per reference pixel (a plane is affine in inverse depth).
    pub fn warp_slanted(&self, from: &Pinhole, to: &Pinhole, u: f32, v: f32, inverse_depth: f32, slope: Vec2) -> Option<Warp> {
        let ray = Vec3::new((u - from.cx as f32) / from.fx as f32, (v - from.cy as f32) / from.fy as f32, 1.0);
        // The point is ray/w; w·(R ray/w + t) has the same image.
        let p = self.rotation * ray + self.translation * inverse_depth;
        if p.z <= 1e-3 {
            return None;
        }
        let (x, y) = (p.x / p.z, p.y / p.z);
        let du = self.rotation.x_axis / from.fx as f32 + self.translation * slope.x;
        let dv = self.rotation.y_axis / from.fy as f32 + self.translation * slope.y;
        let (fx, fy) = (to.fx as f32 / p.z, to.fy as f32 / p.z);
        Some(Warp {
            center: Vec2::new(to.fx as f32 * x + to.cx as f32, to.fy as f32 * y + to.cy as f32),
            jacobian: Mat2::from_cols(
                Vec2::new(fx * (du.x - x * du.z), fy * (du.y - y * du.z)),
                Vec2::new(fx * (dv.x - x * dv.z), fy * (dv.y - y * dv.z)),
            ),
        })
    }

    /// Reference inverse depth to neighbour inverse depth of the same point; `None` behind it.
    pub fn inverse_depth_there(&self, from: &Pinhole, u: f32, v: f32, inverse_depth: f32) -> Option<f32> {
        let ray = Vec3::new((u - from.cx as f32) / from.fx as f32, (v - from.cy as f32) / from.fy as f32, 1.0);
        let p = self.rotation * ray + self.translation * inverse_depth;
        (p.z > 1e-3).then(|| inverse_depth / p.z)
    }
}

/// The neighbours worth matching with, best first: those that see most of the reference's view at a typical depth, with a baseline that is
/// long enough to triangulate there and short enough for both to see the same.
pub fn select_neighbours<'a>(
    reference: &GreyView,
    candidates: impl IntoIterator<Item = &'a GreyView>,
    typical_depth_m: f64,
    count: usize,
) -> Vec<Neighbour<'a>> {
    /// A baseline of this fraction of the typical depth is as good as a longer one.
    const GOOD_BASELINE: f64 = 0.1;
    /// Beyond this fraction a scene looks too different from both ends to be matched well.
    const LONG_BASELINE: f64 = 0.3;
    /// Below this fraction nothing can be triangulated.
    const LEAST_BASELINE: f64 = 0.005;
    /// Least share of the reference's view that a neighbour must see.
    const LEAST_OVERLAP: f64 = 0.25;
    const GRID: usize = 6;
    let camera = &reference.fine_camera;
    let mut scored: Vec<(f64, Neighbour<'a>)> = candidates
        .into_iter()
        .filter_map(|view| {
            let pair = Neighbour::new(reference, view);
            let from_reference = view.world_from_camera.inverse().compose(&reference.world_from_camera);
            let seen = (0..GRID * GRID)
                .filter(|i| {
                    let u = (0.5 + (i % GRID) as f64) / GRID as f64 * camera.width as f64;
                    let v = (0.5 + (i / GRID) as f64) / GRID as f64 * camera.height as f64;
                    let p: DVec3 = from_reference.transform_point(camera.unproject(u, v) * typical_depth_m);
                    view.fine_camera.project(p).is_some_and(|q| {
                        q.x >= 0.0 && q.y >= 0.0 && q.x < view.fine_camera.width as f64 && q.y < view.fine_camera.height as f64
                    })
                })
                .count();
            let overlap = seen as f64 / (GRID * GRID) as f64;
            let relative = pair.baseline_m / typical_depth_m;
            (overlap >= LEAST_OVERLAP && relative >= LEAST_BASELINE)
                .then(|| (overlap * (relative / GOOD_BASELINE).min(1.0) * (LONG_BASELINE / relative).min(1.0), pair))
        })
        .collect();
    // Stable: equal scores keep the candidates' order.
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.into_iter().take(count).map(|s| s.1).collect()
}

/// The vertex of the parabola through three equally spaced values, relative to the middle one in steps, clamped to ± 0.5.
pub fn parabola_offset(before: f32, middle: f32, after: f32) -> f32 {
    let curvature = before - 2.0 * middle + after;
    if curvature.abs() < 1e-12 { 0.0 } else { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) }
}
