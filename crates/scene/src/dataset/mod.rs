//! The keyframe dataset on disk.
//!
//! ```text
//! lobby147/
//!   dataset.json       what everything is: units, axes, cameras, carrier, dB range, split, SHA-256 of every file
//!   trajectory.json    per keyframe: index, time, world_from_camera
//!   optical/           images/00001.png  depth/00001.exr  surfaces/00001.exr  linear/00001.exr, masks/00001_mask.png (optional)
//!   rf/                images/00001.png  spectra/00001.exr  db/00001.exr  sphere/00001.exr  paths/00001.jsonl.gz (the last three optional)
//!   rf-tutorial/       images/00001.png (optional: by the recipe of published sets)
//!   each of the three  sparse/0/{cameras,images,points3D}.txt  transforms.json  train_index.txt  test_index.txt
//! ```
//!
//! A data set that was imported may lack one of the two modalities, depth and surfaces; what it lacks has no files.
//!
//! File stems count from 1, indices from 0. Each modality's folder is self-contained: COLMAP and transforms.json readers open it as it is.
//! No file but `images/N.png` ends in `N.png`, because some readers match images by suffix.

pub(crate) mod beam_width;
mod checks;
mod conventions;
mod darkness;
mod export;
mod file;
mod fixed_array;
mod foreign;
mod header;
mod identity;
mod layout;
mod leftovers;
mod numpy;
mod reader;
mod shared_light;
mod validate;
mod writer;

pub use conventions::{Conventions, EQUIRECTANGULAR_AXES};
pub use export::ColoredPoint;
pub(crate) use export::{Besides, transforms_json};
pub use fixed_array::{FIXED_ARRAY_SCHEMA, FixedArray, ImportedArray, import_fixed_array};
pub use header::{
    DATASET_SCHEMA, DatasetHeader, Imported, LightFrom, MaterialRecord, MeanAndRange, OnSurface, Quantity, SamplingError,
    StatedSensor, StatedSplit,
};
pub use identity::check_finished;
pub use layout::stem;
pub use numpy::keyframe_npz;
pub use reader::Dataset;
pub use validate::validate;
pub(crate) use writer::millimetres;
pub use writer::{DatasetWriter, Extras, KeyframeContent, forget_progress, grown_frame};

#[cfg(test)]
mod tests;
