//! Metrics of a predicted image and a predicted spectrum, one value a frame; a [`Column`] says how the frames of a cell become one number.

pub mod aggregates;
pub mod beams;
mod columns;
pub mod free_space;
pub mod image;
pub mod input;
pub mod lpips;
pub mod outage;
pub mod peaks;
pub mod radio;
pub mod rate;
pub mod stats;

pub use columns::{COLUMNS, Column, RADIO, Statistic};

use crate::metrics::input::Input;
use anyhow::Result;
use beams::{BeamMetrics, Codebook};
use corf_scene::dataset::Quantity;
use corf_scene::keyframe::{DbRange, Modalities};
use corf_scene::{Keyframe, Pinhole, Raster, Rigid3, color};
use free_space::FreeSpaceLink;
use lpips::LpipsComparer;
use outage::{BeamGains, LinkRates};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Prediction of a method at a pose.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// Optical image, sRGB-encoded `[0, 1]`; methods that learn from spectra alone have none.
    pub image: Option<Raster<[f32; 3]>>,
    /// The spectrum; methods that learn from images alone have none.
    pub radio: Option<RadioPrediction>,
    /// z-depth of the optical view, metres, 0 where the field has nothing; methods without geometry have none.
    pub depth_m: Option<Raster<f32>>,
}

/// Prediction of a spectrum.
#[derive(Clone, Debug)]
pub struct RadioPrediction {
    /// Jet-coloured, `[0, 1]`: what the paper's RF metrics look at.
    pub jet: Raster<[f32; 3]>,
    /// On the dataset's dB range, `[0, 1]`: what the physical metrics look at.
    pub scalar: Raster<f32>,
}

impl RadioPrediction {
    /// A scalar spectrum, coloured for the paper's metrics.
    pub fn from_scalar(scalar: Raster<f32>) -> Self {
        Self { jet: scalar.map(|&s| color::jet(s)), scalar }
    }
}

impl Prediction {
    /// A prediction without depth from a scalar spectrum, coloured for the paper's metrics.
    pub fn from_scalar(image: Option<Raster<[f32; 3]>>, radio_scalar: Raster<f32>) -> Self {
        Self { image, radio: Some(RadioPrediction::from_scalar(radio_scalar)), depth_m: None }
    }

    /// What of it is of modalities that the dataset has: of the others there is nothing that could be right or wrong.
    pub fn within(self, has: Modalities) -> Self {
        Self { image: self.image.filter(|_| has.light), radio: self.radio.filter(|_| has.radio), ..self }
    }

    /// Whether every pixel of image and spectrum is a finite number.
    pub fn is_finite(&self) -> bool {
        let colours = self.image.iter().flat_map(|image| image.pixels().iter().flatten());
        let radio = self.radio.iter().flat_map(|r| r.scalar.pixels().iter().chain(r.jet.pixels().iter().flatten()));
        colours.chain(radio).all(|v| v.is_finite())
    }

    /// Both halves of it.
    pub fn halves(&self) -> Halves<'_> {
        let spectrum = self.radio.as_ref().map(|r| PredictedSpectrum { jet: &r.jet, scalar: &r.scalar });
        Halves { image: self.image.as_ref(), spectrum }
    }
}

/// What is predicted of a keyframe: a program that knows light alone, or radio alone, leaves the other half out.
#[derive(Clone, Copy, Debug)]
pub struct Halves<'a> {
    /// Optical image, sRGB-encoded `[0, 1]`.
    pub image: Option<&'a Raster<[f32; 3]>>,
    /// The spectrum.
    pub spectrum: Option<PredictedSpectrum<'a>>,
}

/// A predicted spectrum, as [`Prediction`] holds it.
#[derive(Clone, Copy, Debug)]
pub struct PredictedSpectrum<'a> {
    /// Jet-coloured, `[0, 1]`.
    pub jet: &'a Raster<[f32; 3]>,
    /// On the dataset's dB range, `[0, 1]`.
    pub scalar: &'a Raster<f32>,
}

