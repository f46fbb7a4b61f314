//! The transformer: DINOv2 (Oquab et al. 2023), a vision transformer with layer scale, on patches of 14×14 pixels.

use super::ops::{attention, bicubic, gelu, layer_norm};
use super::weights::Weights;
use crate::Result;
use crate::image_networks::{Layer, Map};

/// Side of a patch, pixels.
pub(super) const PATCH: usize = 14;
/// ε of the layer normalisation, added to the variance.
const EPSILON: f32 = 1e-6;
/// Offset that the official code adds to the number of patches along an axis when it scales the positional embedding.
const STRETCH_OFFSET: f64 = 0.1;
/// Sizes of heads that all published sizes have.
const HEAD: usize = 64;

/// A normalisation's scale and shift.
struct Norm([Vec<f32>; 2]);

impl Norm {
    fn read(weights: &Weights, official: &str, width: usize) -> Result<Self> {
        Ok(Self([
            weights.values(&format!("{official}.weight"), &[width])?,
            weights.values(&format!("{official}.bias"), &[width])?,
        ]))
    }

    fn of(&self, rows: &[f32]) -> Vec<f32> {
        layer_norm(rows, &self.0[0], &self.0[1], EPSILON)
    }
}

/// One block: attention, then two layers on each token alone, each added to what it saw.
struct Block {
    norms: [Norm; 2],
    queries_keys_values: Layer,
    /// Its weights have the layer scale in them.
    attended: Layer,
    widened: Layer,
    /// Its weights have the layer scale in them.
    narrowed: Layer,
}

impl Block {
    fn read(weights: &Weights, block: usize, width: usize) -> Result<Self> {
        let name = |part: &str| format!("pretrained.blocks.{block}.{part}");
        // y ← γ·(W·x + b) is a layer of its own.
        let scaled = |mut layer: Layer, gamma: &str| -> Result<Layer> {
            let gamma = weights.values(&name(gamma), &[width])?;
            let rows = layer.weights.chunks_exact_mut(layer.inputs).zip(&mut layer.bias);
            for ((row, bias), gamma) in rows.zip(gamma) {
                row.iter_mut().for_each(|w| *w *= gamma);
                *bias *= gamma;
            }
            Ok(layer)
        };
        let [inner, _] = weights.shape(&name("mlp.fc1.weight"))?;
        Ok(Self {
            norms: [Norm::read(weights, &name("norm1"), width)?, Norm::read(weights, &name("norm2"), width)?],
            queries_keys_values: weights.queries_keys_values(block, width)?,
            attended: scaled(weights.linear(&name("attn.proj"), width, width)?, "ls1.gamma")?,
            widened: weights.linear(&name("mlp.fc1"), width, inner)?,
            narrowed: scaled(weights.linear(&name("mlp.fc2"), inner, width)?, "ls2.gamma")?,
        })
    }

    fn advance(&self, tokens: &mut [f32], heads: usize) {
        let add = |tokens: &mut [f32], more: Vec<f32>| tokens.iter_mut().zip(more).for_each(|(t, m)| *t += m);
        let qkv = self.queries_keys_values.of_rows(&self.norms[0].of(tokens));
        let values = attention(&qkv, self.attended.inputs, heads);
        add(tokens, self.attended.of_rows(&values));
        let mut wide = self.widened.of_rows(&self.norms[1].of(tokens));
        gelu(&mut wide);
        add(tokens, self.narrowed.of_rows(&wide));
    }
}

/// The whole transformer.
pub(super) struct Transformer {
    pub width: usize,
    heads: usize,
    patches: Layer,
    /// The class token, with its own positional embedding added.
    class: Vec<f32>,
    /// Embedding of each place of the square grid of patches that it was trained with.
    places: Map,
    blocks: Vec<Block>,
    /// After which blocks the four maps are taken.
    taken: [usize; 4],
    norm: Norm,
}

