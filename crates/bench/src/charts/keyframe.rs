//! Figures of keyframes: a spectrum, a prediction, or an observation beside its prediction and the error.

use super::panels::{Bar, Panel, figure};
use super::{ColourMap, ERROR_DB, ERROR_LIGHT, Scale, diverging, heat, image_error, spectrum_error};
use crate::metrics::Halves;
use crate::metrics::peaks::{self, Peak};
use crate::record::predictions::{shrunk, shrunk_image, shrunk_scalar};
use anyhow::{Context, Result, ensure};
use corf_raytrace::spectrum::Grid;
use corf_scene::color::quantize8;
use corf_scene::dataset::{Dataset, Quantity};
use corf_scene::keyframe::DbRange;
use corf_scene::{Keyframe, Pinhole, Raster};

/// Most columns of a picture in a figure: twice as many as it is wide.
const COLUMNS: usize = 720;

/// What keyframes were taken with.
#[derive(Clone, Copy, Debug)]
pub struct Sensors {
    /// Camera of images.
    pub light: Pinhole,
    /// Camera of spectra.
    pub radio: Pinhole,
    /// The range of spectra; none of a data set without any.
    pub range: Option<DbRange>,
    /// What a spectrum's value is.
    pub quantity: Quantity,
}

impl Sensors {
    /// Those of a data set.
    pub fn of(dataset: &Dataset) -> Self {
        Self {
            light: dataset.light_camera(),
            radio: dataset.radio_camera(),
            range: dataset.db_range(),
            quantity: dataset.header().quantity,
        }
    }
}

/// The unit of a spectrum's levels.
fn unit(quantity: Quantity) -> String {
    match quantity {
        Quantity::PowerPerSteradian => format!("dB re {}", quantity.unit()),
        Quantity::BeamPower | Quantity::CaponPower | Quantity::Unknown => "dB".to_owned(),
    }
}

/// The bar of levels.
fn levels(range: &DbRange, quantity: Quantity, map: ColourMap) -> Result<Bar> {
    let values = Scale::linear(range.min_db, range.max_db)?;
    Ok(Bar { colour: Box::new(move |t| map.colour(t)), values, unit: unit(quantity) })
}

fn spectrum_panel<'a>(
    name: &str,
    scalar: &Raster<f32>,
    grid: Grid,
    (range, quantity): (&DbRange, Quantity),
    map: ColourMap,
    peaks: &'a [Peak],
) -> Result<Panel<'a>> {
    let picture = map.picture(&shrunk_scalar(scalar, COLUMNS));
    Ok(Panel { name: name.to_owned(), picture, grid, bar: Some(levels(range, quantity, map)?), peaks })
}

fn image_panel<'a>(name: &str, picture: Raster<[u8; 3]>, camera: Pinhole) -> Panel<'a> {
    Panel { name: name.to_owned(), picture, grid: Grid::Pinhole(camera), bar: None, peaks: &[] }
}

/// The figure of one spectrum of linear power on a grid of directions, with its peaks.
///
/// # Errors
/// Directions or levels that no axis holds.
pub fn spectrum(
    [title, line]: [&str; 2],
    image: &Raster<f32>,
    grid: Grid,
    (range, quantity): (&DbRange, Quantity),
    map: ColourMap,
) -> Result<String> {
    let scalar = image.map(|&linear| range.scalar(linear));
    let peaks = peaks::find(&scalar, &grid, range);
    figure(title, line, &[vec![spectrum_panel("", &scalar, grid, (range, quantity), map, &peaks)?]])
}

