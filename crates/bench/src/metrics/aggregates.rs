//! What a radio field says of a place in a few numbers: power that arrives, strongest direction, best beam, spread, outage.

use super::beams::{Codebook, ELEMENTS, SIDE, axis_gains};
use super::radio::linear;
use super::rate::{TRANSMIT_POWER_DBM, spectral_efficiency_bps_hz};
use corf_scene::dataset::Quantity;
use corf_scene::keyframe::DbRange;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Pinhole, Raster};

/// The numbers of one pose. What the kind of spectrum does not say, and what there is none of where nothing arrives, is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Aggregates {
    /// Power that arrives from the directions of the frame, Σ S·Ω, relative to that transmitted, dB; of power per steradian alone.
    pub path_gain_db: Option<f64>,
    /// The same for the transmit power of the link, dBm.
    pub rssi_dbm: Option<f64>,
    /// The strongest direction.
    pub peak: Option<Direction>,
    /// The best beam of the codebook; of spectra with beams alone.
    pub beam: Option<BestBeam>,
    /// Circular azimuth spread of arrival (3GPP TR 38.901 Annex A, array frame), degrees.
    pub azimuth_spread_deg: Option<f64>,
    /// The same of the zenith angle.
    pub zenith_spread_deg: Option<f64>,
    /// Spectral efficiency behind the best beam, bit/s/Hz; where there are beams.
    pub rate_bps_hz: Option<f64>,
}

/// A direction in the array's frame, and the level there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction {
    /// Azimuth, degrees, positive to the left of straight ahead.
    pub azimuth_deg: f64,
    /// Elevation, degrees, positive up.
    pub elevation_deg: f64,
    /// Level, dB, in the unit of the spectra.
    pub db: f64,
}

/// A beam of the codebook.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BestBeam {
    /// Its number, 8p + q.
    pub number: usize,
    /// Its power relative to that transmitted, dB.
    pub gain_db: f64,
}

/// Powers in dB of no spectrum are beyond this: where a sum is smaller, nothing arrives.
const NOTHING: f64 = 1e-300;

/// Geometry of a pixel of the spectra.
struct Pixel {
    solid_angle_sr: f64,
    /// Cosine and sine of azimuth, then of zenith.
    phasors: [f64; 4],
    /// Gains of the codebook's beams along y, then along z.
    gains: [[f64; SIDE]; 2],
}

/// Sums over the pixels of a spectrum that have power.
struct Sums {
    /// Power, Σ S·Ω.
    total: f64,
    /// Of it times the phasors of its direction.
    phasors: [f64; 4],
    /// Power of each beam; of spectra that are integrated over directions alone.
    beams: [f64; ELEMENTS],
    /// The first of the pixels with the highest level.
    strongest: Option<usize>,
}

impl Default for Sums {
    fn default() -> Self {
        Self { total: 0.0, phasors: [0.0; 4], beams: [0.0; ELEMENTS], strongest: None }
    }
}

/// Pixels whose powers are formed together.
const AT_ONCE: usize = 64;
/// Rows of the codebook whose sums stay in registers while such pixels are added.
const ROWS: usize = 4;

/// Adds what pixels bring to the beams of some rows of the codebook, from `first` on.
#[inline(always)]
fn add_beams(beams: &mut [f64; ROWS * SIDE], first: usize, powers: &[f64; AT_ONCE], pixels: &[Pixel]) {
    let mut sums = *beams;
    for (power, pixel) in powers.iter().zip(pixels) {
        let [across, along] = &pixel.gains;
        for row in 0..ROWS {
            let weighted = power * across[first + row];
            for (i, along) in along.iter().enumerate() {
                sums[row * SIDE + i] += weighted * along;
            }
        }
    }
    *beams = sums;
}

/// 2 to a power, which is held between −1000 and 1000, within 5e-16 of it; without a branch, so that many are formed at once.
#[inline(always)]
fn exp2(x: f64) -> f64 {
    /// Adding it leaves the nearest whole number in the lowest bits.
    const SHIFT: f64 = 1.5 * (1_u64 << 52) as f64;
    let x = x.clamp(-1000.0, 1000.0);
    let shifted = x + SHIFT;
    let y = (x - (shifted - SHIFT)) * std::f64::consts::LN_2;
    // The series of exp y for |y| ≤ ln 2 / 2, to y¹³/13!.
    let mut series = 1.0 / 6_227_020_800.0;
    for factorial in
        [479_001_600.0, 39_916_800.0, 3_628_800.0, 362_880.0, 40_320.0, 5_040.0, 720.0, 120.0, 24.0, 6.0, 2.0, 1.0, 1.0]
    {
        series = series * y + 1.0 / factorial;
    }
    f64::from_bits(series.to_bits().wrapping_add(shifted.to_bits() << 52))
}

