//! Every held-out keyframe: observed and predicted under one slider, for the row that is chosen, with the error beside it.

use super::colours::{bars, jet_bar, jet_image};
use super::{Report, row_folder};
use crate::charts::{image_error, picture_uri, spectrum_error};
use crate::files::escape::html as escape;
use crate::metrics::FrameMetrics;
use crate::record::Outcome;
use crate::record::predictions::{self, IMAGE_COLUMNS, SPECTRUM_COLUMNS, shrunk_image, shrunk_scalar};
use anyhow::Result;
use corf::FieldMeta;
use corf_scene::keyframe::DbRange;
use corf_scene::{Radio, Raster};
use std::fmt::Write;

/// Most bytes of the keyframes' pictures in a page; the rest of it has some hundred kilobytes.
const MOST_BYTES: usize = 24_000_000;
/// Widths that are tried until the pictures fit, as shares of the kept width, in hundredths.
const SHARES: &[usize] = &[100, 75, 50, 35, 20];
/// Width of an error map, as a share of the picture's, in hundredths.
const ERROR_SHARE: usize = 67;
/// Most columns of a spectrum in the gallery.
const GALLERY_COLUMNS: usize = 240;

/// A held-out keyframe, small.
struct Observed {
    index: usize,
    /// None without light.
    image: Option<Raster<[u8; 3]>>,
    /// None without radio.
    radio: Option<ObservedRadio>,
}

/// The spectrum of a held-out keyframe, small.
struct ObservedRadio {
    /// On the dataset's decibel range, `[0, 1]`.
    scalar: Raster<f32>,
    range: DbRange,
    /// Sum of the spectrum, linear.
    power: f64,
}

/// The held-out keyframes of a report.
pub(super) struct Observations(Vec<Observed>);

impl Observations {
    /// Reads them.
    ///
    /// # Errors
    /// A keyframe that cannot be read.
    pub(super) fn read(report: &Report<'_>) -> Result<Self> {
        let range = report.dataset.db_range();
        let read = |&index: &usize| {
            let truth = report.dataset.keyframe(index)?;
            let radio = truth.radio.zip(range).map(|(Radio { spectrum }, range)| ObservedRadio {
                scalar: shrunk_scalar(&spectrum.map(|&s| range.scalar(s)), SPECTRUM_COLUMNS),
                range,
                power: spectrum.pixels().iter().map(|&s| f64::from(s)).sum(),
            });
            Ok(Observed { index, image: truth.light.map(|light| shrunk_image(&light.image, IMAGE_COLUMNS)), radio })
        };
        Ok(Self(report.split.held_out.iter().map(read).collect::<Result<_>>()?))
    }
}

/// A picture with its text.
fn img(picture: &Raster<[u8; 3]>, attributes: &str, alt: &str) -> Result<String> {
    let (uri, alt, width, height) = (picture_uri(picture)?, escape(alt), picture.width(), picture.height());
    Ok(format!("<img {attributes} width=\"{width}\" height=\"{height}\" loading=\"lazy\" alt=\"{alt}\" src=\"{uri}\"/>"))
}

/// One half of a keyframe, light or radio, as its figures are made.
struct Half<'a> {
    name: &'a str,
    keyframe: usize,
    pair: String,
    errors: String,
    captions: String,
}

impl<'a> Half<'a> {
    fn new(name: &'a str, index: usize, observed: &Raster<[u8; 3]>) -> Result<Self> {
        let keyframe = index + 1;
        let pair = img(observed, "class=\"observed\"", &format!("keyframe {keyframe}, {name}, observed"))?;
        Ok(Self { name, keyframe, pair, errors: String::new(), captions: String::new() })
    }

