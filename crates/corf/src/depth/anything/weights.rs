//! The user's weights: a safetensors file, with the tensor names of the official code or of the transformers library.
//!
//! The format (github.com/huggingface/safetensors, "Format"): the header's length in 8 little-endian bytes, the header in JSON (name to type, shape and
//! range of bytes), the bytes.

use super::ops::Layer;
use crate::{Error, Result};
use corf_scene::io;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

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

/// A tensor's entry in the header.
#[derive(Deserialize)]
struct Entry {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

/// Tensors by name: their entries, and where their bytes are.
type Entries = BTreeMap<String, (Entry, Range<usize>)>;

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
    path: PathBuf,
    bytes: Vec<u8>,
    entries: Entries,
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
        let (entries, bytes) = read_safetensors(path)?;
        let has = |name: &str| entries.contains_key(name);
        let (official, library) = ("pretrained.cls_token", renamed("pretrained.cls_token"));
        if !has(official) && !has(&library) {
            let what =
                format!("holds neither tensor `{official}` (official names) nor `{library}` (names of the transformers library)");
            return Err(Error::invalid(path.display().to_string(), what, HELP));
        }
        let is_renamed = !has(official);
        let beside = path.with_file_name("config.json");
        let config = if beside.exists() {
            serde_json::from_str(&io::read_text(&beside)?)
                .map_err(|e| Error::invalid(beside.display().to_string(), e.to_string(), "restore it, or remove it"))?
        } else {
            Config::default()
        };
        Ok(Self { path: path.to_owned(), bytes, entries, is_renamed, config })
    }

    /// An error about this file.
    pub fn fault(&self, what: impl Into<String>, help: &str) -> Error {
        Error::invalid(self.path.display().to_string(), what, help)
    }

    fn name(&self, official: &str) -> String {
        if self.is_renamed { renamed(official) } else { official.to_owned() }
    }

    fn entry(&self, name: &str) -> Result<&(Entry, Range<usize>)> {
        self.entries.get(name).ok_or_else(|| self.fault(format!("tensor `{name}` is missing"), HELP))
    }

    /// Whether a tensor is there, by its official name.
    pub fn has(&self, official: &str) -> bool {
        self.entries.contains_key(&self.name(official))
    }

    /// The size of a tensor of `N` axes, by its official name.
    ///
    /// # Errors
    /// It is missing, or has another number of axes.
    pub fn shape<const N: usize>(&self, official: &str) -> Result<[usize; N]> {
        let name = self.name(official);
        let shape = &self.entry(&name)?.0.shape;
        shape.as_slice().try_into().ok().filter(|s: &[usize; N]| !s.contains(&0)).ok_or_else(|| {
            self.fault(format!("tensor `{name}` has shape {shape:?}, and {N} axes of at least 1 are needed"), HELP)
        })
    }

    /// A tensor's values, by its official name.
    ///
    /// # Errors
    /// It is missing, has another shape, or is of a type that is not read.
    pub fn values(&self, official: &str, shape: &[usize]) -> Result<Vec<f32>> {
        self.values_named(&self.name(official), shape)
    }

    fn values_named(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let (entry, range) = self.entry(name)?;
        if entry.shape != shape {
            return Err(self.fault(format!("tensor `{name}` has shape {:?}, and {shape:?} is needed", entry.shape), HELP));
        }
        let data = &self.bytes[range.clone()];
        let pair = |b: &[u8]| [b[0], b[1]];
        let values: Vec<f32> = match entry.dtype.as_str() {
            "F32" => data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
            "F16" => data.chunks_exact(2).map(|b| half::f16::from_le_bytes(pair(b)).to_f32()).collect(),
            "BF16" => data.chunks_exact(2).map(|b| half::bf16::from_le_bytes(pair(b)).to_f32()).collect(),
            other => {
                return Err(self.fault(format!("tensor `{name}` is of type {other}"), "types F32, F16 and BF16 are read"));
            }
        };
        if values.len() != shape.iter().product::<usize>() {
            return Err(self.fault(format!("tensor `{name}` has {} values for shape {shape:?}", values.len()), HELP));
        }
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.fault(format!("tensor `{name}` has {} at place {i}", values[i]), HELP)),
            None => Ok(values),
        }
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
            layer.weights.extend(self.values_named(&format!("{name}.weight"), &[width, width])?);
            layer.bias.extend(self.values_named(&format!("{name}.bias"), &[width])?);
        }
        Ok(layer)
    }

    /// A convolution of `side × side` pixels, its inputs in the order (row, column, channel).
    ///
    /// # Errors
    /// Those of [`Self::values`].
    pub fn convolution(&self, official: &str, [inputs, outputs, side]: [usize; 3], has_bias: bool) -> Result<Layer> {
        let values = self.values(&format!("{official}.weight"), &[outputs, inputs, side, side])?;
        let mut weights = Vec::with_capacity(values.len());
        for kernel in values.chunks_exact(inputs * side * side) {
            weights.extend((0..side * side).flat_map(|k| (0..inputs).map(move |c| kernel[c * side * side + k])));
        }
        let bias = if has_bias { self.values(&format!("{official}.bias"), &[outputs])? } else { vec![0.0; outputs] };
        Ok(Layer { inputs: inputs * side * side, outputs, weights, bias })
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

/// The tensors of a safetensors file, and its bytes.
fn read_safetensors(path: &Path) -> Result<(Entries, Vec<u8>)> {
    let bytes = io::read(path)?;
    let fault =
        |what: String| Error::invalid(path.display().to_string(), format!("not a readable safetensors file: {what}"), HELP);
    let Some((length, rest)) = bytes.split_first_chunk::<8>() else { return Err(fault("it is cut short".into())) };
    let header = usize::try_from(u64::from_le_bytes(*length)).ok().and_then(|n| rest.get(..n));
    let Some(header) = header else { return Err(fault("its header is cut short".into())) };
    let begin = 8 + header.len();
    let mut table: BTreeMap<String, serde_json::Value> =
        serde_json::from_slice(header).map_err(|e| fault(format!("its header: {e}")))?;
    table.remove("__metadata__");
    let mut entries = BTreeMap::new();
    for (name, entry) in table {
        let entry: Entry = serde_json::from_value(entry).map_err(|e| fault(format!("tensor `{name}`: {e}")))?;
        let [from, to] = entry.data_offsets.map(|at| at.saturating_add(begin));
        if from > to || to > bytes.len() {
            return Err(fault(format!("tensor `{name}` lies beyond its end, so it is cut short or damaged")));
        }
        entries.insert(name, (entry, from..to));
    }
    Ok((entries, bytes))
}

/// A float32 tensor of any safetensors file, with its shape.
#[cfg(test)]
pub(super) fn read_golden(path: &Path, name: &str) -> (Vec<usize>, Vec<f32>) {
    let (entries, bytes) = read_safetensors(path).unwrap();
    let (entry, range) = &entries[name];
    assert_eq!(entry.dtype, "F32");
    (entry.shape.clone(), bytes[range.clone()].chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect())
}