/// All metrics of one held-out frame, as far as it was predicted. Names are those of `metrics.json`; what was not computed has no key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameMetrics {
    /// Keyframe index along the trajectory.
    pub index: usize,
    /// Whether an image was predicted that has no metrics, for none of the observed one's pixels count.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub masked_out: bool,
    /// Metrics of the image.
    #[serde(flatten)]
    pub light: Option<LightMetrics>,
    /// Metrics of the spectrum.
    #[serde(flatten)]
    pub spectrum: Option<SpectrumMetrics>,
    /// LPIPS by column key, of the backbones whose weights were given.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub lpips: BTreeMap<String, f64>,
}

/// Metrics of a predicted image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightMetrics {
    /// PSNR of the 8-bit optical image, dB.
    pub psnr_opt: f64,
    /// SSIM of the 8-bit optical image.
    pub ssim_opt: f64,
}

/// Metrics of a predicted spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpectrumMetrics {
    /// PSNR of the 8-bit Jet spectrum, dB (the paper's PSNR_rf).
    pub psnr_rf_jet: f64,
    /// SSIM of the 8-bit Jet spectrum (the paper's SSIM_rf).
    pub ssim_rf_jet: f64,
    /// PSNR of the 8-bit scalar (dB-scaled) spectrum, dB.
    pub psnr_rf_scalar: f64,
    /// SSIM of the 8-bit scalar spectrum.
    pub ssim_rf_scalar: f64,
    /// Physical metrics of the spectrum; none of grey levels whose unit is not known.
    #[serde(flatten)]
    pub radio: Option<radio::RadioMetrics>,
    /// What the beam that the prediction would choose loses; records made before it was computed have none, nor have spectra without beams.
    #[serde(flatten)]
    pub beams: Option<BeamMetrics>,
    /// Rates of the best and of the chosen beam, which outage follows from; where there are beams, in records made since they are computed.
    #[serde(flatten)]
    pub link: Option<LinkRates>,
}

/// A predicted spectrum beside the observed one, in 8 bits.
struct SpectrumPair<'a> {
    predicted: PredictedSpectrum<'a>,
    /// Linear power.
    truth: &'a Raster<f32>,
    jet: Raster<[u8; 3]>,
    jet_truth: Raster<[u8; 3]>,
    grey_truth: Raster<[u8; 1]>,
}

/// Compares predictions with the keyframes of one dataset.
#[derive(Clone, Debug)]
pub struct Evaluator {
    /// None of a dataset without spectra.
    spectra: Option<SpectrumEvaluator>,
    lpips: LpipsComparer,
}

/// Compares predicted spectra with those of one dataset.
#[derive(Clone, Debug)]
struct SpectrumEvaluator {
    radio_camera: Pinhole,
    range: DbRange,
    codebook: Option<Codebook>,
    free_space: Option<FreeSpaceLink>,
    /// Whether values are powers and pixels have a camera; grey levels of an array that stands still have neither.
    physical: bool,
}

impl Evaluator {
    /// An evaluator of a dataset's keyframes, which computes LPIPS with the networks there are.
    pub fn of(input: &Input) -> Self {
        let dataset = &input.dataset;
        let spectra = dataset.db_range().map(|range| SpectrumEvaluator {
            free_space: FreeSpaceLink::of(dataset.header()),
            physical: dataset.fixed_array().is_none(),
            ..SpectrumEvaluator::new(dataset.radio_camera(), range, dataset.header().quantity)
        });
        Self { spectra, lpips: LpipsComparer::new(&input.networks) }
    }

    /// `rf_camera` gives direction and solid angle of every spectrum pixel, `range` is the dataset's dB range, and `quantity` says what a
    /// value is, and so what a beam of it is.
    pub fn new(radio_camera: Pinhole, range: DbRange, quantity: Quantity) -> Self {
        Self { spectra: Some(SpectrumEvaluator::new(radio_camera, range, quantity)), lpips: LpipsComparer::default() }
    }

