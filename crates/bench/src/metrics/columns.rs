//! The columns of the tables: what each measures, how it is written, and how the frames of a cell become one number.

use super::outage::percent;
use super::{FrameMetrics, rate};
use crate::metrics::stats::quantile;

/// How a column makes one number of a cell's held-out frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Statistic {
    /// Their mean.
    Mean,
    /// Their median, interpolated.
    Median,
    /// Their 90th percentile, interpolated: what the worst tenth begins at.
    P90,
}

/// One column of the tables: what it measures, where it is found and how it is written (the arrow in a heading says which way is better).
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Key in records and CSV.
    pub key: &'static str,
    /// Heading in Markdown and HTML: name, unit, arrow.
    pub heading: &'static str,
    /// Heading in LaTeX.
    pub latex: &'static str,
    /// Digits after the point.
    pub digits: usize,
    /// Definition for one frame; `{budget}` stands for the link budget, `{target}` for the target rate ([`Column::definition`] puts them in).
    text: &'static str,
    /// How frames become one number.
    pub statistic: Statistic,
    /// Least and largest value that a frame can have.
    pub range: [f64; 2],
    /// Reads it off a frame; `None` where the frame has none.
    pub of: fn(&FrameMetrics) -> Option<f64>,
}

/// Excess over a column's range that is rounding.
const ROUNDING: f64 = 1e-6;

impl Column {
    /// Whether a frame's number can be one of this column.
    pub fn can_be(&self, value: f64) -> bool {
        let [least, most] = self.range;
        (least - ROUNDING..=most + ROUNDING).contains(&value)
    }

    /// Definition for one frame, with formula, unit and constants.
    pub fn definition_of_frame(&self) -> String {
        self.text.replace("{budget}", &rate::budget()).replace("{target}", &rate::target())
    }

    /// Definition, with formula, unit and constants: for one frame, and then over frames.
    pub fn definition(&self) -> String {
        let over = match self.statistic {
            Statistic::Mean => "mean over keyframes",
            Statistic::Median => "median over keyframes",
            Statistic::P90 => "90th percentile over keyframes",
        };
        format!("{}; {over}", self.definition_of_frame())
    }

    /// Whether more is better, which the arrow in the heading says; `None` without one: a fact of the data, which no method changes.
    pub fn higher_is_better(&self) -> Option<bool> {
        if self.heading.ends_with('↑') { Some(true) } else { self.heading.ends_with('↓').then_some(false) }
    }

    /// Whether it is of the image, not of the spectrum.
    pub fn is_of_image(&self) -> bool {
        self.key.ends_with("_opt")
    }

    /// Whether a frame is left out of the column: its image is masked out.
    pub fn leaves_out(&self, frame: &FrameMetrics) -> bool {
        frame.masked_out && self.is_of_image()
    }

    /// The column's number of some frames, as far as it does not leave them out; `None` without frames, or where one of them has none.
    pub fn over(&self, frames: &[FrameMetrics]) -> Option<f64> {
        let frames = frames.iter().filter(|f| !self.leaves_out(f));
        let mut values = frames.map(self.of).collect::<Option<Vec<f64>>>().filter(|v| !v.is_empty())?;
        let quantile = |values: &mut Vec<f64>, q: f64| {
            values.sort_by(f64::total_cmp);
            quantile(values, q)
        };
        Some(match self.statistic {
            Statistic::Mean => values.iter().sum::<f64>() / values.len() as f64,
            Statistic::Median => quantile(&mut values, 0.5),
            Statistic::P90 => quantile(&mut values, 0.9),
        })
    }

    /// Name of the backbone of a column of LPIPS, which a record has only where its weights were given.
    pub fn backbone(&self) -> Option<&'static str> {
        self.key.strip_prefix("lpips_")?.split('_').next()
    }

    const fn new(key: &'static str, heading: &'static str, latex: &'static str, digits: usize) -> Self {
        Self { key, heading, latex, digits, text: "", statistic: Statistic::Mean, range: [0.0, f64::INFINITY], of: |_| None }
    }

    /// The column with its definition, as a mean over frames.
    const fn is(self, of: fn(&FrameMetrics) -> Option<f64>, text: &'static str) -> Self {
        Self { text, of, ..self }
    }

    /// The column with the range of its values; by itself they are at least 0.
    const fn within(self, least: f64, most: f64) -> Self {
        Self { range: [least, most], ..self }
    }

    const fn by(self, statistic: Statistic) -> Self {
        Self { statistic, ..self }
    }
}

