//! The configuration of a reconstruction. Defaults are those of `corf-gs`; the paper's own values are in parentheses where they differ.

use crate::{Appearance, Error, Gaussians, IdleKey, Result, target::RadioTarget};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Sampling rule for the pixels of a keyframe that spawn new Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Sampling {
    /// Sampling with the probability `max(P − P̃, 0)` of paper Eqs. (13)–(15).
    Log,
    /// Sampling with the same probability at every pixel: the paper's ablation "w/o optical-guided expansion".
    Uniform,
}

/// Coupling of the two modalities in training.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Coupling {
    /// Both losses shape the shared geometry in every step (paper Eq. (21)).
    Joint,
    /// Two stages: light alone online, then radio on the frozen geometry.
    Frozen,
    /// Two stages: light alone online, then radio, which may still move the geometry.
    #[serde(rename = "rf-tuned")]
    RadioTuned,
}

/// The RF opacity a second stage starts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SecondStageOpacity {
    /// The opacity light has learnt, as RF-3DGS does.
    #[serde(rename = "optical")]
    Light,
    /// The opacity every Gaussian was born with.
    Initial,
}

/// Source of the dense depth prior, before it is aligned and refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DepthPriorKind {
    /// The ray tracer's depth seen through a monocular network's error model. Consumes ground truth, and every result says so.
    Simulated,
    /// The ray tracer's depth as it is, neither aligned nor matched: the row that says what better depth could bring. Consumes ground truth,
    /// and every result says so.
    Exact,
    /// The keyframe's own depth, as a sensor measured it, neither aligned nor matched; a keyframe that brings none is treated as with `none`.
    /// Results say that they used the data set's depth.
    Measured,
    /// Maps that are there already, one a keyframe, of any network's making: `depth.folder`.
    Folder,
    /// Depth-Anything-V2 with the user's weights: `depth.weights`.
    DepthAnything,
    /// No dense prior: triangulated and matched depths alone.
    None,
}

/// Quantity in the maps of `depth.folder`. All are aligned to triangulated depths, since metric networks too err in scale; metric maps are
/// used unaligned only where too little was triangulated to align them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum FolderKind {
    /// Inverse depth up to scale and offset, larger where nearer: MiDaS, Depth-Anything.
    InverseRelative,
    /// Depth up to scale, larger where further: Marigold and the like. Inverted before it is aligned.
    DepthRelative,
    /// z-depth in metres.
    DepthMetric,
    /// Inverse z-depth in 1/m.
    InverseMetric,
}

/// Where keyframes are matched with their neighbours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MatchedOn {
    /// On the device that trains.
    #[default]
    Device,
    /// On the processor, whatever trains.
    Processor,
}

/// Error level of the simulated depth prior (γ, λ and κ of `depth::prior`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PriorPreset {
    /// AbsRel about 0.04 after alignment.
    Mild,
    /// AbsRel about 0.065: a small monocular network, zero-shot, indoors.
    Default,
    /// AbsRel about 0.095.
    Hard,
}