/// The figure of a prediction: image and spectrum, as far as there are some.
///
/// # Errors
/// A prediction of neither; directions or levels that no axis holds.
pub fn prediction(title: &str, predicted: Halves<'_>, sensors: &Sensors, map: ColourMap) -> Result<String> {
    let radio = predicted.spectrum.zip(sensors.range);
    let grid = Grid::Pinhole(sensors.radio);
    let peaks = radio.map(|(spectrum, range)| peaks::find(spectrum.scalar, &grid, &range)).unwrap_or_default();
    let mut row = Vec::new();
    if let Some(image) = predicted.image {
        row.push(image_panel("image", shrunk(image, COLUMNS).map(|p| p.map(quantize8)), sensors.light));
    }
    if let Some((spectrum, range)) = radio {
        row.push(spectrum_panel("spectrum", spectrum.scalar, grid, (&range, sensors.quantity), map, &peaks)?);
    }
    ensure!(!row.is_empty(), "there is neither an image nor a spectrum to draw");
    figure(title, "", &[row])
}

/// The figure of a keyframe beside what is predicted of it: observed, predicted and the error of image and spectrum, each with a scale of its own.
/// A half that was not observed, or is not predicted, is not there.
///
/// # Errors
/// Neither half; directions or levels that no axis holds.
pub fn keyframe(title: &str, truth: &Keyframe, predicted: Halves<'_>, sensors: &Sensors, map: ColourMap) -> Result<String> {
    let mut rows = Vec::new();
    if let Some((light, image)) = truth.light.as_ref().zip(predicted.image) {
        let observed = shrunk_image(&light.image, COLUMNS);
        let predicted = shrunk(image, COLUMNS).map(|p| p.map(quantize8));
        let error = Panel {
            name: "image, mean absolute error".to_owned(),
            bar: Some(Bar {
                colour: Box::new(|t| heat(t as f32)),
                values: Scale::linear(0.0, 100.0 * f64::from(ERROR_LIGHT))?,
                unit: "% of full scale".to_owned(),
            }),
            ..image_panel("", image_error(&observed, &predicted), sensors.light)
        };
        rows.push(vec![
            image_panel("image, observed", observed, sensors.light),
            image_panel("image, predicted", predicted, sensors.light),
            error,
        ]);
    }
    let grid = Grid::Pinhole(sensors.radio);
    let radio = truth.radio.as_ref().zip(predicted.spectrum).zip(sensors.range);
    let scalars = radio.map(|((radio, spectrum), range)| (radio.spectrum.map(|&s| range.scalar(s)), spectrum.scalar, range));
    let peaks = scalars
        .as_ref()
        .map(|(observed, predicted, range)| [peaks::find(observed, &grid, range), peaks::find(predicted, &grid, range)]);
    if let Some(((observed, predicted, range), [of_observed, of_predicted])) = scalars.as_ref().zip(peaks.as_ref()) {
        let of = (range, sensors.quantity);
        let error = Panel {
            name: "spectrum, predicted − observed".to_owned(),
            bar: Some(Bar {
                colour: Box::new(|t| diverging(2.0 * t as f32 - 1.0)),
                values: Scale::linear(f64::from(-ERROR_DB), f64::from(ERROR_DB))?,
                unit: "dB".to_owned(),
            }),
            ..image_panel("", spectrum_error(&shrunk_scalar(observed, COLUMNS), predicted, range), sensors.radio)
        };
        rows.push(vec![
            spectrum_panel("spectrum, observed", observed, grid, of, map, of_observed)?,
            spectrum_panel("spectrum, predicted", predicted, grid, of, map, of_predicted)?,
            error,
        ]);
    }
    ensure!(!rows.is_empty(), "nothing was both observed and predicted that could be drawn");
    figure(title, "", &rows)
}

