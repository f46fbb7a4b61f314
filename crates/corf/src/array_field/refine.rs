//! What becomes of sources after their birth: they move to where the rays that see them meet, and those that nobody sees any more are removed.

use super::births::{DISTANCES_M, Sighting};
use super::cloud::{Cloud, Receiver};
use glam::{DMat3, DVec3};

/// Agreement with a source from which on a ray is one of it, `[0, 1]`.
const OF_IT: f64 = 0.3;
/// Keyframes that have to see a source before it moves.
const LEAST_RAYS: usize = 3;
/// How strongly a source is held where it is, in units of the mean over directions of what rays tell: along a ray that nothing crosses it stays.
const HOLD: f64 = 1e-2;

/// A ray of a source.
struct Seen {
    receiver_m: DVec3,
    direction: DVec3,
    /// How well it agrees, `[0, 1]`.
    weight: f64,
}

/// Moves every source to where the rays that are of it meet: a Gauss–Newton step of the weighted squared angles between it and them. Gains follow
/// squared distances, so that in the mean over these rays the power that is received stays.
pub(super) fn refine(sources: &mut Cloud<f32>, sightings: &[Sighting], width_rad: f64) {
    for (position, log_gain) in sources.position.iter_mut().zip(&mut sources.gain) {
        let (place, gain) = (glam::Vec3::from(*position).as_dvec3(), f64::from(*log_gain).exp());
        let seen = |s: &Sighting| {
            let (direction, weight) = s.best(place, gain, width_rad)?;
            (weight > OF_IT).then_some(Seen { receiver_m: s.place_m, direction, weight })
        };
        let rays: Vec<Seen> = sightings.iter().filter_map(seen).collect();
        if rays.len() < LEAST_RAYS {
            continue;
        }
        let moved = place + step(place, &rays);
        // Nearly parallel rays meet anywhere along themselves, also behind.
        let ahead = |ray: &Seen| {
            let v = moved - ray.receiver_m;
            (DISTANCES_M[0]..=DISTANCES_M[1]).contains(&v.length()) && v.dot(ray.direction) > 0.0
        };
        if !rays.iter().all(ahead) {
            continue;
        }
        let further = |r: &Seen| r.weight * (moved.distance_squared(r.receiver_m) / place.distance_squared(r.receiver_m)).ln();
        let total: f64 = rays.iter().map(|ray| ray.weight).sum();
        *log_gain += (rays.iter().map(further).sum::<f64>() / total) as f32;
        *position = moved.as_vec3().to_array();
    }
}

/// The Gauss–Newton step of a place: a move δ turns its direction u, seen from a distance r, by (I − uuᵀ)·δ/r.
fn step(place: DVec3, rays: &[Seen]) -> DVec3 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for ray in rays {
        let v = place - ray.receiver_m;
        let (distance, unit) = (v.length(), v.normalize());
        let across = DMat3::IDENTITY - DMat3::from_cols(unit * unit.x, unit * unit.y, unit * unit.z);
        normal += across * (ray.weight / (distance * distance));
        right += across * ray.direction * (ray.weight / distance);
    }
    let mean = (normal.x_axis.x + normal.y_axis.y + normal.z_axis.z) / 3.0;
    (normal + DMat3::IDENTITY * (HOLD * mean)).inverse() * right
}

