//! Keyframes as rows of Parquet files.
//!
//! | column | type | content |
//! |---|---|---|
//! | `index`, `file` | int32, text | index from 0; stem of its files in `dataset/` |
//! | `time_s` | double | seconds along the trajectory |
//! | `split` | text | `train`, `test`, or `unused` |
//! | `is_validation`, `in_held_out_segment` | boolean | further protocols of the same keyframes |
//! | `world_from_camera` | 4 lists of 4 doubles | OpenCV camera axes to a z-up world, metres |
//! | `image` | bytes and path | PNG, sRGB |
//! | `spectrum` | rows of float32 | linear power, as `rf/spectra` has it |
//! | `spectrum_image` | bytes and path | PNG, Jet over the data set's decibel range |

use super::Publication;
use anyhow::{Context, Result, anyhow};
use corf_scene::dataset::stem;
use corf_scene::io::{encode_png, read};
use corf_scene::{Raster, Rigid3};
use parquet::basic::Compression;
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use serde_json::json;
use std::sync::Arc;

/// Rows of a file are as many as take this, bytes.
const SHARD_BYTES: u64 = 256 << 20;
/// Rows that are held at once take this at most, bytes …
const GROUP_BYTES: u64 = 64 << 20;
/// … and are so many at most, as Hugging Face's viewer wants it.
const GROUP_ROWS: usize = 100;

/// A Parquet file to be.
pub(super) struct Shard {
    /// Below the publication's folder.
    pub path: String,
    split: &'static str,
    /// By row groups.
    groups: Vec<Vec<usize>>,
}

/// A keyframe.
struct Row {
    index: usize,
    time_s: f64,
    world_from_camera: Rigid3,
    image: Option<Vec<u8>>,
    spectrum: Option<(Raster<f32>, Vec<u8>)>,
}

/// Parts of a list whose sizes add up to `most` at most, but for those of one.
fn parted(list: &[usize], size: impl Fn(usize) -> u64, most: u64, most_items: usize) -> Vec<Vec<usize>> {
    let (mut parts, mut filled): (Vec<Vec<usize>>, u64) = (Vec::new(), 0);
    for &item in list {
        let bytes = size(item);
        match parts.last_mut() {
            Some(part) if filled + bytes <= most && part.len() < most_items => {
                part.push(item);
                filled += bytes;
            }
            _ => {
                parts.push(vec![item]);
                filled = bytes;
            }
        }
    }
    parts
}

impl Publication<'_> {
    /// The files, split by split.
    pub(super) fn shards(&self) -> Result<Vec<Shard>> {
        let size = |index: usize| -> Result<u64> {
            let [image, ..] = self.dataset.files_of(index)?;
            let image = image.map(|path| std::fs::metadata(&path).with_context(|| path.display().to_string())).transpose()?;
            let camera = self.dataset.radio_camera();
            let spectrum = if self.dataset.modalities().radio { 7 * camera.width * camera.height } else { 0 };
            Ok(image.map_or(0, |file| file.len()) + spectrum as u64)
        };
        let sizes: Vec<u64> = (0..self.dataset.len()).map(size).collect::<Result<_>>()?;
        let of = |index: usize| sizes[index];
        let mut shards = Vec::new();
        for split in &self.splits {
            let parts = parted(&split.keyframes, of, SHARD_BYTES, usize::MAX);
            let count = parts.len();
            shards.extend(parts.into_iter().enumerate().map(|(i, part)| Shard {
                path: format!("data/{}-{i:05}-of-{count:05}.parquet", split.name),
                split: split.name,
                groups: parted(&part, of, GROUP_BYTES, GROUP_ROWS),
            }));
        }
        Ok(shards)
    }

    /// The bytes of a file.
    pub(super) fn encode(&self, shard: &Shard) -> Result<Vec<u8>> {
        let image = json!({ "_type": "Image" });
        let mut features = serde_json::Map::new();
        let (list, picture) = (
            |name: &str, of: &str| {
                format!(
                    "required group {name} (LIST) {{ repeated group list {{ required group element (LIST) {{ repeated group list {{ required {of} \
                     element; }} }} }} }}"
                )
            },
            // As Hugging Face's Image feature has it.
            |name: &str| format!("optional group {name} {{ optional binary bytes; optional binary path (STRING); }}"),
        );
        let mut columns = vec![
            "required int32 index; required binary file (STRING); required double time_s; required binary split (STRING);"
                .to_owned(),
            "required boolean is_validation; required boolean in_held_out_segment;".to_owned(),
            list("world_from_camera", "double"),
        ];
        let has = self.dataset.modalities();
        if has.light {
            columns.push(picture("image"));
            features.insert("image".into(), image.clone());
        }
        if has.radio {
            columns.extend([list("spectrum", "float"), picture("spectrum_image")]);
            features.insert("spectrum_image".into(), image);
        }
        let schema = parse_message_type(&format!("message keyframe {{ {} }}", columns.join(" ")))?;
        let about = json!({ "info": { "features": features } }).to_string();
        let properties = WriterProperties::builder()
            .set_created_by(format!("corf {}", env!("CARGO_PKG_VERSION")))
            .set_compression(Compression::UNCOMPRESSED)
            .set_dictionary_enabled(false)
            .set_statistics_enabled(EnabledStatistics::None)
            .set_key_value_metadata(Some(vec![KeyValue::new("huggingface".to_owned(), about)]))
            .build();
        let mut file = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
        for group in &shard.groups {
            let rows: Vec<Row> = group.iter().map(|index| self.row(*index)).collect::<Result<_>>()?;
            let mut columns = Columns(file.next_row_group()?);
            self.write_rows(&mut columns, shard.split, &rows)?;
            columns.0.close()?;
        }
        Ok(file.into_inner()?)
    }

    fn row(&self, index: usize) -> Result<Row> {
        let keyframe = self.dataset.keyframe(index)?;
        let [image, ..] = self.dataset.files_of(index)?;
        let range = self.dataset.db_range();
        let spectrum = keyframe.radio.zip(range).map(|(radio, range)| {
            let picture = encode_png(&range.jet_image(&radio.spectrum))?;
            anyhow::Ok((radio.spectrum, picture))
        });
        Ok(Row {
            index,
            time_s: keyframe.time_s,
            world_from_camera: keyframe.world_from_camera,
            image: image.map(read).transpose()?,
            spectrum: spectrum.transpose()?,
        })
    }

    fn write_rows(&self, columns: &mut Columns<'_>, split: &str, rows: &[Row]) -> Result<()> {
        let names: Vec<String> = rows.iter().map(|row| stem(row.index)).collect();
        let segment = self.dataset.held_out_segment();
        columns.plain::<Int32Type>(&rows.iter().map(|row| row.index as i32).collect::<Vec<_>>())?;
        columns.plain::<ByteArrayType>(&names.iter().map(|name| ByteArray::from(name.as_str())).collect::<Vec<_>>())?;
        columns.plain::<DoubleType>(&rows.iter().map(|row| row.time_s).collect::<Vec<_>>())?;
        columns.plain::<ByteArrayType>(&vec![ByteArray::from(split); rows.len()])?;
        columns.plain::<BoolType>(&rows.iter().map(|row| self.validation.contains(&row.index)).collect::<Vec<_>>())?;
        columns.plain::<BoolType>(&rows.iter().map(|row| segment.contains(&row.index)).collect::<Vec<_>>())?;
        let poses: Vec<Vec<f64>> = rows.iter().map(|row| row.world_from_camera.to_rows().concat()).collect();
        columns.tables::<DoubleType>(&poses, 4)?;
        if self.dataset.modalities().light {
            columns.pictures(rows.iter().map(|row| row.image.as_deref()), &names)?;
        }
        if self.dataset.modalities().radio {
            let spectra: Vec<Vec<f32>> = rows.iter().flat_map(|row| &row.spectrum).map(|(s, _)| s.pixels().to_vec()).collect();
            columns.tables::<FloatType>(&spectra, self.dataset.radio_camera().width)?;
            columns.pictures(rows.iter().map(|row| row.spectrum.as_ref().map(|(_, png)| png.as_slice())), &names)?;
        }
        Ok(())
    }
}

