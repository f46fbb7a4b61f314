//! The user's weights: a safetensors file, with the tensor names of the official code or of the transformers library.

use crate::files::tensors::Tensors;
use crate::image_networks::Layer;
use crate::{Error, Result};
use corf_scene::io;
use serde::Deserialize;
use std::path::Path;

const HELP: &str = "give the model.safetensors of Depth-Anything-V2 Small, Base or Large for relative depth, whole, with its own tensor names \
                    or those of the official code";

/// Replacements that turn the official tensor names into those of the transformers library, applied one after the other.
const RENAMED: [(&str, &str); 26] = [
    ("pretrained.cls_token", "backbone.embeddings.cls_token"),
    ("pretrained.pos_embed", "backbone.embeddings.position_embeddings"),
    ("pretrained.patch_embed.proj", "backbone.embeddings.patch_embeddings.projection"),
    ("pretrained.norm.", "backbone.layernorm."),
    ("pretrained.blocks.", "backbone.encoder.layer."),
    (".attn.proj.", ".attention.output.dense."),
    (".ls1.gamma", ".layer_scale1.lambda1"),
    (".ls2.gamma", ".layer_scale2.lambda1"),
    ("depth_head.projects.0", "neck.reassemble_stage.layers.0.projection"),
    ("depth_head.projects.1", "neck.reassemble_stage.layers.1.projection"),
    ("depth_head.projects.2", "neck.reassemble_stage.layers.2.projection"),
    ("depth_head.projects.3", "neck.reassemble_stage.layers.3.projection"),
    ("depth_head.resize_layers.0", "neck.reassemble_stage.layers.0.resize"),
    ("depth_head.resize_layers.1", "neck.reassemble_stage.layers.1.resize"),
    ("depth_head.resize_layers.3", "neck.reassemble_stage.layers.3.resize"),
    ("depth_head.scratch.layer1_rn", "neck.convs.0"),
    ("depth_head.scratch.layer2_rn", "neck.convs.1"),
    ("depth_head.scratch.layer3_rn", "neck.convs.2"),
    ("depth_head.scratch.layer4_rn", "neck.convs.3"),
    ("depth_head.scratch.refinenet1.out_conv", "neck.fusion_stage.layers.3.projection"),
    ("depth_head.scratch.refinenet2.out_conv", "neck.fusion_stage.layers.2.projection"),
    ("depth_head.scratch.refinenet3.out_conv", "neck.fusion_stage.layers.1.projection"),
    ("depth_head.scratch.refinenet4.out_conv", "neck.fusion_stage.layers.0.projection"),
    ("depth_head.scratch.output_conv1", "head.conv1"),
    ("depth_head.scratch.output_conv2.0", "head.conv2"),
    ("depth_head.scratch.output_conv2.2", "head.conv3"),
];

/// The name the transformers library gives to a tensor.
fn renamed(official: &str) -> String {
    // The residual units of fusion block n, which the library counts from the deepest.
    let unit = official.strip_prefix("depth_head.scratch.refinenet").and_then(|rest| rest.split_once(".resConfUnit"));
    if let Some((block, unit)) = unit {
        let deepest_first = 4 - block.parse::<usize>().unwrap_or(4).min(4);
        return format!("neck.fusion_stage.layers.{deepest_first}.residual_layer{}", unit.replace(".conv", ".convolution"));
    }
    RENAMED.iter().fold(official.to_owned(), |name, (from, to)| name.replace(from, to))
}

/// The parts of the transformers library's `config.json` that do not follow from the tensors' shapes.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Config {
    /// `relative`, or `metric` for a head that gives metres.
    pub depth_estimation_type: Option<String>,
    pub backbone_config: Backbone,
}

/// Its part about the transformer.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(super) struct Backbone {
    pub num_attention_heads: Option<usize>,
    /// Counted from 1, for 0 is the embedding.
    pub out_indices: Option<Vec<usize>>,
}

/// A file of tensors.
pub(super) struct Weights {
    tensors: Tensors,
    /// Whether the names are those of the transformers library.
    is_renamed: bool,
    /// The `config.json` beside the file, or one that says nothing.
    pub config: Config,
}

