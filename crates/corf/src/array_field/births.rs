//! Where rays of several keyframes meet: the places at which virtual sources are born.

use super::peaks::SpectrumRay;
use corf_scene::Rigid3;
use corf_scene::config::AntennaPattern;
use corf_scene::model::world_from_array;
use glam::DVec3;
use rayon::prelude::*;

/// Nearest and furthest distance of a source from a receiver that sees it, metres.
pub(super) const DISTANCES_M: [f64; 2] = [0.5, 60.0];
/// Distances tried along a ray.
const TRIED: usize = 96;
/// Ratio of powers beyond which two rays are not of one source, nepers.
const MOST_RATIO: f64 = 2.0;

/// Gains of elements under this are taken for it: through less nothing can be told of a source.
const LEAST_GAIN: f64 = 0.01;

/// The rays of a keyframe, in the world.
#[derive(Clone, Debug)]
pub struct Sighting {
    /// Place of the receiver, metres.
    pub place_m: DVec3,
    /// Unit directions in the world and linear powers.
    pub rays: Vec<(DVec3, f64)>,
}

impl Sighting {
    /// Rays seen by a camera at a pose, by an array whose elements have a pattern.
    pub fn new(world_from_camera: &Rigid3, rays: &[SpectrumRay], pattern: AntennaPattern) -> Self {
        let turned = world_from_array(world_from_camera);
        let ray = |r: &SpectrumRay| {
            let direction = DVec3::from_array(r.direction.map(f64::from));
            // What an isotropic element would have received.
            let gain = pattern.amplitude(direction).powi(2).max(LEAST_GAIN);
            (turned * direction, f64::from(r.power) / gain)
        };
        Self { place_m: world_from_camera.translation, rays: rays.iter().map(ray).collect() }
    }

    /// How well a place with a gain (power times squared distance) agrees with these rays, `[0, 1]`.
    fn agreement(&self, place_m: DVec3, gain: f64, width_rad: f64) -> f64 {
        self.best(place_m, gain, width_rad).map_or(0.0, |best| best.1)
    }

    /// The direction of the ray that agrees best with such a place, and how well; none where no ray was seen.
    pub(super) fn best(&self, place_m: DVec3, gain: f64, width_rad: f64) -> Option<(DVec3, f64)> {
        let v = place_m - self.place_m;
        let (d2, unit) = (v.length_squared(), v.normalize());
        let one = |(direction, power): &(DVec3, f64)| {
            let ratio = (power * d2 / gain).ln() / MOST_RATIO;
            let chord2 = (*direction - unit).length_squared() / (width_rad * width_rad);
            (*direction, (-0.5 * (chord2 + ratio * ratio)).exp())
        };
        self.rays.iter().map(one).reduce(|best, ray| if ray.1 > best.1 { ray } else { best })
    }
}

/// A place where rays meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// World frame, metres.
    pub place_m: DVec3,
    /// Power times squared distance.
    pub gain: f64,
    /// Sum of the agreements of other keyframes.
    pub votes: f64,
}

/// The place along a ray of a sighting at which most of the others agree.
pub fn meeting(of: &Sighting, ray: usize, others: &[Sighting], width_rad: f64) -> Meeting {
    let (direction, power) = of.rays[ray];
    let ratio = (DISTANCES_M[1] / DISTANCES_M[0]).ln();
    let at = |i: usize| {
        let distance = DISTANCES_M[0] * (ratio * i as f64 / (TRIED - 1) as f64).exp();
        let (place_m, gain) = (of.place_m + direction * distance, power * distance * distance);
        Meeting { place_m, gain, votes: others.iter().map(|o| o.agreement(place_m, gain, width_rad)).sum() }
    };
    let tried: Vec<Meeting> = (0..TRIED).into_par_iter().map(at).collect();
    tried.iter().fold(tried[0], |best, m| if m.votes > best.votes { *m } else { best })
}