    /// All metrics of what is predicted of a keyframe, as far as it was observed.
    ///
    /// # Errors
    /// An interrupt.
    pub fn compare(&self, predicted: Halves<'_>, truth: &Keyframe) -> Result<FrameMetrics> {
        let shown = self.shown(predicted, truth);
        self.with_lpips(shown.metrics(), &shown)
    }

    /// [`Self::compare`] of several keyframes at once, in their order. LPIPS alone is computed of one after the other: a network takes all threads by
    /// itself, and a gigabyte for a large image.
    ///
    /// # Errors
    /// An interrupt.
    pub fn compare_all(&self, pairs: &[(Halves<'_>, &Keyframe)]) -> Result<Vec<FrameMetrics>> {
        let compared = pairs.par_iter().map(|(predicted, truth)| {
            let shown = self.shown(*predicted, truth);
            (shown.metrics(), shown)
        });
        compared.collect::<Vec<_>>().into_iter().map(|(metrics, shown)| self.with_lpips(metrics, &shown)).collect()
    }

    fn with_lpips(&self, metrics: FrameMetrics, shown: &Shown<'_>) -> Result<FrameMetrics> {
        let images = shown.images().map(|(image, truth)| (lpips::LIGHT, image, truth));
        let spectra = shown.spectra.as_ref().map(|(_, pair)| (lpips::SPECTRUM, &pair.jet, &pair.jet_truth));
        let pairs: Vec<_> = images.into_iter().chain(spectra).collect();
        Ok(FrameMetrics { lpips: self.lpips.compare(&pairs)?, ..metrics })
    }

    fn shown<'a>(&'a self, predicted: Halves<'a>, truth: &'a Keyframe) -> Shown<'a> {
        let light = predicted.image.zip(truth.light.as_ref());
        let mask = light.and_then(|(_, truth)| truth.mask.as_ref());
        // An image none of whose pixels count is not compared. Where a pixel does not count, the observation is shown, so that nothing is found
        // there.
        let masked_out = mask.is_some_and(|mask| image::share(mask) == 0.0);
        let image = light.filter(|_| !masked_out).map(|(predicted, truth)| {
            let predicted = predicted.map(|p| p.map(color::quantize8));
            match mask {
                Some(mask) => image::unmasked(&predicted, &truth.image, mask),
                None => predicted,
            }
        });
        let spectra = match (predicted.spectrum, &truth.radio, &self.spectra) {
            (Some(predicted), Some(radio), Some(evaluator)) => Some((evaluator, evaluator.pair(predicted, &radio.spectrum))),
            _ => None,
        };
        Shown { truth, image, mask, masked_out, spectra }
    }
}

type TwoImages<'a> = (&'a Raster<[u8; 3]>, &'a Raster<[u8; 3]>);

/// A prediction beside its keyframe, as both are compared.
struct Shown<'a> {
    truth: &'a Keyframe,
    /// The predicted image in 8 bits, where there are two and a pixel of them counts.
    image: Option<Raster<[u8; 3]>>,
    mask: Option<&'a Raster<bool>>,
    /// Whether no pixel counts.
    masked_out: bool,
    spectra: Option<(&'a SpectrumEvaluator, SpectrumPair<'a>)>,
}

impl Shown<'_> {
    /// The predicted image and the observed one.
    fn images(&self) -> Option<TwoImages<'_>> {
        self.image.as_ref().zip(self.truth.light.as_ref().map(|light| &light.image))
    }

    /// All metrics but LPIPS.
    fn metrics(&self) -> FrameMetrics {
        FrameMetrics {
            index: self.truth.index,
            masked_out: self.masked_out,
            light: self.images().map(|(image, truth)| LightMetrics {
                psnr_opt: image::psnr(image, truth, self.mask),
                ssim_opt: image::ssim(image, truth, self.mask),
            }),
            spectrum: self.spectra.as_ref().map(|(evaluator, pair)| evaluator.compare(pair, &self.truth.world_from_camera)),
            lpips: BTreeMap::new(),
        }
    }
}

