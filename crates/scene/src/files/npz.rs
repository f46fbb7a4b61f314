//! NumPy files: `.npz` out, `.npy` in.
//!
//! An archive is stored, not compressed, and dated 1980-01-01: the same arrays give the same bytes. Format: NumPy enhancement proposal 1
//! (version 1.0 headers) inside a ZIP without extensions, so that no file may reach 4 GiB.

use crate::{Error, Result};

/// The values of an array, row-major.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// `|u1`.
    U8(Vec<u8>),
    /// `<f4`.
    F32(Vec<f32>),
    /// `<f8`.
    F64(Vec<f64>),
    /// `<c16`: real and imaginary parts.
    Complex(Vec<[f64; 2]>),
    /// `<u4`.
    U32(Vec<u32>),
    /// `|b1`.
    Bool(Vec<bool>),
    /// `<U…`.
    Text(Vec<String>),
}

/// A named array.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Its key in the archive.
    pub name: String,
    /// Sizes of its axes; empty for a scalar.
    pub shape: Vec<usize>,
    /// Its values, row-major.
    pub values: Values,
}

impl Values {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::F32(v) => v.len(),
            Self::F64(v) => v.len(),
            Self::Complex(v) => v.len(),
            Self::U32(v) => v.len(),
            Self::Bool(v) => v.len(),
            Self::Text(v) => v.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn descr(&self) -> String {
        match self {
            Self::U8(_) => "|u1".into(),
            Self::F32(_) => "<f4".into(),
            Self::F64(_) => "<f8".into(),
            Self::Complex(_) => "<c16".into(),
            Self::U32(_) => "<u4".into(),
            Self::Bool(_) => "|b1".into(),
            Self::Text(v) => format!("<U{}", text_width(v)),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::U8(v) => v.clone(),
            Self::F32(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::F64(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::Complex(v) => v.iter().flatten().flat_map(|x| x.to_le_bytes()).collect(),
            Self::U32(v) => v.iter().flat_map(|x| x.to_le_bytes()).collect(),
            Self::Bool(v) => v.iter().map(|x| u8::from(*x)).collect(),
            Self::Text(v) => {
                let width = text_width(v);
                let code_points =
                    |s: &String| s.chars().map(u32::from).chain(std::iter::repeat(0)).take(width).collect::<Vec<_>>();
                v.iter().flat_map(code_points).flat_map(u32::to_le_bytes).collect()
            }
        }
    }
}

/// NumPy has no strings of no characters.
fn text_width(texts: &[String]) -> usize {
    texts.iter().map(|s| s.chars().count()).max().unwrap_or(0).max(1)
}

impl Array {
    /// An array.
    ///
    /// # Panics
    /// If the shape's product is not the number of values.
    pub fn new(name: &str, shape: &[usize], values: Values) -> Self {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "{name}: {shape:?} does not hold {} values", values.len());
        Self { name: name.into(), shape: shape.to_vec(), values }
    }

    /// The array as a `.npy` file.
    pub fn to_npy(&self) -> Vec<u8> {
        // Python's tuples, as NumPy writes them: one axis alone keeps its comma.
        let axes: Vec<String> = self.shape.iter().map(usize::to_string).collect();
        let comma = if axes.len() == 1 { "," } else { "" };
        let dictionary =
            format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({}{comma}), }}", self.values.descr(), axes.join(", "));
        // Magic, version and length take 10 bytes; the header ends in a newline on a multiple of 64.
        let length = (10 + dictionary.len() + 1).div_ceil(64) * 64 - 10;
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((length as u16).to_le_bytes());
        bytes.extend(format!("{dictionary:<width$}\n", width = length - 1).as_bytes());
        bytes.extend(self.values.bytes());
        bytes
    }
}

/// Size limit of a ZIP archive without ZIP64 extensions, bytes.
const ZIP_LIMIT: usize = u32::MAX as usize;
/// MS-DOS date of 1980-01-01.
const ZIP_EPOCH: u16 = (1 << 5) | 1;

