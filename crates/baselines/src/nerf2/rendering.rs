//! The complex sum along a ray, and its gradient.
//!
//! ```text
//! P = | Σ_k s_k e^{jφ_k} · e^{−Σ_{i<k} a_i δ_i} · e^{jΣ_{i<k} θ_i δ_i} · 0.025 / r_{k+1} |,    δ_k = r_{k+1} − r_k
//! ```
//! with a, s = |LeakyReLU(·)| and θ, φ = 2π·sigmoid(·) of the network's outputs. The last sample's r_{k+1} is infinite in the published code,
//! so that it counts for nothing; with an end of the ray it is that.

use crate::mlp::Activation;
use corf::numeric::Real;
use std::f64::consts::TAU;

/// Free-space factor at one metre of the published code, metres (λ/4π at 955 MHz); a scale that the amplitudes take up.
pub const FREE_SPACE_M: f64 = 0.025;

/// The network's outputs along one ray, two numbers a sample: amplitude and phase before their activations.
#[derive(Clone, Copy, Debug)]
pub struct RayOutputs<'a, T> {
    /// Attenuation and phase per metre.
    pub attenuation: &'a [T],
    /// Signal that a sample sends.
    pub signal: &'a [T],
}

/// |LeakyReLU(z)| and its derivative.
fn magnitude<T: Real>(z: T) -> [T; 2] {
    let y = Activation::LeakyRelu.apply(z);
    let slope = Activation::LeakyRelu.slope(y);
    if y < T::ZERO { [-y, -slope] } else { [y, slope] }
}

/// 2π·sigmoid(z) and its derivative.
fn angle<T: Real>(z: T) -> [T; 2] {
    let y = Activation::Sigmoid.apply(z);
    [T::of(TAU) * y, T::of(TAU) * Activation::Sigmoid.slope(y)]
}

/// r_{k+1} − r_k, and 0.025 / r_{k+1}; of the last sample 0, and what the end says.
fn segment<T: Real>(distances: &[T], end: Option<T>, k: usize) -> [T; 2] {
    let loss = |r: T| T::of(FREE_SPACE_M) / r;
    match distances.get(k + 1) {
        Some(&next) => [next - distances[k], loss(next)],
        None => [T::ZERO, end.map_or(T::ZERO, loss)],
    }
}

/// The sum along one ray: its magnitude, and what the gradient needs of it.
#[derive(Clone, Debug)]
pub struct Sum<T> {
    /// P.
    pub amplitude: T,
    /// Real and imaginary part of every sample's term for s = 1.
    units: Vec<[T; 2]>,
    /// The sum's direction in the complex plane; zero where the sum is.
    direction: [T; 2],
}

impl<T: Real> Sum<T> {
    /// Sums up; `distances` are those of the samples, metres, and `end` is where the last one's segment ends, if it counts.
    pub fn new(outputs: RayOutputs<'_, T>, distances: &[T], end: Option<T>) -> Self {
        let (mut depth, mut turned) = (T::ZERO, T::ZERO);
        let mut sum = [T::ZERO; 2];
        let mut units = Vec::with_capacity(distances.len());
        for k in 0..distances.len() {
            let [length, loss] = segment(distances, end, k);
            let ([s, _], [phase, _]) = (magnitude(outputs.signal[2 * k]), angle(outputs.signal[2 * k + 1]));
            let weight = (-depth).exp() * loss;
            let (sin, cos) = (phase + turned).sin_cos();
            let unit = [weight * cos, weight * sin];
            sum = [sum[0] + s * unit[0], sum[1] + s * unit[1]];
            units.push(unit);
            let ([a, _], [theta, _]) = (magnitude(outputs.attenuation[2 * k]), angle(outputs.attenuation[2 * k + 1]));
            depth += a * length;
            turned += theta * length;
        }
        let amplitude = (sum[0] * sum[0] + sum[1] * sum[1]).sqrt();
        let direction = if amplitude > T::ZERO { sum.map(|v| v / amplitude) } else { [T::ZERO; 2] };
        Self { amplitude, units, direction }
    }