/// Forms the aggregates of spectra of one camera and kind.
pub struct Aggregator {
    range: DbRange,
    quantity: Quantity,
    codebook: Option<Codebook>,
    transmit_power_dbm: f64,
    pixels: Vec<Pixel>,
    camera: Pinhole,
}

impl Aggregator {
    /// Of the spectra of `camera` on a decibel range, whose values are of `quantity`, for a transmit power, dBm.
    pub fn new(camera: Pinhole, range: DbRange, quantity: Quantity, transmit_power_dbm: f64) -> Self {
        let pixel = |i: usize| {
            let (x, y) = (i % camera.width, i / camera.width);
            let u = ARRAY_FROM_CAMERA.transform_vector(camera.pixel_direction(x, y));
            let (azimuth, zenith) = (u.y.atan2(u.x), u.z.clamp(-1.0, 1.0).acos());
            Pixel {
                solid_angle_sr: camera.pixel_solid_angle_sr(x, y),
                phasors: [azimuth.cos(), azimuth.sin(), zenith.cos(), zenith.sin()],
                gains: axis_gains(u),
            }
        };
        let pixels = (0..camera.width * camera.height).map(pixel).collect();
        Self { range, quantity, codebook: Codebook::of(camera, quantity), transmit_power_dbm, pixels, camera }
    }

    /// Columns that these spectra have no numbers for, each with the reason.
    pub fn left_empty(&self) -> Vec<(&'static str, &'static str)> {
        let mut empty = Vec::new();
        if self.quantity != Quantity::PowerPerSteradian {
            let why = match self.quantity {
                Quantity::Unknown => "the unit of the spectra is not known",
                _ => "the spectra are of beams, which overlap: their sum over directions is no power (of mpc spectra it is)",
            };
            empty.extend([("path_gain_db", why), ("rssi_dbm", why)]);
        }
        if self.codebook.is_none() {
            let why = match self.quantity {
                Quantity::CaponPower => "Capon's estimate is of directions and says no power of a beam (mpc and bartlett do)",
                Quantity::Unknown => "the unit of the spectra is not known",
                _ => "no beam of the codebook points into the frame",
            };
            empty.extend(["best_beam", "best_beam_gain_db", "rate_bps_hz", "outage"].map(|column| (column, why)));
        }
        empty
    }

    /// The aggregates of a predicted spectrum, on the decibel range from 0 to 1.
    pub fn of(&self, scalar: &Raster<f32>) -> Aggregates {
        let Sums { total, phasors: sums, beams, strongest } = self.summed(scalar.pixels());
        if total <= NOTHING {
            // Nothing is as good as any rate there.
            return Aggregates { rate_bps_hz: self.codebook.as_ref().map(|_| 0.0), ..Aggregates::default() };
        }
        let path_gain_db = (self.quantity == Quantity::PowerPerSteradian).then(|| 10.0 * total.log10());
        let best = self.codebook.as_ref().and_then(|codebook| {
            let powers = match codebook {
                Codebook::Integrated(_) => beams.to_vec(),
                Codebook::Sampled(_) => codebook.powers(&scalar.map(|s| linear(*s, &self.range))),
            };
            let best = (0..powers.len()).reduce(|best, i| if powers[i] > powers[best] { i } else { best })?;
            Some((codebook.number(best), powers[best]))
        });
        let spread = |re: f64, im: f64| (-2.0 * (re.hypot(im) / total).min(1.0).ln()).max(0.0).sqrt().to_degrees();
        let more = 10f64.powf(0.1 * (self.transmit_power_dbm - TRANSMIT_POWER_DBM));
        Aggregates {
            path_gain_db,
            rssi_dbm: path_gain_db.map(|gain| gain + self.transmit_power_dbm),
            peak: strongest.map(|i| self.direction(i, scalar.pixels()[i])),
            beam: best.filter(|best| best.1 > NOTHING).map(|(number, power)| BestBeam { number, gain_db: 10.0 * power.log10() }),
            azimuth_spread_deg: Some(spread(sums[0], sums[1])),
            zenith_spread_deg: Some(spread(sums[2], sums[3])),
            rate_bps_hz: best.map(|best| spectral_efficiency_bps_hz(more * best.1, ELEMENTS)),
        }
    }