/// The configuration of a [`crate::Reconstructor`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ReconstructionConfig {
    /// Joint, or one of the two-stage pipelines. Default `joint`.
    pub coupling: Coupling,
    /// The RF opacity a two-stage pipeline's second stage starts from. Default `optical`, the stronger of the two.
    pub second_stage_opacity: SecondStageOpacity,
    /// Sampling rule for the pixels that spawn Gaussians. Default `log`.
    pub sampling: Sampling,
    /// Spawn probability of `uniform` sampling (paper: 0.1).
    pub uniform_probability: f32,
    /// Least probability of `log` sampling where nothing covers a pixel yet: blank walls show no structure to light and are what radio meets.
    /// Published: 0.
    pub least_probability: f32,
    /// Encoding of the spectra that the RF field is trained on. Default `jet`, as published; `db` is nearer to what is strong and no better in the mean.
    #[serde(rename = "rf_target")]
    pub radio_target: RadioTarget,
    /// Optimisation steps per keyframe (paper: 75).
    pub iterations_per_keyframe: usize,
    /// Number of these steps, the last ones of a keyframe, that overlap with the next keyframe's expansion: they run after it has surveyed
    /// the field and before its Gaussians and images are added, so that a GPU trains while the processor decides what to add. After the
    /// last keyframe they run without overlap. Default 0, as published.
    pub overlapped_iterations: usize,
    /// Time of a keyframe instead of `iterations_per_keyframe`, milliseconds from when its turn comes: its expansion takes what it takes, and
    /// steps fill the rest, five at least. A result then depends on the machine and its load, and no two runs are the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keyframe_budget_ms: Option<f64>,
    /// Pyramid levels (paper: 3).
    pub pyramid_levels: u32,
    /// Pyramid levels of the spectrum, at most `pyramid_levels`: with fewer it starts finer than the image. Default: as many, as published.
    #[serde(rename = "rf_pyramid_levels")]
    pub radio_pyramid_levels: Option<u32>,
    /// A keyframe moves one pyramid level finer after this many of its own visits (5).
    pub visits_per_level: usize,
    /// Share of a keyframe's visits at the finest pyramid level that render the optical image at full resolution; the others render it one
    /// level coarser, at a quarter of the cost. The spectrum is at full resolution in all of them. Published: 1. Default: half a megapixel
    /// over the number of the image's pixels, at most 1.
    pub finest_share: Option<f32>,
    /// Probability that a step visits the latest keyframe; otherwise it visits any of them. Published: 0.2. Default 0.05.
    pub latest_probability: f32,
    /// λ_rf (paper: 0.1).
    #[serde(rename = "rf_weight")]
    pub radio_weight: f32,
    /// η at a keyframe's first visit (paper: 0.01), in a world whose mean baseline is 0.1.
    pub depth_weight: f32,
    /// η's decay per visit of a keyframe (paper: 0.9).
    pub depth_weight_decay: f32,
    /// Spherical-harmonic degree of the optical colour, 0–3. Default 1: with some 75 visits a keyframe, higher degrees learn the training
    /// views by heart (lobby-mini, held out: 21.6 dB against 20.9 dB at degree 2).
    #[serde(rename = "optical_sh_degree")]
    pub light_sh_degree: usize,
    /// Spherical-harmonic degree of the RF colour, 0–3. Default 3: at 60 GHz lower degrees lose 1.3 dB and more (public study).
    #[serde(rename = "rf_sh_degree")]
    pub radio_sh_degree: usize,
    /// σ of the Laplacian of Gaussian, pixels of an image of up to 640 columns; it grows in proportion to wider ones, where grain of a pixel's
    /// size is no structure.
    pub log_sigma_px: f32,
    /// Smallest and largest pixel distance of a new Gaussian; the largest as a fraction of the image width.
    pub scale_clamp: [f32; 2],
    /// Initial opacity of both modalities at an accurate multi-view match, at a depth of the prior alone, and at a triangulated corner.
    pub initial_opacity: [f32; 3],
    /// A Gaussian that is the main contributor at this many accurate new samples is replaced by them (10).
    pub replace_at_samples: usize,
    /// Old Gaussians at or below this opacity are pruned (0.05).
    pub prune_opacity: f32,
    /// A Gaussian is old this many keyframes after its birth.
    pub prune_age_keyframes: usize,
    /// A Gaussian whose standard deviation exceeds this fraction of the image is pruned (half).
    pub prune_image_fraction: f32,
    /// Position rate in a world whose mean baseline is 0.1 (5e-5).
    pub position_rate: f32,
    /// Number of camera baselines whose mean defines the world's scale (5).
    pub scale_baselines: usize,
    /// Keyframes collected before the first expansion, so that the first ones have neighbours to be matched with (2 to 8).
    pub bootstrap_keyframes: usize,
    /// Depth settings.
    pub depth: DepthConfig,
}

