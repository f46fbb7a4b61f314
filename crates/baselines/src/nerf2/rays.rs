//! Training rays: which pixels a step looks at, and where along them.

use super::Nerf2Config;
use crate::stage;
use corf::{Error, Result};
use corf_scene::{Pinhole, Raster, Rigid3, Rng};

/// A pixel's ray in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelRay {
    /// The receiver, metres.
    pub origin_m: [f32; 3],
    /// Unit vector.
    pub direction: [f32; 3],
    /// The transmitter, metres, where it is not the one place that a trainer knows.
    pub transmitter_m: Option<[f32; 3]>,
}

/// The ray of a pixel: of a receiver that moves and looks through a pinhole, or of an array that stands still while the transmitter moves.
#[derive(Clone, Debug, PartialEq)]
pub enum Sight {
    /// A view's pose is the receiver's.
    Moving(Pinhole),
    /// A view's place is the transmitter's.
    Fixed {
        /// The array, metres.
        origin_m: [f32; 3],
        /// Unit vectors of the pixels.
        directions: Raster<[f32; 3]>,
    },
}

impl From<Pinhole> for Sight {
    fn from(camera: Pinhole) -> Self {
        Self::Moving(camera)
    }
}

impl Sight {
    /// Columns and rows of a spectrum.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Moving(camera) => (camera.width, camera.height),
            Self::Fixed { directions, .. } => (directions.width(), directions.height()),
        }
    }

    fn pixels(&self) -> usize {
        let (width, height) = self.size();
        width * height
    }

    /// The ray of a pixel, counted row by row, of a view.
    fn ray(&self, view: &Rigid3, pixel: usize) -> PixelRay {
        let single = |v: glam::DVec3| [v.x as f32, v.y as f32, v.z as f32];
        match self {
            Self::Moving(camera) => {
                let direction = view.transform_vector(camera.pixel_direction(pixel % camera.width, pixel / camera.width));
                PixelRay { origin_m: single(view.translation), direction: single(direction), transmitter_m: None }
            }
            Self::Fixed { origin_m, directions } => PixelRay {
                origin_m: *origin_m,
                direction: directions.pixels()[pixel],
                transmitter_m: Some(single(view.translation)),
            },
        }
    }
}

/// Rays of one step, with what was observed along them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Batch {
    /// The rays.
    pub rays: Vec<PixelRay>,
    /// Observed value of each.
    pub targets: Vec<f32>,
    /// Distances of each ray's samples, ascending, metres: `rays × samples`.
    pub distances: Vec<f32>,
}

/// Every pixel of every training spectrum, in an order that is drawn anew for each epoch.
#[derive(Clone, Debug)]
pub struct TrainingRays {
    views: Vec<Rigid3>,
    sight: Sight,
    /// View by view, row by row.
    targets: Vec<f32>,
    seed: u64,
}

impl TrainingRays {
    /// No views yet, all with this camera.
    pub fn new(sight: impl Into<Sight>, seed: u64) -> Self {
        Self { views: vec![], sight: sight.into(), targets: vec![], seed }
    }

    /// Adds a view.
    ///
    /// # Errors
    /// A spectrum of another size, or with values that are not finite.
    pub fn push(&mut self, world_from_camera: Rigid3, targets: &Raster<f32>) -> Result<()> {
        let place = || format!("training spectrum {}", self.views.len());
        let (size, own) = ((targets.width(), targets.height()), self.sight.size());
        if size != own {
            let what = format!("{}x{} pixels where the RF camera has {}x{}", size.0, size.1, own.0, own.1);
            return Err(Error::invalid(place(), what, "give spectra of the data set's RF camera"));
        }
        if !targets.pixels().iter().all(|v| v.is_finite()) {
            return Err(Error::invalid(place(), "a value is not a finite number", "check the data set"));
        }
        self.views.push(world_from_camera);
        self.targets.extend(targets.pixels());
        Ok(())
    }

