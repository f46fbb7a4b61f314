//! The backbones: which layers images go through, and behind which of them they are compared.

use super::Backbone;
use crate::Result;
use crate::files::tensors::Tensors;
use crate::image_networks::{Layer, Map, MaxPool, Window};
use rayon::prelude::*;

/// Added to the length of a pixel's features before they are divided by it.
const EPSILON: f64 = 1e-10;

/// A step of a backbone with its weights.
pub(super) enum Step {
    /// A convolution and a rectifier.
    Convolution(Layer, Window),
    /// SqueezeNet's module (Iandola et al. 2016), each layer with a rectifier: few channels (1×1), then more of them (1×1 and 3×3, side by side).
    Fire(Box<[Layer; 3]>),
    Pool(MaxPool),
    /// Here two images are compared, with these weights of the channels.
    Comparison(Vec<f32>),
}

impl Step {
    /// The map behind the step.
    pub fn of(&self, map: Map) -> Map {
        match self {
            Self::Convolution(layer, window) => rectified(layer.convolve(&map, *window)),
            Self::Fire(layers) => {
                let [squeeze, one, three] = layers.as_ref();
                let few = rectified(squeeze.of_pixels(&map));
                rectified(beside(&one.of_pixels(&few), &three.convolve(&few, Window::three(1))))
            }
            Self::Pool(pool) => pool.of(&map),
            Self::Comparison(_) => map,
        }
    }

    /// Pixels along an axis behind the step; `None` where too few come in.
    pub fn places(&self, length: usize) -> Option<usize> {
        match self {
            Self::Convolution(_, window) => window.places(length),
            Self::Pool(pool) => pool.places(length),
            Self::Fire(_) | Self::Comparison(_) => Some(length),
        }
    }
}

fn rectified(mut map: Map) -> Map {
    map.rectify();
    map
}

/// The channels of two maps of one size, the first one's before the second one's.
fn beside(a: &Map, b: &Map) -> Map {
    let mut out = Map::zero(a.height, a.width, a.channels + b.channels);
    let pixels = a.values.par_chunks(a.channels).zip(b.values.par_chunks(b.channels));
    out.values.par_chunks_mut(a.channels + b.channels).zip(pixels).with_min_len(256).for_each(|(out, (a, b))| {
        let (left, right) = out.split_at_mut(a.len());
        left.copy_from_slice(a);
        right.copy_from_slice(b);
    });
    out
}

/// Mean over pixels of `Σ_c w_c (f̂ᵃ_c − f̂ᵇ_c)²`, f̂ being a pixel's features divided by their length.
pub(super) fn distance(weights: &[f32], [a, b]: &[Map; 2]) -> f64 {
    let length = |features: &[f32]| features.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt() + EPSILON;
    let of_pixel = |(a, b): (&[f32], &[f32])| -> f64 {
        let (unit_a, unit_b) = (1.0 / length(a), 1.0 / length(b));
        let difference = |(a, b): (&f32, &f32)| f64::from(*a) * unit_a - f64::from(*b) * unit_b;
        a.iter().zip(b).map(difference).zip(weights).map(|(d, w)| f64::from(*w) * d * d).sum()
    };
    let row = a.width * a.channels;
    let pixels = |(a, b): (&[f32], &[f32])| a.chunks_exact(weights.len()).zip(b.chunks_exact(weights.len())).map(of_pixel).sum();
    let rows: Vec<f64> = a.values.par_chunks(row).zip(b.values.par_chunks(row)).map(pixels).collect();
    rows.iter().sum::<f64>() / (a.height * a.width) as f64
}

/// A step without its weights; numbers of modules are torchvision's.
enum Plan {
    Convolution { module: usize, outputs: usize, window: Window },
    Fire { module: usize, few: usize, each: usize },
    Pool(MaxPool),
    Comparison,
}

fn plan(backbone: Backbone) -> Vec<Plan> {
    use Plan::{Comparison, Convolution, Fire, Pool};
    let convolution = |module, outputs, side, stride, border| {
        let window = Window { side, stride, border };
        Convolution { module, outputs, window }
    };
    let three = |module, outputs| convolution(module, outputs, 3, 1, 1);
    match backbone {
        // VGG-16 (Simonyan and Zisserman 2015): relu1_2, 2_2, 3_3, 4_3, 5_3.
        Backbone::Vgg => {
            let pool = || Pool(MaxPool { side: 2, stride: 2, beyond: false });
            let mut steps = vec![three(0, 64), three(2, 64), Comparison];
            steps.extend([pool(), three(5, 128), three(7, 128), Comparison]);
            steps.extend([pool(), three(10, 256), three(12, 256), three(14, 256), Comparison]);
            steps.extend([pool(), three(17, 512), three(19, 512), three(21, 512), Comparison]);
            steps.extend([pool(), three(24, 512), three(26, 512), three(28, 512), Comparison]);
            steps
        }
        // AlexNet as in Krizhevsky 2014: behind each rectifier.
        Backbone::Alex => {
            let pool = || Pool(MaxPool { side: 3, stride: 2, beyond: false });
            let mut steps = vec![convolution(0, 64, 11, 4, 2), Comparison];
            steps.extend([pool(), convolution(3, 192, 5, 1, 2), Comparison]);
            steps.extend([pool(), three(6, 384), Comparison, three(8, 256), Comparison, three(10, 256), Comparison]);
            steps
        }
        // SqueezeNet 1.1: the first rectifier, and fires 4, 7, 9, 10, 11, 12.
        Backbone::Squeeze => {
            let pool = || Pool(MaxPool { side: 3, stride: 2, beyond: true });
            let fire = |module, few, each| Fire { module, few, each };
            let mut steps = vec![convolution(0, 64, 3, 2, 0), Comparison];
            steps.extend([pool(), fire(3, 16, 64), fire(4, 16, 64), Comparison]);
            steps.extend([pool(), fire(6, 32, 128), fire(7, 32, 128), Comparison]);
            steps.extend([pool(), fire(9, 48, 192), Comparison, fire(10, 48, 192), Comparison]);
            steps.extend([fire(11, 64, 256), Comparison, fire(12, 64, 256), Comparison]);
            steps
        }
    }
}

/// A backbone's steps with the weights of a file.
///
/// # Errors
/// A tensor that is missing, has another shape than the backbone's, or holds what is no number.
pub(super) fn read(backbone: Backbone, tensors: &Tensors) -> Result<Vec<Step>> {
    let layer = |name: &str, shape| tensors.convolution(&format!("{name}.weight"), Some(&format!("{name}.bias")), shape);
    let (mut channels, mut comparisons) = (3, 0);
    let mut read = |step: Plan| -> Result<Step> {
        Ok(match step {
            Plan::Convolution { module, outputs, window } => {
                let inputs = std::mem::replace(&mut channels, outputs);
                Step::Convolution(layer(&format!("features.{module}"), [inputs, outputs, window.side])?, window)
            }
            Plan::Fire { module, few, each } => {
                let inputs = std::mem::replace(&mut channels, 2 * each);
                let part = |part: &str, shape| layer(&format!("features.{module}.{part}"), shape);
                let squeeze = part("squeeze", [inputs, few, 1])?;
                Step::Fire(Box::new([squeeze, part("expand1x1", [few, each, 1])?, part("expand3x3", [few, each, 3])?]))
            }
            Plan::Pool(pool) => Step::Pool(pool),
            Plan::Comparison => {
                let weights = tensors.values(&format!("lin{comparisons}.weight"), &[channels])?;
                comparisons += 1;
                Step::Comparison(weights)
            }
        })
    };
    plan(backbone).into_iter().map(&mut read).collect()
}