/// Settings of depth estimation (`corf::depth`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DepthConfig {
    /// Dense prior. Default `simulated`.
    pub prior: DepthPriorKind,
    /// Error level of the `simulated` prior. Default `default`.
    pub preset: PriorPreset,
    /// Folder of the `folder` prior's maps, from the current directory: `NNNNN.exr`, `.npy` or `.png` for the keyframe whose image is `NNNNN.png`
    /// (its index plus one). Given with that prior and no other.
    pub folder: Option<PathBuf>,
    /// Quantity in those maps. Default `inverse-relative`.
    pub folder_kind: FolderKind,
    /// Value of whole-number maps (16-bit PNG, `.npy` of integers) at one metre (or at 1/m, for `inverse-metric`); floats are metres, relative maps
    /// have no unit. Default 1000: millimetres.
    pub png_scale: f64,
    /// Weights of the `depth-anything` prior, a safetensors file, from the current directory; a `config.json` beside it is read. Given with
    /// that prior and no other.
    pub weights: Option<PathBuf>,
    /// Shorter side of what that network sees, pixels, rounded to a multiple of its patches' 14. Default 518, as published.
    pub input_px: usize,
    /// Whether that network sees colours with ImageNet's mean and standard deviation taken off, as it was trained, or as they are, between 0
    /// and 1. Default true.
    pub imagenet_normalisation: bool,
    /// Nearest depth considered, metres.
    pub near_m: f64,
    /// Furthest depth considered, metres.
    pub far_m: f64,
    /// Neighbouring keyframes matched with (6).
    pub neighbours: usize,
    /// Most corners triangulated in a keyframe (2000; small images get one per 20 pixels).
    pub corners: usize,
    /// Inverse depths of the coarse epipolar sweep (64).
    pub sweep_candidates: usize,
    /// Candidates of the guided matching (16).
    pub match_candidates: usize,
    /// Half range of the guided matching, relative to the aligned inverse depth (0.225).
    pub match_range: f64,
    /// Whether the aligned prior is corrected locally by the matches that were accurate.
    pub correction: bool,
    /// Half range of the guided matching around a corrected prior, relative to it (0.15).
    pub corrected_range: f64,
    /// Shortest epipolar segment worth searching, pixels of a 640-pixel-wide image; scales with the width.
    pub min_segment_px: f64,
    /// The worst candidate's cost must exceed the best one's by this factor (1.1).
    pub cost_ratio: f64,
    /// Lowest mean ZNCC of an accurate match.
    pub min_zncc: f32,
    /// Where keyframes are matched: on the `device` that trains, or on the `processor` in any case. A GPU finds what the processor finds but for
    /// matches within rounding of a threshold. Default `device`.
    pub matched_on: MatchedOn,
}

impl Default for DepthConfig {
    fn default() -> Self {
        Self {
            prior: DepthPriorKind::Simulated,
            preset: PriorPreset::Default,
            folder: None,
            folder_kind: FolderKind::InverseRelative,
            png_scale: 1000.0,
            weights: None,
            input_px: 518,
            imagenet_normalisation: true,
            near_m: 0.4,
            far_m: 30.0,
            neighbours: 6,
            corners: 2000,
            sweep_candidates: 64,
            match_candidates: 16,
            match_range: 0.225,
            correction: true,
            corrected_range: 0.15,
            min_segment_px: 4.0,
            cost_ratio: 1.1,
            min_zncc: 0.7,
            matched_on: MatchedOn::Device,
        }
    }
}

impl DepthConfig {
    /// Keys that mean nothing beside the others: those of other priors, and of what is left out.
    fn idle_keys(&self) -> Vec<IdleKey> {
        use DepthPriorKind as Prior;
        const ALIGNED: &str =
            "it counts with a prior that is aligned alone: depth.prior = \"simulated\", \"folder\" or \"depth-anything\"";
        const NETWORK: &str = "it counts with depth.prior = \"depth-anything\" alone";
        const MATCHED: &str = "exact depths are neither triangulated nor matched: it counts with other values of depth.prior";
        const METRIC: &str = "it counts with depth.prior = \"folder\" and a metric depth.folder_kind alone";
        let is_aligned = matches!(self.prior, Prior::Simulated | Prior::Folder | Prior::DepthAnything);
        let is_metric = matches!(self.folder_kind, FolderKind::DepthMetric | FolderKind::InverseMetric);
        let is_corrected = is_aligned && self.correction;
        // A keyframe that brings no measured depth is matched.
        let is_matched = self.prior != Prior::Exact;
        IdleKey::all([
            ("neighbours", is_matched, MATCHED),
            ("corners", is_matched, MATCHED),
            ("sweep_candidates", is_matched, MATCHED),
            ("match_candidates", is_matched, MATCHED),
            ("match_range", is_matched, MATCHED),
            ("min_segment_px", is_matched, MATCHED),
            ("cost_ratio", is_matched, MATCHED),
            ("min_zncc", is_matched, MATCHED),
            ("matched_on", is_matched, MATCHED),
            ("preset", self.prior == Prior::Simulated, "it counts with depth.prior = \"simulated\" alone"),
            ("folder_kind", self.prior == Prior::Folder, "it counts with depth.prior = \"folder\" alone"),
            ("png_scale", self.prior == Prior::Folder && is_metric, METRIC),
            ("input_px", self.prior == Prior::DepthAnything, NETWORK),
            ("imagenet_normalisation", self.prior == Prior::DepthAnything, NETWORK),
            ("correction", is_aligned, ALIGNED),
            ("corrected_range", is_corrected, if is_aligned { "it counts with depth.correction = true alone" } else { ALIGNED }),
        ])
    }

