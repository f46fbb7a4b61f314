//! Emitters: points of which each sends power to the receiver.
//!
//! An emitter at x is received at r as a plane wave of the power exp(g)/|x − r|² from the direction of x − r, where g, its log gain, is
//! b + Σ_k φ_k(r)·w_k: a gain of its own and a correction for where it is seen from, interpolated between [`Anchors`](super::anchors::Anchors).

use super::wave::{WAVES_PER_TASK, Wave, dot};
use crate::files::tensors::{Tensor, Tensors};
use crate::{Real, Result};
use corf_scene::config::AntennaPattern;
use corf_scene::model::world_from_array;
use corf_scene::{Pinhole, Rigid3};
use glam::DVec3;
use rayon::prelude::*;

/// Nearest distance that free-space loss and directions are taken at, metres.
pub(super) const NEAREST_M: f64 = 0.2;

/// Emitters, or anything that there is one of for each of their parameters.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud<T> {
    /// World frame, metres.
    pub position: Vec<[T; 3]>,
    /// Log gain b, nepers of power.
    pub gain: Vec<T>,
    /// Corrections of the log gain: of every anchor one for each emitter.
    pub seen_from: Vec<Vec<T>>,
}

/// A receiver: where it is, how its array is turned, and which anchors it is near.
#[derive(Clone, Debug)]
pub struct Receiver<T> {
    pub(super) place: [T; 3],
    /// Rows of the rotation from the world into the array's frame.
    pub(super) array_from_world: [[T; 3]; 3],
    weights: Vec<(usize, T)>,
    /// Whether what comes from behind the array is left out.
    pub(super) gated: bool,
    /// Greatest power of a wave.
    pub(super) most_power: T,
    /// Pattern of an element of the array.
    pub(super) pattern: AntennaPattern,
    /// Least and greatest tangents to the left and upwards of the directions that are let in, where not all are.
    pub(super) frame: Option<[[T; 2]; 2]>,
}

impl<T: Real> Receiver<T> {
    /// The receiver of a camera's pose.
    pub fn new(world_from_camera: &Rigid3, weights: &[(usize, f64)], gated: bool) -> Self {
        let turned = world_from_array(world_from_camera);
        let row = |axis: usize| turned.col(axis).to_array().map(T::of);
        Self {
            place: world_from_camera.translation.to_array().map(T::of),
            array_from_world: [row(0), row(1), row(2)],
            weights: weights.iter().map(|(k, w)| (*k, T::of(*w))).collect(),
            gated,
            most_power: T::of(f64::INFINITY),
            pattern: AntennaPattern::Iso,
            frame: None,
        }
    }

    /// The same, of elements with a pattern: a wave's power is what one of them receives.
    pub fn of_elements(mut self, pattern: AntennaPattern) -> Self {
        self.pattern = pattern;
        self
    }

    /// The same, of waves of no more than a power.
    pub fn of_power_up_to(mut self, most: f64) -> Self {
        self.most_power = T::of(most);
        self
    }

    /// The same, to which what comes from outside a camera's frame does not exist.
    pub fn within(mut self, camera: &Pinhole) -> Self {
        let tangents = |focal: f64, centre: f64, count: usize| [(centre - count as f64) / focal, centre / focal].map(T::of);
        self.frame = Some([tangents(camera.fx, camera.cx, camera.width), tangents(camera.fy, camera.cy, camera.height)]);
        self
    }
}

impl<T: Real> Cloud<T> {
    /// Number of emitters.
    pub fn len(&self) -> usize {
        self.gain.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.gain.is_empty()
    }

    /// Log gain of an emitter for a receiver.
    fn log_gain<U: Real>(&self, emitter: usize, receiver: &Receiver<U>) -> U {
        let own = in_precision(self.gain[emitter]);
        receiver.weights.iter().fold(own, |sum, (k, w)| sum + *w * in_precision(self.seen_from[*k][emitter]))
    }

    /// The waves that reach a receiver, in its precision, with the emitters they come from, ascending; `extent2` is the variance of an emitter's
    /// size, m².
    pub fn waves<U: Real>(&self, receiver: &Receiver<U>, extent2: U) -> Vec<(u32, Wave<U>)> {
        let wave = |emitter: usize| {
            let (direction, d2) = receiver.towards(&self.position[emitter].map(in_precision))?;
            let power = self.log_gain(emitter, receiver).exp() / d2 * receiver.element_gain(direction);
            let power = if power < receiver.most_power { power } else { receiver.most_power };
            Some((emitter as u32, Wave { direction, power, spread2: extent2 / d2 }))
        };
        let starts: Vec<usize> = (0..self.len()).step_by(WAVES_PER_TASK).collect();
        let chunk = |first: &usize| (*first..(*first + WAVES_PER_TASK).min(self.len())).filter_map(wave).collect::<Vec<_>>();
        starts.par_iter().map(chunk).collect::<Vec<_>>().concat()
    }
}

