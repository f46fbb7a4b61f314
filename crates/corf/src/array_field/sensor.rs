//! The sensor that forms an observation of the waves at a receiver, by kind of spectrum.

use super::beam::{ArrayBeam, MOST_ELEMENTS};
use super::capon::Capon;
use super::lobes::Lobes;
use super::wave::Wave;
use crate::{Error, Real, Result};
use corf_scene::Pinhole;
use serde::{Deserialize, Serialize};

/// Diagonal loadings with which Capon's spectra and their gradients are right.
const LOADINGS: std::ops::RangeInclusive<f64> = 1e-9..=1.0;

/// A sensor and the pixels it is looked at over.
#[derive(Clone, Debug)]
pub enum ArraySensor<T> {
    /// Beams of an array.
    Beam(ArrayBeam<T>),
    /// Capon's beamformer on an array.
    Capon(Capon),
    /// A lobe for each wave.
    Lobes(Lobes<T>),
}

impl<T: Real> ArraySensor<T> {
    /// The spectrum of waves at every pixel, linear.
    pub fn observe(&self, waves: &[Wave<T>]) -> Vec<T> {
        match self {
            Self::Beam(beam) => beam.observe(waves),
            Self::Capon(capon) => capon.observe(waves),
            Self::Lobes(lobes) => lobes.observe(waves),
        }
    }

    /// Derivatives of two losses by the waves' powers alone. Times its power, a wave's is its part in the observation: these parts add up to it.
    pub fn pull_powers(&self, waves: &[Wave<T>], by_pixel: [&[T]; 2]) -> Vec<[T; 2]> {
        match self {
            Self::Beam(beam) => beam.pull_powers(waves, by_pixel),
            Self::Capon(capon) => capon.pull_powers(waves, by_pixel),
            Self::Lobes(lobes) => lobes.pull_powers(waves, by_pixel),
        }
    }
}

/// The kind of a sensor, with all that its observations depend on beside the camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorSettings {
    /// Beams of an array: `bartlett`, and the mean of `bartlett-coherent` over the arrivals' phases.
    Beam {
        /// Numbers of antenna elements: columns (along y), then rows (along z).
        elements: [usize; 2],
        /// Distances of columns and of rows, wavelengths.
        spacing_wavelengths: [f64; 2],
        /// Whether what comes from behind is left out.
        gated: bool,
    },
    /// Capon's beamformer on an array: the mean of `mvdr` over the arrivals' phases goes into its covariance.
    Capon {
        /// Numbers of antenna elements: columns (along y), then rows (along z).
        elements: [usize; 2],
        /// Distances of columns and of rows, wavelengths.
        spacing_wavelengths: [f64; 2],
        /// Whether what comes from behind is left out.
        gated: bool,
        /// Diagonal loading ε, in units of the covariance's mean eigenvalue.
        loading: f64,
    },
    /// A lobe for each wave: `mpc`.
    Lobes {
        /// Standard deviation per axis, degrees.
        width_deg: f64,
    },
}

impl SensorSettings {
    /// Whether waves from behind the array's plane are left out.
    pub fn is_gated(&self) -> bool {
        matches!(self, Self::Beam { gated: true, .. } | Self::Capon { gated: true, .. })
    }

    /// Spectrum of a wave of the power 1 in its own direction.
    pub fn peak(&self) -> f64 {
        match *self {
            Self::Beam { .. } => 1.0,
            Self::Capon { elements: [columns, rows], loading, .. } => 1.0 + loading / (columns * rows) as f64,
            Self::Lobes { width_deg } => (std::f64::consts::TAU * width_deg.to_radians().powi(2)).recip(),
        }
    }

    /// By how much a wave may be stronger than all that is seen in a frame, dB: outside of it a beam's side lobes show what a lobe does not.
    pub fn unseen_db(&self) -> f64 {
        const OF_BEAMS: f64 = 40.0;
        match *self {
            Self::Beam { .. } => OF_BEAMS,
            // Capon's spectrum is nowhere below ε/N of the power of all waves.
            Self::Capon { elements: [columns, rows], loading, .. } => {
                (10.0 * ((columns * rows) as f64 / loading).log10()).min(OF_BEAMS)
            }
            Self::Lobes { .. } => 0.0,
        }
    }

    /// A sensor that shows a lobe as wide as the array's beam, and none beside it; gains of emitters then mean power per steradian.
    pub fn without_side_lobes(self) -> Self {
        match self {
            // Half-power width of an even array: 0.886 over its length in wavelengths; that of a Gaussian is 2.355 standard deviations.
            Self::Beam { elements, spacing_wavelengths, .. } | Self::Capon { elements, spacing_wavelengths, .. } => {
                let length = elements[0] as f64 * spacing_wavelengths[0];
                Self::Lobes { width_deg: (0.886 / length / 2.355).to_degrees() }
            }
            lobes => lobes,
        }
    }

    /// Checks that a camera can look at it.
    ///
    /// # Errors
    /// An array without elements or with too many, a loading beyond what double precision holds, a spacing or a width that is no number, lobes that
    /// fall between the camera's pixels.
    pub fn check(&self, camera: &Pinhole) -> Result<()> {
        let refuse = |what: String, help: &str| Err(Error::invalid("the radio sensor", what, help));
        if let Self::Capon { loading, .. } = *self
            && !LOADINGS.contains(&loading)
        {
            return refuse(format!("a diagonal loading of {loading}"), "1e-9 to 1 are supported, as of data sets");
        }
        match *self {
            Self::Beam { elements, spacing_wavelengths, .. } | Self::Capon { elements, spacing_wavelengths, .. } => {
                if elements.iter().any(|n| !(1..=MOST_ELEMENTS).contains(n)) {
                    return refuse(
                        format!("an array of {} x {} elements", elements[0], elements[1]),
                        "1 to 16 along each side are supported",
                    );
                }
                if spacing_wavelengths.iter().any(|s| !(s.is_finite() && *s > 0.0)) {
                    return refuse(format!("elements {spacing_wavelengths:?} wavelengths apart"), "give positive numbers");
                }
            }
            Self::Lobes { width_deg } => {
                // As where the data set's own lobes become means over pixels.
                const LEAST_PIXELS: f64 = 0.6 - 1e-9;
                let pixels = width_deg.to_radians() * camera.fx.min(camera.fy);
                if !(LEAST_PIXELS..1e3).contains(&pixels) {
                    return refuse(
                        format!("lobes of {width_deg}° are {pixels:.2} pixels wide"),
                        "generate the spectra with more pixels or wider lobes (0.6 pixels at least)",
                    );
                }
            }
        }
        Ok(())
    }

    /// The sensor over a camera's pixels.
    pub fn build<T: Real>(&self, camera: &Pinhole) -> ArraySensor<T> {
        match *self {
            Self::Beam { elements, spacing_wavelengths, .. } => {
                ArraySensor::Beam(ArrayBeam::new(camera, elements, spacing_wavelengths))
            }
            Self::Capon { elements, spacing_wavelengths, loading, .. } => {
                ArraySensor::Capon(Capon::new(ArrayBeam::new(camera, elements, spacing_wavelengths), loading))
            }
            Self::Lobes { width_deg } => ArraySensor::Lobes(Lobes::new(camera, width_deg)),
        }
    }
}
