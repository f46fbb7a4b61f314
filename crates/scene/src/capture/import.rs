//! From a capture to a data set.

use super::options::CaptureOptions;
use super::plan::Plan;
use crate::dataset::beam_width::{self, Widths};
use crate::dataset::{DatasetWriter, Extras, KeyframeContent};
use crate::finding::{Finding, Severity};
use crate::words::{counted, verb};
use crate::{Error, Light, Radio, Raster, Result, io};
use rayon::prelude::*;
use std::path::Path;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Words about an import.
#[derive(Clone, Debug)]
pub struct CaptureReport {
    /// Changes and assumptions.
    pub notes: Vec<String>,
    /// Warnings: black images, empty depth.
    pub findings: Vec<Finding>,
}

/// Imports a capture into a folder, new or empty, as a data set. `tell(done, all)` is called from several threads, and may end it with an error.
///
/// # Errors
/// A capture that cannot be read, or that leaves open what only its maker knows: the message says which option settles it. What was
/// written until then is left to the caller to remove.
pub fn import<E: From<Error> + Send>(
    options: &CaptureOptions,
    out: &Path,
    report: &(dyn Fn(usize, usize) -> std::result::Result<(), E> + Sync),
) -> std::result::Result<CaptureReport, E> {
    let plan = Plan::of(options)?;
    let writer = DatasetWriter::create(out, &plan.header, false)?;
    let (done, all, left_out) = (AtomicUsize::new(0), plan.shots.len(), LeftOut::default());
    let widths: Vec<OnceLock<Widths>> = vec![OnceLock::new(); all];
    (0..all).into_par_iter().try_for_each(|i| {
        let frame = frame(&plan, i, options)?;
        left_out.count(frame.light.as_ref().and_then(|light| light.mask.as_ref()));
        if let Some(radio) = &frame.radio {
            widths[i].get_or_init(|| beam_width::of(&radio.spectrum, &plan.header.radio_camera));
        }
        writer.write_frame(i, &frame)?;
        report(done.fetch_add(1, Ordering::Relaxed) + 1, all)
    })?;
    let mut findings = writer.dark_findings()?;
    findings.extend(left_out.finding());
    let widths: Vec<Widths> = widths.into_iter().filter_map(OnceLock::into_inner).collect();
    findings.extend(beam_width::findings("spectra", &plan.header, &widths));
    writer.finish_with_points(&plan.points)?;
    let mut notes = plan.header.imported.map(|i| i.notes).unwrap_or_default();
    notes.extend(left_out.note());
    Ok(CaptureReport { notes, findings })
}

/// What masks leave out, counted by several threads.
#[derive(Default)]
struct LeftOut {
    masks: AtomicUsize,
    pixels: AtomicUsize,
    of: AtomicUsize,
}

impl LeftOut {
    fn count(&self, mask: Option<&Raster<bool>>) {
        let Some(mask) = mask else { return };
        self.masks.fetch_add(1, Ordering::Relaxed);
        self.of.fetch_add(mask.pixels().len(), Ordering::Relaxed);
        self.pixels.fetch_add(mask.pixels().iter().filter(|counts| !**counts).count(), Ordering::Relaxed);
    }

    /// How much it is, where it is anything.
    fn note(&self) -> Option<String> {
        let [masks, pixels, of] = [&self.masks, &self.pixels, &self.of].map(|n| n.load(Ordering::Relaxed));
        (pixels > 0).then(|| {
            format!(
                "{:.1} % of the pixels of the {} with masks do not count",
                100.0 * pixels as f64 / of as f64,
                counted(masks, "image")
            )
        })
    }

    /// A warning of masks that leave nothing out.
    fn finding(&self) -> Option<Finding> {
        let [masks, pixels] = [&self.masks, &self.pixels].map(|n| n.load(Ordering::Relaxed));
        (masks > 0 && pixels == 0).then(|| {
            let what = format!("{} {} no pixel out", counted(masks, "mask"), verb(masks, "leaves", "leave"));
            Finding::new(
                Severity::Warning,
                "masks",
                what,
                "masks are black where a pixel does not count; white ones can be left away",
            )
        })
    }
}