impl<T: Real> Receiver<T> {
    /// Anchors and their weights.
    pub fn weights(&self) -> &[(usize, T)] {
        &self.weights
    }

    /// Gain of an element towards a direction in the array's frame.
    pub(super) fn element_gain(&self, direction: [T; 3]) -> T {
        match self.pattern {
            AntennaPattern::Iso => T::ONE,
            pattern => T::of(pattern.amplitude(DVec3::from_array(direction.map(T::to_f64))).powi(2)),
        }
    }

    fn offset(&self, x: &[T; 3]) -> ([T; 3], T) {
        let v = [0, 1, 2].map(|i| x[i] - self.place[i]);
        (v, dot(v, v))
    }

    /// Direction in the array's frame and squared distance of a place that the array is let see.
    fn towards(&self, x: &[T; 3]) -> Option<([T; 3], T)> {
        let (v, d2) = self.offset(x);
        if d2 < T::of(NEAREST_M * NEAREST_M) {
            return None;
        }
        let d = d2.sqrt();
        let u = self.array_from_world.map(|row| dot(row, v) / d);
        let inside = |[left, up]: &[[T; 2]; 2]| {
            let within = |v: T, [least, most]: &[T; 2]| v > *least * u[0] && v < *most * u[0];
            u[0] > T::ZERO && within(u[1], left) && within(u[2], up)
        };
        let let_in = self.frame.as_ref().map_or(!self.gated || u[0] > T::ZERO, inside);
        let_in.then_some((u, d2))
    }
}

/// A number in another precision.
fn in_precision<T: Real, U: Real>(value: T) -> U {
    U::of(value.to_f64())
}

impl Cloud<f32> {
    /// Its arrays for a file: position (n × 3), gain (n), and the corrections of each anchor (anchors × n).
    pub(super) fn tensors(&self, of: &str) -> Vec<Tensor<'_>> {
        let n = self.len();
        vec![
            Tensor::new(format!("{of}.position"), &[n, 3], self.position.as_flattened()),
            Tensor::new(format!("{of}.gain"), &[n], &self.gain[..]),
            Tensor::new(format!("{of}.seen_from"), &[self.seen_from.len(), n], self.seen_from.concat()),
        ]
    }

    /// The cloud of such arrays in a file, of `n` emitters.
    pub(super) fn read(file: &Tensors, of: &str, n: usize, anchors: usize) -> Result<Self> {
        let place = file.values(&format!("{of}.position"), &[n, 3])?;
        let seen_from = file.values(&format!("{of}.seen_from"), &[anchors, n])?;
        Ok(Self {
            position: place.as_chunks().0.to_vec(),
            gain: file.values(&format!("{of}.gain"), &[n])?,
            seen_from: (0..anchors).map(|k| seen_from[k * n..(k + 1) * n].to_vec()).collect(),
        })
    }

    /// Adds an emitter that is seen alike from everywhere.
    pub(super) fn push(&mut self, position: [f32; 3], gain: f32) {
        self.position.push(position);
        self.gain.push(gain);
        self.seen_from.iter_mut().for_each(|row| row.push(0.0));
    }

    /// Leaves out those that are not to stay.
    pub(super) fn keep(&mut self, stays: &[bool]) {
        let mut stays = stays.iter().copied().cycle();
        self.position.retain(|_| stays.next() == Some(true));
        for numbers in std::iter::once(&mut self.gain).chain(&mut self.seen_from) {
            numbers.retain(|_| stays.next() == Some(true));
        }
    }

    /// Adds an anchor, near others by these weights: emitters are seen from it as interpolation would have it.
    pub(super) fn add_anchor(&mut self, weights: &[(usize, f64)]) {
        let mut row = vec![0.0; self.len()];
        for (k, weight) in weights {
            row.iter_mut().zip(&self.seen_from[*k]).for_each(|(to, from)| *to += *weight as f32 * from);
        }
        self.seen_from.push(row);
    }
}