/// Encodes arrays as one `.npz`.
///
/// # Errors
/// More than 4 GiB, or more than 65 535 arrays.
pub fn encode_npz(arrays: &[Array]) -> Result<Vec<u8>> {
    let too_large =
        || Error::invalid("npz", "the arrays do not fit into 4 GiB", "write fewer receivers at a time, in several files");
    if arrays.len() > usize::from(u16::MAX) {
        return Err(too_large());
    }
    let (mut file, mut directory) = (Vec::new(), Vec::new());
    for array in arrays {
        let data = array.to_npy();
        let name = format!("{}.npy", array.name);
        let offset = file.len();
        if offset.saturating_add(data.len()) > ZIP_LIMIT {
            return Err(too_large());
        }
        let mut common = Vec::new();
        for field in [20, 0, 0, 0, ZIP_EPOCH] {
            common.extend(field.to_le_bytes());
        }
        for field in [crc32fast::hash(&data), data.len() as u32, data.len() as u32] {
            common.extend(field.to_le_bytes());
        }
        common.extend((name.len() as u16).to_le_bytes());
        common.extend(0u16.to_le_bytes());
        file.extend(b"PK\x03\x04");
        file.extend(&common);
        file.extend(name.as_bytes());
        file.extend(&data);
        directory.extend(b"PK\x01\x02");
        directory.extend(20u16.to_le_bytes());
        directory.extend(&common);
        // Comment, disk, attributes inside and outside.
        directory.extend([0u8; 10]);
        directory.extend((offset as u32).to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let start = file.len();
    if start.saturating_add(directory.len()) > ZIP_LIMIT {
        return Err(too_large());
    }
    let (count, size) = (arrays.len() as u16, directory.len() as u32);
    file.extend(directory);
    file.extend(b"PK\x05\x06\0\0\0\0");
    file.extend(count.to_le_bytes());
    file.extend(count.to_le_bytes());
    file.extend(size.to_le_bytes());
    file.extend((start as u32).to_le_bytes());
    file.extend(0u16.to_le_bytes());
    Ok(file)
}

/// The numbers of a `.npy` file.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyNumbers {
    /// Sizes of its axes; empty for a scalar.
    pub shape: Vec<usize>,
    /// Its values, row-major.
    pub values: Vec<f64>,
    /// How each is stored.
    pub stored: Scalar,
}

/// How a `.npy` file stores a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scalar {
    /// A float of so many bytes: 2, 4 or 8.
    Float(usize),
    /// A whole number, signed or not, of 1, 2, 4 or 8 bytes.
    Whole,
}

/// Reads a number of up to eight bytes in little-endian order.
type Read = fn([u8; 8]) -> f64;

/// The type that a `.npy` header describes: how a number is stored, its bytes, whether they are in big-endian order, and how it is read.
fn type_of(descr: &str) -> Option<(Scalar, usize, bool, Read)> {
    let big_endian = match *descr.as_bytes().first()? {
        b'<' | b'|' => false,
        b'>' => true,
        _ => return None,
    };
    let (scalar, read): (Scalar, Read) = match descr.get(1..)? {
        "f2" => (Scalar::Float(2), |[a, b, ..]| half::f16::from_le_bytes([a, b]).to_f64()),
        "f4" => (Scalar::Float(4), |[a, b, c, d, ..]| f64::from(f32::from_le_bytes([a, b, c, d]))),
        "f8" => (Scalar::Float(8), f64::from_le_bytes),
        "i1" => (Scalar::Whole, |[a, ..]| f64::from(a as i8)),
        "i2" => (Scalar::Whole, |[a, b, ..]| f64::from(i16::from_le_bytes([a, b]))),
        "i4" => (Scalar::Whole, |[a, b, c, d, ..]| f64::from(i32::from_le_bytes([a, b, c, d]))),
        "i8" => (Scalar::Whole, |bytes| i64::from_le_bytes(bytes) as f64),
        // Bytes that are not there are zero.
        "u1" | "u2" | "u4" | "u8" => (Scalar::Whole, |bytes| u64::from_le_bytes(bytes) as f64),
        _ => return None,
    };
    let width = usize::from(descr.as_bytes()[2] - b'0');
    // One byte has no order, and more have one.
    ((width == 1) == descr.starts_with('|')).then_some((scalar, width, big_endian, read))
}