impl Transformer {
    /// Reads it; its size is that of its tensors.
    ///
    /// # Errors
    /// Tensors that are missing or do not fit together; a number of heads or of blocks that nothing says what to do with.
    pub fn read(weights: &Weights) -> Result<Self> {
        let [_, _, width] = weights.shape("pretrained.cls_token")?;
        let [_, positions, _] = weights.shape("pretrained.pos_embed")?;
        let side = (positions - 1).isqrt();
        if side == 0 || side * side + 1 != positions {
            return Err(weights.fault(
                format!("its positional embedding has {positions} places, which are no square and one"),
                "give weights with one embedding a patch and one of the class token",
            ));
        }
        let embedding = weights.values("pretrained.pos_embed", &[1, positions, width])?;
        let (own, places) = embedding.split_at(width);
        let class = weights.values("pretrained.cls_token", &[1, 1, width])?.iter().zip(own).map(|(c, p)| c + p).collect();
        let backbone = &weights.config.backbone_config;
        let heads = backbone.num_attention_heads.unwrap_or(width / HEAD);
        if heads == 0 || !width.is_multiple_of(heads) {
            return Err(weights.fault(
                format!("{heads} attention heads do not share {width} channels"),
                "give its config.json, with backbone_config.num_attention_heads, in the same folder",
            ));
        }
        let count = (0..).take_while(|i| weights.has(&format!("pretrained.blocks.{i}.norm1.weight"))).count();
        let listed = backbone.out_indices.as_ref().map(|list| list.iter().map(|i| i.wrapping_sub(1)).collect());
        let taken: Option<Vec<usize>> = listed.or_else(|| published_blocks(count).map(Vec::from));
        let taken = taken.and_then(|t| <[usize; 4]>::try_from(t).ok());
        let Some(taken) = taken.filter(|t| t.iter().all(|b| *b < count) && t.is_sorted_by(|a, b| a < b)) else {
            return Err(weights.fault(
                format!("nothing says which four of its {count} blocks give maps"),
                "published sizes have 12 or 24; for others give its config.json, with backbone_config.out_indices, in the same folder",
            ));
        };
        // Nothing after the last map is needed.
        let blocks = (0..=taken[3]).map(|i| Block::read(weights, i, width)).collect::<Result<_>>()?;
        Ok(Self {
            width,
            heads,
            patches: weights.convolution("pretrained.patch_embed.proj", [3, width, PATCH], true)?,
            class,
            places: Map { height: side, width: side, channels: width, values: places.to_vec() },
            blocks,
            taken,
            norm: Norm::read(weights, "pretrained.norm", width)?,
        })
    }

    /// Four maps of the patches, from shallow to deep. `image` has three channels and sides that are multiples of [`PATCH`].
    pub fn forward(&self, image: &Map) -> [Map; 4] {
        let (height, width) = (image.height / PATCH, image.width / PATCH);
        let line = PATCH * image.channels;
        let mut pixels = Vec::with_capacity(image.values.len());
        for at in 0..height * width {
            let (x, y) = (at % width, at / width);
            for row in 0..PATCH {
                pixels.extend(&image.values[((y * PATCH + row) * image.width + x * PATCH) * image.channels..][..line]);
            }
        }
        let mut patches = Map { height, width, channels: self.width, values: self.patches.of_rows(&pixels) };
        patches.add(&self.places_of(height, width));
        let mut tokens = self.class.clone();
        tokens.extend(&patches.values);
        let mut maps = Vec::with_capacity(self.taken.len());
        for (i, block) in self.blocks.iter().enumerate() {
            block.advance(&mut tokens, self.heads);
            if self.taken.contains(&i) {
                let values = self.norm.of(&tokens[self.width..]);
                maps.push(Map { height, width, channels: self.width, values });
            }
        }
        let mut maps = maps.into_iter();
        std::array::from_fn(|_| maps.next().unwrap_or_else(|| Map::zero(height, width, self.width)))
    }

    /// The positional embedding of a grid of another shape, as the official code has it: stretched by (patches + 0.1)/side, which is not quite the
    /// ratio of the sizes.
    fn places_of(&self, height: usize, width: usize) -> Map {
        let side = self.places.height;
        if (height, width) == (side, side) {
            return self.places.clone();
        }
        let step = |patches: usize| side as f64 / (patches as f64 + STRETCH_OFFSET);
        bicubic(&self.places, [height, width], [step(height), step(width)])
    }
}

/// After which blocks the published sizes give their maps.
fn published_blocks(count: usize) -> Option<[usize; 4]> {
    match count {
        12 => Some([2, 5, 8, 11]),
        24 => Some([4, 11, 17, 23]),
        _ => None,
    }
}