/// The figure of a predicted spectrum, levels in `[0, 1]`, beside the standard deviation of its decibels and their absolute error, on one scale.
///
/// # Errors
/// A data set without spectra; directions or levels that no axis holds.
pub fn uncertainty(
    title: &str,
    predicted: &Raster<f32>,
    [deviation_db, error_db]: [&Raster<f32>; 2],
    sensors: &Sensors,
    map: ColourMap,
) -> Result<String> {
    let range = sensors.range.context("there are no spectra to draw")?;
    let grid = Grid::Pinhole(sensors.radio);
    let peaks = peaks::find(predicted, &grid, &range);
    let decibels = |name: &str, db: &Raster<f32>| -> Result<Panel<'static>> {
        let shares = shrunk_scalar(&db.map(|v| (v / ERROR_DB).clamp(0.0, 1.0)), COLUMNS);
        Ok(Panel {
            name: name.to_owned(),
            picture: shares.map(|&t| heat(t)),
            grid,
            bar: Some(Bar {
                colour: Box::new(|t| heat(t as f32)),
                values: Scale::linear(0.0, f64::from(ERROR_DB))?,
                unit: "dB".to_owned(),
            }),
            peaks: &[],
        })
    };
    let row = vec![
        spectrum_panel("spectrum, predicted", predicted, grid, (&range, sensors.quantity), map, &peaks)?,
        decibels("standard deviation", deviation_db)?,
        decibels("absolute error", error_db)?,
    ];
    figure(title, "", &[row])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::Prediction;
    use corf_scene::{Light, Radio, Rigid3};

    const RANGE: DbRange = DbRange { min_db: -110.0, max_db: -40.0 };

    fn sensors() -> Sensors {
        let camera = Pinhole::from_horizontal_fov(48, 32, 90.0);
        Sensors { light: camera, radio: camera, range: Some(RANGE), quantity: Quantity::PowerPerSteradian }
    }

    fn observed() -> Keyframe {
        let spectrum = Raster::from_fn(48, 32, |x, y| {
            (1e-6 * (-0.5 * ((x as f64 - 30.0).powi(2) + (y as f64 - 12.0).powi(2)) / 4.0).exp()) as f32
        });
        Keyframe {
            index: 8,
            time_s: 0.0,
            world_from_camera: Rigid3::IDENTITY,
            light: Some(Light::of_image(Raster::filled(48, 32, [100; 3]))),
            radio: Some(Radio { spectrum }),
        }
    }

    #[test]
    fn a_keyframe_has_six_panels_with_a_scale_each_where_colours_mean_numbers() {
        let truth = observed();
        let predicted = Prediction::from_scalar(Some(Raster::filled(48, 32, [0.5; 3])), Raster::filled(48, 32, 0.4));
        let svg = keyframe("keyframe 9", &truth, predicted.halves(), &sensors(), ColourMap::Perceptual).unwrap();
        assert_eq!(svg.matches("<image ").count(), 6);
        for (text, count) in [("dB re 1/sr", 2), ("% of full scale", 1), ("dB", 1), ("azimuth, °", 6), ("image, predicted", 1)] {
            assert_eq!(svg.matches(&format!(">{text}</text>")).count(), count, "{text}: {svg}");
        }
        // The peak of the observation is where its power is, and stands in words under it.
        assert!(svg.contains(">1: azimuth −15.2°, elevation 8.0°, −60.0 dB</text>"), "{svg}");
        let radio = Halves { image: None, ..predicted.halves() };
        assert_eq!(keyframe("k", &truth, radio, &sensors(), ColourMap::Jet).unwrap().matches("<image ").count(), 3);
        let nothing = Halves { image: None, spectrum: None };
        assert!(keyframe("k", &truth, nothing, &sensors(), ColourMap::Jet).is_err());
        assert!(prediction("k", nothing, &sensors(), ColourMap::Jet).is_err());
        assert_eq!(prediction("k", predicted.halves(), &sensors(), ColourMap::Jet).unwrap().matches("<image ").count(), 2);
    }

    #[test]
    fn a_spectrum_without_power_and_one_of_the_sphere_are_drawn() {
        let grid = Grid::Sphere(corf_scene::Equirectangular { width: 36, height: 18 });
        let of = (&RANGE, Quantity::BeamPower);
        let svg = spectrum(["none", "line"], &Raster::filled(36, 18, 0.0), grid, of, ColourMap::Perceptual).unwrap();
        assert!(svg.contains(">dB</text>") && !svg.contains("<circle") && svg.contains(">135</text>"), "{svg}");
    }
}
