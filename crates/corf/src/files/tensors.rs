//! Named arrays of numbers on disk: [safetensors files](https://github.com/huggingface/safetensors), others' and the program's own.
//!
//! The program's own have metadata with one entry, `corf`: JSON with the `format` of the file and its version, a `header` that says what the arrays are,
//! and the `crc32` of all of the entry before it and of the arrays in the order of their names. Whatever reads safetensors opens them.

use crate::{Error, Result};
use corf_scene::io;
use safetensors::tensor::{Dtype, Metadata, SafeTensorError, SafeTensors, View};
use serde::{Serialize, de::DeserializeOwned};
use std::borrow::Cow;
use std::collections::HashMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The metadata's entry.
const ENTRY: &str = "corf";

/// A kind of the program's own files.
#[derive(Debug)]
pub struct Kind {
    /// What it is, for messages.
    pub name: &'static str,
    /// Its format, with the version.
    pub format: &'static str,
    /// Advice to who gave a file that cannot be used.
    pub help: &'static str,
    /// Whether a number that is not finite is refused, as of a network that has diverged.
    pub finite: bool,
}

/// An array to be written.
#[derive(Debug)]
pub struct Tensor<'a> {
    name: String,
    shape: Vec<usize>,
    numbers: Numbers<'a>,
}

#[derive(Debug)]
enum Numbers<'a> {
    F32(Cow<'a, [f32]>),
    U32(Cow<'a, [u32]>),
}

impl<'a> Tensor<'a> {
    /// Numbers in the order of a shape, the last axis fastest.
    pub fn new(name: impl Into<String>, shape: &[usize], values: impl Into<Cow<'a, [f32]>>) -> Self {
        Self { name: name.into(), shape: shape.to_vec(), numbers: Numbers::F32(values.into()) }
    }

    /// The same of whole numbers, or of bits.
    pub fn words(name: impl Into<String>, shape: &[usize], words: impl Into<Cow<'a, [u32]>>) -> Self {
        Self { name: name.into(), shape: shape.to_vec(), numbers: Numbers::U32(words.into()) }
    }

    fn is_finite(&self) -> bool {
        match &self.numbers {
            Numbers::F32(values) => values.iter().all(|v| v.is_finite()),
            Numbers::U32(_) => true,
        }
    }
}

impl View for &Tensor<'_> {
    fn dtype(&self) -> Dtype {
        match self.numbers {
            Numbers::F32(_) => Dtype::F32,
            Numbers::U32(_) => Dtype::U32,
        }
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Owned(match &self.numbers {
            Numbers::F32(values) => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            Numbers::U32(words) => words.iter().flat_map(|v| v.to_le_bytes()).collect(),
        })
    }

    fn data_len(&self) -> usize {
        match &self.numbers {
            Numbers::F32(values) => 4 * values.len(),
            Numbers::U32(words) => 4 * words.len(),
        }
    }
}

/// What the metadata of a kind's files begins with.
fn beginning(kind: &Kind) -> String {
    format!("{{\"format\":\"{}\",\"header\":", kind.format)
}

/// Writes a file of a kind whole or not at all.
///
/// # Errors
/// A number that is not finite where the kind refuses those; an array with another number of values than its shape; a file that cannot be written.
pub fn write(path: &Path, kind: &Kind, header: &impl Serialize, tensors: Vec<Tensor<'_>>) -> Result<()> {
    if kind.finite && !tensors.iter().all(Tensor::is_finite) {
        let what = format!("a parameter of the {} is not a finite number", kind.name);
        return Err(Error::invalid(path.display().to_string(), what, "it has diverged: train it with a smaller rate"));
    }
    let failed = |source: std::io::Error| Error::Io { action: "write", path: path.to_owned(), source };
    let mut text = beginning(kind) + &serde_json::to_string(header).map_err(|e| failed(e.into()))?;
    let mut tensors: Vec<&Tensor<'_>> = tensors.iter().collect();
    tensors.sort_by(|a, b| a.name.cmp(&b.name));
    let mut crc = crc32fast::Hasher::new();
    crc.update(text.as_bytes());
    tensors.iter().for_each(|t| crc.update(&t.data()));
    text += &format!(",\"crc32\":{}}}", crc.finalize());
    // With one entry the map has one order, and the same content gives the same bytes.
    let metadata = HashMap::from([(ENTRY.to_owned(), text)]);
    let bytes = safetensors::serialize(tensors.into_iter().map(|t| (&t.name, t)), Some(metadata));
    Ok(io::write_atomic(path, &bytes.map_err(|e| failed(std::io::Error::other(e)))?)?)
}