/// Decodes a `.npy` file of floats or whole numbers, in C order and any byte order; `place` names it in messages.
///
/// # Errors
/// The bytes are no such file, or end early.
pub fn decode_npy(bytes: &[u8], place: &str) -> Result<NpyNumbers> {
    let fault = |what: String| {
        Error::invalid(
            place,
            what,
            "save it with numpy.save, as a C-ordered array of float32 or float64 (numpy.ascontiguousarray)",
        )
    };
    let length_bytes = match bytes.get(..8) {
        Some([0x93, b'N', b'U', b'M', b'P', b'Y', 1, _]) => 2,
        Some([0x93, b'N', b'U', b'M', b'P', b'Y', 2 | 3, _]) => 4,
        _ => return Err(fault("not a .npy file".into())),
    };
    let length = bytes.get(8..8 + length_bytes).map(|b| b.iter().rev().fold(0usize, |n, byte| n << 8 | usize::from(*byte)));
    let start = 8 + length_bytes;
    let header = length.and_then(|n| bytes.get(start..start.checked_add(n)?)).and_then(|h| std::str::from_utf8(h).ok());
    let Some(header) = header else { return Err(fault("its header is cut short".into())) };
    let value = |key: &str| header.split_once(&format!("'{key}':")).map(|(_, rest)| rest.trim_start());
    let descr = value("descr").and_then(|v| v.strip_prefix('\'')?.split('\'').next());
    let Some((stored, width, big_endian, read)) = descr.and_then(type_of) else {
        return Err(fault(format!("its type is {}, neither float nor integer", descr.unwrap_or("not stated"))));
    };
    if !value("fortran_order").is_some_and(|v| v.starts_with("False")) {
        return Err(fault("it is in Fortran order".into()));
    }
    let axes = value("shape").and_then(|v| v.strip_prefix('(')?.split_once(')')).map(|(inside, _)| inside);
    let shape: Option<Vec<usize>> =
        axes.and_then(|a| a.split(',').map(str::trim).filter(|s| !s.is_empty()).map(|s| s.parse().ok()).collect());
    let Some(shape) = shape else { return Err(fault("its shape cannot be read".into())) };
    let data = &bytes[start + header.len()..];
    let count = shape.iter().try_fold(1usize, |n, axis| n.checked_mul(*axis));
    if count.and_then(|n| n.checked_mul(width)) != Some(data.len()) {
        return Err(fault(format!("{} bytes of data for shape {shape:?}", data.len())));
    }
    let number = |bytes: &[u8]| {
        let mut little = [0; 8];
        little[..width].copy_from_slice(bytes);
        if big_endian {
            little[..width].reverse();
        }
        read(little)
    };
    Ok(NpyNumbers { shape, values: data.chunks_exact(width).map(number).collect(), stored })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_aligned_and_read_back() {
        for shape in [vec![], vec![6], vec![2, 3], vec![1, 2, 3, 1]] {
            let n = shape.iter().product::<usize>();
            let array = Array::new("x", &shape, Values::F64((0..n).map(|i| i as f64 - 0.5).collect()));
            let bytes = array.to_npy();
            assert_eq!((bytes.len() - 8 * n) % 64, 0);
            let read = decode_npy(&bytes, "x.npy").unwrap();
            assert_eq!((read.shape, Values::F64(read.values), read.stored), (shape, array.values, Scalar::Float(8)));
        }
    }

    /// `to_npy`'s bytes of `f32` under another type, with `data` as its values.
    fn typed(descr: &str, count: usize, data: &[u8]) -> Vec<u8> {
        let whole = Array::new("x", &[count], Values::F32(vec![0.0; count])).to_npy();
        let mut bytes = whole[..whole.len() - 4 * count].to_vec();
        let at = bytes.windows(3).position(|w| w == b"<f4").unwrap();
        bytes[at..at + 3].copy_from_slice(descr.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn every_type_of_number_is_read_in_either_byte_order() {
        // 4000 is 0x0fa0; 0x3fc0 is 2⁰ (1 + 960/1024) in half precision; 1.5 is 0x3fc00000 in single.
        let little: [(&str, &[u8], f64, Scalar); 8] = [
            ("|u1", &[200], 200.0, Scalar::Whole),
            ("|i1", &[200], -56.0, Scalar::Whole),
            ("<u2", &[0xa0, 0x0f], 4000.0, Scalar::Whole),
            ("<i2", &[0x60, 0xf0], -4000.0, Scalar::Whole),
            ("<u4", &[0, 0, 0, 0x80], 2_147_483_648.0, Scalar::Whole),
            ("<i4", &[0, 0, 0, 0x80], -2_147_483_648.0, Scalar::Whole),
            ("<f2", &[0xc0, 0x3f], 1.9375, Scalar::Float(2)),
            ("<f4", &[0, 0, 0xc0, 0x3f], 1.5, Scalar::Float(4)),
        ];
        for (descr, bytes, value, stored) in little {
            let read = decode_npy(&typed(descr, 1, bytes), "x").unwrap();
            assert_eq!((read.values.as_slice(), read.stored), ([value].as_slice(), stored), "{descr}");
            if bytes.len() > 1 {
                let reversed: Vec<u8> = bytes.iter().rev().copied().collect();
                assert_eq!(decode_npy(&typed(&descr.replace('<', ">"), 1, &reversed), "x").unwrap().values, [value], "{descr}");
            }
        }
        for (descr, bytes) in [("<i8", (-7i64).to_le_bytes()), (">i8", (-7i64).to_be_bytes())] {
            assert_eq!(decode_npy(&typed(descr, 1, &bytes), "x").unwrap().values, [-7.0]);
        }
        assert_eq!(decode_npy(&typed("<u8", 1, &7u64.to_le_bytes()), "x").unwrap().values, [7.0]);
        for descr in ["<c8", "|b1", "|O8", "<U4", "<f1", "<u3", "|f4", "<u1", "=f4"] {
            let error = decode_npy(&typed(descr, 1, &[0; 8]), "x").unwrap_err().to_string();
            assert!(error.contains(&format!("its type is {descr}")), "{error}");
        }
    }

    #[test]
    fn what_is_no_array_of_floats_is_named() {
        let whole = Array::new("x", &[2, 3], Values::F64(vec![0.0; 6])).to_npy();
        for cut in [0, 5, 9, 40, whole.len() - 1] {
            assert!(decode_npy(&whole[..cut], "cut.npy").unwrap_err().to_string().contains("cut.npy"), "{cut}");
        }
        let complex = Array::new("x", &[1], Values::Complex(vec![[7.0, 0.0]])).to_npy();
        assert!(decode_npy(&complex, "i.npy").unwrap_err().to_string().contains("<c16"));
        let text = String::from_utf8_lossy(&whole).replace("False", "True ");
        assert!(decode_npy(text.replace('\u{fffd}', "").as_bytes(), "f.npy").is_err());
    }

    #[test]
    fn an_archive_lists_each_array_with_its_checksum() {
        let arrays = [
            Array::new("a", &[2], Values::Complex(vec![[1.0, -1.0], [0.0, 2.0]])),
            Array::new("names", &[2], Values::Text(vec!["wall".into(), "tür".into()])),
            Array::new("valid", &[1, 1], Values::Bool(vec![true])),
        ];
        let bytes = encode_npz(&arrays).unwrap();
        assert_eq!(bytes, encode_npz(&arrays).unwrap());
        let first = arrays[0].to_npy();
        assert_eq!(&bytes[..4], b"PK\x03\x04");
        assert_eq!(bytes[14..18], crc32fast::hash(&first).to_le_bytes());
        assert_eq!(bytes[35..35 + first.len()], first);
        // The last 22 bytes count three entries and say where their list starts.
        let end = &bytes[bytes.len() - 22..];
        let start = u32::from_le_bytes([end[16], end[17], end[18], end[19]]) as usize;
        assert_eq!((end[8], &bytes[start..start + 4]), (3, b"PK\x01\x02".as_slice()));
    }
}