    /// The sums over a spectrum. A processor with AVX2 adds more of them at once, each in the same order, so that the bytes are the same.
    fn summed(&self, scalars: &[f32]) -> Sums {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has AVX2.
            return unsafe { self.summed_avx2(scalars) };
        }
        self.summed_portable(scalars)
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn summed_avx2(&self, scalars: &[f32]) -> Sums {
        self.summed_portable(scalars)
    }

    #[inline(always)]
    fn summed_portable(&self, scalars: &[f32]) -> Sums {
        let mut sums = Sums::default();
        let integrated = matches!(self.codebook, Some(Codebook::Integrated(_)));
        // log2 of a power is linear in its level.
        let [lowest, range] =
            [self.range.min_db, self.range.max_db - self.range.min_db].map(|db| db / 10.0 * std::f64::consts::LOG2_10);
        for (chunk, (some, pixels)) in scalars.chunks(AT_ONCE).zip(self.pixels.chunks(AT_ONCE)).enumerate() {
            let mut powers = [0.0; AT_ONCE];
            for ((power, scalar), pixel) in powers.iter_mut().zip(some).zip(pixels) {
                let linear = exp2(lowest + range * f64::from(scalar.clamp(0.0, 1.0)));
                *power = if *scalar > 0.0 { linear * pixel.solid_angle_sr } else { 0.0 };
            }
            for (i, (power, pixel)) in powers.iter().zip(pixels).enumerate().filter(|(_, (power, _))| **power > 0.0) {
                sums.total += power;
                sums.phasors.iter_mut().zip(pixel.phasors).for_each(|(sum, part)| *sum += power * part);
                if sums.strongest.is_none_or(|at| some[i] > scalars[at]) {
                    sums.strongest = Some(chunk * AT_ONCE + i);
                }
            }
            if integrated {
                for (few, beams) in sums.beams.as_chunks_mut::<{ ROWS * SIDE }>().0.iter_mut().enumerate() {
                    add_beams(beams, few * ROWS, &powers, pixels);
                }
            }
        }
        sums
    }

