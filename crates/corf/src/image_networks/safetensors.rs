//! Tensors by name out of a safetensors file.
//!
//! The format (github.com/huggingface/safetensors, "Format"): the header's length in 8 little-endian bytes, the header in JSON (name to type, shape and
//! range of bytes), the bytes.

use super::Layer;
use crate::{Error, Result};
use corf_scene::io;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// A tensor's entry in the header.
#[derive(Deserialize)]
struct Entry {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

/// A file of tensors.
pub(crate) struct Tensors {
    path: PathBuf,
    /// Advice to who gave a file that cannot be used.
    help: &'static str,
    bytes: Vec<u8>,
    /// By name: the entry, and where the bytes are.
    entries: BTreeMap<String, (Entry, Range<usize>)>,
}

impl Tensors {
    /// Reads a file; `help` is the advice in every error about it.
    ///
    /// # Errors
    /// A file that cannot be read, is no safetensors file, or is cut short.
    pub fn read(path: &Path, help: &'static str) -> Result<Self> {
        let mut tensors = Self { path: path.to_owned(), help, bytes: io::read(path)?, entries: BTreeMap::new() };
        tensors.entries = tensors.list().map_err(|what| tensors.fault(format!("not a readable safetensors file: {what}")))?;
        Ok(tensors)
    }

    /// The header's entries.
    fn list(&self) -> Result<BTreeMap<String, (Entry, Range<usize>)>, String> {
        let (length, rest) = self.bytes.split_first_chunk::<8>().ok_or("it is cut short")?;
        let header = usize::try_from(u64::from_le_bytes(*length)).ok().and_then(|n| rest.get(..n));
        let header = header.ok_or("its header is cut short")?;
        let begin = 8 + header.len();
        let mut table: BTreeMap<String, serde_json::Value> =
            serde_json::from_slice(header).map_err(|e| format!("its header: {e}"))?;
        table.remove("__metadata__");
        let mut entries = BTreeMap::new();
        for (name, entry) in table {
            let entry: Entry = serde_json::from_value(entry).map_err(|e| format!("tensor `{name}`: {e}"))?;
            let [from, to] = entry.data_offsets.map(|at| at.saturating_add(begin));
            if from > to || to > self.bytes.len() {
                return Err(format!("tensor `{name}` lies beyond its end, so it is cut short or damaged"));
            }
            entries.insert(name, (entry, from..to));
        }
        Ok(entries)
    }

    /// An error about this file.
    pub fn fault(&self, what: impl Into<String>) -> Error {
        self.fault_with(what, self.help)
    }

    /// An error about this file, with another advice than usual.
    pub fn fault_with(&self, what: impl Into<String>, help: &str) -> Error {
        Error::invalid(self.path.display().to_string(), what, help)
    }

    /// SHA-256 of the file's bytes, in hexadecimal.
    pub fn sha256(&self) -> String {
        io::sha256_hex(&self.bytes)
    }

    /// Whether a tensor is there.
    pub fn has(&self, name: &str) -> bool {
        self.entries.contains_key(name)
    }

    fn entry(&self, name: &str) -> Result<&(Entry, Range<usize>)> {
        self.entries.get(name).ok_or_else(|| self.fault(format!("tensor `{name}` is missing")))
    }

    /// The size of a tensor of `N` axes.
    ///
    /// # Errors
    /// It is missing, or has another number of axes.
    pub fn shape<const N: usize>(&self, name: &str) -> Result<[usize; N]> {
        let shape = &self.entry(name)?.0.shape;
        shape
            .as_slice()
            .try_into()
            .ok()
            .filter(|s: &[usize; N]| !s.contains(&0))
            .ok_or_else(|| self.fault(format!("tensor `{name}` has shape {shape:?}, and {N} axes of at least 1 are needed")))
    }

    /// A tensor's values.
    ///
    /// # Errors
    /// It is missing, has another shape, is of a type that is not read, or has a value that is not finite.
    pub fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let (entry, range) = self.entry(name)?;
        if entry.shape != shape {
            return Err(self.fault(format!("tensor `{name}` has shape {:?}, and {shape:?} is needed", entry.shape)));
        }
        let data = &self.bytes[range.clone()];
        let pair = |b: &[u8]| [b[0], b[1]];
        let values: Vec<f32> = match entry.dtype.as_str() {
            "F32" => data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
            "F16" => data.chunks_exact(2).map(|b| half::f16::from_le_bytes(pair(b)).to_f32()).collect(),
            "BF16" => data.chunks_exact(2).map(|b| half::bf16::from_le_bytes(pair(b)).to_f32()).collect(),
            other => {
                return Err(self.fault_with(format!("tensor `{name}` is of type {other}"), "types F32, F16 and BF16 are read"));
            }
        };
        if values.len() != shape.iter().product::<usize>() {
            return Err(self.fault(format!("tensor `{name}` has {} values for shape {shape:?}", values.len())));
        }
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.fault(format!("tensor `{name}` has {} at place {i}", values[i]))),
            None => Ok(values),
        }
    }

    /// A convolution of `side × side` pixels, its inputs in the order (row, column, channel); without a bias where none is named.
    ///
    /// # Errors
    /// Those of [`Self::values`].
    pub fn convolution(&self, weight: &str, bias: Option<&str>, [inputs, outputs, side]: [usize; 3]) -> Result<Layer> {
        let values = self.values(weight, &[outputs, inputs, side, side])?;
        let mut weights = Vec::with_capacity(values.len());
        for kernel in values.chunks_exact(inputs * side * side) {
            weights.extend((0..side * side).flat_map(|k| (0..inputs).map(move |c| kernel[c * side * side + k])));
        }
        let bias = bias.map_or_else(|| Ok(vec![0.0; outputs]), |name| self.values(name, &[outputs]))?;
        Ok(Layer { inputs: inputs * side * side, outputs, weights, bias })
    }
}
