//! `[rf]` of a dataset file: how radio is traced, and the spectra that are formed of it.

use crate::{Error, Result, bounds};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// No image is wider or higher.
pub(super) const MAX_IMAGE_SIDE: usize = 16_384;

/// `[rf]`: how radio is traced, and the spectra that are formed of it. Its defaults are those of every command that traces radio.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SpectrumConfig {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Full horizontal field of view, degrees.
    pub horizontal_fov_deg: f64,
    /// Interactions on a path at most: reflections, transmissions and scatterings together, 0 to 5. Files of earlier versions call it
    /// `max_reflections`.
    // Data sets say so still: their hashes, and with them `--resume` and published records, hang on every byte of the header.
    #[serde(rename(serialize = "max_reflections"), alias = "max_reflections", alias = "max_depth")]
    pub max_interactions: usize,
    /// Straight-through transmission.
    pub transmission: bool,
    /// Paths that diffract once at an edge of a body or a corner of walls.
    pub diffraction: bool,
    /// Paths that diffract once at the open edge of a single sheet as well.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub edge_diffraction: bool,
    /// Diffuse scattering.
    pub diffuse: bool,
    /// Side of the world-fixed surface patches on which indirect light is kept, metres.
    pub patch_size_m: f64,
    /// Directions over the whole sphere in which the diffuse field is gathered; 120 000 are 0.6° apart, for a lobe of 1°.
    pub directions: usize,
    /// Photons that bring the diffuse field's indirect light, once for all positions.
    pub photons: usize,
    /// Rays from the transmitter that find chains of mirrors.
    pub rays: usize,
    /// Kind of spectrum that is formed from the paths.
    pub spectrum: SpectrumKind,
    /// Standard deviation of an `mpc` lobe along each axis, degrees.
    pub lobe_width_deg: f64,
    /// Delays are told apart to its inverse by `bartlett-coherent` and `mvdr`, Hz; 1e9 are taps of 1 ns.
    pub bandwidth_hz: f64,
    /// Diagonal loading of `mvdr` in units of the covariance's mean eigenvalue: noise that far under the mean power of an element. A lone
    /// path's peak on an 8×8 array is 0.31° from centre to half power at 0.1 and shrinks with its square root; pixels should not be
    /// coarser.
    pub mvdr_loading: f64,
    /// Width of the one dB range below the dataset's peak, dB.
    pub dynamic_range_db: f64,
    /// Also write the propagation paths of every keyframe.
    pub write_paths: bool,
    /// Also write every spectrum in dB as EXR: it is 10 log10 of the linear one.
    pub write_db: bool,
    /// `[columns, rows]`: also write the spectrum over the whole sphere, equirectangular. Default: not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sphere: Option<[usize; 2]>,
    /// Data sets of earlier versions say `true` where they hold images by the recipe of published sets; all say it, for hashes hang on it.
    #[schemars(skip)]
    pub tutorial_compat: bool,
}

impl Default for SpectrumConfig {
    fn default() -> Self {
        Self {
            width: 300,
            height: 200,
            horizontal_fov_deg: 90.0,
            max_interactions: 3,
            transmission: true,
            diffraction: false,
            edge_diffraction: false,
            diffuse: true,
            patch_size_m: 0.16,
            directions: 120_000,
            photons: 1_000_000,
            rays: 200_000,
            spectrum: SpectrumKind::Mpc,
            lobe_width_deg: 1.0,
            bandwidth_hz: 1e9,
            mvdr_loading: 0.1,
            dynamic_range_db: 70.0,
            write_paths: false,
            write_db: false,
            sphere: None,
            tutorial_compat: false,
        }
    }
}