    fn direction(&self, pixel: usize, scalar: f32) -> Direction {
        let (x, y) = (pixel % self.camera.width, pixel / self.camera.width);
        let u = ARRAY_FROM_CAMERA.transform_vector(self.camera.pixel_direction(x, y));
        Direction {
            azimuth_deg: u.y.atan2(u.x).to_degrees(),
            elevation_deg: u.z.clamp(-1.0, 1.0).asin().to_degrees(),
            db: self.range.db(scalar),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: DbRange = DbRange { min_db: -120.0, max_db: -40.0 };

    fn camera() -> Pinhole {
        Pinhole::from_horizontal_fov(48, 32, 90.0)
    }

    fn of(quantity: Quantity, scalar: &Raster<f32>) -> Aggregates {
        Aggregator::new(camera(), RANGE, quantity, TRANSMIT_POWER_DBM).of(scalar)
    }

    /// Scalars of lobes: column, row, height.
    fn lobes(all: &[(f64, f64, f64)]) -> Raster<f32> {
        Raster::from_fn(48, 32, |x, y| {
            let lobe = |(u, v, height): &(f64, f64, f64)| {
                height * (-0.5 * ((x as f64 - u).powi(2) + (y as f64 - v).powi(2)) / 4.0).exp()
            };
            RANGE.scalar(1e-6 * all.iter().map(lobe).sum::<f64>() as f32)
        })
    }

    #[test]
    fn powers_of_two_are_right_to_the_last_digits() {
        for i in -20_000..=20_000 {
            let x = f64::from(i) * 0.0173;
            let (found, right) = (exp2(x), x.exp2());
            assert!((found / right - 1.0).abs() < 5e-16, "2^{x}: {found} instead of {right}");
        }
        assert_eq!((exp2(0.0), exp2(-10.0), exp2(40.0)), (1.0, 1.0 / 1024.0, (1_u64 << 40) as f64));
        assert!(exp2(-1e6) > 0.0 && exp2(-1e6) < NOTHING && exp2(1e6).is_finite());
    }

    #[test]
    fn sums_have_the_same_bytes_with_and_without_wide_registers() {
        let aggregator = Aggregator::new(camera(), RANGE, Quantity::PowerPerSteradian, TRANSMIT_POWER_DBM);
        let scalar = lobes(&[(30.0, 12.0, 1.0), (9.0, 20.0, 0.2)]);
        let [wide, narrow] = [aggregator.summed(scalar.pixels()), aggregator.summed_portable(scalar.pixels())];
        assert_eq!((wide.total, wide.phasors, wide.strongest), (narrow.total, narrow.phasors, narrow.strongest));
        assert_eq!(wide.beams, narrow.beams);
    }

    #[test]
    fn the_sums_are_those_of_the_metrics() {
        let (scalar, camera) = (lobes(&[(30.0, 12.0, 1.0), (9.0, 20.0, 0.2)]), camera());
        let found = of(Quantity::PowerPerSteradian, &scalar);
        let power = |x: usize, y: usize| linear(scalar[(x, y)], &RANGE);
        let total: f64 = (0..32)
            .flat_map(|y| (0..48).map(move |x| (x, y)))
            .map(|(x, y)| power(x, y) * camera.pixel_solid_angle_sr(x, y))
            .sum();
        assert!((found.path_gain_db.unwrap() - 10.0 * total.log10()).abs() < 1e-9);
        assert!((found.rssi_dbm.unwrap() - found.path_gain_db.unwrap() - TRANSMIT_POWER_DBM).abs() < 1e-12);
        // The slow way over the codebook.
        let powers = Codebook::of(camera, Quantity::PowerPerSteradian).unwrap().powers(&scalar.map(|s| linear(*s, &RANGE)));
        let best = powers.iter().copied().fold(0.0, f64::max);
        let beam = found.beam.unwrap();
        assert_eq!(powers[beam.number], best);
        assert!((beam.gain_db - 10.0 * best.log10()).abs() < 1e-9);
        assert_eq!(found.rate_bps_hz, Some(spectral_efficiency_bps_hz(best, ELEMENTS)));
        let peak = found.peak.unwrap();
        let u = ARRAY_FROM_CAMERA.transform_vector(camera.pixel_direction(30, 12));
        assert!(
            (peak.azimuth_deg - u.y.atan2(u.x).to_degrees()).abs() < 1e-12 && peak.azimuth_deg < 0.0 && peak.elevation_deg > 0.0
        );
        assert!((peak.db + 60.0).abs() < 1e-3);
    }

    #[test]
    fn a_lone_direction_has_no_spread_and_more_power_is_more_rate() {
        let mut lone = Raster::filled(48, 32, 0.0);
        lone[(20, 16)] = 0.5;
        let found = of(Quantity::PowerPerSteradian, &lone);
        // The logarithm of a sum that is 1 up to rounding: √(2·1e-15) of a radian.
        assert!(found.azimuth_spread_deg.unwrap() < 1e-5 && found.zenith_spread_deg.unwrap() < 1e-5, "{found:?}");
        let two = of(Quantity::PowerPerSteradian, &lobes(&[(8.0, 16.0, 1.0), (40.0, 16.0, 1.0)]));
        assert!(two.azimuth_spread_deg.unwrap() > 20.0 && two.zenith_spread_deg.unwrap() < 8.0, "{two:?}");
        let stronger = Aggregator::new(camera(), RANGE, Quantity::PowerPerSteradian, TRANSMIT_POWER_DBM + 10.0).of(&lone);
        assert!((stronger.rssi_dbm.unwrap() - found.rssi_dbm.unwrap() - 10.0).abs() < 1e-12);
        assert!(stronger.rate_bps_hz > found.rate_bps_hz);
    }

    #[test]
    fn what_a_kind_does_not_say_is_empty_and_has_a_reason() {
        let scalar = lobes(&[(24.0, 16.0, 1.0)]);
        for (quantity, gain, beams) in [
            (Quantity::PowerPerSteradian, true, true),
            (Quantity::BeamPower, false, true),
            (Quantity::CaponPower, false, false),
            (Quantity::Unknown, false, false),
        ] {
            let aggregator = Aggregator::new(camera(), RANGE, quantity, TRANSMIT_POWER_DBM);
            let found = aggregator.of(&scalar);
            assert_eq!((found.path_gain_db.is_some(), found.rssi_dbm.is_some()), (gain, gain), "{quantity:?}");
            assert_eq!((found.beam.is_some(), found.rate_bps_hz.is_some()), (beams, beams), "{quantity:?}");
            assert!(found.peak.is_some() && found.azimuth_spread_deg.is_some() && found.zenith_spread_deg.is_some());
            let empty = aggregator.left_empty();
            assert_eq!(empty.iter().any(|(column, _)| *column == "rssi_dbm"), !gain, "{quantity:?}");
            assert_eq!(empty.iter().any(|(column, _)| *column == "outage"), !beams, "{quantity:?}");
            assert!(empty.iter().all(|(_, why)| !why.is_empty()));
        }
    }

    #[test]
    fn where_nothing_arrives_there_is_no_direction_and_no_rate() {
        let nothing = of(Quantity::PowerPerSteradian, &Raster::filled(48, 32, 0.0));
        assert_eq!(nothing, Aggregates { rate_bps_hz: Some(0.0), ..Aggregates::default() });
    }
}