/// A file of tensors.
pub struct Tensors {
    path: PathBuf,
    /// Advice to who gave a file that cannot be used.
    help: &'static str,
    bytes: Vec<u8>,
    metadata: Metadata,
    /// Where the numbers begin.
    begin: usize,
}

impl Tensors {
    /// Reads a file; `help` is the advice in every error about it. Memory is taken for its bytes and for a list of its tensors.
    ///
    /// # Errors
    /// A file that cannot be read, is no safetensors file, or is cut short.
    pub fn read(path: &Path, help: &'static str) -> Result<Self> {
        let bytes = io::read(path)?;
        let (length, metadata) = SafeTensors::read_metadata(&bytes).map_err(|e| {
            let what = match e {
                SafeTensorError::HeaderTooSmall
                | SafeTensorError::InvalidHeaderLength
                | SafeTensorError::MetadataIncompleteBuffer => "it is cut short or damaged".to_owned(),
                other => other.to_string(),
            };
            Error::invalid(path.display().to_string(), format!("not a readable safetensors file: {what}"), help)
        })?;
        Ok(Self { path: path.to_owned(), help, bytes, metadata, begin: length + size_of::<u64>() })
    }

    /// Reads a file of a kind that [`write()`] wrote, with its header.
    ///
    /// # Errors
    /// A file that is missing, damaged, or of another kind or version.
    pub fn read_kind<H: DeserializeOwned>(path: &Path, kind: &Kind) -> Result<(Self, H)> {
        let refused = || {
            let what = format!("this is no {} of this version, or a damaged one", kind.name);
            Error::invalid(path.display().to_string(), what, kind.help)
        };
        let tensors = match Self::read(path, kind.help) {
            Err(Error::Invalid { .. }) => return Err(refused()),
            other => other?,
        };
        let header = tensors.header(kind).ok_or_else(refused)?;
        Ok((tensors, header))
    }

    /// The header of a kind's file that is whole.
    fn header<H: DeserializeOwned>(&self, kind: &Kind) -> Option<H> {
        let text = self.metadata.metadata().as_ref()?.get(ENTRY)?;
        let (text, sum) = text.strip_suffix('}')?.rsplit_once(",\"crc32\":")?;
        let mut names = self.metadata.offset_keys();
        names.sort();
        let mut crc = crc32fast::Hasher::new();
        crc.update(text.as_bytes());
        names
            .iter()
            .filter_map(|name| self.metadata.info(name))
            .for_each(|info| crc.update(&self.bytes[self.range(info.data_offsets)]));
        if sum != crc.finalize().to_string() {
            return None;
        }
        serde_json::from_str(text.strip_prefix(&beginning(kind))?).ok()
    }

    fn range(&self, (from, to): (usize, usize)) -> Range<usize> {
        self.begin + from..self.begin + to
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
        self.metadata.info(name).is_some()
    }

    fn missing(&self, name: &str) -> Error {
        self.fault(format!("tensor `{name}` is missing"))
    }

    /// The size of a tensor of `N` axes.
    ///
    /// # Errors
    /// It is missing, or has another number of axes.
    pub fn shape<const N: usize>(&self, name: &str) -> Result<[usize; N]> {
        let shape = &self.metadata.info(name).ok_or_else(|| self.missing(name))?.shape;
        shape
            .as_slice()
            .try_into()
            .ok()
            .filter(|s: &[usize; N]| !s.contains(&0))
            .ok_or_else(|| self.fault(format!("tensor `{name}` has shape {shape:?}, and {N} axes of at least 1 are needed")))
    }

    /// The type and the bytes of a tensor of a shape.
    fn data(&self, name: &str, shape: &[usize]) -> Result<(Dtype, &[u8])> {
        let info = self.metadata.info(name).ok_or_else(|| self.missing(name))?;
        if info.shape != shape {
            return Err(self.fault(format!("tensor `{name}` has shape {:?}, and {shape:?} is needed", info.shape)));
        }
        Ok((info.dtype, &self.bytes[self.range(info.data_offsets)]))
    }

    /// A tensor's values, finite or not.
    ///
    /// # Errors
    /// It is missing, has another shape, or is of a type that is not read.
    pub fn numbers(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let (dtype, data) = self.data(name, shape)?;
        Ok(match dtype {
            Dtype::F32 => data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
            Dtype::F16 => data.as_chunks().0.iter().map(|b| half::f16::from_le_bytes(*b).to_f32()).collect(),
            Dtype::BF16 => data.as_chunks().0.iter().map(|b| half::bf16::from_le_bytes(*b).to_f32()).collect(),
            other => {
                return Err(self.fault_with(format!("tensor `{name}` is of type {other}"), "types F32, F16 and BF16 are read"));
            }
        })
    }