    /// Checks what the priors made elsewhere need: their files are named when the prior asks for them, and only then.
    fn check_prior(&self) -> Result<()> {
        let files = [
            ("folder", self.folder.is_some(), DepthPriorKind::Folder, "the folder of the maps"),
            ("weights", self.weights.is_some(), DepthPriorKind::DepthAnything, "the network's safetensors file"),
        ];
        for (key, given, prior, what) in files {
            if given == (self.prior == prior) {
                continue;
            }
            let name = serde_json::json!(prior);
            let (fault, help) = if given {
                ("the prior does not read it".to_owned(), format!("set depth.prior = {name}, or leave the key out"))
            } else {
                (format!("depth.prior = {name} needs it"), format!("give {what}: depth.{key} = \"PATH\""))
            };
            return Err(Error::invalid(format!("reconstruction config, key `depth.{key}`"), fault, help));
        }
        let ranges = [
            ("png_scale", (1e-6..=1e9).contains(&self.png_scale), "a positive number, 1e-6 to 1e9"),
            ("input_px", (14..=4096).contains(&self.input_px), "14 to 4096 pixels (published: 518)"),
        ];
        match ranges.iter().find(|r| !r.1) {
            None => Ok(()),
            Some((key, _, range)) => Err(Error::invalid(
                format!("reconstruction config, key `depth.{key}`"),
                "the value is out of range",
                format!("give {range}"),
            )),
        }
    }
}

impl Default for ReconstructionConfig {
    fn default() -> Self {
        Self {
            coupling: Coupling::Joint,
            second_stage_opacity: SecondStageOpacity::Light,
            sampling: Sampling::Log,
            uniform_probability: 0.1,
            least_probability: 0.0,
            radio_target: RadioTarget::Jet,
            iterations_per_keyframe: 75,
            keyframe_budget_ms: None,
            overlapped_iterations: 0,
            pyramid_levels: 3,
            radio_pyramid_levels: None,
            visits_per_level: 5,
            finest_share: None,
            latest_probability: 0.05,
            radio_weight: 0.1,
            depth_weight: 0.01,
            depth_weight_decay: 0.9,
            light_sh_degree: 1,
            radio_sh_degree: 3,
            log_sigma_px: 0.8,
            scale_clamp: [0.5, 0.1],
            initial_opacity: [0.07, 0.02, 0.2],
            replace_at_samples: 10,
            prune_opacity: 0.05,
            prune_age_keyframes: 3,
            prune_image_fraction: 0.5,
            position_rate: 5e-5,
            scale_baselines: 5,
            bootstrap_keyframes: 3,
            depth: DepthConfig::default(),
        }
    }
}

