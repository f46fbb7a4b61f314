//! The optimiser of stock 3D Gaussian splatting (Kerbl et al. 2023) beside the sparse one: dense Adam with bias correction, and what adaptive
//! density control asks of a device.

use super::Step;
use crate::{Error, OptimizerConfig, Result};

/// One step of dense Adam: the Gaussians that the step does not see are stepped with a gradient of zero, so that their moments decay and their
/// momentum moves them, as the published implementation does. It trains one modality, and the opacity and colour of the other stay as they are.
///
/// Rates are the device's own, but for that of positions, which does not decay with a Gaussian's visits.
#[derive(Clone, Copy, Debug)]
pub struct DenseStep {
    /// View, level, weights and background; the weight of one modality is 0.
    pub step: Step,
    /// t of the bias correction `1 − βᵗ`, counted from 1.
    pub number: u32,
    /// Rate of positions in this step, metres.
    pub position_rate_m: f32,
    /// Highest degree of harmonics that has a gradient in this step; coefficients of higher ones are not touched while they are zero.
    pub degree: usize,
    /// Whether the step adds to the [`ScreenGradient`]s.
    pub screen_gradients: bool,
}

/// Positional gradient of a Gaussian on the screen, summed over the steps that asked for it since the Gaussians held last changed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct ScreenGradient {
    /// Σ ‖∂L/∂m‖ over those of the steps in which it was visible; m is its projected mean in normalised device coordinates, in which an image is
    /// two wide and two high: pixel gradients times half the width and half the height.
    pub norm_sum: f32,
    /// The number of those steps.
    pub steps: u32,
}

impl ScreenGradient {
    /// The mean norm; 0 of a Gaussian that no step has seen.
    pub fn mean(&self) -> f32 {
        if self.steps == 0 { 0.0 } else { self.norm_sum / self.steps as f32 }
    }

    /// Refuses other than one of each Gaussian.
    pub(crate) fn check_all(gradients: &[Self], held: usize) -> Result<()> {
        if gradients.len() == held {
            return Ok(());
        }
        let what = format!("{} for {held} Gaussians", gradients.len());
        Err(Error::invalid("screen-space gradients", what, "give one of each Gaussian"))
    }
}

/// A copy to be made of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Duplicate {
    /// Number of the Gaussian that is copied.
    pub source: u32,
    /// Displacement of the copy along the Gaussian's own axes, in standard deviations.
    pub offset: [f32; 3],
    /// Divisor of the copy's standard deviations.
    pub shrink: f32,
}

impl Duplicate {
    /// Geometry and opacities of the copy from the source's: position (3), quaternion (4), ln scale (3), opacity logits (2).
    pub(crate) fn core(&self, source: &[f32; 12]) -> [f32; 12] {
        let mut out = *source;
        let q = glam::Quat::from_xyzw(source[4], source[5], source[6], source[3]).normalize();
        let along = glam::Vec3::from_array([0, 1, 2].map(|k| self.offset[k] * source[7 + k].exp()));
        let moved = glam::Vec3::new(source[0], source[1], source[2]) + q * along;
        out[..3].copy_from_slice(&moved.to_array());
        let less = self.shrink.ln();
        out[7..10].iter_mut().for_each(|s| *s -= less);
        out
    }

    /// Refuses copies of Gaussians that are not held.
    pub(crate) fn check_all(duplicates: &[Self], held: usize) -> Result<()> {
        match duplicates.iter().find(|d| d.source as usize >= held) {
            None => Ok(()),
            Some(d) => {
                let what = format!("Gaussian {} of {held} is to be copied", d.source);
                Err(Error::invalid("duplicates", what, "name Gaussians that the device holds"))
            }
        }
    }
}

impl DenseStep {
    /// Refuses a step that trains both modalities or none, or has no place in a bias correction.
    pub(crate) fn check(&self) -> Result<()> {
        let place = || format!("dense training step {}", self.number);
        let trained = [self.step.light_weight, self.step.radio_weight].iter().filter(|w| **w > 0.0).count();
        if trained != 1 {
            return Err(Error::invalid(
                place(),
                format!("{trained} modalities are trained"),
                "train one: the other's weight is 0",
            ));
        }
        if self.number == 0 || !(self.position_rate_m.is_finite() && self.position_rate_m >= 0.0) {
            let what = format!("a position rate of {} m", self.position_rate_m);
            return Err(Error::invalid(place(), what, "count steps from 1 and give a finite rate ≥ 0"));
        }
        Ok(())
    }

    /// The constants of sparse Adam that make its arithmetic a bias-corrected step:
    /// `m̂/(√v̂ + ε) = √(1−β₂ᵗ)/(1−β₁ᵗ) · m/(√v + ε√(1−β₂ᵗ))`.
    pub fn constants(&self, config: &OptimizerConfig) -> OptimizerConfig {
        let rest = |beta: f32| 1.0 - f64::from(beta).powi(self.number.min(i32::MAX as u32) as i32);
        let root = rest(config.beta2).sqrt();
        let factor = root / rest(config.beta1);
        let scaled = |rate: f32| (f64::from(rate) * factor) as f32;
        let mut out = *config;
        out.position_rate_m = scaled(self.position_rate_m);
        out.position_decay = 0.0;
        (out.log_scale_rate, out.rotation_rate) = (scaled(config.log_scale_rate), scaled(config.rotation_rate));
        for rates in [&mut out.light, &mut out.radio] {
            (rates.sh_dc, rates.opacity) = (scaled(rates.sh_dc), scaled(rates.opacity));
        }
        out.epsilon = (f64::from(config.epsilon) * root) as f32;
        out
    }

    /// Coefficients of a channel that have a gradient.
    pub(crate) fn coefficients(&self) -> usize {
        (self.degree + 1) * (self.degree + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// f32 rounding of a handful of operations on numbers near 1.
    const ROUNDING: f32 = 1e-6;

    #[test]
    fn a_copy_is_displaced_along_its_own_axes_and_shrunk() {
        // A quarter turn about z takes the first axis, 0.5 m long, to world y.
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let source = [1.0, 2.0, 3.0, 2.0 * half, 0.0, 0.0, 2.0 * half, 0.5f32.ln(), 0.2f32.ln(), 0.1f32.ln(), 0.7, -0.3];
        let moved = Duplicate { source: 0, offset: [2.0, 0.0, -1.0], shrink: 1.6 }.core(&source);
        for (k, expected) in [1.0, 3.0, 2.9].into_iter().enumerate() {
            assert!((moved[k] - expected).abs() < ROUNDING * 4.0, "{moved:?}");
        }
        assert_eq!(moved[3..7], source[3..7]);
        assert!((moved[7].exp() - 0.5 / 1.6).abs() < ROUNDING);
        assert_eq!(moved[10..], source[10..]);
        assert_eq!(Duplicate { source: 0, offset: [0.0; 3], shrink: 1.0 }.core(&source), source);
        assert!(Duplicate::check_all(&[Duplicate { source: 3, offset: [0.0; 3], shrink: 1.0 }], 3).is_err());
    }
}
