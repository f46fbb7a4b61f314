//! Schedule of the optimisation steps: keyframe, pyramid levels and depth weight of each (paper, Training Strategy).

use crate::{
    config::ReconstructionConfig,
    device::{Step, ViewId},
    stage,
};
use corf_scene::Rng;
use serde::{Deserialize, Serialize};

/// η that has decayed below this share of its first value (after 66 visits of a keyframe at 0.9) moves nothing and still costs time: it counts
/// as 0.
const LEAST_DEPTH_DECAY: f32 = 1e-3;

/// Loss weights of one stage of the optimisation, and whether it updates geometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageWeights {
    /// Weight of the optical loss.
    pub light: f32,
    /// Weight of the RF loss.
    pub radio: f32,
    /// Whether the inverse-depth term takes part.
    pub depth: bool,
    /// Whether geometry is updated.
    pub geometry: bool,
}

/// The state from which steps are drawn: the buffer of keyframes with their visits, and a counter of steps that keys the random numbers.
#[derive(Clone, Debug)]
pub struct Schedule {
    seed: u64,
    steps_drawn: u64,
    views: Vec<(ViewId, usize)>,
    radio_floor: [f32; 3],
    /// η at the first visit, in this world's units.
    depth_weight: f32,
    /// Keyframe and pyramid levels of every online step, in order: what a second stage repeats.
    online: Vec<(ViewId, [u32; 2])>,
}

/// Saved state of a [`Schedule`]: the steps drawn so far.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScheduleState {
    steps_drawn: u64,
    visits: Vec<usize>,
    online: Vec<(usize, [u32; 2])>,
}

impl Schedule {
    /// The state to be saved: the steps drawn so far.
    pub fn state(&self) -> ScheduleState {
        ScheduleState {
            steps_drawn: self.steps_drawn,
            visits: self.views.iter().map(|v| v.1).collect(),
            online: self.online.iter().map(|(view, levels)| (view.0, *levels)).collect(),
        }
    }

    /// Goes on as if a schedule with the same views had drawn it; views beyond those it knew are new.
    pub fn restore(&mut self, state: &ScheduleState) {
        self.steps_drawn = state.steps_drawn;
        self.views.iter_mut().zip(&state.visits).for_each(|(view, visits)| view.1 = *visits);
        self.online = state.online.iter().map(|&(view, levels)| (ViewId(view), levels)).collect();
    }

    /// An empty buffer.
    pub fn new(seed: u64, radio_floor: [f32; 3]) -> Self {
        Self { seed, steps_drawn: 0, views: Vec::new(), radio_floor, depth_weight: 0.0, online: Vec::new() }
    }

    /// Adds the latest keyframe.
    pub fn push(&mut self, view: ViewId) {
        self.views.push((view, 0));
    }

    /// Sets η of a first visit; it is given in the published world's units and depends on the metric scale.
    pub fn set_depth_weight(&mut self, weight: f32) {
        self.depth_weight = weight;
    }

    /// Number of online steps so far.
    pub fn online_steps(&self) -> usize {
        self.online.len()
    }

    /// Online steps `range` once more with other weights: a second stage sees the same keyframes at the same pyramid levels in the same
    /// order as the first, so that the stages differ in what they train and in nothing else.
    pub fn replay(&self, range: std::ops::Range<usize>, weights: StageWeights) -> Vec<Step> {
        let step = |&(view, levels): &(ViewId, [u32; 2])| Step {
            view,
            levels,
            light_weight: weights.light,
            radio_weight: weights.radio,
            depth_weight: 0.0,
            train_geometry: weights.geometry,
            light_background: [0.0; 3],
            radio_background: self.radio_floor,
        };
        self.online[range].iter().map(step).collect()
    }

    /// Keyframes in the buffer.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether the buffer is empty.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// The next `count` online steps: the latest keyframe with probability `latest_probability`, otherwise any of the buffer. None while it is empty.
    pub fn online(
        &mut self,
        count: usize,
        latest_probability: f32,
        weights: StageWeights,
        config: &ReconstructionConfig,
    ) -> Vec<Step> {
        if self.views.is_empty() {
            return Vec::new();
        }
        (0..count)
            .map(|_| {
                let mut rng = Rng::keyed(self.seed, stage::STEPS, self.steps_drawn);
                let latest = self.views.len() - 1;
                let which = if rng.uniform() < latest_probability { latest } else { rng.below(self.views.len()) };
                let step = self.visit(which, weights, config, &mut rng);
                self.online.push((step.view, step.levels));
                step
            })
            .collect()
    }

    /// One epoch: every keyframe once at full resolution, in a random order.
    pub fn epoch(&mut self, weights: StageWeights, config: &ReconstructionConfig) -> Vec<Step> {
        let mut rng = Rng::keyed(self.seed, stage::EPOCHS, self.steps_drawn);
        let mut order: Vec<usize> = (0..self.views.len()).collect();
        // Fisher–Yates.
        for i in (1..order.len()).rev() {
            order.swap(i, rng.below(i + 1));
        }
        order
            .into_iter()
            .map(|which| {
                let mut rng = Rng::keyed(self.seed, stage::STEPS, self.steps_drawn);
                Step { levels: [0; 2], ..self.visit(which, weights, config, &mut rng) }
            })
            .collect()
    }