impl ReconstructionConfig {
    /// Checks every number against the range in which it means something.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the key.
    pub fn validate(&self) -> Result<()> {
        let probability = |x: f32| (0.0..=1.0).contains(&x);
        let positive = |x: f32| (1e-12..=1e6).contains(&x);
        let weight = |x: f32| (0.0..=1e6).contains(&x);
        let count = |n: usize, most: usize| (1..=most).contains(&n);
        let d = &self.depth;
        let checks: [(&str, bool, &str); 35] = [
            ("uniform_probability", probability(self.uniform_probability), "a probability between 0 and 1"),
            ("least_probability", probability(self.least_probability), "a probability between 0 and 1"),
            ("iterations_per_keyframe", count(self.iterations_per_keyframe, 1_000_000), "1 to 1 000 000 (paper: 75)"),
            (
                "overlapped_iterations",
                self.overlapped_iterations <= self.iterations_per_keyframe,
                "at most iterations_per_keyframe",
            ),
            (
                "keyframe_budget_ms",
                self.keyframe_budget_ms.is_none_or(|ms| (1.0..=3.6e6).contains(&ms)),
                "1 to 3 600 000 milliseconds",
            ),
            ("pyramid_levels", (1..=6).contains(&self.pyramid_levels), "between 1 and 6 (paper: 3)"),
            (
                "rf_pyramid_levels",
                self.radio_pyramid_levels.is_none_or(|n| (1..=self.pyramid_levels).contains(&n)),
                "between 1 and pyramid_levels",
            ),
            ("visits_per_level", self.visits_per_level >= 1, "at least 1"),
            ("finest_share", self.finest_share.is_none_or(probability), "a share between 0 and 1"),
            ("latest_probability", probability(self.latest_probability), "a probability between 0 and 1"),
            ("rf_weight", weight(self.radio_weight), "not negative, up to 1e6 (paper: 0.1)"),
            ("depth_weight", weight(self.depth_weight), "not negative, up to 1e6 (paper: 0.01)"),
            ("depth_weight_decay", probability(self.depth_weight_decay), "between 0 and 1 (paper: 0.9)"),
            ("optical_sh_degree", self.light_sh_degree <= 3, "0 to 3"),
            ("rf_sh_degree", self.radio_sh_degree <= 3, "0 to 3"),
            ("log_sigma_px", (0.05..=20.0).contains(&self.log_sigma_px), "between 0.05 and 20 pixels"),
            (
                "scale_clamp",
                self.scale_clamp.iter().all(|&x| positive(x)),
                "[smallest pixel distance, largest fraction of the width]",
            ),
            (
                "initial_opacity",
                self.initial_opacity.iter().all(|o| (1e-6..=1.0 - 1e-6).contains(o)),
                "three numbers strictly between 0 and 1",
            ),
            ("replace_at_samples", self.replace_at_samples >= 1, "at least 1"),
            ("prune_opacity", probability(self.prune_opacity), "between 0 and 1"),
            ("prune_image_fraction", positive(self.prune_image_fraction), "positive, 1e-12 to 1e6"),
            ("position_rate", positive(self.position_rate) && self.position_rate <= 1.0, "positive, 1e-12 to 1"),
            ("scale_baselines", self.scale_baselines >= 1, "at least 1 (5)"),
            ("depth.corners", count(d.corners, 1_000_000), "1 to 1 000 000"),
            ("depth.min_segment_px", (0.0..=1e6).contains(&d.min_segment_px), "not negative, up to 1e6"),
            ("depth.cost_ratio", (1.0..=1e6).contains(&d.cost_ratio), "at least 1, up to 1e6"),
            ("depth.min_zncc", (-1.0..=1.0).contains(&d.min_zncc), "between -1 and 1"),
            ("bootstrap_keyframes", (2..=8).contains(&self.bootstrap_keyframes), "2 to 8"),
            ("depth.near_m", d.near_m >= 1e-6 && d.near_m < d.far_m, "positive (1e-6 at least) and below depth.far_m"),
            ("depth.far_m", d.far_m <= 1e6, "a finite distance in metres, up to 1e6"),
            ("depth.neighbours", (1..=32).contains(&d.neighbours), "1 to 32"),
            ("depth.sweep_candidates", (8..=1024).contains(&d.sweep_candidates), "8 to 1024"),
            ("depth.match_candidates", (4..=256).contains(&d.match_candidates), "4 to 256"),
            ("depth.match_range", d.match_range >= 1e-6 && d.match_range < 1.0, "between 0 and 1"),
            ("depth.corrected_range", d.corrected_range >= 1e-6 && d.corrected_range < 1.0, "between 0 and 1"),
        ];
        match checks.iter().find(|c| !c.1) {
            None => d.check_prior(),
            Some((key, _, range)) => Err(Error::invalid(
                format!("reconstruction config, key `{key}`"),
                "the value is out of range",
                format!("give {range}"),
            )),
        }
    }

    /// Keys that mean nothing beside the others of this configuration.
    pub fn idle_keys(&self) -> Vec<IdleKey> {
        const UNIFORM: &str = "it counts with sampling = \"uniform\" alone (the method corf-gs-uniform)";
        const LOG: &str = "it counts with sampling = \"log\" alone (all methods but corf-gs-uniform)";
        const JOINT: &str = "in two stages each modality is learnt by itself, and nothing is weighed against it";
        const STAGED: &str = "it counts in two stages alone (the methods corf-gs-frozen and corf-gs-rf-tuned)";
        let uniform = self.sampling == Sampling::Uniform;
        const BUDGET: &str = "with keyframe_budget_ms steps are taken while there is time: leave one of the two out";
        let mut idle = IdleKey::all([
            ("iterations_per_keyframe", self.keyframe_budget_ms.is_none(), BUDGET),
            ("overlapped_iterations", self.keyframe_budget_ms.is_none(), BUDGET),
            ("second_stage_opacity", self.coupling != Coupling::Joint, STAGED),
            ("rf_weight", self.coupling == Coupling::Joint, JOINT),
            ("uniform_probability", uniform, UNIFORM),
            ("least_probability", !uniform, LOG),
            ("log_sigma_px", !uniform, LOG),
            ("depth_weight_decay", self.depth_weight > 0.0, "it counts with a depth_weight above 0 alone"),
            ("visits_per_level", self.pyramid_levels > 1, "it counts with pyramid_levels of 2 and more alone"),
        ]);
        idle.extend(self.depth.idle_keys().into_iter().map(|key| key.within("depth")));
        idle
    }