/// A column of LPIPS: key, backbone, input, image, and the image's index in LaTeX.
macro_rules! lpips {
    ($key:literal, $backbone:literal, $input:literal, $image:literal, $index:literal) => {
        Column::new(
            $key,
            concat!("LPIPS-", $backbone, " ", $input, " ", $image, " ↓"),
            concat!(r"LPIPS$_\mathrm{", $index, r"}^\downarrow$ (", $backbone, ", $", $input, "$)"),
            3,
        )
        .is(
            |m| m.lpips.get($key).copied(),
            concat!(
                "learned perceptual image patch similarity v0.1 of the 8-bit ",
                $image,
                " image with the backbone ",
                $backbone,
                " on inputs scaled to ",
                $input,
            ),
        )
    };
}

/// The keys of the columns that tell how a spectrum serves a radio.
pub const RADIO: &[&str] = &[
    "rmse_db_30",
    "peak_error_median_deg",
    "peak_error_p90_deg",
    "codebook_loss_db",
    "codebook_loss_p90_db",
    "beam_top1",
    "beam_top3",
    "rate_loss_bps_hz",
    "rate_loss_percent",
    "outage_best_percent",
    "outage_blocked_percent",
    "outage_percent",
    "outage_missed_percent",
    "outage_false_percent",
    "total_power_error_db",
    "azimuth_spread_error_deg",
];

const PEAK: &str = "angle between the directions of the strongest observed and the strongest predicted pixel, degrees";
const CODEBOOK: &str = "10·log10(max_b P_b / P_b̂), dB: observed power of the best beam of the 8×8 codebook over that of the beam that is strongest in the prediction";

