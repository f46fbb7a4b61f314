//! glTF accessors into vectors: any component type, normalised or not, strided, sparse; every byte range is checked.

use super::document::Source;
use crate::{Error, Result};
use gltf::accessor::{DataType, Dimensions};

/// An accessor's elements as floats, `N` components each.
pub(super) fn floats<const N: usize>(accessor: &gltf::Accessor<'_>, source: &Source<'_>, place: &str) -> Result<Vec<[f32; N]>> {
    let place = format!("{place}: accessor {}", accessor.index());
    let components = match accessor.dimensions() {
        Dimensions::Scalar => 1,
        Dimensions::Vec2 => 2,
        Dimensions::Vec3 => 3,
        Dimensions::Vec4 => 4,
        // Column by column; the columns of smaller matrices are padded.
        Dimensions::Mat4 => 16,
        Dimensions::Mat2 | Dimensions::Mat3 => 0,
    };
    if components != N {
        return Err(Error::invalid(place, format!("has {components} components instead of {N}"), "export the model again"));
    }
    let decode = decoder(accessor.data_type(), accessor.normalized());
    let size = size_of(accessor.data_type());
    let element = |bytes: &[u8]| std::array::from_fn(|c| decode(&bytes[c * size..]));
    elements(accessor, source, size * N, &place, [0.0; N], element)
}

/// Whether an accessor has data in the file, be it sparse; what a compressed primitive declares has none.
pub(super) fn has_data(accessor: &gltf::Accessor<'_>) -> bool {
    accessor.view().is_some() || accessor.sparse().is_some()
}

/// Vertex colours: linear RGBA in `[0, 1]`, opaque where the file gives RGB.
pub(super) fn colors(accessor: &gltf::Accessor<'_>, source: &Source<'_>, place: &str) -> Result<Vec<[f32; 4]>> {
    if accessor.data_type() != DataType::F32 && !accessor.normalized() {
        return Err(Error::invalid(
            format!("{place}: accessor {}", accessor.index()),
            "colours of integers that are not normalised",
            "set `normalized` on the accessor; export the model again",
        ));
    }
    match accessor.dimensions() {
        Dimensions::Vec3 => Ok(floats::<3>(accessor, source, place)?.into_iter().map(|[r, g, b]| [r, g, b, 1.0]).collect()),
        _ => floats::<4>(accessor, source, place),
    }
}

/// Four joints a vertex, as numbers within the skin.
pub(super) fn joints(accessor: &gltf::Accessor<'_>, source: &Source<'_>, place: &str) -> Result<Vec<[u32; 4]>> {
    let place = format!("{place}: accessor {}", accessor.index());
    let data_type = accessor.data_type();
    if accessor.dimensions() != Dimensions::Vec4 || !matches!(data_type, DataType::U8 | DataType::U16) {
        return Err(Error::invalid(place, "joints are no four unsigned integers of 8 or 16 bits", "export the model again"));
    }
    let size = size_of(data_type);
    let element = |bytes: &[u8]| std::array::from_fn(|c| unsigned(data_type, &bytes[c * size..]));
    elements(accessor, source, size * 4, &place, [0; 4], element)
}

/// Weights of four joints a vertex.
pub(super) fn weights(accessor: &gltf::Accessor<'_>, source: &Source<'_>, place: &str) -> Result<Vec<[f32; 4]>> {
    let shares = matches!(accessor.data_type(), DataType::U8 | DataType::U16) && accessor.normalized();
    if accessor.data_type() != DataType::F32 && !shares {
        return Err(Error::invalid(
            format!("{place}: accessor {}", accessor.index()),
            "weights of joints are neither floats nor normalised integers of 8 or 16 bits",
            "set `normalized` on the accessor; export the model again",
        ));
    }
    floats::<4>(accessor, source, place)
}

/// An accessor's elements as indices.
pub(super) fn indices(accessor: &gltf::Accessor<'_>, source: &Source<'_>, place: &str) -> Result<Vec<u32>> {
    let place = format!("{place}: accessor {}", accessor.index());
    let data_type = accessor.data_type();
    if accessor.dimensions() != Dimensions::Scalar || !matches!(data_type, DataType::U8 | DataType::U16 | DataType::U32) {
        return Err(Error::invalid(place, "indices are no unsigned integers", "export the model again"));
    }
    elements(accessor, source, size_of(data_type), &place, 0, |bytes| unsigned(data_type, bytes))
}