    /// A step of a keyframe.
    fn visit(&mut self, which: usize, weights: StageWeights, config: &ReconstructionConfig, rng: &mut Rng) -> Step {
        self.steps_drawn += 1;
        let (view, visits) = &mut self.views[which];
        // A keyframe moves one level finer after every `visits_per_level` of its own visits.
        let coarsest = config.pyramid_levels - 1;
        let level = coarsest.saturating_sub((*visits / config.visits_per_level) as u32);
        let spared = level == 0 && !spread(*visits, config.finest_share.unwrap_or(1.0));
        let radio_level = level.min(config.radio_pyramid_levels.map_or(coarsest, |n| n - 1));
        let levels = [if spared { coarsest.min(1) } else { level }, radio_level];
        let decay = config.depth_weight_decay.powi((*visits).min(10_000) as i32);
        let depth_weight = if weights.depth && decay >= LEAST_DEPTH_DECAY { self.depth_weight * decay } else { 0.0 };
        *visits += 1;
        Step {
            view: *view,
            levels,
            light_weight: weights.light,
            radio_weight: weights.radio,
            depth_weight,
            train_geometry: weights.geometry,
            light_background: [rng.uniform(), rng.uniform(), rng.uniform()],
            radio_background: self.radio_floor,
        }
    }
}

/// Whether the k-th of many is among a share of them that is spread as evenly as whole numbers allow.
fn spread(k: usize, share: f32) -> bool {
    let taken_of = |count: usize| (count as f64 * f64::from(share)).floor() as usize;
    taken_of(k + 1) > taken_of(k)
}

#[cfg(test)]
mod tests {
    use super::*;

    const JOINT: StageWeights = StageWeights { light: 1.0, radio: 0.1, depth: true, geometry: true };

    fn schedule(views: usize, seed: u64) -> Schedule {
        let mut s = Schedule::new(seed, [0.0, 0.0, 0.5]);
        (0..views).for_each(|i| s.push(ViewId(i)));
        s.set_depth_weight(0.01);
        s
    }

    #[test]
    fn the_latest_keyframe_gets_its_share_and_the_rest_is_even() {
        let n = 20_000;
        let steps = schedule(10, 3).online(n, 0.2, JOINT, &ReconstructionConfig::default());
        let share = |v| steps.iter().filter(|s| s.view == ViewId(v)).count() as f64 / n as f64;
        // Binomial: 5σ of 0.28 over 20 000 draws is 0.016; 0.2 + 0.8/10 is the latest's share.
        assert!((share(9) - 0.28).abs() < 0.016, "{}", share(9));
        assert!((share(4) - 0.08).abs() < 0.0096, "{}", share(4));
    }

    #[test]
    fn a_keyframe_gets_finer_and_trusts_depth_less_with_its_own_visits() {
        let config = ReconstructionConfig::default();
        let steps = schedule(1, 1).online(17, 0.2, JOINT, &config);
        let levels: Vec<u32> = steps.iter().map(|s| s.levels[0]).collect();
        assert_eq!(levels, [2, 2, 2, 2, 2, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0]);
        assert!(steps.iter().all(|s| s.levels[1] == s.levels[0]));
        assert!((steps[3].depth_weight - 0.01 * 0.9f32.powi(3)).abs() < 1e-9);
        let later = schedule(1, 1).online(80, 0.2, JOINT, &config);
        assert!(later[65].depth_weight > 0.0 && later[66].depth_weight == 0.0, "0.9^65 is above a thousandth");
        assert_ne!(steps[0].light_background, steps[1].light_background);
        assert_eq!(steps[0].radio_background, [0.0, 0.0, 0.5]);
    }

    #[test]
    fn a_share_of_the_fine_visits_is_coarser_and_an_epoch_is_not() {
        let config = ReconstructionConfig { finest_share: Some(0.25), ..ReconstructionConfig::default() };
        let mut schedule = schedule(1, 1);
        let steps = schedule.online(50, 0.2, JOINT, &config);
        assert!(steps[10..].iter().all(|s| s.levels[1] == 0), "spectra are small: they stay");
        let levels: Vec<u32> = steps.iter().map(|s| s.levels[0]).collect();
        assert_eq!(levels[..10], [2, 2, 2, 2, 2, 1, 1, 1, 1, 1]);
        // A quarter in every run of four.
        assert!(levels[10..].chunks_exact(4).all(|run| run.iter().filter(|l| **l == 0).count() == 1), "{levels:?}");
        let fine = ReconstructionConfig { radio_pyramid_levels: Some(1), ..ReconstructionConfig::default() };
        let levels: Vec<[u32; 2]> = self::schedule(1, 1).online(11, 0.2, JOINT, &fine).iter().map(|s| s.levels).collect();
        assert_eq!([levels[0], levels[5], levels[10]], [[2, 0], [1, 0], [0, 0]], "the spectrum alone starts fine");
        assert_eq!(schedule.epoch(JOINT, &config)[0].levels, [0; 2]);
        let flat = ReconstructionConfig { pyramid_levels: 1, ..config };
        assert!(schedule.online(9, 0.2, JOINT, &flat).iter().all(|s| s.levels == [0; 2]));
    }

    #[test]
    fn an_epoch_visits_everyone_once_in_an_order_the_seed_decides() {
        let config = ReconstructionConfig::default();
        let order = |seed| schedule(12, seed).epoch(JOINT, &config).iter().map(|s| s.view.0).collect::<Vec<_>>();
        let mut sorted = order(1);
        sorted.sort_unstable();
        assert_eq!(sorted, (0..12).collect::<Vec<_>>());
        assert_ne!(order(1), order(2));
        assert_eq!(order(1), order(1));
    }
}
