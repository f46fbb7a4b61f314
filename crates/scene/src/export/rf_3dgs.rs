//! A data set of light and radio as one folder for RF-3DGS: images, spectra as Jet pictures, and one COLMAP model for both.
//!
//! ```text
//! images/00001.png     8-bit sRGB
//! spectrum/00001.png   Jet, 8 bits, over the data set's range of decibels
//! sparse/0/{cameras,images,points3D}.txt, train_index.txt, test_index.txt
//! ```
//!
//! RF-3DGS trains first on `images/`, then with `--images spectrum` on the spectra. It has one camera for both, that of the model, and takes from it
//! the field of view alone: pictures may have any number of pixels, but they must show one frame. Spectra of a data set often show more above and
//! below than its images; they are then resampled to the images' frame, bilinearly in linear power, at their own number of columns. Nothing else may
//! be lost: where the images show more than the spectra, the export is refused, and RF-3DGS is to be given the folders `optical/` and `rf/`.

use super::{File, FolderExport};
use crate::dataset::{Dataset, stem};
use crate::keyframe::DbRange;
use crate::{Error, Finding, Pinhole, Radio, Raster, Result, Severity, io};

/// Difference of two frames, in pixels of the spectrum, that is rounding.
const SAME_FRAME_PX: f64 = 1e-6;

/// The export of a data set.
#[derive(Debug)]
pub struct Rf3dgsExport<'d> {
    dataset: &'d Dataset,
    range: DbRange,
    camera: Pinhole,
    resampled: bool,
    whole: Vec<File>,
}

impl<'d> Rf3dgsExport<'d> {
    /// Prepares the export.
    ///
    /// # Errors
    /// A data set without images or without spectra; images that show more than the spectra; files that cannot be read.
    pub fn new(dataset: &'d Dataset) -> Result<Self> {
        let place = || dataset.dir().display().to_string();
        let (true, Some(range)) = (dataset.modalities().light, dataset.db_range()) else { return Err(not_both(dataset)) };
        let (light, radio) = (dataset.light_camera(), dataset.radio_camera());
        let camera = in_frame_of(&light, &radio);
        let corners = [(0.0, 0.0), (camera.width as f64, camera.height as f64)];
        let seen = corners.map(|(x, y)| {
            let ray = camera.unproject(x, y);
            [radio.fx * ray.x + radio.cx, radio.fy * ray.y + radio.cy]
        });
        let inside = seen.iter().all(|[x, y]| {
            (-SAME_FRAME_PX..=radio.width as f64 + SAME_FRAME_PX).contains(x)
                && (-SAME_FRAME_PX..=radio.height as f64 + SAME_FRAME_PX).contains(y)
        });
        if !inside {
            let what = "the images show directions of which the spectra know nothing, and RF-3DGS has one camera for both";
            let help = "give RF-3DGS the folders optical/ and rf/ of the data set, which it opens as they are";
            return Err(Error::invalid(place(), what, help));
        }
        let size = [radio.width as f64, radio.height as f64];
        let off = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        let resampled = camera.height != radio.height || off(seen[0], [0.0; 2]).max(off(seen[1], size)) > SAME_FRAME_PX;
        let whole = ["sparse/0/cameras.txt", "sparse/0/images.txt", "sparse/0/points3D.txt", "train_index.txt", "test_index.txt"]
            .into_iter()
            .map(|name| Ok((name.to_owned(), io::read(dataset.dir().join("optical").join(name))?)))
            .collect::<Result<_>>()?;
        Ok(Self { dataset, range, camera, resampled, whole })
    }
}

impl FolderExport for Rf3dgsExport<'_> {
    fn keyframe(&self, index: usize) -> Result<Vec<File>> {
        let keyframe = self.dataset.keyframe(index)?;
        let (Some(light), Some(Radio { spectrum })) = (keyframe.light, keyframe.radio) else {
            return Err(not_both(self.dataset));
        };
        let resampled = self.resampled.then(|| resample(&spectrum, &self.dataset.radio_camera(), &self.camera));
        let jet = self.range.jet_image(resampled.as_ref().unwrap_or(&spectrum));
        Ok(vec![
            (format!("images/{}.png", stem(index)), io::encode_png(&light.image)?),
            (format!("spectrum/{}.png", stem(index)), io::encode_png(&jet)?),
        ])
    }

    fn whole(&self) -> Vec<File> {
        self.whole.clone()
    }

    fn findings(&self) -> Vec<Finding> {
        let (radio, c) = (self.dataset.radio_camera(), &self.camera);
        let what =
            format!("resampled from {}x{} to {}x{} pixels, the frame of images/", radio.width, radio.height, c.width, c.height);
        let help = "the data set's own folder rf/ has them as they are; RF-3DGS opens it as well";
        let finding = Finding::new(Severity::Note, "spectrum/", what, help);
        self.resampled.then_some(finding).into_iter().collect()
    }
}