    /// Rays in all.
    pub fn len(&self) -> usize {
        self.targets.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// Rays of step number `step`, counted from 0: the next of an endless row of epochs, each of which has every ray once.
    ///
    /// # Panics
    /// Without views.
    pub fn batch(&self, config: &Nerf2Config, step: u64) -> Batch {
        assert!(!self.is_empty(), "rays of no view");
        let mut batch = Batch::default();
        let (count, pixels) = (self.len() as u64, self.sight.pixels());
        for k in 0..config.rays as u64 {
            let place = step * config.rays as u64 + k;
            let index = permuted(self.seed, place / count, place % count, count) as usize;
            let (view, pixel) = (index / pixels, index % pixels);
            batch.rays.push(self.sight.ray(&self.views[view], pixel));
            batch.targets.push(self.targets[index]);
        }
        batch.distances = match config.jitter {
            true => {
                let mut rng = Rng::keyed(self.seed, stage::DISTANCES, step);
                distances(config, config.rays, || rng.uniform())
            }
            false => distances(config, config.rays, || 0.5),
        };
        batch
    }
}

/// Rays of all pixels of a view, row by row.
pub fn view_rays(sight: &Sight, view: &Rigid3) -> Vec<PixelRay> {
    (0..sight.pixels()).map(|pixel| sight.ray(view, pixel)).collect()
}

/// Distances of the samples of `rays` rays, metres. With jitter a ray is cut into equal parts, and `within` says where in each of them
/// (`[0, 1)`) its sample lies; without, samples lie at equal distances from the ray's beginning to its end.
pub(super) fn distances(config: &Nerf2Config, rays: usize, mut within: impl FnMut() -> f32) -> Vec<f32> {
    let (near, length) = (config.near_m, config.far_m - config.near_m);
    let parts = if config.jitter { config.samples } else { config.samples - 1 } as f32;
    let mut distance = |k: usize| {
        let inside = if config.jitter { within() } else { 0.0 };
        near + length * ((k as f32 + inside) / parts)
    };
    (0..rays).flat_map(|_| (0..config.samples).map(&mut distance).collect::<Vec<_>>()).collect()
}

/// Element number `place` of an epoch's order of `count`: a Feistel network of four rounds over the least power of four that holds `count`,
/// walked until it lands inside. Nothing has to be stored, and every step can be computed by itself.
fn permuted(seed: u64, epoch: u64, place: u64, count: u64) -> u64 {
    let half = (u64::BITS - (count - 1).leading_zeros()).div_ceil(2).max(1);
    let mask = (1 << half) - 1;
    let key = stage::keyed(stage::RAYS, epoch as usize);
    let mut value = place;
    loop {
        let (mut left, mut right) = (value >> half, value & mask);
        for round in 0..4u64 {
            let mixed = Rng::keyed(seed, key, round << 32 | right).next_u64() >> 32;
            (left, right) = (right, left ^ (mixed & mask));
        }
        value = left << half | right;
        if value < count {
            return value;
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use corf_scene::Raster;

    #[test]
    fn every_epoch_has_every_ray_once_in_an_order_of_its_own() {
        for count in [1, 2, 3, 64, 1000] {
            let order = |seed, epoch| (0..count).map(|i| permuted(seed, epoch, i, count)).collect::<Vec<_>>();
            let mut sorted = order(1, 0);
            sorted.sort_unstable();
            assert_eq!(sorted, (0..count).collect::<Vec<_>>(), "{count}");
            if count > 3 {
                assert!(order(1, 0) != order(1, 1) && order(1, 0) != order(2, 0));
            }
        }
        // Neighbours do not stay together: the mean distance of two drawn at random from n is n/3.
        let order: Vec<f64> = (0..1000).map(|i| permuted(1, 0, i, 1000) as f64).collect();
        let mean = order.windows(2).map(|w| (w[1] - w[0]).abs()).sum::<f64>() / 999.0;
        assert!((mean - 333.0).abs() < 40.0, "{mean}");
    }

    #[test]
    fn rays_go_through_their_pixels_and_carry_their_values() {
        let camera = Pinhole::from_horizontal_fov(4, 3, 90.0);
        let config = Nerf2Config { rays: 24, samples: 3, near_m: 1.0, far_m: 2.0, ..Nerf2Config::default() };
        let mut rays = TrainingRays::new(camera, 7);
        let poses = [0.0, 5.0].map(|x| {
            // A quarter turn about z.
            let rows = [[0.0, -1.0, 0.0, x], [1.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0, 2.0], [0.0, 0.0, 0.0, 1.0]];
            Rigid3::from_rows(&rows, "test").unwrap()
        });
        for (v, pose) in poses.iter().enumerate() {
            rays.push(*pose, &Raster::from_fn(4, 3, |x, y| (100 * v + 10 * y + x) as f32)).unwrap();
        }
        let batch = rays.batch(&config, 0);
        for (ray, value) in batch.rays.iter().zip(&batch.targets) {
            let (v, y, x) = (*value as usize / 100, *value as usize / 10 % 10, *value as usize % 10);
            assert_eq!(ray.origin_m, [5.0 * v as f32, 1.0, 2.0]);
            let d = camera.pixel_direction(x, y);
            let expected = [-d.y, d.x, d.z];
            assert!(ray.direction.iter().zip(expected).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-6));
        }
        let mut values = batch.targets.clone();
        values.sort_by(f32::total_cmp);
        values.dedup();
        assert_eq!(values.len(), 24, "an epoch has all of them");
        assert_eq!(batch.distances[..3], [1.0, 1.5, 2.0]);
        assert!(rays.push(poses[0], &Raster::filled(3, 3, 0.0)).is_err());
        assert!(rays.push(poses[0], &Raster::filled(4, 3, f32::NAN)).is_err());
    }

    #[test]
    fn jittered_samples_stay_in_their_parts_and_change_with_the_step() {
        let config = Nerf2Config { rays: 50, samples: 8, near_m: 0.5, far_m: 4.5, jitter: true, ..Nerf2Config::default() };
        let mut rays = TrainingRays::new(Pinhole::from_horizontal_fov(2, 2, 90.0), 7);
        rays.push(Rigid3::IDENTITY, &Raster::filled(2, 2, 0.0)).unwrap();
        let (a, b) = (rays.batch(&config, 0).distances, rays.batch(&config, 1).distances);
        assert!(a != b && a == rays.batch(&config, 0).distances);
        for ray in a.chunks(8) {
            assert!(ray.iter().enumerate().all(|(k, r)| (0.5 + 0.5 * k as f32..1.0 + 0.5 * k as f32).contains(r)), "{ray:?}");
        }
        // In the middle of each part where a field is only looked at.
        assert_eq!(distances(&config, 1, || 0.5)[..2], [0.75, 1.25]);
    }
}
