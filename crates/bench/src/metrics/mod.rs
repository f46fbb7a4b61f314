//! Metrics of a predicted image and a predicted spectrum, one value a frame; means are taken over frames afterwards.

pub mod image;
pub mod lpips;
pub mod radio;

use corf_scene::keyframe::DbRange;
use corf_scene::{Keyframe, Pinhole, Raster, color};
use lpips::LpipsNetworks;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Prediction of a method at a pose.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// Optical image, sRGB-encoded `[0, 1]`.
    pub image: Raster<[f32; 3]>,
    /// Jet-coloured spectrum, `[0, 1]`: what the paper's RF metrics look at.
    pub rf_jet: Raster<[f32; 3]>,
    /// The spectrum as a scalar on the dataset's dB range, `[0, 1]`: what the physical metrics look at.
    pub rf_scalar: Raster<f32>,
    /// z-depth of the optical view, metres, 0 where the field has nothing; methods without geometry have none.
    pub depth_m: Option<Raster<f32>>,
}

impl Prediction {
    /// A prediction without depth from a scalar spectrum, coloured for the paper's metrics.
    pub fn from_scalar(image: Raster<[f32; 3]>, rf_scalar: Raster<f32>) -> Self {
        Self { image, rf_jet: rf_scalar.map(|&s| color::jet(s)), rf_scalar, depth_m: None }
    }
}

/// All metrics of one held-out frame. Names are those of `metrics.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameMetrics {
    /// Keyframe index along the trajectory.
    pub index: usize,
    /// PSNR of the 8-bit optical image, dB.
    pub psnr_opt: f64,
    /// SSIM of the 8-bit optical image.
    pub ssim_opt: f64,
    /// PSNR of the 8-bit Jet spectrum, dB (the paper's PSNR_rf).
    pub psnr_rf_jet: f64,
    /// SSIM of the 8-bit Jet spectrum (the paper's SSIM_rf).
    pub ssim_rf_jet: f64,
    /// PSNR of the 8-bit scalar (dB-scaled) spectrum, dB.
    pub psnr_rf_scalar: f64,
    /// SSIM of the 8-bit scalar spectrum.
    pub ssim_rf_scalar: f64,
    /// Physical metrics of the spectrum.
    #[serde(flatten)]
    pub radio: radio::RadioMetrics,
    /// LPIPS by column key, of the backbones whose weights were given.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub lpips: BTreeMap<String, f64>,
}

/// Compares a prediction with a keyframe.
///
/// `rf_camera` gives the solid angle of every spectrum pixel and `range` the dataset's dB range; LPIPS is computed with the networks there are.
pub fn compare(
    prediction: &Prediction,
    truth: &Keyframe,
    rf_camera: &Pinhole,
    range: &DbRange,
    networks: &LpipsNetworks,
) -> FrameMetrics {
    let image = prediction.image.map(|p| p.map(color::quantize8));
    let scalar_truth = truth.spectrum.map(|&s| range.scalar(s));
    let jet_truth = scalar_truth.map(|&s| color::jet(s).map(color::quantize8));
    let jet = prediction.rf_jet.map(|p| p.map(color::quantize8));
    let grey_truth = scalar_truth.map(|&s| [color::quantize8(s)]);
    let grey = prediction.rf_scalar.map(|&s| [color::quantize8(s)]);
    FrameMetrics {
        index: truth.index,
        psnr_opt: image::psnr(&image, &truth.image),
        ssim_opt: image::ssim(&image, &truth.image),
        psnr_rf_jet: image::psnr(&jet, &jet_truth),
        ssim_rf_jet: image::ssim(&jet, &jet_truth),
        psnr_rf_scalar: image::psnr(&grey, &grey_truth),
        ssim_rf_scalar: image::ssim(&grey, &grey_truth),
        radio: radio::compare(&prediction.rf_scalar, &truth.spectrum, rf_camera, range),
        lpips: networks.compare([("opt", &image, &truth.image), ("rf_jet", &jet, &jet_truth)]),
    }
}

/// One column of the tables: where it is found and how it is written (the arrow in a heading says which way is better).
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Key in records and CSV.
    pub key: &'static str,
    /// Heading in Markdown and HTML.
    pub heading: &'static str,
    /// Heading in LaTeX.
    pub latex: &'static str,
    /// Digits after the point.
    pub digits: usize,
    /// Reads it off a frame, where the frame has it.
    pub of: fn(&FrameMetrics) -> Option<f64>,
}

impl Column {
    /// Name of the backbone of a column of LPIPS, which a record has only where its weights were given.
    pub fn backbone(&self) -> Option<&'static str> {
        self.key.strip_prefix("lpips_")?.split('_').next()
    }
}

/// A column of LPIPS: key, backbone, input, image, and the image's index in LaTeX.
macro_rules! lpips {
    ($key:literal, $backbone:literal, $input:literal, $image:literal, $index:literal) => {
        Column {
            key: $key,
            heading: concat!("LPIPS-", $backbone, " ", $input, " ", $image, " ↓"),
            latex: concat!(r"LPIPS$_\mathrm{", $index, r"}^\downarrow$ (", $backbone, ", $", $input, "$)"),
            digits: 3,
            of: |m| m.lpips.get($key).copied(),
        }
    };
}