fn not_both(dataset: &Dataset) -> Error {
    let help = "RF-3DGS opens the folder that there is, optical/ or rf/, as it is";
    Error::invalid(dataset.dir().display().to_string(), "the data set has not both images and spectra", help)
}

/// The camera that shows what `frame` shows, with as many columns as `rf` and pixels about square.
fn in_frame_of(frame: &Pinhole, radio: &Pinhole) -> Pinhole {
    let x = radio.width as f64 / frame.width as f64;
    let height = ((frame.height as f64 * x * frame.fx / frame.fy).round() as usize).max(1);
    let y = height as f64 / frame.height as f64;
    Pinhole { width: radio.width, height, fx: x * frame.fx, fy: y * frame.fy, cx: x * frame.cx, cy: y * frame.cy }
}

/// Linear power at the centres of the pixels of `to`, bilinear between the centres of those of `from`; at its border their own.
fn resample(spectrum: &Raster<f32>, from: &Pinhole, to: &Pinhole) -> Raster<f32> {
    let mut out = Raster::filled(to.width, to.height, 0.0);
    let last = [spectrum.width() - 1, spectrum.height() - 1];
    for y in 0..to.height {
        for x in 0..to.width {
            let ray = to.unproject(x as f64 + 0.5, y as f64 + 0.5);
            let at = [from.fx * ray.x + from.cx - 0.5, from.fy * ray.y + from.cy - 0.5];
            let at = [0, 1].map(|k| at[k].clamp(0.0, last[k] as f64));
            let near = at.map(|v| v.floor() as usize);
            let share = [0, 1].map(|k| at[k] - near[k] as f64);
            let far = [0, 1].map(|k| (near[k] + 1).min(last[k]));
            let value = |x: usize, y: usize| f64::from(spectrum[(x, y)]);
            let row = |y: usize| (1.0 - share[0]) * value(near[0], y) + share[0] * value(far[0], y);
            out[(x, y)] = ((1.0 - share[1]) * row(near[1]) + share[1] * row(far[1])) as f32;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const RADIO: Pinhole = Pinhole { width: 48, height: 32, fx: 24.0, fy: 24.0, cx: 24.0, cy: 16.0 };

    #[test]
    fn the_frame_of_the_images_is_kept_in_the_columns_of_the_spectra() {
        let wide = Pinhole { width: 1600, height: 900, fx: 800.0, fy: 800.0, cx: 800.0, cy: 450.0 };
        let camera = in_frame_of(&wide, &RADIO);
        assert_eq!((camera.width, camera.height, camera.fx, camera.cx, camera.cy), (48, 27, 24.0, 24.0, 13.5));
        assert_eq!(in_frame_of(&RADIO, &RADIO), RADIO);
        // Pixels that are not square stay in the frame.
        let tall = Pinhole { fy: 400.0, ..wide };
        assert_eq!(in_frame_of(&tall, &RADIO).height, 54);
    }

    #[test]
    fn a_plane_of_power_is_resampled_to_itself() {
        // Linear in the picture plane, so linear between pixels.
        let plane = |camera: &Pinhole, x: usize, y: usize| {
            let ray = camera.unproject(x as f64 + 0.5, y as f64 + 0.5);
            3.0 + ray.x - 2.0 * ray.y
        };
        let mut spectrum = Raster::filled(RADIO.width, RADIO.height, 0.0);
        for y in 0..RADIO.height {
            for x in 0..RADIO.width {
                spectrum[(x, y)] = plane(&RADIO, x, y) as f32;
            }
        }
        let to = Pinhole { width: 40, height: 20, fx: 24.0, fy: 24.0, cx: 19.0, cy: 11.0 };
        let out = resample(&spectrum, &RADIO, &to);
        for y in 0..to.height {
            for x in 0..to.width {
                assert!((f64::from(out[(x, y)]) - plane(&to, x, y)).abs() < 1e-6, "{x} {y}");
            }
        }
    }
}