/// Every metric, in the order of the tables; the first six are the paper's.
pub const COLUMNS: &[Column] = &[
    Column::new("psnr_opt", "PSNR opt ↑", r"PSNR$_\mathrm{opt}^\uparrow$", 2)
        .is(|m| Some(m.light?.psnr_opt), "peak signal-to-noise ratio of the 8-bit image over pixels and channels, dB"),
    Column::new("ssim_opt", "SSIM opt ↑", r"SSIM$_\mathrm{opt}^\uparrow$", 3)
        .is(|m| Some(m.light?.ssim_opt), "structural similarity of the 8-bit image: 11×11 Gaussian window of σ = 1.5, zero padding")
        .within(-1.0, 1.0),
    Column::new("psnr_rf_jet", "PSNR rf (Jet) ↑", r"PSNR$_\mathrm{rf}^\uparrow$", 2)
        .is(|m| Some(m.spectrum?.psnr_rf_jet), "peak signal-to-noise ratio of the 8-bit Jet image of the spectrum, dB"),
    Column::new("ssim_rf_jet", "SSIM rf (Jet) ↑", r"SSIM$_\mathrm{rf}^\uparrow$", 3)
        .is(|m| Some(m.spectrum?.ssim_rf_jet), "structural similarity of the 8-bit Jet image of the spectrum")
        .within(-1.0, 1.0),
    Column::new("psnr_rf_scalar", "PSNR rf (dB) ↑", r"PSNR$_\mathrm{rf,dB}^\uparrow$", 2).is(
        |m| Some(m.spectrum?.psnr_rf_scalar),
        "peak signal-to-noise ratio of the spectrum as 8-bit grey on the data set's decibel range, dB",
    ),
    Column::new("ssim_rf_scalar", "SSIM rf (dB) ↑", r"SSIM$_\mathrm{rf,dB}^\uparrow$", 3)
        .is(|m| Some(m.spectrum?.ssim_rf_scalar), "structural similarity of that grey image")
        .within(-1.0, 1.0),
    Column::new("rmse_db_30", "RMSE within 30 dB, dB ↓", r"RMSE$_{30}^\downarrow$ (dB)", 2).is(
        |m| Some(m.spectrum?.radio?.rmse_db_30),
        "root mean square error in dB over the pixels within 30 dB of the observed peak, both on the data set's decibel range",
    ),
    Column::new("rmse_db", "RMSE, dB ↓", r"RMSE$^\downarrow$ (dB)", 2)
        .is(|m| Some(m.spectrum?.radio?.rmse_db), "root mean square error in dB over all pixels, both on the data set's decibel range"),
    Column::new("psp_similarity", "PSP similarity ↑", r"PSP$^\uparrow$", 3).is(
        |m| Some(m.spectrum?.radio?.psp_similarity),
        "1 − ½ Σ |ŜΩ/ΣŜΩ − SΩ/ΣSΩ|, in [0, 1] (power angular spectrum similarity, 3GPP TS 38.151)",
    )
        .within(0.0, 1.0),
    Column::new("total_power_error_db", "total power error, dB ↓", r"$|\Delta P|^\downarrow$ (dB)", 2)
        .is(|m| Some(m.spectrum?.radio?.total_power_error_db), "|10·log10(ΣŜΩ / ΣSΩ)|, dB: error of the power in the image"),
    Column::new("peak_error_deg", "peak AoA error, ° ↓", r"AoA$^\downarrow$ ($^\circ$)", 1)
        .is(|m| Some(m.spectrum?.radio?.peak_error_deg), PEAK)
        .within(0.0, 180.0),
    Column::new("beam_loss_db", "beam loss, dB ↓", r"beam loss$^\downarrow$ (dB)", 2).is(
        |m| Some(m.spectrum?.radio?.beam_loss_db),
        "10·log10(max S / S(argmax Ŝ)), dB: what a beam as narrow as a pixel, pointed at the predicted peak, loses",
    ),
    Column::new("energy_capture_1", "energy in best 1 % ↑", r"$E_{1\%}^\uparrow$", 3).is(
        |m| Some(m.spectrum?.radio?.energy_capture_1),
        "share of the observed power inside the predicted strongest 1 % of the image's solid angle",
    )
        .within(0.0, 1.0),
    Column::new("energy_capture_5", "energy in best 5 % ↑", r"$E_{5\%}^\uparrow$", 3)
        .is(|m| Some(m.spectrum?.radio?.energy_capture_5), "the same of the strongest 5 %")
        .within(0.0, 1.0),
    Column::new("azimuth_spread_error_deg", "azimuth spread error, ° ↓", r"$|\Delta\mathrm{ASA}|^\downarrow$ ($^\circ$)", 2).is(
        |m| Some(m.spectrum?.radio?.azimuth_spread_error_deg),
        "|difference| of the circular azimuth spreads √(−2 ln |Σ SΩ e^{jφ} / Σ SΩ|), degrees (3GPP TR 38.901, Annex A; array frame)",
    ),
    Column::new("peak_error_median_deg", "median peak AoA error, ° ↓", r"AoA$_{50}^\downarrow$ ($^\circ$)", 1)
        .is(|m| Some(m.spectrum?.radio?.peak_error_deg), PEAK)
        .by(Statistic::Median)
        .within(0.0, 180.0),
    Column::new("peak_error_p90_deg", "P90 peak AoA error, ° ↓", r"AoA$_{90}^\downarrow$ ($^\circ$)", 1)
        .is(|m| Some(m.spectrum?.radio?.peak_error_deg), PEAK)
        .by(Statistic::P90)
        .within(0.0, 180.0),
    Column::new("codebook_loss_db", "8×8 beam loss, dB ↓", r"$8{\times}8$ beam loss$^\downarrow$ (dB)", 2)
        .is(|m| Some(m.spectrum?.beams?.codebook_loss_db), CODEBOOK),
    Column::new("codebook_loss_p90_db", "P90 8×8 beam loss, dB ↓", r"$8{\times}8$ beam loss$_{90}^\downarrow$ (dB)", 2)
        .is(|m| Some(m.spectrum?.beams?.codebook_loss_db), CODEBOOK)
        .by(Statistic::P90),
    Column::new("beam_top1", "top-1 beam ↑", r"top-1 beam$^\uparrow$", 3)
        .is(|m| Some(m.spectrum?.beams?.beam_top1), "1 where the beam of the 8×8 codebook that is strongest in the prediction is the best, else 0")
        .within(0.0, 1.0),
    Column::new("beam_top3", "top-3 beam ↑", r"top-3 beam$^\uparrow$", 3)
        .is(|m| Some(m.spectrum?.beams?.beam_top3), "1 where the best beam is among the three that are strongest in the prediction, else 0")
        .within(0.0, 1.0),
    Column::new("rate_loss_bps_hz", "rate loss, bit/s/Hz ↓", r"rate loss$^\downarrow$ (bit/s/Hz)", 2).is(
        |m| Some(m.spectrum?.beams?.rate_loss_bps_hz),
        "log2(1 + SNR) of the best beam minus that of the beam that is strongest in the prediction, bit/s/Hz; SNR = 64·P_t·P_b / (k·T·B·F) with {budget}",
    ),
    Column::new("rate_loss_percent", "rate loss, % ↓", r"rate loss$^\downarrow$ (\%)", 1).is(
        |m| Some(m.spectrum?.beams?.rate_loss_percent),
        "that rate loss in per cent of the best beam's rate; {budget}",
    )
        .within(0.0, 100.0),
    Column::new("outage_best_percent", "outage of the best beam, %", r"outage of the best beam (\%)", 1).is(
        |m| Some(percent(m.spectrum?.link?.outage().best)),
        "100 where log2(1 + SNR) of the best beam as observed is below {target}, else 0: what the place allows, whatever is predicted; {budget}",
    )
        .within(0.0, 100.0),
    Column::new("outage_blocked_percent", "outage by blockage, %", r"outage by blockage (\%)", 1).is(
        |m| Some(percent(m.spectrum?.link?.outage().blocked?)),
        "100 where the best beam is in outage and one steered at the transmitter through free space would not be, else 0; {target}, {budget}",
    )
        .within(0.0, 100.0),
    Column::new("outage_percent", "outage, % ↓", r"outage$^\downarrow$ (\%)", 1).is(
        |m| Some(percent(m.spectrum?.link?.outage().chosen)),
        "100 where log2(1 + SNR), as observed, of the beam that is strongest in the prediction is below {target}, else 0; {budget}",
    )
        .within(0.0, 100.0),
    Column::new("outage_missed_percent", "missed outage, % ↓", r"missed outage$^\downarrow$ (\%)", 1).is(
        |m| Some(percent(m.spectrum?.link?.outage().missed())),
        "100 where the best beam as observed is in outage and the strongest beam of the prediction, as predicted, is not, else 0; {target}, {budget}",
    )
        .within(0.0, 100.0),
    Column::new("outage_false_percent", "false outage, % ↓", r"false outage$^\downarrow$ (\%)", 1).is(
        |m| Some(percent(m.spectrum?.link?.outage().false_alarm())),
        "100 where the strongest beam of the prediction, as predicted, is in outage and the best beam as observed is not, else 0; {target}, {budget}",
    )
        .within(0.0, 100.0),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_says_what_it_is_and_which_way_is_better() {
        for (i, c) in COLUMNS.iter().enumerate() {
            assert!(COLUMNS[..i].iter().all(|other| other.key != c.key && other.heading != c.heading), "{}", c.key);
            let arrows = |up: bool, down: bool| [up, down];
            let heading = arrows(c.heading.ends_with(" ↑"), c.heading.ends_with(" ↓"));
            let fact = ["outage_best_percent", "outage_blocked_percent"].contains(&c.key);
            assert_eq!(heading.iter().filter(|arrow| **arrow).count(), usize::from(!fact), "{}", c.key);
            assert_eq!(heading, arrows(c.latex.contains(r"\uparrow"), c.latex.contains(r"\downarrow")), "{}", c.key);
            assert_eq!(c.higher_is_better(), (!fact).then_some(heading[0]), "{}", c.key);
            let definition = c.definition();
            assert!(
                definition.len() > 40 && !definition.contains('{') || definition.contains("e^{jφ}"),
                "{}: {definition}",
                c.key
            );
            for (in_key, unit) in [("_deg", "°"), ("_db", "dB"), ("bps_hz", "bit/s/Hz"), ("percent", "%")] {
                assert!(!c.key.ends_with(in_key) || c.heading.contains(unit), "{}: {}", c.key, c.heading);
            }
        }
        assert!(RADIO.iter().all(|key| COLUMNS.iter().any(|c| c.key == *key)));
    }

    #[test]
    fn the_link_budget_stands_in_the_definition() {
        for column in COLUMNS.iter().filter(|c| c.key.starts_with("rate_loss") || c.key.starts_with("outage")) {
            assert!(column.definition().contains(&rate::budget()), "{}", column.definition());
            assert_eq!(
                column.definition().contains(&rate::target()),
                column.key.starts_with("outage"),
                "{}",
                column.definition()
            );
        }
    }
}
