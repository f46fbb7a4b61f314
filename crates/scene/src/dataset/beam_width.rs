//! Whether spectra show lobes as wide as the sensor that is stated for them makes.

use super::header::DatasetHeader;
use crate::config::{ReceiverConfig, SpectrumKind};
use crate::finding::{Finding, Severity};
use crate::model::ARRAY_FROM_CAMERA;
use crate::{Pinhole, Raster};
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// Lobes so many pixels wide can be measured.
const LEAST_PIXELS: f64 = 2.5;
/// So many keyframes say something of an array.
const LEAST_KEYFRAMES: usize = 3;
/// The narrowest tenth of all lobes is as wide as a lone wave's; it is wider by this only if the array is not the stated one. Waves that are not told
/// apart widen most lobes, but not all.
const WIDE: f64 = 1.4;
/// Half of all lobes are narrower than a lone wave's by this only if the array is not the stated one: a sum of lobes is no narrower than each.
const NARROW: f64 = 0.8;
/// Waves that interfere may be.
const NARROW_COHERENT: f64 = 0.65;

/// Half-power widths of a spectrum's strongest lobe along columns (array y), then along rows (array z).
pub(crate) type Widths = [Option<Width>; 2];

/// A width, in the frame as a whole.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Width {
    /// Of the direction's component along the axis.
    sine: f64,
    /// Radians for each unit of it.
    radians: f64,
}

/// The widths of a spectrum's strongest lobe, where its half power lies within the frame on both sides.
pub(crate) fn of(spectrum: &Raster<f32>, camera: &Pinhole) -> Widths {
    let pixels = spectrum.pixels();
    let Some(at) = (0..pixels.len()).max_by(|a, b| pixels[*a].total_cmp(&pixels[*b])) else { return [None; 2] };
    let half = 0.5 * f64::from(pixels[at]);
    if half.is_nan() || half <= 0.0 {
        return [None; 2];
    }
    let peak = ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(at % spectrum.width(), at / spectrum.width());
    [DVec3::Y, DVec3::Z].map(|axis| {
        let sides = [-1.0, 1.0].map(|sign| crossing(spectrum, camera, (peak, axis * sign), half));
        let sine = sides[0]? + sides[1]?;
        // A step along the axis turns the direction by √(1 − the other component²)/x.
        let other = DVec3::new(0.0, peak.z, peak.y).dot(axis);
        Some(Width { sine, radians: (1.0 - other * other).sqrt() / peak.x })
    })
}

/// How far along an axis of the array a spectrum has fallen to a value.
fn crossing(spectrum: &Raster<f32>, camera: &Pinhole, (peak, axis): (DVec3, DVec3), value: f64) -> Option<f64> {
    let step = 0.25 / camera.fx.max(camera.fy);
    let mut before = 2.0 * value;
    for k in 1.. {
        let (way, moved) = (f64::from(k) * step, peak + axis * (f64::from(k) * step));
        let x2 = 1.0 - moved.y * moved.y - moved.z * moved.z;
        if x2 <= 0.0 {
            return None;
        }
        let direction = DVec3::new(x2.sqrt(), moved.y, moved.z);
        let here = at(spectrum, camera.project(ARRAY_FROM_CAMERA.rotation.transpose() * direction)?)?;
        if here <= value {
            return Some(way - step * (value - here) / (before - here).max(f64::MIN_POSITIVE));
        }
        before = here;
    }
    None
}

/// A spectrum between the centres of its pixels.
fn at(spectrum: &Raster<f32>, place: DVec2) -> Option<f64> {
    let (u, v) = (place.x - 0.5, place.y - 0.5);
    let inside = u >= 0.0 && v >= 0.0 && u < (spectrum.width() - 1) as f64 && v < (spectrum.height() - 1) as f64;
    inside.then(|| {
        let (x, y, a, b) = (u as usize, v as usize, u.fract(), v.fract());
        let value = |x, y| f64::from(spectrum[(x, y)]);
        let row = |y| value(x, y) * (1.0 - a) + value(x + 1, y) * a;
        row(y) * (1.0 - b) + row(y + 1) * b
    })
}

/// Half-power width of a lone wave's beam by an array, in the sine along an axis.
fn beam(elements: usize, spacing_wavelengths: f64) -> Option<f64> {
    let n = elements as f64;
    // |sin(n·x/2) / (n·sin(x/2))|² falls from 1 to 0 between x = 0 and 2π/n.
    let power = |x: f64| ((0.5 * n * x).sin() / (n * (0.5 * x).sin())).powi(2);
    let (mut low, mut high) = (0.0, TAU / n);
    if elements < 2 {
        return None;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if power(middle) > 0.5 { &mut low } else { &mut high }) = middle;
    }
    Some(2.0 * low / (TAU * spacing_wavelengths))
}