impl SpectrumEvaluator {
    fn new(radio_camera: Pinhole, range: DbRange, quantity: Quantity) -> Self {
        Self { radio_camera, range, codebook: Codebook::of(radio_camera, quantity), free_space: None, physical: true }
    }

    fn pair<'a>(&self, predicted: PredictedSpectrum<'a>, truth: &'a Raster<f32>) -> SpectrumPair<'a> {
        let scalar_truth = truth.map(|&s| self.range.scalar(s));
        SpectrumPair {
            predicted,
            truth,
            jet: predicted.jet.map(|p| p.map(color::quantize8)),
            jet_truth: scalar_truth.map(|&s| color::jet(s).map(color::quantize8)),
            grey_truth: scalar_truth.map(|&s| [color::quantize8(s)]),
        }
    }

    fn compare(&self, pair: &SpectrumPair<'_>, world_from_camera: &Rigid3) -> SpectrumMetrics {
        let SpectrumPair { predicted, truth, jet, jet_truth, grey_truth } = pair;
        let grey = predicted.scalar.map(|&s| [color::quantize8(s)]);
        let linear = |s: &f32| radio::linear(*s, &self.range);
        let beams = self.codebook.as_ref().map(|codebook| {
            let observed = codebook.powers(&truth.map(|&s| f64::from(s).max(0.0)));
            let predicted = codebook.powers(&predicted.scalar.map(linear));
            let limit_db = self.range.max_db - self.range.min_db;
            (beams::compare(&predicted, &observed, limit_db), self.link(codebook, &predicted, &observed, world_from_camera))
        });
        SpectrumMetrics {
            psnr_rf_jet: image::psnr(jet, jet_truth, None),
            ssim_rf_jet: image::ssim(jet, jet_truth, None),
            psnr_rf_scalar: image::psnr(&grey, grey_truth, None),
            ssim_rf_scalar: image::ssim(&grey, grey_truth, None),
            radio: self.physical.then(|| radio::compare(predicted.scalar, truth, &self.radio_camera, &self.range)),
            beams: beams.map(|b| b.0),
            link: beams.map(|b| b.1),
        }
    }

