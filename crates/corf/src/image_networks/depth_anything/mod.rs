//! Depth-Anything-V2 (Yang et al. 2024): a transformer and a dense prediction head that give the inverse depth of one image up to scale and offset.
//!
//! The weights are the user's; nothing is downloaded. What follows the official code where it and the transformers library differ is the stretch of
//! the positional embedding. The same image and weights give the same bytes on any number of threads of one kind of processor.

mod dpt;
mod ops;
#[cfg(test)]
mod tests;
mod vit;
mod weights;

use crate::depth::dense::Dense;
use crate::image_networks::Map;
use crate::{Error, Result, config::DepthConfig};
use corf_scene::Raster;
use dpt::Head;
use ops::bicubic;
use std::fmt;
use std::path::Path;
use vit::{PATCH, Transformer};
use weights::Weights;

/// Mean and standard deviation of ImageNet's colours, sRGB between 0 and 1.
const IMAGENET: [[f32; 3]; 2] = [[0.485, 0.456, 0.406], [0.229, 0.224, 0.225]];
/// Most patches of an image: attention compares each with each.
const MOST_PATCHES: usize = 1 << 14;

/// The network with its weights, and how it is shown images.
pub struct DepthNetwork {
    transformer: Transformer,
    head: Head,
    /// Shorter side of what it sees, pixels.
    side: usize,
    imagenet_normalisation: bool,
}

impl fmt::Debug for DepthNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Network").field("width", &self.transformer.width).field("side", &self.side).finish_non_exhaustive()
    }
}

impl DepthNetwork {
    /// Reads the weights at `path` (float32, float16 or bfloat16; tensor names of the official code or of the transformers library); Small, Base or
    /// Large is told by their shapes.
    ///
    /// # Errors
    /// A file that cannot be read, is damaged, or lacks a tensor; a network for metric depth.
    pub fn read(path: &Path, config: &DepthConfig) -> Result<Self> {
        let weights = Weights::read(path)?;
        if let Some(kind) = weights.config.depth_estimation_type.as_ref().filter(|kind| *kind != "relative") {
            return Err(weights.fault(
                format!("its config.json says depth_estimation_type = \"{kind}\""),
                "give weights for relative depth; maps of other networks can be given as depth.prior = \"folder\"",
            ));
        }
        let transformer = Transformer::read(&weights)?;
        let head = Head::read(&weights, transformer.width)?;
        // As many patches as come nearest, at least one.
        let side = PATCH * ((config.input_px + PATCH / 2) / PATCH).max(1);
        Ok(Self { transformer, head, side, imagenet_normalisation: config.imagenet_normalisation })
    }

    /// Rows and columns of what the network sees of an image (columns, rows): its shape, the shorter side as configured, whole patches.
    ///
    /// # Errors
    /// An image without pixels, or so long that there would be too many patches.
    pub fn input_size(&self, (width, height): (usize, usize)) -> Result<[usize; 2]> {
        let shorter = width.min(height).max(1);
        let scaled = |side: usize| {
            let patches = side as f64 * self.side as f64 / shorter as f64 / PATCH as f64;
            (patches.round_ties_even() as usize).max(self.side / PATCH) * PATCH
        };
        let size = [height, width].map(scaled);
        if width == 0 || height == 0 || size[0] / PATCH > MOST_PATCHES / (size[1] / PATCH) {
            return Err(Error::invalid(
                "the depth-anything prior",
                format!("it would see the {width}x{height} image with {}x{} pixels, more than it can", size[1], size[0]),
                "lower depth.input_px, or set depth.prior = \"none\"",
            ));
        }
        Ok(size)
    }

    /// The inverse depth of an image up to scale and offset, at the network's resolution or the image's, whichever is lower.
    ///
    /// # Errors
    /// Those of [`Self::input_size`]; weights that give what is no number.
    pub fn estimate(&self, image: &Raster<[u8; 3]>) -> Result<Dense> {
        let input = self.show(image)?;
        let map = self.forward(&input);
        if map.values.iter().any(|v| !v.is_finite()) {
            return Err(Error::invalid(
                "the depth-anything prior",
                "the network gave a value that is no number",
                "its weights are damaged, or not of this network: give others (depth.weights)",
            ));
        }
        let size = (image.width(), image.height());
        Ok(Dense::reduced(Raster::from_vec(map.width, map.height, map.values), size))
    }

    /// An image as the network sees it: resampled by a cubic kernel, and normalised.
    fn show(&self, image: &Raster<[u8; 3]>) -> Result<Map> {
        let size = self.input_size((image.width(), image.height()))?;
        let values = image.pixels().as_flattened().iter().map(|v| f32::from(*v) / 255.0).collect();
        let whole = Map { height: image.height(), width: image.width(), channels: 3, values };
        let step = [image.height() as f64 / size[0] as f64, image.width() as f64 / size[1] as f64];
        let mut seen = bicubic(&whole, size, step);
        if self.imagenet_normalisation {
            let [mean, deviation] = IMAGENET;
            for pixel in seen.values.chunks_exact_mut(3) {
                for ((value, mean), deviation) in pixel.iter_mut().zip(mean).zip(deviation) {
                    *value = (*value - mean) / deviation;
                }
            }
        }
        Ok(seen)
    }

    /// Forward pass of the network: the output map of an input image.
    fn forward(&self, input: &Map) -> Map {
        self.head.forward(&self.transformer.forward(input))
    }
}