    /// The configuration for images of this size: with the default of `finest_share` resolved and `log_sigma_px` scaled to their pixels.
    pub(crate) fn for_images(&self, width: usize, height: usize) -> Self {
        /// Pixels that a visit at full resolution sees on average.
        const VISITED: f32 = 0.5e6;
        /// Columns up to which σ is what the configuration says.
        const SIGMA_COLUMNS: f32 = 640.0;
        let pixels = (width * height).max(1) as f32;
        Self {
            finest_share: Some(self.finest_share.unwrap_or((VISITED / pixels).min(1.0))),
            log_sigma_px: self.log_sigma_px * (width as f32 / SIGMA_COLUMNS).max(1.0),
            ..self.clone()
        }
    }

    /// Steps that overlap with the next keyframe's expansion: none where a keyframe has a time.
    pub(crate) fn overlapped_iterations(&self) -> usize {
        if self.keyframe_budget_ms.is_some() { 0 } else { self.overlapped_iterations }
    }

    /// No Gaussians yet, with the channels and harmonic degrees this configuration asks for: what a device is made with.
    pub fn empty_field(&self) -> Gaussians {
        let mut field = Gaussians::empty(self.radio_target.channels(), self.light_sh_degree);
        field.radio = Appearance::empty(self.radio_target.channels(), self.radio_sh_degree);
        field
    }

    /// Whether the dense prior reads the depth that keyframes bring, which is the ray tracer's or a sensor's: every result made with it says so.
    pub fn consumes_ground_truth_depth(&self) -> bool {
        matches!(self.depth.prior, DepthPriorKind::Simulated | DepthPriorKind::Exact | DepthPriorKind::Measured)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_the_papers_and_valid() {
        let config = ReconstructionConfig::default();
        config.validate().unwrap();
        assert_eq!((config.iterations_per_keyframe, config.pyramid_levels, config.radio_weight), (75, 3, 0.1));
    }

    #[test]
    fn a_typo_is_named_and_a_bad_value_is_located() {
        let error = serde_json::from_str::<ReconstructionConfig>(r#"{"rf_wieght": 0.1}"#).unwrap_err().to_string();
        assert!(error.contains("rf_wieght"), "{error}");
        let config: ReconstructionConfig =
            serde_json::from_str(r#"{"depth": {"near_m": -1.0}, "coupling": "rf-tuned"}"#).unwrap();
        assert_eq!(config.coupling, Coupling::RadioTuned);
        let error = config.validate().unwrap_err().to_string();
        assert!(error.contains("depth.near_m"), "{error}");
    }

    #[test]
    fn a_priors_files_are_asked_for_and_others_are_refused() {
        let fault = |depth: &str| {
            let config: ReconstructionConfig = serde_json::from_str(&format!(r#"{{"depth": {depth}}}"#)).unwrap();
            assert!(!config.consumes_ground_truth_depth() || config.depth.prior == DepthPriorKind::Simulated);
            config.validate().err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert_eq!(fault(r#"{"prior": "folder", "folder": "maps", "folder_kind": "depth-metric", "png_scale": 5000}"#), "");
        assert_eq!(fault(r#"{"prior": "depth-anything", "weights": "model.safetensors", "input_px": 392}"#), "");
        for (depth, key) in [
            (r#"{"prior": "folder"}"#, "depth.folder"),
            (r#"{"prior": "depth-anything", "folder": "maps"}"#, "depth.folder"),
            (r#"{"prior": "depth-anything"}"#, "depth.weights"),
            (r#"{"weights": "model.safetensors"}"#, "depth.weights"),
            (r#"{"prior": "none", "folder": "maps"}"#, "depth.folder"),
            (r#"{"png_scale": 0}"#, "depth.png_scale"),
            (r#"{"input_px": 13}"#, "depth.input_px"),
        ] {
            let error = fault(depth);
            assert!(error.contains(&format!("`{key}`")) && error.contains("help"), "{depth}: {error}");
        }
    }
}