/// Reads all of a capture as [`import`] does, and writes nothing; how many keyframes there are.
///
/// # Errors
/// Those of [`import`], but for what only writing can find.
pub fn examine(options: &CaptureOptions) -> Result<usize> {
    let plan = Plan::of(options)?;
    (0..plan.shots.len()).try_for_each(|i| frame(&plan, i, options).map(drop))?;
    Ok(plan.shots.len())
}

/// Everything of one keyframe.
fn frame(plan: &Plan, index: usize, options: &CaptureOptions) -> Result<KeyframeContent> {
    let header = &plan.header;
    let light = plan.shots[index].image.as_ref().map(|path| light(path, plan, index, options)).transpose()?;
    let radio = match (&plan.spectra, plan.encoding) {
        (Some(paths), Some(encoding)) => {
            let path = &paths[index];
            let spectrum = options.reading().read(path, encoding)?;
            let camera = &header.radio_camera;
            check_size(path, &spectrum, (camera.width, camera.height), "the first spectrum", "give spectra of one size")?;
            Some(Radio { spectrum })
        }
        _ => None,
    };
    Ok(KeyframeContent { light, radio, extras: Extras::default() })
}

/// An image with its depth and its mask, as the data set's camera sees them.
fn light(path: &Path, plan: &Plan, index: usize, options: &CaptureOptions) -> Result<Light> {
    let lens = &plan.shots[index].lens;
    let own = &lens.pinhole;
    let (image, opacity) = io::read_png_and_opacity(path)?;
    let help = "give the images that the cameras were made for";
    check_size(path, &image, (own.width, own.height), "the capture's camera", help)?;
    let image = lens.resample(&image, &plan.header.light_camera);
    let depth_m = plan.depths.as_ref().map(|depths| depth(&depths[index], plan, index, options)).transpose()?;
    let mask = mask(plan, index, opacity.filter(|_| !options.ignore_masks))?;
    Ok(Light { image, depth_m, surface: None, mask })
}

/// A depth map in metres, 0 where there is none, as the data set's camera sees it.
fn depth(path: &Path, plan: &Plan, index: usize, options: &CaptureOptions) -> Result<Raster<f32>> {
    let lens = &plan.shots[index].lens;
    let map = io::read_map(path, io::MapOf::Depth)?;
    let size = (lens.pinhole.width, lens.pinhole.height);
    check_size(path, &map.values, size, "the image's camera", "give depth of the images' size")?;
    let depth = map.into_depth_m(options.depth_unit_m, &path.display().to_string(), "--depth-unit")?;
    Ok(lens.resample_nearest(&depth, &plan.header.light_camera))
}

/// Which pixels of the data set's image count: those in which no pixel of the capture's image has a part that its mask leaves out or that is not
/// opaque; none where all do.
fn mask(plan: &Plan, index: usize, opaque: Option<Raster<bool>>) -> Result<Option<Raster<bool>>> {
    let lens = &plan.shots[index].lens;
    let stated = match &plan.masks[index] {
        None => None,
        Some(path) => {
            let mask = io::read_mask(path)?;
            let size = (lens.pinhole.width, lens.pinhole.height);
            check_size(path, &mask, size, "the image's camera", "give masks of the images' size")?;
            Some(mask)
        }
    };
    let counts = match (stated, opaque) {
        (Some(stated), Some(opaque)) => Raster::from_fn(stated.width(), stated.height(), |x, y| stated[(x, y)] && opaque[(x, y)]),
        (Some(one), None) | (None, Some(one)) => one,
        (None, None) => return Ok(None),
    };
    let picture = counts.map(|counts| [if *counts { u8::MAX } else { 0 }; 3]);
    Ok(Some(lens.resample(&picture, &plan.header.light_camera).map(|p| p[0] == u8::MAX)))
}

fn check_size<T>(path: &Path, raster: &Raster<T>, (width, height): (usize, usize), whose: &str, help: &str) -> Result<()> {
    if (raster.width(), raster.height()) == (width, height) {
        return Ok(());
    }
    let what = format!("is {}x{} pixels where {whose} has {width}x{height}", raster.width(), raster.height());
    Err(Error::invalid(path.display().to_string(), what, help))
}