/// Warnings where lobes are not as wide as the sensor of an imported data set makes them; `place` is the data set. Nothing is said of `mvdr`, whose lobes
/// are as narrow as what arrives lets them be.
pub(crate) fn findings(place: &str, header: &DatasetHeader, seen: &[Widths]) -> Vec<Finding> {
    let (Some(kind), Some(imported)) = (header.spectrum, &header.imported) else { return vec![] };
    let lobe = imported.sensor.as_ref().and_then(|s| s.lobe_width_deg);
    let camera = &header.radio_camera;
    let axes = [("columns", 0, camera.fx), ("rows", 1, camera.fy)];
    axes.into_iter()
        .filter_map(|(name, axis, focal)| {
            let (expected, narrow, of) = expected(kind, header.receiver.as_ref(), lobe, axis)?;
            if expected * focal < LEAST_PIXELS {
                return None;
            }
            let in_unit = |w: &Width| if kind == SpectrumKind::Mpc { w.sine * w.radians } else { w.sine };
            let mut ratios: Vec<f64> = seen.iter().filter_map(|widths| widths[axis].as_ref().map(in_unit)).map(|w| w / expected).collect();
            ratios.sort_by(f64::total_cmp);
            if ratios.len() < LEAST_KEYFRAMES {
                return None;
            }
            let (tenth, middle) = (ratios[ratios.len() / 10], ratios[ratios.len() / 2]);
            let (ratio, word) = match (tenth > WIDE, middle < narrow) {
                (true, _) => (tenth, "wider"),
                (_, true) => (middle, "narrower"),
                _ => return None,
            };
            let what = format!(
                "the strongest lobes of its spectra are {word} along {name} than {of}: {ratio:.2} times as wide at half power ({} keyframes)",
                ratios.len()
            );
            let help = "the stated sensor or the stated field of view (--rf-camera) is not that of the spectra, or they were smoothed: import them again with \
                        what they were made with";
            Some(Finding::new(Severity::Warning, place, what, help))
        })
        .collect()
}

/// Width of a lone wave's lobe, the ratio under which lobes are too narrow, and what makes it.
fn expected(
    kind: SpectrumKind,
    receiver: Option<&ReceiverConfig>,
    lobe_deg: Option<f64>,
    axis: usize,
) -> Option<(f64, f64, String)> {
    match kind {
        SpectrumKind::Mpc => {
            let lobe_deg = lobe_deg?;
            // A Gaussian's half power lies √(2 ln 2) standard deviations from its middle.
            let width = 2.0 * (2.0 * std::f64::consts::LN_2).sqrt() * lobe_deg.to_radians();
            Some((width, NARROW, format!("lobes of {lobe_deg} degrees of standard deviation")))
        }
        SpectrumKind::Bartlett | SpectrumKind::BartlettCoherent => {
            let receiver = receiver?;
            let (elements, spacing) = ([receiver.cols, receiver.rows][axis], receiver.spacing_wavelengths[axis]);
            let width = beam(elements, spacing)?;
            let narrow = if kind == SpectrumKind::Bartlett { NARROW } else { NARROW_COHERENT };
            let degrees = (2.0 * (0.5 * width).min(1.0).asin()) * 180.0 / PI;
            Some((
                width,
                narrow,
                format!("beams of {elements} elements {spacing} wavelengths apart ({degrees:.1} degrees at boresight)"),
            ))
        }
        SpectrumKind::Mvdr => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Beam of a lone wave by a linear array along each axis.
    fn spectrum(camera: &Pinhole, wave: DVec3, [cols, rows]: [usize; 2]) -> Raster<f32> {
        let fejer = |n: usize, x: f64| {
            if x.abs() < 1e-9 { 1.0 } else { ((n as f64 * x / 2.0).sin() / (n as f64 * (x / 2.0).sin())).powi(2) }
        };
        Raster::from_fn(camera.width, camera.height, |x, y| {
            let u = ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(x, y) - wave;
            (fejer(cols, PI * u.y) * fejer(rows, PI * u.z)) as f32
        })
    }

    #[test]
    fn a_lone_waves_beam_is_as_wide_as_its_array_makes_it_wherever_it_comes_from() {
        let camera = Pinhole::from_horizontal_fov(96, 64, 90.0);
        for wave in [DVec3::X, DVec3::new(0.9, 0.3, 0.1), DVec3::new(0.8, -0.35, -0.2)] {
            let widths = of(&spectrum(&camera, wave.normalize(), [8, 6]), &camera);
            for (width, n) in widths.into_iter().zip([8, 6]) {
                let (width, expected) = (width.unwrap().sine, beam(n, 0.5).unwrap());
                assert!((width / expected - 1.0).abs() < 0.04, "{wave} {n}: {width} {expected}");
            }
        }
        // 0.886/(N·d), the textbook's for long arrays, 12.7° at boresight for eight.
        assert!((beam(64, 0.5).unwrap() - 0.886 / 32.0).abs() < 1e-4);
        assert!((2.0 * (0.5 * beam(8, 0.5).unwrap()).asin().to_degrees() - 12.8).abs() < 0.1);
        assert!(beam(1, 0.5).is_none());
        // A lobe that ends outside the frame, and a spectrum without power, say nothing.
        assert!(of(&spectrum(&camera, DVec3::new(0.7, 0.7, 0.0).normalize(), [8, 8]), &camera)[0].is_none());
        assert!(of(&Raster::filled(96, 64, 0.0), &camera)[0].is_none());
    }
}