    /// Adds a row's prediction and its error, or that there is none.
    fn push(&mut self, row: usize, label: &str, pictures: Option<[Raster<[u8; 3]>; 2]>, psnr: Option<f64>) -> Result<()> {
        let (name, keyframe) = (self.name, self.keyframe);
        // Without the script the first row is seen.
        let hidden = if row == 0 { "" } else { " hidden=\"hidden\"" };
        let Some([predicted, error]) = pictures else {
            let _ = write!(self.captions, "<span data-row=\"{row}\"{hidden}>no prediction kept</span>");
            return Ok(());
        };
        let what = format!("keyframe {keyframe}, {name}, ");
        let attributes = format!("class=\"predicted\" data-row=\"{row}\"{hidden}");
        self.pair += &img(&predicted, &attributes, &format!("{what}predicted by {label}"))?;
        self.errors += &img(&error, &format!("data-row=\"{row}\"{hidden}"), &format!("{what}error of {label}"))?;
        let psnr = psnr.map_or(String::new(), |psnr| format!("PSNR {psnr:.1} dB"));
        let _ = write!(self.captions, "<span data-row=\"{row}\"{hidden}>{psnr}</span>");
        Ok(())
    }

    /// The figure with the slider, and that of the errors.
    fn figures(self) -> [String; 2] {
        let (name, keyframe) = (self.name, self.keyframe);
        let label = format!("keyframe {keyframe}, {name}: observed left of the handle, predicted right of it");
        let slider = format!("<input type=\"range\" min=\"0\" max=\"100\" value=\"50\" aria-label=\"{label}\"/>");
        [
            format!(
                "<figure class=\"pair\"><div class=\"over\">{}{slider}</div><figcaption><span>{name}: observed | predicted</span>{}</figcaption></figure>",
                self.pair, self.captions
            ),
            format!("<figure class=\"error\"><div>{}</div><figcaption>{name}: error</figcaption></figure>", self.errors),
        ]
    }
}

/// The metrics of a row's kept predictions: those of the first seed.
fn frames_of<'a>(report: &'a Report<'_>, label: &str) -> &'a [FrameMetrics] {
    let first = report.plan.seeds.first();
    let record = report.records.iter().find(|r| r.row == label && Some(&r.seed) == first);
    match record.map(|r| &r.outcome) {
        Some(Outcome::Done(numbers)) => &numbers.frames,
        _ => &[],
    }
}

/// A keyframe with the first `rows` rows' predictions, its pictures `share` hundredths as wide as they are kept. A half that was not observed is
/// not shown.
fn keyframe(report: &Report<'_>, observed: &Observed, rows: usize, share: usize) -> Result<String> {
    let widths = |width: usize| {
        let columns = (width * share / 100).max(1);
        [columns, (columns * ERROR_SHARE / 100).max(1)]
    };
    let frame = |label: &str| frames_of(report, label).iter().find(|f| f.index == observed.index);
    let rows = report.plan.rows.iter().map(|r| r.label.as_str()).enumerate().take(rows);
    let kept: Vec<_> = rows
        .map(|(row, label)| (row, label, predictions::load(&row_folder(report.predictions, label), observed.index)))
        .collect();
    let ([mut light, mut light_error], [mut radio, mut radio_error]) = <([String; 2], [String; 2])>::default();
    if let Some(truth) = &observed.image {
        let [columns, error_columns] = widths(truth.width());
        let mut half = Half::new("image", observed.index, &shrunk_image(truth, columns))?;
        for (row, label, kept) in &kept {
            let pictures = kept.as_ref().and_then(|kept| kept.image.as_ref()).map(|image| {
                let error = image_error(truth, image);
                [shrunk_image(image, columns), shrunk_image(&error, error_columns)]
            });
            half.push(*row, label, pictures, frame(label).and_then(|f| Some(f.light?.psnr_opt)))?;
        }
        [light, light_error] = half.figures();
    }
    if let Some(ObservedRadio { scalar: truth, range, .. }) = &observed.radio {
        let [columns, error_columns] = widths(truth.width());
        let mut half = Half::new("spectrum", observed.index, &jet_image(&shrunk_scalar(truth, columns)))?;
        for (row, label, kept) in &kept {
            let pictures = kept.as_ref().and_then(|kept| kept.scalar.as_ref()).map(|scalar| {
                let error = spectrum_error(truth, scalar, range);
                [jet_image(&shrunk_scalar(scalar, columns)), shrunk_image(&error, error_columns)]
            });
            half.push(*row, label, pictures, frame(label).and_then(|f| Some(f.spectrum?.psnr_rf_scalar)))?;
        }
        [radio, radio_error] = half.figures();
    }
    let number = observed.index + 1;
    Ok(format!(
        "<article id=\"keyframe-{number}\"><h3>keyframe {number}</h3><div class=\"pictures\">{light}{radio}{light_error}{radio_error}</div></article>"
    ))
}

