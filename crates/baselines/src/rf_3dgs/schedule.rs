//! What each step of an offline reconstruction trains, from its number alone: stage, view, rate of positions, degree of harmonics.

use super::config::{RadioMoments, Rf3dgsConfig};
use crate::stage;
use corf::device::{DenseStep, Step, ViewId};
use corf_scene::Rng;

/// The view of each step of a stage: each epoch visits every view once, in an order of its own that its number and the seed decide.
#[derive(Clone, Debug)]
pub(crate) struct Epochs {
    seed: u64,
    views: usize,
    /// Number of an epoch with the order of its views: the one last asked for.
    held: Option<(usize, Vec<usize>)>,
    stage: usize,
}

impl Epochs {
    /// For `views` uploaded views in a stage of this number.
    pub fn new(seed: u64, views: usize, stage: usize) -> Self {
        Self { seed, views, held: None, stage }
    }

    /// The view of step `step` (from 1).
    pub fn view(&mut self, step: usize) -> ViewId {
        let (epoch, place) = ((step - 1) / self.views, (step - 1) % self.views);
        if self.held.as_ref().is_none_or(|(held, _)| *held != epoch) {
            let mut rng = Rng::keyed(self.seed, stage::keyed(stage::OFFLINE_EPOCHS, self.stage), epoch as u64);
            let mut order: Vec<usize> = (0..self.views).collect();
            // Fisher–Yates.
            for i in (1..order.len()).rev() {
                order.swap(i, rng.below(i + 1));
            }
            self.held = Some((epoch, order));
        }
        ViewId(self.held.as_ref().map_or(0, |(_, order)| order[place]))
    }
}

/// A rate that falls log-linearly from the first to the last within `steps` steps, and then stays.
pub(crate) fn log_linear([first, last]: [f64; 2], steps: usize, step: usize) -> f64 {
    let t = (step as f64 / steps as f64).min(1.0);
    ((1.0 - t) * first.ln() + t * last.ln()).exp()
}

/// Draws the steps of both stages. A step depends on its number and the seed alone, so that nothing has to be kept to go on from any.
#[derive(Clone, Debug)]
pub struct Rf3dgsSchedule {
    config: Rf3dgsConfig,
    extent_m: f64,
    /// Of light, and of RF.
    epochs: [Epochs; 2],
}

impl Rf3dgsSchedule {
    /// For `views` uploaded views of a scene of this extent.
    pub fn new(config: &Rf3dgsConfig, extent_m: f64, seed: u64, views: usize) -> Self {
        Self { config: config.clone(), extent_m, epochs: [0, 1].map(|stage| Epochs::new(seed, views, stage)) }
    }

    /// Rate of positions in optical step `step` (from 1), metres: log-linear from the first to the last, which it then stays at.
    pub fn position_rate_m(&self, step: usize) -> f64 {
        self.extent_m * log_linear(self.config.rates.position.map(f64::from), self.config.rates.position_steps, step)
    }

    /// Highest degree of harmonics that is learnt in optical step `step` (from 1).
    pub fn degree(&self, step: usize) -> usize {
        (step / self.config.degree_interval).min(self.config.sh_degree)
    }

    /// The step of number `number` of both stages, from 1: light with its geometry first, then RF on frozen geometry.
    pub fn step(&mut self, number: usize) -> DenseStep {
        let radio = number > self.config.light_steps;
        let within = if radio { number - self.config.light_steps } else { number };
        let counted = if radio && self.config.radio_moments == RadioMoments::Zero { within } else { number };
        DenseStep {
            step: Step {
                view: self.epochs[usize::from(radio)].view(within),
                levels: [0; 2],
                light_weight: if radio { 0.0 } else { 1.0 },
                radio_weight: if radio { 1.0 } else { 0.0 },
                depth_weight: 0.0,
                train_geometry: !radio,
                light_background: [0.0; 3],
                radio_background: self.config.radio_background_color(),
            },
            number: counted.min(u32::MAX as usize) as u32,
            position_rate_m: if radio { 0.0 } else { self.position_rate_m(number) as f32 },
            degree: if radio { self.config.sh_degree } else { self.degree(number) },
            screen_gradients: !radio && self.config.density.watches(number),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rf_3dgs::RadioBackground;

    fn schedule(config: &Rf3dgsConfig) -> Rf3dgsSchedule {
        Rf3dgsSchedule::new(config, 5.0, 3, 7)
    }

    #[test]
    fn rates_and_degrees_are_the_published_ones() {
        let s = schedule(&Rf3dgsConfig::default());
        for (step, expected) in [(0, 1.6e-4), (15_000, 1.6e-5), (30_000, 1.6e-6), (35_000, 1.6e-6)] {
            assert!((s.position_rate_m(step) / (5.0 * expected) - 1.0).abs() < 1e-6, "{step}");
        }
        let degrees = [1, 999, 1000, 1999, 2000, 3000, 29_000].map(|step| s.degree(step));
        assert_eq!(degrees, [0, 0, 1, 1, 2, 3, 3]);
        // A shorter stage ends on the way down.
        let short = Rf3dgsConfig { light_steps: 15_000, ..Rf3dgsConfig::default() };
        assert!((schedule(&short).position_rate_m(15_000) / (5.0 * 1.6e-5) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn every_epoch_visits_every_view_once_and_a_step_depends_on_its_number_alone() {
        let config = Rf3dgsConfig { light_steps: 70, radio_steps: 70, ..Rf3dgsConfig::default() };
        let mut s = schedule(&config);
        let views: Vec<usize> = (1..=140).map(|n| s.step(n).step.view.0).collect();
        let mut orders = std::collections::BTreeSet::new();
        for epoch in views.chunks(7) {
            let mut sorted = epoch.to_vec();
            sorted.sort_unstable();
            assert_eq!(sorted, (0..7).collect::<Vec<_>>());
            orders.insert(epoch.to_vec());
        }
        // 7! orders: that two of twenty are the same happens once in 26 seeds, that three are practically never.
        assert!(orders.len() >= 18, "{} orders", orders.len());
        for number in [140, 3, 71, 70] {
            assert_eq!(schedule(&config).step(number).step.view.0, views[number - 1]);
        }
    }

    #[test]
    fn the_radio_stage_counts_on_as_published_and_from_the_start_when_corrected() {
        let published = Rf3dgsConfig::default();
        let corrected = Rf3dgsConfig {
            radio_moments: RadioMoments::Zero,
            radio_background: RadioBackground::Floor,
            ..Rf3dgsConfig::default()
        };
        let (a, b) = (schedule(&published).step(30_001), schedule(&corrected).step(30_001));
        assert_eq!((a.number, b.number), (30_001, 1));
        assert_eq!((a.step.radio_background, b.step.radio_background), ([0.0; 3], corf_scene::color::jet(0.0)));
        for s in [a, b] {
            assert_eq!((s.degree, s.step.train_geometry, s.screen_gradients), (3, false, false));
            assert_eq!((s.step.light_weight, s.step.radio_weight, s.step.levels), (0.0, 1.0, [0; 2]));
        }
        let (light, late) = (schedule(&published).step(1), schedule(&published).step(20_000));
        assert_eq!((light.number, light.degree, light.step.train_geometry, light.screen_gradients), (1, 0, true, true));
        assert!(!late.screen_gradients && late.step.light_background == [0.0; 3]);
    }
}
