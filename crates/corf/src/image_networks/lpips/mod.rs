//! LPIPS v0.1 (Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric"): how far apart two images are to a
//! network that was trained on photographs.
//!
//! An input x becomes `(x − shift)/scale` per colour and goes through the backbone. Behind five (SqueezeNet: seven) of its rectifiers features f are
//! compared: with `f̂ = f/(√Σ_c f_c² + 1e-10)` and the learned weights w of the channels,
//! `LPIPS = Σ_l mean over pixels of Σ_c w_lc (f̂ᵃ_lc − f̂ᵇ_lc)²`.
//!
//! The weights are the user's; nothing is downloaded. The same images and weights give the same bytes on any number of threads of one kind of
//! processor. Maps are held whole: with VGG-16 at most three of 64 values a pixel at once, 1.1 GB for images of 1600×900. `LpipsOnGpu` computes the
//! same on a GPU, all in f32.

#[cfg(feature = "gpu")]
mod gpu;
#[cfg(test)]
mod tests;
mod trunk;

#[cfg(feature = "gpu")]
pub use gpu::LpipsOnGpu;

use crate::Result;
use crate::files::tensors::Tensors;
use crate::image_networks::Map;
use corf_scene::Raster;
use std::fmt;
use std::path::Path;
use trunk::Step;

/// Subtracted from each colour of an input, which is then divided by the second.
const NORMALISATION: [[f32; 3]; 2] = [[-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]];
/// Difference to the known distance of the known pair beyond which weights are not those of LPIPS v0.1. Sums in another order differ by 1e-6.
const KNOWN_TOLERANCE: f64 = 1e-4;
const HELP: &str = "give the weights of LPIPS v0.1 as tools/fetch_weights.py writes them";

/// A network whose features are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Backbone {
    /// VGG-16, which the literature on radiance fields reports.
    Vgg,
    /// AlexNet, which LPIPS's authors recommend for evaluation.
    Alex,
    /// SqueezeNet 1.1.
    Squeeze,
}

impl Backbone {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Vgg, Self::Alex, Self::Squeeze];

    /// Name in keys and file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vgg => "vgg",
            Self::Alex => "alex",
            Self::Squeeze => "squeeze",
        }
    }

    /// Name of the file with its weights.
    pub fn file(self) -> String {
        format!("lpips_{}.safetensors", self.name())
    }

    /// Its distance of [`known_pair`] with [`LpipsInput::Signed`], from an implementation of its own in f64 (numpy) that agrees with the official
    /// program's values for its example images.
    fn known_distance(self) -> f64 {
        match self {
            Self::Vgg => 0.546_372,
            Self::Alex => 0.296_605,
            Self::Squeeze => 0.303_548,
        }
    }
}

/// Convention for the input x that a network is shown for a colour value v between 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LpipsInput {
    /// x = 2v − 1, between −1 and 1: LPIPS as its authors define it.
    Signed,
    /// x = v, between 0 and 1: the step to [−1, 1] left out, as the literature on Gaussian splatting does. Not LPIPS, but what it reports by that
    /// name.
    Unit,
}

/// LPIPS with one backbone.
pub struct Lpips {
    backbone: Backbone,
    steps: Vec<Step>,
    sha256: String,
}

impl fmt::Debug for Lpips {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Lpips").field("backbone", &self.backbone).field("sha256", &self.sha256).finish_non_exhaustive()
    }
}

impl Lpips {
    /// Reads the weights at `path`: a safetensors file with torchvision's names of tensors (`features.N.weight`) and `lin0.weight` and so on.
    ///
    /// # Errors
    /// A file that cannot be read, is damaged or lacks a tensor; weights that are not those of LPIPS v0.1, told by a pair of images whose distance is
    /// known.
    pub fn read(path: &Path, backbone: Backbone) -> Result<Self> {
        let tensors = Tensors::read(path, HELP)?;
        let lpips = Self { backbone, steps: trunk::read(backbone, &tensors)?, sha256: tensors.sha256() };
        let [a, b] = known_pair();
        let (found, known) = (lpips.distance(&a, &b, LpipsInput::Signed), backbone.known_distance());
        // Written so that what is no number is refused.
        if (found - known).abs() <= KNOWN_TOLERANCE {
            return Ok(lpips);
        }
        let name = backbone.name();
        Err(tensors
            .fault(format!("gives {found:.5} for a pair of images to which LPIPS v0.1 ({name}) gives {known:.5}: other weights")))
    }

    /// Its backbone.
    pub fn backbone(&self) -> Backbone {
        self.backbone
    }

    /// SHA-256 of the file of weights, in hexadecimal.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// Length of the shortest side of an image that the backbone can be shown, pixels.
    pub fn least_px(&self) -> usize {
        let fits = |length: &usize| self.steps.iter().try_fold(*length, |length, step| step.places(length)).is_some();
        (1..).find(fits).expect("every backbone ends somewhere")
    }

    /// The distance of two images.
    ///
    /// # Panics
    /// If they differ in size, or are smaller than [`Self::least_px`].
    pub fn distance(&self, a: &Raster<[u8; 3]>, b: &Raster<[u8; 3]>, input: LpipsInput) -> f64 {
        self.layers(a, b, input).iter().sum()
    }

    /// The shares of the layers in the distance of two images, from shallow to deep.
    ///
    /// # Panics
    /// If they differ in size, or are smaller than [`Self::least_px`].
    pub fn layers(&self, a: &Raster<[u8; 3]>, b: &Raster<[u8; 3]>, input: LpipsInput) -> Vec<f64> {
        let mut maps = pair_shown(a, b, input);
        let mut shares = Vec::new();
        for step in &self.steps {
            if let Step::Comparison(weights) = step {
                shares.push(trunk::distance(weights, &maps));
            }
            // One after the other: what was behind the step before it goes before the second is made.
            maps = maps.map(|map| step.of(map));
        }
        shares
    }
}

/// Two images as a network sees them.
///
/// # Panics
/// If they differ in size.
fn pair_shown(a: &Raster<[u8; 3]>, b: &Raster<[u8; 3]>, input: LpipsInput) -> [Map; 2] {
    assert_eq!((a.width(), a.height()), (b.width(), b.height()), "images of one size are compared");
    [shown(a, input), shown(b, input)]
}

/// An image as a network sees it.
fn shown(image: &Raster<[u8; 3]>, input: LpipsInput) -> Map {
    let [shift, scale] = NORMALISATION;
    let normalised = |pixel: &[u8; 3]| -> [f32; 3] {
        std::array::from_fn(|c| {
            let value = f32::from(pixel[c]) / 255.0;
            let x = match input {
                LpipsInput::Signed => 2.0 * value - 1.0,
                LpipsInput::Unit => value,
            };
            (x - shift[c]) / scale[c]
        })
    };
    let values = image.pixels().iter().flat_map(normalised).collect();
    Map { height: image.height(), width: image.width(), channels: 3, values }
}

/// Two images that tell by their distance whether weights are LPIPS's; not symmetric in any way that a mistake in the order of weights could hide
/// behind.
fn known_pair() -> [Raster<[u8; 3]>; 2] {
    const SIDE: usize = 48;
    let byte = |v: usize| (v % 256) as u8;
    let a = Raster::from_fn(SIDE, SIDE, |x, y| [byte(5 * x), byte(3 * y), byte(x * y)]);
    let b = Raster::from_fn(SIDE, SIDE, |x, y| [byte(5 * x), byte(x * y + 60), byte(3 * y)]);
    [a, b]
}
