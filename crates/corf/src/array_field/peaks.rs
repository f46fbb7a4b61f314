//! Rays that a spectrum shows: its peaks, taken off one after the other with the sensor's own response (CLEAN; Högbom 1974). Capon's peaks do not add
//! up and have no side lobes: there its local maxima are the rays.

use super::sensor::ArraySensor;
use super::wave::{Wave, dot};
use corf_scene::Pinhole;
use corf_scene::model::ARRAY_FROM_CAMERA;
use glam::DVec3;

/// Share of a peak that is taken off at once.
const LOOP_GAIN: f32 = 0.7;
/// Components taken off at most.
const MOST_COMPONENTS: usize = 32;
/// Ratio of Capon's peaks to their highest pixel at most.
const MOST_BETWEEN: f64 = 100.0;
/// Components nearer to each other than this are one, cosine of 2°.
const SAME: f32 = 0.999_39;

/// A ray that a spectrum shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpectrumRay {
    /// Unit direction, array frame.
    pub direction: [f32; 3],
    /// Linear power.
    pub power: f32,
}

/// The rays of a spectrum that are no more than `range_db` below the strongest, strongest first.
pub fn rays(sensor: &ArraySensor<f32>, camera: &Pinhole, spectrum: &[f32], range_db: f32) -> Vec<SpectrumRay> {
    let below = 10f32.powf(-0.1 * range_db);
    let mut rays = match sensor {
        ArraySensor::Capon(capon) => maxima(camera, spectrum, capon.peak() as f32, below),
        _ => cleaned(sensor, camera, spectrum, below),
    };
    rays.sort_by(|a, b| b.power.total_cmp(&a.power));
    rays
}

/// Local maxima of Capon's spectrum inside the frame. Its reciprocal is a quadratic form of steering vectors: close to a parabola around a wave even
/// where the peak is narrower than a pixel, so that the vertex says how high the peak is between pixels; `peak` is that of a wave of the power 1.
/// Rays that are less than a share `below` of the strongest are left out.
fn maxima(camera: &Pinhole, spectrum: &[f32], peak: f32, below: f32) -> Vec<SpectrumRay> {
    let (width, height) = (camera.width, camera.height);
    let around =
        |at: usize| [at - width - 1, at - width, at - width + 1, at - 1, at + 1, at + width - 1, at + width, at + width + 1];
    let inside = |at: &usize| (1..width - 1).contains(&(at % width)) && (1..height - 1).contains(&(at / width));
    // Of equal neighbours the first.
    let highest = |at: &usize| {
        spectrum[*at] > 0.0
            && around(*at).iter().all(|i| spectrum[*i] < spectrum[*at] || (spectrum[*i] == spectrum[*at] && i > at))
    };
    let ray = |at: usize| {
        let vertices = [1, width].map(|stride| Vertex::of([at - stride, at, at + stride].map(|i| -1.0 / f64::from(spectrum[i]))));
        let reciprocal = 1.0 / f64::from(spectrum[at]);
        let lowest = (reciprocal - vertices.map(|v| v.rise).iter().sum::<f64>()).max(reciprocal / MOST_BETWEEN);
        SpectrumRay {
            direction: between(camera, at, vertices.map(|v| v.offset)).map(|v| v as f32),
            power: (1.0 / lowest) as f32 / peak,
        }
    };
    let mut rays: Vec<SpectrumRay> = (0..spectrum.len()).filter(inside).filter(highest).map(ray).collect();
    let least = below * rays.iter().map(|ray| ray.power).fold(0.0, f32::max);
    rays.retain(|ray| ray.power >= least);
    rays
}

/// Rays taken off one after the other, none below a share of the strongest pixel.
fn cleaned(sensor: &ArraySensor<f32>, camera: &Pinhole, spectrum: &[f32], below: f32) -> Vec<SpectrumRay> {
    let mut left = spectrum.to_vec();
    let strongest = spectrum.iter().copied().fold(0.0, f32::max);
    let least = strongest * below;
    let mut rays: Vec<SpectrumRay> = vec![];
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
            None => rays.push(SpectrumRay { direction, power }),
        }
    }
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
        Vertex::of([a, b, c].map(f64::ln)).offset
    };
    between(camera, at, [vertex(x, camera.width, 1), vertex(y, camera.height, camera.width)])
}

/// Direction in the array's frame at offsets from a pixel's centre.
fn between(camera: &Pinhole, at: usize, [dx, dy]: [f64; 2]) -> [f64; 3] {
    let (x, y) = ((at % camera.width) as f64 + 0.5, (at / camera.width) as f64 + 0.5);
    let d: DVec3 = camera.unproject(x + dx, y + dy).normalize();
    (ARRAY_FROM_CAMERA.rotation * d).to_array()
}

/// Where a parabola through three neighbours is highest: offset from the middle one, at most half a step, and how much higher it is there.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    offset: f64,
    rise: f64,
}

impl Vertex {
    fn of([a, b, c]: [f64; 3]) -> Self {
        let (slope, curvature) = (0.5 * (c - a), a - 2.0 * b + c);
        // Next to a pixel of no power there is no parabola.
        if !(curvature < 0.0 && curvature.is_finite()) {
            return Self { offset: 0.0, rise: 0.0 };
        }
        let offset = (-slope / curvature).clamp(-0.5, 0.5);
        Self { offset, rise: offset * (slope + 0.5 * offset * curvature) }
    }
}
