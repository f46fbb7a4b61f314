//! A data set's light as nerfstudio reads it: images, depth in millimetres, and points to start from.
//!
//! ```text
//! transforms.json          cameras, poses, lists of the split, `ply_file_path`, and `depth_file_path` of every frame where there is depth
//! images/00001.png         8-bit sRGB
//! depths/00001_depth.png   16 bits, whole millimetres along the optical axis; 0 where there is none, and beyond 65.535 m
//! masks/00001_mask.png     8 bits, 0 where a pixel does not count; of all keyframes or, where none has a mask, of none: nerfstudio takes nothing between
//! sparse_pc.ply            the points of the data set's COLMAP model: `double x y z`, `uchar red green blue`
//! ```
//!
//! A data set's own `optical/transforms.json` names neither points nor depth: a PLY in that folder would be taken for Gaussians by other
//! readers, and depth in millimetres would be there twice.

use super::{File, FolderExport};
use crate::capture::read_points;
use crate::dataset::{Besides, ColoredPoint, Dataset, millimetres, stem, transforms_json};
use crate::io::encode_mask;
use crate::{Error, Raster, Result, io};

/// Name of the point cloud, nerfstudio's own.
const POINTS: &str = "sparse_pc.ply";

/// Path of a keyframe's depth. It does not end as the image's does: some readers match images by the end of their path.
fn depth_path(index: usize) -> String {
    format!("depths/{}_depth.png", stem(index))
}

fn mask_path(index: usize) -> String {
    format!("masks/{}_mask.png", stem(index))
}

/// The export of a data set.
#[derive(Debug)]
pub struct Nerfstudio<'d> {
    dataset: &'d Dataset,
    whole: Vec<File>,
}

impl<'d> Nerfstudio<'d> {
    /// Prepares the export.
    ///
    /// # Errors
    /// A data set without images; points that cannot be read.
    pub fn new(dataset: &'d Dataset) -> Result<Self> {
        if !dataset.modalities().light {
            return Err(no_images(dataset));
        }
        let points = read_points(&dataset.dir().join("optical/sparse/0/points3D.txt"))?;
        let besides = Besides {
            points: POINTS,
            depth: dataset.has_depth().then_some(depth_path as fn(usize) -> String),
            mask: dataset.has_masks().then_some(mask_path as fn(usize) -> String),
            offset_m: dataset.header().offset_m(),
        };
        let split = [dataset.train_indices(), dataset.test_indices()];
        let transforms = transforms_json(&dataset.light_camera(), dataset.poses(), split, Some(&besides))?;
        let whole = vec![(POINTS.to_owned(), cloud(&points)), ("transforms.json".to_owned(), transforms.into_bytes())];
        Ok(Self { dataset, whole })
    }
}

impl FolderExport for Nerfstudio<'_> {
    fn keyframe(&self, index: usize) -> Result<Vec<File>> {
        let Some(light) = self.dataset.keyframe(index)?.light else { return Err(no_images(self.dataset)) };
        let mut files = vec![(format!("images/{}.png", stem(index)), io::encode_png(&light.image)?)];
        if self.dataset.has_depth()
            && let Some(depth) = &light.depth_m
        {
            files.push((depth_path(index), io::encode_png16(&depth.map(|d| millimetres(*d)))?));
        }
        if self.dataset.has_masks() {
            let all = || Raster::filled(light.image.width(), light.image.height(), true);
            files.push((mask_path(index), encode_mask(&light.mask.clone().unwrap_or_else(all))?));
        }
        Ok(files)
    }

    fn whole(&self) -> Vec<File> {
        self.whole.clone()
    }
}

fn no_images(dataset: &Dataset) -> Error {
    let help = "nerfstudio opens its folder rf/ as it is";
    Error::invalid(dataset.dir().display().to_string(), "the data set has no images", help)
}

/// Coloured points as little-endian binary PLY.
fn cloud(points: &[ColoredPoint]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    )
    .into_bytes();
    for point in points {
        bytes.extend(point.position.to_array().iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(point.color);
    }
    bytes
}
