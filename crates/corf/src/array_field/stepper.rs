//! Training steps of a radio field, on either device: residuals are taken off in proportion to the part that an emitter has in each pixel.

use super::cloud::Receiver;
use super::field::ArrayField;
use super::sensor::ArraySensor;
use super::wave::Wave;
use crate::Result;
use corf_scene::Rigid3;

/// Bounds of log gains, nepers.
pub(super) const MOST_GAIN: f32 = 40.0;

/// What a step depends on beside field and view; [`ArrayConfig`](super::ArrayConfig) says what each is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule {
    pub rate: f32,
    pub damping: f32,
    pub clip: f32,
    pub visibility: f32,
    /// Power under which nothing is seen, linear.
    pub floor: f32,
}

/// A keyframe to train with.
pub(super) struct View {
    /// `world_from_camera`.
    pub pose: Rigid3,
    /// Power that others than the field's emitters show, where there are some.
    pub background: Option<Vec<f32>>,
    /// ln of the observed power plus the floor.
    pub log: Vec<f32>,
    pub receiver: Receiver<f32>,
}

/// Takes training steps.
pub(super) trait Stepper {
    /// Takes a step with each view, in order; returns the mean squared residual before the last, nepers².
    ///
    /// # Errors
    /// The device's; the field is then as it was.
    fn take(&mut self, field: &mut ArrayField, views: &[&View]) -> Result<f32>;
}

/// A view's residuals where this power is predicted, as what pulls at powers and what a power accounts for, by pixel.
pub(super) struct Residuals {
    pub up: Vec<f32>,
    pub own: Vec<f32>,
    /// Mean of their squares, nepers².
    pub mean_square: f32,
}

impl Residuals {
    /// Of `power` beside the view's background.
    pub fn of(view: &View, mut power: Vec<f32>, rule: &Rule) -> Self {
        if let Some(background) = &view.background {
            power.iter_mut().zip(background).for_each(|(power, more)| *power += more);
        }
        let (mut up, mut own) = (Vec::with_capacity(power.len()), Vec::with_capacity(power.len()));
        let mut squares = 0.0;
        for (p, log) in power.iter().zip(&view.log) {
            let p = p.max(0.0) + rule.floor;
            let residual = p.ln() - log;
            squares += residual * residual;
            up.push(residual.clamp(-rule.clip, rule.clip) / p);
            own.push(p.recip());
        }
        Self { up, own, mean_square: squares / power.len() as f32 }
    }
}

/// Takes steps on the processor, in single precision.
pub(super) struct CpuStepper {
    pub rule: Rule,
    pub sensor: ArraySensor<f32>,
}

impl Stepper for CpuStepper {
    fn take(&mut self, field: &mut ArrayField, views: &[&View]) -> Result<f32> {
        Ok(views.iter().fold(0.0, |_, view| self.step(field, view)))
    }
}

impl CpuStepper {
    fn step(&self, field: &mut ArrayField, view: &View) -> f32 {
        let rule = &self.rule;
        let extent2 = (field.extent_m * field.extent_m) as f32;
        let mut seen = field.sources.waves(&view.receiver, 0.0);
        let count = seen.len();
        seen.extend(field.points.waves(&view.receiver, extent2));
        let waves: Vec<Wave<f32>> = seen.iter().map(|w| w.1).collect();
        let Residuals { up, own, mean_square } = Residuals::of(view, self.sensor.observe(&waves), rule);
        let pulls = self.sensor.pull_powers(&waves, [&up, &own]);
        // Without a background all emitters together account for every pixel.
        let accounted = match view.background {
            None => up.len() as f32,
            Some(_) => waves.iter().zip(&pulls).map(|(wave, pull)| wave.power * pull[1]).sum(),
        };
        let most_power = field.most_power.map_or(f32::INFINITY, |most| most as f32);
        let damping = rule.damping * accounted / waves.len().max(1) as f32;
        let weights = view.receiver.weights();
        let norm: f32 = weights.iter().map(|w| w.1 * w.1).sum();
        let share = if weights.is_empty() { 0.0 } else { rule.visibility };
        for (i, ((emitter, wave), pull)) in seen.iter().zip(&pulls).enumerate() {
            let cloud = if i < count { &mut field.sources } else { &mut field.points };
            let emitter = *emitter as usize;
            let step = -rule.rate * wave.power * pull[0] / (wave.power * pull[1] + damping);
            let step = step.min((most_power / wave.power).ln());
            let gain = &mut cloud.gain[emitter];
            *gain = (*gain + (1.0 - share) * step).clamp(-MOST_GAIN, MOST_GAIN);
            for (k, weight) in weights {
                cloud.seen_from[*k][emitter] += share * weight / norm * step;
            }
        }
        mean_square
    }
}
