//! Rays that a spectrum shows: its peaks, taken off one after the other with the sensor's own response (CLEAN; Högbom 1974).

use super::sensor::ArraySensor;
use super::wave::{Wave, dot};
use corf_scene::Pinhole;
use corf_scene::model::ARRAY_FROM_CAMERA;
use glam::DVec3;

/// Share of a peak that is taken off at once.
const LOOP_GAIN: f32 = 0.7;
/// Components taken off at most.
const MOST_COMPONENTS: usize = 32;
/// Components nearer to each other than this are one, cosine of 2°.
const SAME: f32 = 0.999_39;

/// A ray that a spectrum shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Unit direction, array frame.
    pub direction: [f32; 3],
    /// Linear power.
    pub power: f32,
}

/// The rays of a spectrum that are no more than `range_db` below the strongest, strongest first.
pub fn rays(sensor: &ArraySensor<f32>, camera: &Pinhole, spectrum: &[f32], range_db: f32) -> Vec<Ray> {
    let mut left = spectrum.to_vec();
    let strongest = spectrum.iter().copied().fold(0.0, f32::max);
    let least = strongest * 10f32.powf(-0.1 * range_db);
    let mut rays: Vec<Ray> = vec![];
    for _ in 0..MOST_COMPONENTS {
        let at = (0..left.len()).fold(0, |best, i| if left[i] > left[best] { i } else { best });
        if left[at] < least || least <= 0.0 {
            break;
        }
        let direction = refined(camera, &left, at).map(|v| v as f32);
        let response = sensor.observe(&[Wave { direction, power: 1.0, spread2: 0.0 }]);
        if response[at] <= 0.0 {
            break;
        }
        let power = LOOP_GAIN * left[at] / response[at];
        left.iter_mut().zip(&response).for_each(|(left, response)| *left -= power * response);
        match rays.iter_mut().find(|ray| dot(ray.direction, direction) > SAME) {
            Some(ray) => ray.power += power,
            None => rays.push(Ray { direction, power }),
        }
    }
    rays.sort_by(|a, b| b.power.total_cmp(&a.power));
    rays
}

/// Direction of the peak at a pixel in the array's frame: the vertices of parabolas through the logarithms of its neighbours.
pub(super) fn refined(camera: &Pinhole, image: &[f32], at: usize) -> [f64; 3] {
    let (x, y) = (at % camera.width, at / camera.width);
    let vertex = |place: usize, count: usize, stride: usize| {
        if place == 0 || place + 1 == count {
            return 0.0;
        }
        let [a, b, c] = [image[at - stride], image[at], image[at + stride]].map(f64::from);
        if a <= 0.0 || c <= 0.0 {
            return 0.0;
        }
        let [a, b, c] = [a, b, c].map(f64::ln);
        let curvature = a - 2.0 * b + c;
        if curvature < 0.0 { (0.5 * (a - c) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
    };
    let (dx, dy) = (vertex(x, camera.width, 1), vertex(y, camera.height, camera.width));
    let d: DVec3 = camera.unproject(x as f64 + 0.5 + dx, y as f64 + 0.5 + dy).normalize();
    (ARRAY_FROM_CAMERA.rotation * d).to_array()
}