    /// Writes the gradient in the network's outputs, given that in P; the arguments are those of [`Self::new`].
    pub fn backward(
        &self,
        outputs: RayOutputs<'_, T>,
        distances: &[T],
        end: Option<T>,
        gradient: T,
        [attenuation, signal]: [&mut [T]; 2],
    ) {
        let [ux, uy] = self.direction;
        // Σ over samples behind k of what each adds along the sum, and across it.
        let (mut along_behind, mut across_behind) = (T::ZERO, T::ZERO);
        for k in (0..distances.len()).rev() {
            let [length, _] = segment(distances, end, k);
            let [x, y] = self.units[k];
            let (by_s, across) = (ux * x + uy * y, ux * y - uy * x);
            let ([s, ds], [_, dphase]) = (magnitude(outputs.signal[2 * k]), angle(outputs.signal[2 * k + 1]));
            let ([_, da], [_, dtheta]) = (magnitude(outputs.attenuation[2 * k]), angle(outputs.attenuation[2 * k + 1]));
            let (along, across) = (s * by_s, s * across);
            signal[2 * k] = gradient * by_s * ds;
            signal[2 * k + 1] = -gradient * across * dphase;
            attenuation[2 * k] = -gradient * along_behind * length * da;
            attenuation[2 * k + 1] = -gradient * across_behind * length * dtheta;
            along_behind += along;
            across_behind += across;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    const SAMPLES: usize = 9;

    fn drawn(seed: u64) -> ([Vec<f64>; 2], Vec<f64>) {
        let mut rng = Rng::keyed(seed, 0, 0);
        let outputs = [0, 1].map(|_| (0..2 * SAMPLES).map(|_| rng.normal()).collect());
        let distances = (0..SAMPLES).map(|k| 0.1 + 0.4 * k as f64 + 0.3 * rng.uniform_f64()).collect();
        (outputs, distances)
    }

    #[test]
    fn one_sample_is_its_amplitude_times_the_free_space_factor() {
        let outputs = RayOutputs { attenuation: &[5.0, 1.0, 0.0, 0.0f64], signal: &[3.0, 0.7, 100.0, 0.0] };
        let sum = Sum::new(outputs, &[1.0, 2.0], None);
        assert!((sum.amplitude - 3.0 * 0.025 / 2.0).abs() < 1e-15, "{sum:?}");
    }

    #[test]
    fn what_lies_in_front_attenuates_and_turns() {
        // Two equal sources; the first segment attenuates by e^{−ln 2} and turns by π: what is left is half of one, less the path.
        let half = std::f64::consts::LN_2;
        let outputs = RayOutputs { attenuation: &[half, 0.0, 0.0, 0.0, 0.0, 0.0], signal: &[1.0, 0.0, 1.0, 0.0, 0.0, 0.0f64] };
        let sum = Sum::new(outputs, &[1.0, 2.0, 3.0], None);
        let expected = 0.025 / 2.0 - 0.5 * 0.025 / 3.0;
        assert!((sum.amplitude - expected).abs() < 1e-12, "{} {expected}", sum.amplitude);
        // The last sample counts where the ray has an end.
        let outputs = RayOutputs { signal: &[1.0, 0.0, 1.0, 0.0, 1.0, 0.0], ..outputs };
        assert_eq!(Sum::new(outputs, &[1.0, 2.0, 3.0], None).amplitude, sum.amplitude);
        let longer = Sum::new(outputs, &[1.0, 2.0, 3.0], Some(3.5)).amplitude;
        // By then it has turned once round.
        assert!((longer - expected - 0.5 * 0.025 / 3.5).abs() < 1e-12, "{longer}");
    }

    #[test]
    fn gradients_are_those_of_finite_differences() {
        for (seed, end) in [(1, None), (2, Some(5.0))] {
            let (mut outputs, distances) = drawn(seed);
            let value = |o: &[Vec<f64>; 2]| Sum::new(RayOutputs { attenuation: &o[0], signal: &o[1] }, &distances, end);
            let mut gradient = [vec![0.0; 2 * SAMPLES], vec![0.0; 2 * SAMPLES]];
            let [a, s] = &mut gradient;
            value(&outputs).backward(
                RayOutputs { attenuation: &outputs[0], signal: &outputs[1] },
                &distances,
                end,
                1.7,
                [a.as_mut_slice(), s.as_mut_slice()],
            );
            const H: f64 = 1e-6;
            for head in 0..2 {
                for i in 0..2 * SAMPLES {
                    let kept = outputs[head][i];
                    outputs[head][i] = kept + H;
                    let up = value(&outputs).amplitude;
                    outputs[head][i] = kept - H;
                    let down = value(&outputs).amplitude;
                    outputs[head][i] = kept;
                    let expected = 1.7 * (up - down) / (2.0 * H);
                    assert!((gradient[head][i] - expected).abs() < 1e-8, "{head} {i}: {} {expected}", gradient[head][i]);
                }
            }
        }
    }

    #[test]
    fn silence_has_no_gradient_and_no_infinities() {
        let zeros = [0.0f32; 2 * SAMPLES];
        let outputs = RayOutputs { attenuation: &zeros, signal: &zeros };
        let distances: Vec<f32> = (0..SAMPLES).map(|k| k as f32 + 0.5).collect();
        let sum = Sum::new(outputs, &distances, None);
        let (mut a, mut s) = (zeros, zeros);
        sum.backward(outputs, &distances, None, 1.0, [&mut a, &mut s]);
        assert_eq!(sum.amplitude, 0.0);
        assert!(a.iter().chain(&s).all(|v| *v == 0.0));
    }
}
