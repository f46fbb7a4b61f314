//! Training a network: Adam with L2 weight decay (Kingma and Ba 2015; decay added to the gradient, as PyTorch's `Adam` does), and the
//! cosine schedule of its rate.

use corf::numeric::Real;
use corf::{Error, Result};
use std::f64::consts::PI;

/// Parameters with what the optimiser remembers of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained<T> {
    /// The network's parameters.
    pub parameters: Vec<T>,
    /// Running means of the gradient and of its square.
    pub moments: [Vec<T>; 2],
    /// Steps taken.
    pub steps: u64,
}

impl<T: Real> Trained<T> {
    /// Parameters that no step has been taken with.
    pub fn new(parameters: Vec<T>) -> Self {
        let moments = [vec![T::ZERO; parameters.len()], vec![T::ZERO; parameters.len()]];
        Self { parameters, moments, steps: 0 }
    }

    /// Refuses a state of other than so many parameters.
    pub(crate) fn check(&self, parameters: usize) -> Result<()> {
        let fits = |a: &Vec<T>| a.len() == parameters;
        if fits(&self.parameters) && self.moments.iter().all(fits) {
            return Ok(());
        }
        let what = format!("{} parameters where the network has {parameters}", self.parameters.len());
        Err(Error::invalid("network", what, "take the state of a network of the same shape"))
    }
}

/// Constants of the optimiser.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adam {
    /// Decay of the mean of gradients.
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    pub beta2: f64,
    /// Added to the root of the latter.
    pub epsilon: f64,
    /// Share of the parameters that is added to the gradient.
    pub weight_decay: f64,
}

impl Adam {
    /// The usual constants with a weight decay.
    pub fn with_decay(weight_decay: f64) -> Self {
        Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, weight_decay }
    }

    /// Factors of step number `step` (from 1): of the rate, rate / (1 − β₁ᵗ), and of the root of the second moment, 1 / √(1 − β₂ᵗ).
    pub fn factors(&self, step: u64, rate: f64) -> [f64; 2] {
        let left = |beta: f64| 1.0 - beta.powf(step as f64);
        [rate / left(self.beta1), 1.0 / left(self.beta2).sqrt()]
    }

    /// 1 − β₁ and 1 − β₂, which single precision would get wrong by 5e-5.
    pub(crate) fn gains(&self) -> [f64; 2] {
        [1.0 - self.beta1, 1.0 - self.beta2]
    }

    /// Takes a step.
    ///
    /// # Panics
    /// A gradient of another size.
    pub fn step<T: Real>(&self, trained: &mut Trained<T>, gradient: &[T], rate: f64) {
        assert_eq!(gradient.len(), trained.parameters.len(), "a gradient of the parameters' size");
        trained.steps += 1;
        let [rate, root] = self.factors(trained.steps, rate).map(T::of);
        let [beta1, beta2, epsilon, decay] = [self.beta1, self.beta2, self.epsilon, self.weight_decay].map(T::of);
        let [gain1, gain2] = self.gains().map(T::of);
        let [first, second] = &mut trained.moments;
        for (((p, g), m), v) in trained.parameters.iter_mut().zip(gradient).zip(first).zip(second) {
            let g = *g + decay * *p;
            *m = beta1 * *m + gain1 * g;
            *v = beta2 * *v + gain2 * g * g;
            *p = *p - rate * *m / (v.sqrt() * root + epsilon);
        }
    }
}

/// Cosine annealing: the rate falls from `rate` to `least` within `steps` steps, and rises again within as many.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cosine {
    /// Rate at step 0.
    pub rate: f64,
    /// Rate at step `steps`.
    pub least: f64,
    /// Half a period, at least 1.
    pub steps: u64,
}

impl Cosine {
    /// Rate of a step, counted from 0: least + (rate − least)·(1 + cos(π·step/steps))/2.
    pub fn at(&self, step: u64) -> f64 {
        let turn = (PI * step as f64 / self.steps as f64).cos();
        self.least + 0.5 * (self.rate - self.least) * (1.0 + turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_as_long_as_the_rate_and_decay_pulls_towards_zero() {
        let mut trained = Trained::new(vec![1.0f64, -2.0, 3.0]);
        Adam::with_decay(0.0).step(&mut trained, &[0.5, -1e-3, 0.0], 0.1);
        // m/√v is the gradient's sign at first; ε makes 1e-3 fall short of it by 1e-5.
        let expected = [0.9, -1.9, 3.0];
        assert!(trained.parameters.iter().zip(expected).all(|(p, e)| (p - e).abs() < 2e-6), "{trained:?}");
        let mut trained = Trained::new(vec![1.0f64, -2.0]);
        Adam::with_decay(0.01).step(&mut trained, &[0.0, 0.0], 0.1);
        assert!(trained.parameters[0] < 0.91 && trained.parameters[1] > -1.91, "{trained:?}");
    }

    #[test]
    fn a_second_step_follows_the_formula() {
        let adam = Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8, weight_decay: 0.0 };
        let mut trained = Trained::new(vec![0.0f64]);
        adam.step(&mut trained, &[1.0], 0.1);
        adam.step(&mut trained, &[2.0], 0.1);
        // By hand: m = 0.9·0.1 + 0.1·2, v = 0.99·0.01 + 0.01·4, corrected by 1 − 0.81 and 1 − 0.9801.
        let (m, v): (f64, f64) = (0.29 / 0.19, 0.0499 / 0.0199);
        assert!((trained.parameters[0] + 0.1 + 0.1 * m / v.sqrt()).abs() < 1e-8, "{trained:?}");
    }

    #[test]
    fn the_rate_falls_and_rises_again() {
        let cosine = Cosine { rate: 8e-4, least: 1e-6, steps: 10_000 };
        assert_eq!([0, 10_000, 20_000].map(|s| (1e7 * cosine.at(s)).round() / 1e7), [8e-4, 1e-6, 8e-4]);
        assert!((cosine.at(5_000) - 4.005e-4).abs() < 1e-9 && cosine.at(15_000) > cosine.at(12_000));
    }
}