impl Weights {
    /// Reads a file, and the `config.json` in its folder if there is one.
    ///
    /// # Errors
    /// A file that cannot be read or is no safetensors file of this network; a `config.json` that is no JSON.
    pub fn read(path: &Path) -> Result<Self> {
        let tensors = Tensors::read(path, HELP)?;
        let (official, library) = ("pretrained.cls_token", renamed("pretrained.cls_token"));
        if !tensors.has(official) && !tensors.has(&library) {
            let what =
                format!("holds neither tensor `{official}` (official names) nor `{library}` (names of the transformers library)");
            return Err(tensors.fault(what));
        }
        let is_renamed = !tensors.has(official);
        let beside = path.with_file_name("config.json");
        let config = if beside.exists() {
            serde_json::from_str(&io::read_text(&beside)?)
                .map_err(|e| Error::invalid(beside.display().to_string(), e.to_string(), "restore it, or remove it"))?
        } else {
            Config::default()
        };
        Ok(Self { tensors, is_renamed, config })
    }

    /// An error about this file.
    pub fn fault(&self, what: impl Into<String>, help: &str) -> Error {
        self.tensors.fault_with(what, help)
    }

    fn name(&self, official: &str) -> String {
        if self.is_renamed { renamed(official) } else { official.to_owned() }
    }

    /// Whether a tensor is there, by its official name.
    pub fn has(&self, official: &str) -> bool {
        self.tensors.has(&self.name(official))
    }

    /// The size of a tensor of `N` axes, by its official name.
    ///
    /// # Errors
    /// It is missing, or has another number of axes.
    pub fn shape<const N: usize>(&self, official: &str) -> Result<[usize; N]> {
        self.tensors.shape(&self.name(official))
    }

    /// A tensor's values, by its official name.
    ///
    /// # Errors
    /// It is missing, has another shape, or is of a type that is not read.
    pub fn values(&self, official: &str, shape: &[usize]) -> Result<Vec<f32>> {
        self.tensors.values(&self.name(official), shape)
    }

    /// A linear layer.
    ///
    /// # Errors
    /// Those of [`Self::values`].
    pub fn linear(&self, official: &str, inputs: usize, outputs: usize) -> Result<Layer> {
        let weights = self.values(&format!("{official}.weight"), &[outputs, inputs])?;
        Ok(Layer { inputs, outputs, weights, bias: self.values(&format!("{official}.bias"), &[outputs])? })
    }

    /// The layer of a block that gives queries, keys and values of `width` each, which the transformers library keeps apart.
    ///
    /// # Errors
    /// Those of [`Self::values`].
    pub fn queries_keys_values(&self, block: usize, width: usize) -> Result<Layer> {
        if !self.is_renamed {
            return self.linear(&format!("pretrained.blocks.{block}.attn.qkv"), width, 3 * width);
        }
        let mut layer = Layer { inputs: width, outputs: 3 * width, weights: vec![], bias: vec![] };
        for part in ["query", "key", "value"] {
            let name = format!("backbone.encoder.layer.{block}.attention.attention.{part}");
            layer.weights.extend(self.tensors.values(&format!("{name}.weight"), &[width, width])?);
            layer.bias.extend(self.tensors.values(&format!("{name}.bias"), &[width])?);
        }
        Ok(layer)
    }

    /// A convolution of `side × side` pixels, its inputs in the order (row, column, channel).
    ///
    /// # Errors
    /// Those of [`Self::values`].
    pub fn convolution(&self, official: &str, [inputs, outputs, side]: [usize; 3], has_bias: bool) -> Result<Layer> {
        let bias = has_bias.then(|| self.name(&format!("{official}.bias")));
        self.tensors.convolution(&self.name(&format!("{official}.weight")), bias.as_deref(), [inputs, outputs, side])
    }

    /// A transposed convolution of `channels` to as many whose kernel and stride are `side`, its outputs in the order (row, column, channel).
    ///
    /// # Errors
    /// Those of [`Self::values`].
    pub fn transposed(&self, official: &str, channels: usize, side: usize) -> Result<Layer> {
        let area = side * side;
        let values = self.values(&format!("{official}.weight"), &[channels, channels, side, side])?;
        let (mut weights, mut bias) = (Vec::with_capacity(values.len()), Vec::with_capacity(area * channels));
        let own = self.values(&format!("{official}.bias"), &[channels])?;
        for k in 0..area {
            for out in 0..channels {
                weights.extend((0..channels).map(|c| values[(c * channels + out) * area + k]));
            }
            bias.extend(&own);
        }
        Ok(Layer { inputs: channels, outputs: area * channels, weights, bias })
    }
}