/// The columns of a row group, written in their order.
struct Columns<'f>(SerializedRowGroupWriter<'f, Vec<u8>>);

impl Columns<'_> {
    fn write<T: DataType>(&mut self, values: &[T::T], definition: Option<&[i16]>, repetition: Option<&[i16]>) -> Result<()> {
        let mut column = self.0.next_column()?.ok_or_else(|| anyhow!("the schema has no further column"))?;
        column.typed::<T>().write_batch(values, definition, repetition)?;
        Ok(column.close()?)
    }

    /// A value a row.
    fn plain<T: DataType>(&mut self, values: &[T::T]) -> Result<()> {
        self.write::<T>(values, None, None)
    }

    /// A table a row, of lines of `width` numbers: a list of lists.
    fn tables<T: DataType>(&mut self, tables: &[Vec<T::T>], width: usize) -> Result<()> {
        // A new row begins at 0, a new line at 1, within a line goes on at 2.
        let level = |i: usize| match (i, i % width) {
            (0, _) => 0,
            (_, 0) => 1,
            _ => 2,
        };
        let repetition: Vec<i16> = tables.iter().flat_map(|table| (0..table.len()).map(level)).collect();
        let values: Vec<T::T> = tables.concat();
        self.write::<T>(&values, Some(&vec![2; values.len()]), Some(&repetition))
    }

    /// A picture a row: its bytes, and a name.
    fn pictures<'p>(&mut self, pictures: impl Iterator<Item = Option<&'p [u8]>>, names: &[String]) -> Result<()> {
        let bytes: Vec<ByteArray> = pictures.flatten().map(|bytes| ByteArray::from(bytes.to_vec())).collect();
        let paths: Vec<ByteArray> = names.iter().map(|name| ByteArray::from(format!("{name}.png").as_str())).collect();
        self.write::<ByteArrayType>(&bytes, Some(&vec![2; bytes.len()]), None)?;
        self.write::<ByteArrayType>(&paths, Some(&vec![2; paths.len()]), None)
    }
}

#[cfg(test)]
mod tests {
    use super::parted;

    #[test]
    fn parts_are_filled_to_a_limit_of_bytes_and_of_rows() {
        let list: Vec<usize> = (0..7).collect();
        assert_eq!(parted(&list, |_| 3, 7, 9), [vec![0, 1], vec![2, 3], vec![4, 5], vec![6]]);
        assert_eq!(parted(&list, |_| 3, 100, 5), [vec![0, 1, 2, 3, 4], vec![5, 6]]);
        // What is larger than a part has one for itself.
        assert_eq!(parted(&list[..3], |i| [1, 9, 1][i], 4, 9), [vec![0], vec![1], vec![2]]);
        assert!(parted(&[], |_| 1, 1, 1).is_empty());
    }
}