impl SpectrumConfig {
    /// Checks every value but the image's; `place` says where they were given.
    ///
    /// # Errors
    /// The first value out of range, by key.
    pub fn validate(&self, place: &str) -> Result<()> {
        let fail = |key: &str, what: String, help: &str| Err(Error::invalid(format!("{place}: {key}"), what, help));
        let radio = self;
        check_fov(&format!("{place}: rf.horizontal_fov_deg"), radio.horizontal_fov_deg)?;
        for (key, value) in [
            ("rf.patch_size_m", radio.patch_size_m),
            ("rf.dynamic_range_db", radio.dynamic_range_db),
            ("rf.bandwidth_hz", radio.bandwidth_hz),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return fail(key, format!("{value} is not a positive number"), "give a value above 0");
            }
        }
        if !(0.02..=1e3).contains(&radio.patch_size_m) {
            return fail("rf.patch_size_m", format!("{:?}", radio.patch_size_m), "give 0.02 m to 1000 m");
        }
        if !(100..=super::lobe::MAX_DIRECTIONS).contains(&radio.directions) {
            return fail(
                "rf.directions",
                format!("{}", radio.directions),
                "give 100 to 50 000 000; 120 000 suits a 1 degree lobe",
            );
        }
        for (key, value) in [("rf.photons", radio.photons), ("rf.rays", radio.rays)] {
            if value > bounds::MAX_RAYS {
                return fail(key, format!("{value}"), "give at most 100 000 000");
            }
        }
        if radio.edge_diffraction && !radio.diffraction {
            return fail("rf.edge_diffraction", "open edges diffract where edges do".into(), "set diffraction = true as well");
        }
        let shown = (radio.spectrum == SpectrumKind::Mpc && radio.diffuse).then_some(radio.directions);
        super::lobe::check(radio.lobe_width_deg, shown, place)?;
        bounds::number(&format!("{place}: rf.bandwidth_hz"), radio.bandwidth_hz, &(0.0..=*bounds::FREQUENCY_HZ.end()), "hertz")?;
        if radio.bandwidth_hz < 1e6 {
            return fail(
                "rf.bandwidth_hz",
                format!("{} Hz is under 1 MHz", radio.bandwidth_hz),
                "bandwidths are in hertz: for 1 GHz write 1e9",
            );
        }
        if !(1e-9..=1.0).contains(&radio.mvdr_loading) {
            return fail("rf.mvdr_loading", format!("{}", radio.mvdr_loading), "give 1e-9 to 1, e.g. 0.1");
        }
        if let Some([columns, rows]) = radio.sphere
            && !((1..=MAX_IMAGE_SIDE).contains(&columns) && (1..=MAX_IMAGE_SIDE).contains(&rows))
        {
            return fail("rf.sphere", format!("{columns}x{rows} pixels"), "give [columns, rows], e.g. [360, 180]");
        }
        if !(1.0..=80.0).contains(&radio.dynamic_range_db) {
            return fail(
                "rf.dynamic_range_db",
                format!("{:?} dB", radio.dynamic_range_db),
                "lobes are traced down to 80 dB: give 1 to 80",
            );
        }
        if radio.max_interactions > 5 {
            return fail("rf.max_interactions", format!("{} is above 5", radio.max_interactions), "give 0 to 5");
        }
        if radio.tutorial_compat {
            let help = "leave it out: rf/images holds every spectrum in the colours of one range";
            return fail("rf.tutorial_compat", "images by the recipe of published sets are no longer made".into(), help);
        }
        Ok(())
    }
}

/// Kind of spectrum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SpectrumKind {
    /// Each path as a narrow Gaussian lobe at its angle of arrival: power per steradian.
    #[default]
    Mpc,
    /// The array's conventional beamformer, noncoherent over paths.
    Bartlett,
    /// The array's conventional beamformer, coherent within a delay tap.
    BartlettCoherent,
    /// Minimum variance (Capon) over delay taps.
    Mvdr,
}

impl SpectrumKind {
    /// The kind's name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mpc => "mpc",
            Self::Bartlett => "bartlett",
            Self::BartlettCoherent => "bartlett-coherent",
            Self::Mvdr => "mvdr",
        }
    }
}

/// Checks a field of view; `place` says where it was given.
pub(super) fn check_fov(place: &str, fov_deg: f64) -> Result<()> {
    let (least, most) = (bounds::FIELD_OF_VIEW_DEG.start(), bounds::FIELD_OF_VIEW_DEG.end());
    if bounds::FIELD_OF_VIEW_DEG.contains(&fov_deg) {
        return Ok(());
    }
    let what = format!("{fov_deg} degrees is no pinhole's field of view");
    Err(Error::invalid(place, what, format!("give {least} to {most} degrees: no plane reaches 180 degrees")))
}