    /// A tensor's values.
    ///
    /// # Errors
    /// Those of [`Self::numbers`], and a value that is not finite.
    pub fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let values = self.numbers(name, shape)?;
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.fault(format!("tensor `{name}` has {} at place {i}", values[i]))),
            None => Ok(values),
        }
    }

    /// A tensor's values in groups of `K`, its last axis; `count` of them.
    ///
    /// # Errors
    /// Those of [`Self::numbers`].
    pub fn groups<const K: usize>(&self, name: &str, count: usize) -> Result<Vec<[f32; K]>> {
        Ok(self.numbers(name, &[count, K])?.as_chunks().0.to_vec())
    }

    /// A tensor's whole numbers or bits.
    ///
    /// # Errors
    /// It is missing, has another shape, or is of another type.
    pub fn words(&self, name: &str, shape: &[usize]) -> Result<Vec<u32>> {
        match self.data(name, shape)? {
            (Dtype::U32, data) => Ok(data.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b)).collect()),
            (other, _) => Err(self.fault(format!("tensor `{name}` is of type {other}, and U32 is needed"))),
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    const KIND: Kind = Kind { name: "network", format: "corf-test/1", help: "make it again", finite: true };

    fn written(folder: &Path) -> PathBuf {
        let path = folder.join("n");
        let a = Tensor::new("a", &[2], vec![1.0f32, -2.5]);
        let b = Tensor::new("b", &[1, 3], &[3.0f32, f32::MIN_POSITIVE, 0.0][..]);
        write(&path, &KIND, &("tag \",\"crc32\":7}", 7), vec![b, a, Tensor::words("c", &[2], vec![0, u32::MAX])]).unwrap();
        path
    }

    #[test]
    fn what_is_written_is_read_and_what_is_damaged_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = written(folder.path());
        let all = |path: &Path| -> Result<_> {
            let (file, header) = Tensors::read_kind::<(String, u32)>(path, &KIND)?;
            Ok((header, file.values("a", &[2])?, file.groups::<3>("b", 1)?, file.words("c", &[2])?))
        };
        let (header, a, b, c) = all(&path).unwrap();
        assert_eq!((header.0.as_str(), header.1), ("tag \",\"crc32\":7}", 7));
        assert_eq!((a, b, c), (vec![1.0, -2.5], vec![[3.0, f32::MIN_POSITIVE, 0.0]], vec![0, u32::MAX]));
        let (file, _) = Tensors::read_kind::<(String, u32)>(&path, &KIND).unwrap();
        for (name, shape, word) in [
            ("a", &[3][..], "has shape [2]"),
            ("d", &[2], "missing"),
            ("c", &[2], "type U32"),
            ("a", &[usize::MAX, 9], "has shape"),
        ] {
            let error = file.values(name, shape).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("help"), "{error}");
        }
        let other = Kind { format: "corf-test/2", ..KIND };
        let error = Tensors::read_kind::<(String, u32)>(&path, &other).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("no network of this version") && error.contains("make it again"), "{error}");
        let bytes = std::fs::read(&path).unwrap();
        for cut in 0..bytes.len() {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            assert!(all(&path).is_err(), "{cut} bytes");
            let mut changed = bytes.clone();
            changed[cut] ^= 4;
            std::fs::write(&path, &changed).unwrap();
            assert!(all(&path).is_err(), "byte {cut}");
        }
    }

    #[test]
    fn the_same_content_gives_the_same_bytes_and_numbers_that_are_none_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let first = std::fs::read(written(folder.path())).unwrap();
        assert_eq!(std::fs::read(written(folder.path())).unwrap(), first);
        let path = folder.path().join("nan");
        let nan = || vec![Tensor::new("a", &[1], vec![f32::NAN])];
        assert!(write(&path, &KIND, &0, nan()).unwrap_err().to_string().contains("diverged"));
        write(&path, &Kind { finite: false, ..KIND }, &0, nan()).unwrap();
        let (file, _) = Tensors::read_kind::<u32>(&path, &KIND).unwrap();
        assert!(file.numbers("a", &[1]).unwrap()[0].is_nan() && file.values("a", &[1]).is_err());
        assert!(write(&path, &KIND, &0, vec![Tensor::new("a", &[2], vec![1.0])]).is_err(), "a shape of two for one value");
    }
}