/// Removes sources that bring no receiver this power.
pub(super) fn prune(sources: &mut Cloud<f32>, receivers: &[&Receiver<f32>], least_power: f32) {
    let mut seen = vec![false; sources.len()];
    for receiver in receivers {
        for (i, wave) in sources.waves(receiver, 0.0) {
            seen[i as usize] |= wave.power >= least_power;
        }
    }
    sources.keep(&seen);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array_field::peaks::SpectrumRay;
    use corf_scene::Rigid3;
    use corf_scene::config::AntennaPattern;
    use corf_scene::model::world_from_array;

    /// Poses along a line, and the ray by which each sees a source of gain 2 at a place.
    fn sightings(place: DVec3, count: usize) -> (Vec<Rigid3>, Vec<Sighting>) {
        let pose = |i: usize| {
            let receiver = DVec3::new(0.4 * i as f64, 0.3 * (i as f64).sin(), 1.5);
            Rigid3::looking_at(receiver, receiver + DVec3::X, DVec3::Z)
        };
        let poses: Vec<Rigid3> = (0..count).map(pose).collect();
        let see = |pose: &Rigid3| {
            let v = place - pose.translation;
            let direction = (world_from_array(pose).transpose() * v.normalize()).as_vec3().to_array();
            Sighting::new(pose, &[SpectrumRay { direction, power: (2.0 / v.length_squared()) as f32 }], AntennaPattern::Iso)
        };
        let sightings = poses.iter().map(see).collect();
        (poses, sightings)
    }

    fn source(place: DVec3, gain: f64) -> Cloud<f32> {
        let mut cloud = Cloud::default();
        cloud.push(place.as_vec3().to_array(), gain.ln() as f32);
        cloud
    }

    #[test]
    fn a_source_comes_to_where_its_rays_meet_and_is_as_strong_as_they_are() {
        let place = DVec3::new(7.0, 2.0, 2.2);
        let (poses, sightings) = sightings(place, 8);
        // Born too far away along the first ray, with a gain that shows the first receiver what it has seen.
        let far = poses[0].translation + 1.25 * (place - poses[0].translation);
        let mut cloud = source(far, 2.0 * 1.25 * 1.25);
        for _ in 0..20 {
            refine(&mut cloud, &sightings, 0.03);
        }
        let found = glam::Vec3::from(cloud.position[0]).as_dvec3();
        assert!(found.distance(place) < 0.02, "{found}");
        assert!((cloud.gain[0].exp() / 2.0 - 1.0).abs() < 0.1, "{}", cloud.gain[0].exp());
    }

    #[test]
    fn what_two_keyframes_see_or_nobody_stays_where_it_is() {
        let place = DVec3::new(7.0, 2.0, 2.2);
        let aside = place + DVec3::new(0.05, 0.05, 0.0);
        for (sightings, gain) in [(sightings(place, 2).1, 2.0), (sightings(place, 8).1, 2e4)] {
            let mut cloud = source(aside, gain);
            let before = cloud.clone();
            refine(&mut cloud, &sightings, 0.03);
            assert_eq!(cloud, before);
        }
    }

    #[test]
    fn parallel_rays_do_not_send_a_source_away() {
        let place = DVec3::new(50.0, 0.0, 1.5);
        let (poses, _) = sightings(place, 6);
        let ray = |pose: &Rigid3| {
            Sighting::new(pose, &[SpectrumRay { direction: [1.0, 0.0, 0.0], power: 2.0 / 2500.0 }], AntennaPattern::Iso)
        };
        let sightings: Vec<Sighting> = poses.iter().map(ray).collect();
        let mut cloud = source(place, 2.0);
        for _ in 0..300 {
            refine(&mut cloud, &sightings, 0.03);
        }
        let found = glam::Vec3::from(cloud.position[0]).as_dvec3();
        assert!(found != place && poses.iter().all(|pose| found.distance(pose.translation) <= DISTANCES_M[1] + 1e-3), "{found}");
    }

    #[test]
    fn a_source_that_one_receiver_sees_stays_and_one_that_none_does_is_removed() {
        let (poses, _) = sightings(DVec3::X, 3);
        let receivers: Vec<Receiver<f32>> = poses.iter().map(|pose| Receiver::new(pose, &[(0, 1.0)], true)).collect();
        let mut cloud = source(DVec3::new(5.0, 0.0, 1.5), 1.0);
        cloud.push([6.0, 1.0, 1.5], 0.0);
        cloud.push([-6.0, 1.0, 1.5], 9.0);
        cloud.push([5.0, -1.0, 1.5], 1.0);
        cloud.add_anchor(&[]);
        cloud.seen_from[0] = vec![1.0, -30.0, 2.0, 3.0];
        prune(&mut cloud, &receivers.iter().collect::<Vec<_>>(), 1e-3);
        assert_eq!(cloud.position, [[5.0, 0.0, 1.5], [5.0, -1.0, 1.5]]);
        assert_eq!((cloud.gain, cloud.seen_from), (vec![0.0, 1.0], vec![vec![1.0, 3.0]]));
    }
}
