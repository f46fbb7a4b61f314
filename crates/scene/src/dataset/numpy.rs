//! A keyframe as one NumPy archive, with everything in it that is needed to read its numbers.
//!
//! | array | shape, type | content |
//! |---|---|---|
//! | `image` | (H, W, 3) uint8 | sRGB; missing without light |
//! | `depth_m` | (H, W) float32 | z-depth in metres, 0 where there is none; missing without depth |
//! | `mask` | (H, W) bool | whether a pixel of the image counts; missing where all do |
//! | `optical_intrinsics` | (3, 3) float64 | pixels; (0, 0) is the outer corner of the top left pixel; missing without light |
//! | `spectrum` | (h, w) float32 | linear power in `spectrum_unit`; missing without radio |
//! | `rf_intrinsics` | (3, 3) float64 | as the optical ones; missing without radio |
//! | `spectrum_unit` | text | `1/sr`, `1` or `unknown` |
//! | `db_range` | (2,) float64 | the levels of scalar 0 and 1, dB; missing without radio |
//! | `world_from_camera` | (4, 4) float64 | OpenCV camera axes, metres, z-up world |
//! | `time_s`, `index` | float64, uint32 | along the trajectory, the index from 0 |
//! | `is_train`, `is_test` | bool | in the interleaved split |
//! | `conventions` | text | all conventions of the data set, as JSON |

use super::Dataset;
use super::header::to_json;
use crate::npz::{Array, Values, encode_npz};
use crate::{Light, Pinhole, Radio, Result};

/// The archive of keyframe `index`.
///
/// # Errors
/// Those of [`Dataset::keyframe`].
pub fn keyframe_npz(dataset: &Dataset, index: usize) -> Result<Vec<u8>> {
    let keyframe = dataset.keyframe(index)?;
    let text = |name: &str, text: String| Array::new(name, &[], Values::Text(vec![text]));
    let mut arrays = vec![
        Array::new("index", &[], Values::U32(vec![index as u32])),
        Array::new("time_s", &[], Values::F64(vec![keyframe.time_s])),
        Array::new("world_from_camera", &[4, 4], Values::F64(keyframe.world_from_camera.to_rows().concat())),
        Array::new("is_train", &[], Values::Bool(vec![dataset.train_indices().contains(&index)])),
        Array::new("is_test", &[], Values::Bool(vec![dataset.test_indices().contains(&index)])),
    ];
    if let Some(Light { image, depth_m, mask, .. }) = &keyframe.light {
        arrays.push(Array::new("image", &[image.height(), image.width(), 3], Values::U8(image.pixels().concat())));
        arrays.push(intrinsics("optical_intrinsics", &dataset.light_camera()));
        if let Some(depth) = depth_m {
            arrays.push(Array::new("depth_m", &[depth.height(), depth.width()], Values::F32(depth.pixels().to_vec())));
        }
        if let Some(mask) = mask {
            arrays.push(Array::new("mask", &[mask.height(), mask.width()], Values::Bool(mask.pixels().to_vec())));
        }
    }
    if let (Some(Radio { spectrum }), Some(range)) = (&keyframe.radio, dataset.db_range()) {
        arrays.push(Array::new("spectrum", &[spectrum.height(), spectrum.width()], Values::F32(spectrum.pixels().to_vec())));
        arrays.push(intrinsics("rf_intrinsics", &dataset.radio_camera()));
        arrays.push(text("spectrum_unit", dataset.header().quantity.unit().to_owned()));
        arrays.push(Array::new("db_range", &[2], Values::F64(vec![range.min_db, range.max_db])));
    }
    arrays.push(text("conventions", to_json(dataset.conventions())?));
    encode_npz(&arrays)
}

fn intrinsics(name: &str, c: &Pinhole) -> Array {
    Array::new(name, &[3, 3], Values::F64(vec![c.fx, 0.0, c.cx, 0.0, c.fy, c.cy, 0.0, 0.0, 1.0]))
}