/// All keyframes; `None` where they take more bytes than a page may have.
fn keyframes(report: &Report<'_>, observations: &Observations, rows: usize, share: usize) -> Result<Option<String>> {
    let mut out = String::new();
    for observed in &observations.0 {
        out += &keyframe(report, observed, rows, share)?;
        if out.len() > MOST_BYTES {
            return Ok(None);
        }
    }
    Ok(Some(out))
}

/// Every held-out keyframe as the chosen row predicts it. Pictures are made narrower until all fit into a page; where even the narrowest do
/// not, rows are left out from the end, and it is said.
///
/// # Errors
/// A picture that cannot be encoded.
pub(super) fn section(report: &Report<'_>, observations: &Observations) -> Result<String> {
    let all = report.plan.rows.len();
    let tries = SHARES.iter().map(|&share| (all, share));
    let fewer =
        std::iter::successors(Some(all / 2), |n| Some(n / 2)).take_while(|n| *n > 0).map(|rows| (rows, SHARES[SHARES.len() - 1]));
    for (rows, share) in tries.chain(fewer) {
        let Some(pictures) = keyframes(report, observations, rows, share)? else { continue };
        let options: String = (report.plan.rows.iter().take(rows).enumerate())
            .map(|(i, row)| format!("<option value=\"{i}\">{}</option>", escape(&row.label)))
            .collect();
        let left_out = if rows < all {
            format!(" Of {all} rows the pictures of the first {rows} are shown: more would not fit into one page.")
        } else {
            String::new()
        };
        return Ok(format!(
            "<p class=\"note\">All {} held-out keyframes, of each row's first seed; spectra share one range of decibels. The slider parts what was \
             observed (left) from what was predicted (right): drag it, or focus it and use the arrow keys. Pictures are at most {} and {} columns \
             wide, and errors are taken at that size; the numbers are of the full size.{left_out}</p>\
             <div class=\"choose\"><label for=\"row\">predicted by</label> <select id=\"row\">{options}</select></div>{}{pictures}",
            observations.0.len(),
            IMAGE_COLUMNS * share / 100,
            SPECTRUM_COLUMNS * share / 100,
            bars(&report.dataset.db_range().unwrap_or(FieldMeta::RANGE_WITHOUT_RADIO))
        ));
    }
    Ok("<p class=\"note\">The pictures would not fit into one page; the folder predictions holds them.</p>".to_owned())
}

/// The held-out keyframe that receives the most, as every row predicts its spectrum: there is the most to get wrong.
///
/// # Errors
/// A picture that cannot be encoded.
pub(super) fn gallery(report: &Report<'_>, observations: &Observations) -> Result<String> {
    let radio = observations.0.iter().filter_map(|o| Some((o, o.radio.as_ref()?)));
    let Some((observed, radio)) = radio.max_by(|a, b| a.1.power.total_cmp(&b.1.power)) else { return Ok(String::new()) };
    let figure = |scalar: &Raster<f32>, caption: &str| -> Result<String> {
        let picture = img(&jet_image(&shrunk_scalar(scalar, GALLERY_COLUMNS)), "", &format!("spectrum, {caption}"))?;
        Ok(format!("<figure>{picture}<figcaption>{}</figcaption></figure>", escape(caption)))
    };
    let number = observed.index + 1;
    let mut out = format!("<p class=\"note\">Keyframe {number}, the one that receives the most.</p><div class=\"gallery\">");
    out += &figure(&radio.scalar, "observed")?;
    for row in &report.plan.rows {
        let kept = predictions::load(&row_folder(report.predictions, &row.label), observed.index);
        if let Some(scalar) = kept.and_then(|k| k.scalar) {
            out += &figure(&scalar, &row.label)?;
        }
    }
    write!(out, "</div><div class=\"bars\">{}</div>", jet_bar(&radio.range))?;
    Ok(out)
}
