//! What a dispatch is told: constants, and the receivers with the anchors they are near.

use super::super::cloud::Receiver;
use super::super::{ArrayField, SensorSettings};
use bytemuck::Zeroable;
use corf_gpu::record;
use corf_scene::Rigid3;

record! {
    /// Constants of every kernel.
    pub(super) struct Job {
        /// First receiver of a dispatch.
        pub first: u32,
        /// Receivers of a dispatch.
        pub receivers: u32,
        pub emitters: u32,
        /// Of an image.
        pub pixels: u32,
        pub width: u32,
        pub height: u32,
        /// Directions that are let in: 0 all, 1 those before the array, 2 those of the frame.
        pub let_in: u32,
        /// Whether targets have a background.
        pub has_background: u32,
        /// Least and greatest tangents to the left, then upwards, of the frame.
        pub frame: [f32; 4],
        /// 2π times the spacing of columns and of rows, wavelengths.
        pub steps: [f32; 2],
        /// Of a lobe that nothing widens, rad².
        pub variance: f32,
        pub most_power: f32,
        /// Of a training step, as those that follow.
        pub floor: f32,
        pub rate: f32,
        pub damping: f32,
        pub clip: f32,
        /// Share of a correction that goes to where an emitter is seen from.
        pub share: f32,
        pub padding: f32,
        pub more_padding: [f32; 2],
    }
}

record! {
    /// A receiver, with the rows of the rotation from the world into the array's frame.
    pub(super) struct ReceiverRow {
        place: [f32; 3],
        /// Of its anchors in the list of all.
        first: u32,
        forward: [f32; 3],
        anchors: u32,
        left: [f32; 3],
        /// Σ of its weights' squares.
        norm: f32,
        up: [f32; 3],
        padding: u32,
    }
}

record! {
    /// An anchor that a receiver is near.
    pub(super) struct Near {
        number: u32,
        weight: f32,
    }
}

/// The records in WGSL.
pub(super) fn declarations() -> String {
    Job::declaration() + &ReceiverRow::declaration() + &Near::declaration()
}

/// Receivers, and the anchors of all of them.
#[derive(Default)]
pub(super) struct Receivers {
    pub rows: Vec<ReceiverRow>,
    pub anchors: Vec<Near>,
}

impl Receivers {
    /// Receivers of a field at poses.
    pub fn at(field: &ArrayField, poses: &[Rigid3]) -> Self {
        let mut all = Self::default();
        poses.iter().for_each(|pose| all.push(&field.receiver(pose)));
        all
    }

    /// Adds one.
    pub fn push(&mut self, receiver: &Receiver<f32>) {
        let weights = receiver.weights();
        let [forward, left, up] = receiver.array_from_world;
        self.rows.push(ReceiverRow {
            place: receiver.place,
            first: self.anchors.len() as u32,
            forward,
            anchors: weights.len() as u32,
            left,
            norm: weights.iter().map(|w| w.1 * w.1).sum(),
            up,
            padding: 0,
        });
        self.anchors.extend(weights.iter().map(|(k, weight)| Near { number: *k as u32, weight: *weight }));
    }
}

impl Job {
    /// Constants of a field's observations at `receivers` poses from `first` on; those of training are none.
    pub fn new(field: &ArrayField, first: usize, receivers: usize) -> Self {
        // All receivers of a field let the same in.
        let receiver: Receiver<f32> = field.receiver(&Rigid3::IDENTITY);
        let (steps, variance) = match field.sensor {
            SensorSettings::Beam { spacing_wavelengths, .. } | SensorSettings::Capon { spacing_wavelengths, .. } => {
                (spacing_wavelengths.map(|s| (std::f64::consts::TAU * s) as f32), 0.0)
            }
            SensorSettings::Lobes { width_deg } => ([0.0; 2], width_deg.to_radians().powi(2) as f32),
        };
        let let_in = match (receiver.frame, receiver.gated) {
            (Some(_), _) => 2,
            (None, true) => 1,
            (None, false) => 0,
        };
        Self {
            first: first as u32,
            receivers: receivers as u32,
            emitters: (field.sources.len() + field.points.len()) as u32,
            pixels: (field.camera.width * field.camera.height) as u32,
            width: field.camera.width as u32,
            height: field.camera.height as u32,
            let_in,
            frame: receiver.frame.map_or([0.0; 4], |[[a, b], [c, d]]| [a, b, c, d]),
            steps,
            variance,
            // A shader is not to meet an infinite number.
            most_power: receiver.most_power.min(f32::MAX),
            ..Self::zeroed()
        }
    }
}
