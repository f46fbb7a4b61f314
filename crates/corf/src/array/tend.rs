//! What becomes of sources after their birth: they move to where the rays that see them meet, two that no array tells apart become one, and those that
//! explain nothing are removed.

use super::births::Sighting;
use super::cloud::Cloud;
use super::field::ArrayField;
use glam::{DMat3, DVec3};

/// Agreement with a source that a ray has to have to be of it, `[0, 1]`.
const OF_IT: f64 = 0.3;
/// Keyframes that have to see a source before it is moved.
const LEAST_RAYS: usize = 3;
/// Nearest that sources come to a receiver, metres.
const NEAREST_M: f64 = 0.5;

/// Moves each source to where the rays that are of it meet: one Gauss-Newton step of the weighted squared angles between rays and source. What is received from
/// it stays as it is, in the mean over those keyframes.
pub(super) fn refine(sources: &mut Cloud<f32>, sightings: &[Sighting], width_rad: f64) {
    for i in 0..sources.len() {
        let place = place(sources, i);
        let gain = f64::from(sources.gain[i]).exp();
        let rays: Vec<(DVec3, DVec3, f64)> = sightings
            .iter()
            .filter_map(|s| s.best(place, gain, width_rad).map(|(direction, agreement)| (s.place_m, direction, agreement)))
            .filter(|ray| ray.2 > OF_IT)
            .collect();
        if rays.len() < LEAST_RAYS {
            continue;
        }
        // Held where it is along what no ray tells.
        let mut normal = DMat3::ZERO;
        let mut right = DVec3::ZERO;
        for (receiver, direction, weight) in &rays {
            let v = place - *receiver;
            let (distance, unit) = (v.length(), v.normalize());
            let across = DMat3::IDENTITY - DMat3::from_cols(unit * unit.x, unit * unit.y, unit * unit.z);
            normal += across * (weight / (distance * distance));
            right += across * *direction * (weight / distance);
        }
        let hold = 1e-2 * (normal.x_axis.x + normal.y_axis.y + normal.z_axis.z) / 3.0;
        let moved = place + (normal + DMat3::from_diagonal(DVec3::splat(hold))).inverse() * right;
        if !moved.is_finite() || rays.iter().any(|r| moved.distance(r.0) < NEAREST_M) {
            continue;
        }
        let total: f64 = rays.iter().map(|r| r.2).sum();
        let further = |(receiver, _, weight): &(DVec3, DVec3, f64)| {
            weight * (moved.distance_squared(*receiver) / place.distance_squared(*receiver)).ln()
        };
        sources.gain[i] += (rays.iter().map(further).sum::<f64>() / total) as f32;
        sources.position[i] = moved.as_vec3().to_array();
    }
}

/// Makes one of two sources where no receiver sees them further apart than an angle: gains add, and it stands at their mean place, weighted by gains.
pub(super) fn merge(sources: &mut Cloud<f32>, sightings: &[Sighting], least_rad: f64) {
    let mut gone = vec![false; sources.len()];
    for i in 0..sources.len() {
        for j in i + 1..sources.len() {
            if gone[i] || gone[j] {
                continue;
            }
            let [a, b] = [i, j].map(|k| place(sources, k));
            let apart = |s: &Sighting| (a - s.place_m).angle_between(b - s.place_m);
            if sightings.iter().all(|s| apart(s) < least_rad) {
                absorb(sources, i, j);
                gone[j] = true;
            }
        }
    }
    keep(sources, &gone);
}

/// Removes sources that no receiver has ever seen with so much power.
pub(super) fn prune(field: &mut ArrayField, receivers: &[super::cloud::Receiver<f32>], least_power: f32) {
    let mut seen = vec![false; field.sources.len()];
    for receiver in receivers {
        for (i, wave) in field.sources.waves(receiver, 0.0) {
            seen[i as usize] |= wave.power >= least_power;
        }
    }
    let gone: Vec<bool> = seen.iter().map(|s| !s).collect();
    keep(&mut field.sources, &gone);
}

fn place(sources: &Cloud<f32>, i: usize) -> DVec3 {
    glam::Vec3::from(sources.position[i]).as_dvec3()
}

/// Adds source j to source i.
fn absorb(sources: &mut Cloud<f32>, i: usize, j: usize) {
    let sum = |a: f32, b: f32| {
        let most = a.max(b);
        most + ((a - most).exp() + (b - most).exp()).ln()
    };
    let (a, b) = (sources.gain[i], sources.gain[j]);
    let gain = sum(a, b);
    let share = f64::from((b - gain).exp());
    let between = place(sources, i).lerp(place(sources, j), share);
    sources.position[i] = between.as_vec3().to_array();
    sources.gain[i] = gain;
    for row in &mut sources.seen_from {
        row[i] = sum(a + row[i], b + row[j]) - gain;
    }
}

/// Leaves out those that are gone.
fn keep(sources: &mut Cloud<f32>, gone: &[bool]) {
    let mut stays = gone.iter().map(|g| !g).cycle();
    sources.position.retain(|_| stays.next().unwrap_or(true));
    sources.gain.retain(|_| stays.next().unwrap_or(true));
    for row in &mut sources.seen_from {
        row.retain(|_| stays.next().unwrap_or(true));
    }
}