    /// The link behind the beam that a prediction chooses, by the powers of the codebook's beams.
    fn link(&self, codebook: &Codebook, predicted: &[f64], observed: &[f64], world_from_camera: &Rigid3) -> LinkRates {
        let [best, chosen] = beams::best_and_chosen(predicted, observed);
        let gains = BeamGains {
            best: observed[best],
            chosen: observed[chosen],
            predicted: predicted[chosen],
            free_space: self.free_space.and_then(|free| free.gain(world_from_camera)),
        };
        LinkRates::new([codebook.number(best), codebook.number(chosen)], gains, beams::ELEMENTS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::{Light, Radio};

    const RANGE: DbRange = DbRange { min_db: -110.0, max_db: -40.0 };

    /// The columns that need neither weights nor a transmitter.
    fn computed() -> impl Iterator<Item = &'static Column> {
        COLUMNS.iter().filter(|c| c.backbone().is_none() && c.key != "outage_blocked_percent")
    }

    fn keyframe() -> Keyframe {
        let spectrum = Raster::from_fn(48, 32, |x, y| {
            (1e-6 * (-0.5 * ((x as f64 - 30.0).powi(2) + (y as f64 - 12.0).powi(2)) / 4.0).exp()) as f32
        });
        let image = Raster::from_fn(24, 16, |x, y| [(9 * x) as u8, (15 * y) as u8, 100]);
        Keyframe {
            index: 8,
            time_s: 0.0,
            world_from_camera: Rigid3::IDENTITY,
            light: Some(Light::of_image(image)),
            radio: Some(Radio { spectrum }),
        }
    }

    fn spectrum(truth: &mut Keyframe) -> &mut Raster<f32> {
        &mut truth.radio.as_mut().unwrap().spectrum
    }

    fn light(truth: &mut Keyframe) -> &mut Light {
        truth.light.as_mut().unwrap()
    }

    fn observed(truth: &Keyframe) -> Prediction {
        let image = truth.light.as_ref().unwrap().image.map(|p| p.map(|v| f32::from(v) / 255.0));
        Prediction::from_scalar(Some(image), truth.radio.as_ref().unwrap().spectrum.map(|&s| RANGE.scalar(s)))
    }

    #[test]
    fn the_observation_itself_is_the_best_prediction_in_every_column() {
        let truth = keyframe();
        for quantity in [Quantity::PowerPerSteradian, Quantity::BeamPower] {
            let evaluator = Evaluator::new(Pinhole::from_horizontal_fov(48, 32, 90.0), RANGE, quantity);
            let frame = evaluator.compare(observed(&truth).halves(), &truth).unwrap();
            for column in computed() {
                let value = (column.of)(&frame).unwrap();
                let best = match column.key {
                    key if key.starts_with("psnr") => image::PSNR_OF_EQUAL_DB,
                    // What is strong is caught as far as it fits.
                    key if key.starts_with("energy") => value,
                    key if key.starts_with("ssim") || key.starts_with("psp") || key.starts_with("beam_top") => 1.0,
                    _ => 0.0,
                };
                assert!((value - best).abs() < 2e-3, "{}: {value}, {best}", column.key);
            }
        }
    }

    #[test]
    fn whoever_sees_what_is_there_is_in_outage_where_everybody_is_and_knows_it() {
        let wide = DbRange { min_db: -160.0, max_db: -40.0 };
        let camera = Pinhole::from_horizontal_fov(48, 32, 90.0);
        let mut out = Vec::new();
        for weaker_db in (0..=60).step_by(4) {
            let mut truth = keyframe();
            let weaker = spectrum(&mut truth).map(|&s| s * 10f32.powf(-0.1 * weaker_db as f32));
            let prediction = Prediction::from_scalar(None, weaker.map(|&s| wide.scalar(s)));
            *spectrum(&mut truth) = weaker;
            let evaluator = Evaluator::new(camera, wide, Quantity::PowerPerSteradian);
            let frame = evaluator.compare(prediction.halves(), &truth).unwrap().spectrum.unwrap();
            let (beams, link) = (frame.beams.unwrap(), frame.link.unwrap());
            assert!(beams.codebook_loss_db == 0.0 && link.best_beam == link.chosen_beam);
            assert!((link.predicted_rate_bps_hz - link.best_rate_bps_hz).abs() < 1e-3, "{link:?}");
            let outage = link.outage();
            assert!(outage.chosen == outage.best && !outage.missed() && !outage.false_alarm(), "{link:?}");
            out.push(outage.best);
        }
        // Weaker and weaker: in service first, then in outage, and never back.
        assert!(!out[0] && out[out.len() - 1] && out.windows(2).all(|pair| pair[0] <= pair[1]), "{out:?}");
    }

    #[test]
    fn halves_that_are_not_predicted_have_no_numbers_and_no_keys() {
        let truth = keyframe();
        let evaluator = Evaluator::new(Pinhole::from_horizontal_fov(48, 32, 90.0), RANGE, Quantity::CaponPower);
        let whole = observed(&truth);
        let light = evaluator.compare(Halves { spectrum: None, ..whole.halves() }, &truth).unwrap();
        let radio = evaluator.compare(Halves { image: None, ..whole.halves() }, &truth).unwrap();
        for column in computed() {
            let beam = ["codebook", "beam_top", "rate", "outage"].iter().any(|start| column.key.starts_with(start));
            let of_image = column.is_of_image();
            assert_eq!((column.of)(&light).is_some(), of_image, "{}", column.key);
            assert_eq!((column.of)(&radio).is_some(), !of_image && !beam, "{}: Capon's estimate has no beams", column.key);
        }
        // What was not observed is neither right nor wrong.
        let seen = evaluator.compare(whole.halves(), &Keyframe { radio: None, ..truth.clone() }).unwrap();
        let heard = evaluator.compare(whole.halves(), &Keyframe { light: None, ..truth.clone() }).unwrap();
        assert_eq!((&seen, &heard), (&light, &radio));
        for frame in [light, radio, evaluator.compare(whole.halves(), &truth).unwrap()] {
            let json = serde_json::to_value(&frame).unwrap();
            assert!(json.as_object().unwrap().values().all(|v| !v.is_null()), "{json}");
            assert_eq!(serde_json::from_value::<FrameMetrics>(json).unwrap(), frame);
        }
    }

    #[test]
    fn images_that_a_mask_covers_are_left_out_of_the_columns_of_images_and_counted() {
        let mut truths = [(); 3].map(|()| keyframe());
        light(&mut truths[1]).mask = Some(Raster::filled(24, 16, false));
        light(&mut truths[2]).mask = Some(Raster::from_fn(24, 16, |x, _| x > 4));
        let evaluator = Evaluator::new(Pinhole::from_horizontal_fov(48, 32, 90.0), RANGE, Quantity::PowerPerSteradian);
        let mut predicted = observed(&truths[0]);
        predicted.image = predicted.image.map(|image| image.map(|p| p.map(|v| 0.9 * v)));
        let frames = truths.each_ref().map(|truth| evaluator.compare(predicted.halves(), truth).unwrap());
        assert_eq!(frames.each_ref().map(|f| (f.masked_out, f.light.is_some())), [(false, true), (true, false), (false, true)]);
        for column in computed() {
            let values: Vec<f64> = frames.iter().filter_map(column.of).collect();
            assert_eq!(values.len(), if column.is_of_image() { 2 } else { 3 }, "{}", column.key);
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            assert!(column.statistic != Statistic::Mean || column.over(&frames) == Some(mean), "{}", column.key);
        }
        // A program that predicts no images leaves none out.
        let radio = evaluator.compare(Halves { image: None, ..predicted.halves() }, &truths[1]).unwrap();
        assert!(!radio.masked_out && serde_json::to_value(&radio).unwrap().get("masked_out").is_none());
    }

    #[test]
    fn spectra_without_power_have_finite_numbers_on_either_side() {
        let mut truth = keyframe();
        let evaluator = Evaluator::new(Pinhole::from_horizontal_fov(48, 32, 90.0), RANGE, Quantity::PowerPerSteradian);
        let nothing = Prediction::from_scalar(Some(Raster::filled(24, 16, [0.0; 3])), Raster::filled(48, 32, 0.0));
        let something = observed(&truth);
        let finite = |frame: &FrameMetrics| {
            computed().for_each(|c| assert!((c.of)(frame).unwrap().is_finite(), "{}", c.key));
            frame.spectrum.unwrap()
        };
        let missed = finite(&evaluator.compare(nothing.halves(), &truth).unwrap());
        let beams = missed.beams.unwrap();
        assert!(beams.beam_top1 == 0.0 && beams.codebook_loss_db > 20.0 && beams.rate_loss_percent > 50.0, "{beams:?}");
        *spectrum(&mut truth) = Raster::filled(48, 32, 0.0);
        for prediction in [&nothing, &something] {
            let beams = finite(&evaluator.compare(prediction.halves(), &truth).unwrap()).beams.unwrap();
            // Where nothing arrives nothing can be lost.
            assert_eq!((beams.codebook_loss_db, beams.rate_loss_bps_hz, beams.rate_loss_percent), (0.0, 0.0, 0.0));
        }
        // Under the dataset's floor there is power still: what was observed is not clipped, a prediction is.
        *spectrum(&mut truth) = Raster::filled(48, 32, 1e-12);
        let faint = finite(&evaluator.compare(nothing.halves(), &truth).unwrap());
        assert_eq!(faint.radio.map(|r| (r.rmse_db, r.total_power_error_db)), Some((0.0, 70.0)));
    }
}