/// Every metric, in the order of the tables; the first six are the paper's. LPIPS comes last: by backbone, for LPIPS's input and the literature's.
pub const COLUMNS: &[Column] = &[
    Column {
        key: "psnr_opt",
        heading: "PSNR opt ↑",
        latex: r"PSNR$_\mathrm{opt}^\uparrow$",
        digits: 2,
        of: |m| Some(m.psnr_opt),
    },
    Column {
        key: "ssim_opt",
        heading: "SSIM opt ↑",
        latex: r"SSIM$_\mathrm{opt}^\uparrow$",
        digits: 3,
        of: |m| Some(m.ssim_opt),
    },
    Column {
        key: "psnr_rf_jet",
        heading: "PSNR rf (Jet) ↑",
        latex: r"PSNR$_\mathrm{rf}^\uparrow$",
        digits: 2,
        of: |m| Some(m.psnr_rf_jet),
    },
    Column {
        key: "ssim_rf_jet",
        heading: "SSIM rf (Jet) ↑",
        latex: r"SSIM$_\mathrm{rf}^\uparrow$",
        digits: 3,
        of: |m| Some(m.ssim_rf_jet),
    },
    Column {
        key: "psnr_rf_scalar",
        heading: "PSNR rf (dB) ↑",
        latex: r"PSNR$_\mathrm{rf,dB}^\uparrow$",
        digits: 2,
        of: |m| Some(m.psnr_rf_scalar),
    },
    Column {
        key: "ssim_rf_scalar",
        heading: "SSIM rf (dB) ↑",
        latex: r"SSIM$_\mathrm{rf,dB}^\uparrow$",
        digits: 3,
        of: |m| Some(m.ssim_rf_scalar),
    },
    Column {
        key: "rmse_db_30",
        heading: "RMSE within 30 dB, dB ↓",
        latex: r"RMSE$_{30}^\downarrow$ (dB)",
        digits: 2,
        of: |m| Some(m.radio.rmse_db_30),
    },
    Column {
        key: "rmse_db", heading: "RMSE, dB ↓", latex: r"RMSE$^\downarrow$ (dB)", digits: 2, of: |m| Some(m.radio.rmse_db)
    },
    Column {
        key: "psp_similarity",
        heading: "PSP similarity ↑",
        latex: r"PSP$^\uparrow$",
        digits: 3,
        of: |m| Some(m.radio.psp_similarity),
    },
    Column {
        key: "total_power_error_db",
        heading: "total power error, dB ↓",
        latex: r"$|\Delta P|^\downarrow$ (dB)",
        digits: 2,
        of: |m| Some(m.radio.total_power_error_db),
    },
    Column {
        key: "peak_error_deg",
        heading: "peak AoA error, ° ↓",
        latex: r"AoA$^\downarrow$ ($^\circ$)",
        digits: 1,
        of: |m| Some(m.radio.peak_error_deg),
    },
    Column {
        key: "beam_loss_db",
        heading: "beam loss, dB ↓",
        latex: r"beam loss$^\downarrow$ (dB)",
        digits: 2,
        of: |m| Some(m.radio.beam_loss_db),
    },
    Column {
        key: "energy_capture_1",
        heading: "energy in best 1 % ↑",
        latex: r"$E_{1\%}^\uparrow$",
        digits: 3,
        of: |m| Some(m.radio.energy_capture_1),
    },
    Column {
        key: "energy_capture_5",
        heading: "energy in best 5 % ↑",
        latex: r"$E_{5\%}^\uparrow$",
        digits: 3,
        of: |m| Some(m.radio.energy_capture_5),
    },
    Column {
        key: "azimuth_spread_error_deg",
        heading: "azimuth spread error, ° ↓",
        latex: r"$|\Delta\mathrm{ASA}|^\downarrow$ ($^\circ$)",
        digits: 2,
        of: |m| Some(m.radio.azimuth_spread_error_deg),
    },
    lpips!("lpips_vgg_opt", "VGG", "[-1,1]", "opt", "opt"),
    lpips!("lpips_vgg_rf_jet", "VGG", "[-1,1]", "rf (Jet)", "rf"),
    lpips!("lpips_vgg_01_opt", "VGG", "[0,1]", "opt", "opt"),
    lpips!("lpips_vgg_01_rf_jet", "VGG", "[0,1]", "rf (Jet)", "rf"),
    lpips!("lpips_alex_opt", "Alex", "[-1,1]", "opt", "opt"),
    lpips!("lpips_alex_rf_jet", "Alex", "[-1,1]", "rf (Jet)", "rf"),
    lpips!("lpips_alex_01_opt", "Alex", "[0,1]", "opt", "opt"),
    lpips!("lpips_alex_01_rf_jet", "Alex", "[0,1]", "rf (Jet)", "rf"),
    lpips!("lpips_squeeze_opt", "Squeeze", "[-1,1]", "opt", "opt"),
    lpips!("lpips_squeeze_rf_jet", "Squeeze", "[-1,1]", "rf (Jet)", "rf"),
    lpips!("lpips_squeeze_01_opt", "Squeeze", "[0,1]", "opt", "opt"),
    lpips!("lpips_squeeze_01_rf_jet", "Squeeze", "[0,1]", "rf (Jet)", "rf"),
];