/// The elements of an accessor, its sparse replacements applied.
fn elements<T: Clone>(
    accessor: &gltf::Accessor<'_>,
    source: &Source<'_>,
    size: usize,
    place: &str,
    zero: T,
    element: impl Fn(&[u8]) -> T,
) -> Result<Vec<T>> {
    let count = accessor.count();
    let mut values: Vec<T> = match accessor.view() {
        Some(view) => {
            let (bytes, stride) = range(&view, accessor.offset(), count, size, source, place)?;
            (0..count).map(|i| element(&bytes[i * stride..])).collect()
        }
        None if accessor.sparse().is_none() => {
            return Err(Error::invalid(place, "has no data", "export the model again, without compression"));
        }
        // Without a view the elements are zero; a file must not ask for more than it could replace.
        None if count > MAX_IMPLICIT => {
            return Err(Error::invalid(
                place,
                format!("{count} elements without data; {MAX_IMPLICIT} are the most"),
                "export the model again",
            ));
        }
        None => vec![zero; count],
    };
    if let Some(sparse) = accessor.sparse() {
        use gltf::accessor::sparse::IndexType;
        let (at, with, n) = (sparse.indices(), sparse.values(), sparse.count());
        let index_type = match at.index_type() {
            IndexType::U8 => DataType::U8,
            IndexType::U16 => DataType::U16,
            IndexType::U32 => DataType::U32,
        };
        let index_size = size_of(index_type);
        let (places, place_stride) = range(&at.view(), at.offset(), n, index_size, source, place)?;
        let (replacements, stride) = range(&with.view(), with.offset(), n, size, source, place)?;
        for i in 0..n {
            let index = unsigned(index_type, &places[i * place_stride..]) as usize;
            let Some(slot) = values.get_mut(index) else {
                return Err(Error::invalid(place, format!("sparse index {index} of {count}"), "export the model again"));
            };
            *slot = element(&replacements[i * stride..]);
        }
    }
    Ok(values)
}

/// Most elements an accessor may have that no buffer backs.
const MAX_IMPLICIT: usize = 1 << 22;

/// The bytes of `count` elements and their stride.
fn range<'b>(
    view: &gltf::buffer::View<'_>,
    offset: usize,
    count: usize,
    size: usize,
    source: &'b Source<'_>,
    place: &str,
) -> Result<(&'b [u8], usize)> {
    let stride = view.stride().unwrap_or(size);
    let length = match count.checked_sub(1) {
        None => Some(0),
        Some(last) => last.checked_mul(stride).and_then(|l| l.checked_add(size)),
    };
    let bytes = source.view(view, place)?;
    length
        .filter(|_| stride >= size)
        .and_then(|length| bytes.get(offset..offset.checked_add(length)?))
        .map(|bytes| (bytes, stride))
        .ok_or_else(|| {
            Error::invalid(
                place,
                format!(
                    "{count} elements of {size} bytes, {stride} apart from byte {offset}, are not in buffer view {}",
                    view.index()
                ),
                "the file is damaged or cut short; export the model again",
            )
        })
}

fn size_of(data_type: DataType) -> usize {
    match data_type {
        DataType::I8 | DataType::U8 => 1,
        DataType::I16 | DataType::U16 => 2,
        DataType::U32 | DataType::F32 => 4,
    }
}

fn unsigned(data_type: DataType, b: &[u8]) -> u32 {
    match data_type {
        DataType::U8 | DataType::I8 => u32::from(b[0]),
        DataType::U16 | DataType::I16 => u32::from(u16::from_le_bytes([b[0], b[1]])),
        DataType::U32 | DataType::F32 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
    }
}

/// Bytes to a float, by glTF 2.0 §3.6.2.2: normalised integers map to `[0, 1]` or `[−1, 1]`.
fn decoder(data_type: DataType, normalized: bool) -> fn(&[u8]) -> f32 {
    match (data_type, normalized) {
        (DataType::F32, _) => |b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        (DataType::U8, true) => |b| f32::from(b[0]) / 255.0,
        (DataType::U8, false) => |b| f32::from(b[0]),
        (DataType::I8, true) => |b| (f32::from(b[0] as i8) / 127.0).max(-1.0),
        (DataType::I8, false) => |b| f32::from(b[0] as i8),
        (DataType::U16, true) => |b| f32::from(u16::from_le_bytes([b[0], b[1]])) / 65535.0,
        (DataType::U16, false) => |b| f32::from(u16::from_le_bytes([b[0], b[1]])),
        (DataType::I16, true) => |b| (f32::from(i16::from_le_bytes([b[0], b[1]])) / 32767.0).max(-1.0),
        (DataType::I16, false) => |b| f32::from(i16::from_le_bytes([b[0], b[1]])),
        (DataType::U32, _) => |b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32,
    }
}
