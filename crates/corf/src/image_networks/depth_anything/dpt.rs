//! The head: a dense prediction transformer's (Ranftl et al. 2021), which brings four maps of the patches together to one map of the pixels.

use super::ops::bilinear;
use super::vit::PATCH;
use super::weights::Weights;
use crate::Result;
use crate::image_networks::{Layer, Map, Window};

const HEAD: &str = "depth_head";

/// Two convolutions behind rectifiers, added to what they saw.
struct Residual([Layer; 2]);

impl Residual {
    fn read(weights: &Weights, name: &str, channels: usize) -> Result<Self> {
        let convolution = |k: usize| weights.convolution(&format!("{name}.conv{k}"), [channels, channels, 3], true);
        Ok(Self([convolution(1)?, convolution(2)?]))
    }

    fn of(&self, map: &Map) -> Map {
        let mut out = map.clone();
        for layer in &self.0 {
            out.rectify();
            out = layer.convolve(&out, Window::three(1));
        }
        out.add(map);
        out
    }
}

/// Joins a map with what comes from deeper, and enlarges the sum.
struct Fusion {
    /// Missing in the deepest, which has nothing to join.
    joined: Option<Residual>,
    refined: Residual,
    out: Layer,
}

/// Resampling of one of the four feature maps before the fusion.
enum Resized {
    /// Transposed convolution to 4 or 2 times the size.
    Spread(Layer, usize),
    Same,
    /// Convolution of stride 2, to half the size.
    Halved(Layer),
}

/// The whole head.
pub(super) struct Head {
    projected: [Layer; 4],
    resized: [Resized; 4],
    levelled: [Layer; 4],
    /// Fusion blocks from shallow to deep.
    fusions: [Fusion; 4],
    narrowed: Layer,
    last: [Layer; 2],
}

impl Head {
    /// Reads it, for a transformer of that width; its own sizes are those of its tensors.
    ///
    /// # Errors
    /// Tensors that are missing or do not fit together.
    pub fn read(weights: &Weights, width: usize) -> Result<Self> {
        let scratch = |part: &str| format!("{HEAD}.scratch.{part}");
        let [features, ..] = weights.shape::<4>(&scratch("layer1_rn.weight"))?;
        let mut channels = [0; 4];
        for (i, channels) in channels.iter_mut().enumerate() {
            [*channels, ..] = weights.shape::<4>(&format!("{HEAD}.projects.{i}.weight"))?;
        }
        let each = |read: &dyn Fn(usize) -> Result<Layer>| -> Result<[Layer; 4]> { Ok([read(0)?, read(1)?, read(2)?, read(3)?]) };
        let resize = |i: usize| format!("{HEAD}.resize_layers.{i}");
        let fusion = |i: usize| -> Result<Fusion> {
            let name = |part: &str| scratch(&format!("refinenet{}.{part}", i + 1));
            Ok(Fusion {
                joined: (i < 3).then(|| Residual::read(weights, &name("resConfUnit1"), features)).transpose()?,
                refined: Residual::read(weights, &name("resConfUnit2"), features)?,
                out: weights.convolution(&name("out_conv"), [features, features, 1], true)?,
            })
        };
        let [half, ..] = weights.shape::<4>(&scratch("output_conv1.weight"))?;
        let [few, ..] = weights.shape::<4>(&scratch("output_conv2.0.weight"))?;
        Ok(Self {
            projected: each(&|i| weights.convolution(&format!("{HEAD}.projects.{i}"), [width, channels[i], 1], true))?,
            resized: [
                Resized::Spread(weights.transposed(&resize(0), channels[0], 4)?, 4),
                Resized::Spread(weights.transposed(&resize(1), channels[1], 2)?, 2),
                Resized::Same,
                Resized::Halved(weights.convolution(&resize(3), [channels[3], channels[3], 3], true)?),
            ],
            levelled: each(&|i| weights.convolution(&scratch(&format!("layer{}_rn", i + 1)), [channels[i], features, 3], false))?,
            fusions: [fusion(0)?, fusion(1)?, fusion(2)?, fusion(3)?],
            narrowed: weights.convolution(&scratch("output_conv1"), [features, half, 3], true)?,
            last: [
                weights.convolution(&scratch("output_conv2.0"), [half, few, 3], true)?,
                weights.convolution(&scratch("output_conv2.2"), [few, 1, 1], true)?,
            ],
        })
    }

    /// Inverse depth up to scale and offset, not negative, of every pixel of the image that the patches are of.
    pub fn forward(&self, patches: &[Map; 4]) -> Map {
        let [a, b, c, d] = std::array::from_fn(|i| {
            let map = self.projected[i].of_pixels(&patches[i]);
            let map = match &self.resized[i] {
                Resized::Spread(layer, side) => layer.spread(&map, *side),
                Resized::Same => map,
                Resized::Halved(layer) => layer.convolve(&map, Window::three(2)),
            };
            self.levelled[i].convolve(&map, Window::three(1))
        });
        // Each is enlarged to the next one's size, and the last to twice its own.
        let size = |map: &Map| (map.height, map.width);
        let path = self.fusions[3].of(d, None, size(&c));
        let path = self.fusions[2].of(path, Some(&c), size(&b));
        let path = self.fusions[1].of(path, Some(&b), size(&a));
        let path = self.fusions[0].of(path, Some(&a), (2 * a.height, 2 * a.width));
        let map = self.narrowed.convolve(&path, Window::three(1));
        let mut map =
            self.last[0].convolve(&bilinear(&map, PATCH * patches[0].height, PATCH * patches[0].width), Window::three(1));
        map.rectify();
        let mut map = self.last[1].of_pixels(&map);
        map.rectify();
        map
    }
}

impl Fusion {
    fn of(&self, mut path: Map, map: Option<&Map>, (height, width): (usize, usize)) -> Map {
        if let (Some(joined), Some(map)) = (&self.joined, map) {
            path.add(&joined.of(map));
        }
        // The official code enlarges before this last layer, which is linear on each pixel: the other way round is the same for less.
        bilinear(&self.out.of_pixels(&self.refined.of(&path)), height, width)
    }
}
