//! Conventions of a capture that was imported: what its maker said of it, what was done to it, and what is not known.

use super::{Topic, cameras, frames};
use crate::config::{RearHalfSpace, SpectrumKind};
use crate::dataset::header::{DatasetHeader, Imported, Quantity, StatedSensor};
use crate::keyframe::DbRange;

/// Topics of an imported data set.
pub(super) fn topics(header: &DatasetHeader, imported: &Imported, range: Option<&DbRange>) -> [Topic; 7] {
    [
        ("frames", world(imported)),
        ("cameras", cameras(header)),
        ("import", import(imported)),
        ("optical", light(header)),
        ("spectrum", spectrum(header)),
        ("rf_image", radio_image(range)),
        ("sampling", sampling(header)),
    ]
}

fn world(imported: &Imported) -> Vec<(&'static str, String)> {
    let turned = match imported.up {
        Some([x, y, z]) => format!("the capture's frame, turned so that its direction ({x}, {y}, {z}) is up"),
        None => "the capture's frame, which was taken to be z-up".into(),
    };
    let scale = format!("one unit of the capture was taken for {} m", imported.metres_per_unit);
    let moved = match imported.offset_m {
        Some([x, y, z]) => format!("; ({x}, {y}, {z}) m was taken off all positions then (header.imported.offset_m)"),
        None => String::new(),
    };
    let mut list = frames();
    list.retain(|(question, _)| *question != "world");
    list.insert(0, ("world", format!("right-handed, z up, metres: {turned}; {scale}{moved}")));
    if imported.world_from_capture.is_some() {
        let change = "x_world = scale * rotation * x_capture + translation_m, of header.imported.world_from_capture";
        list.insert(1, ("capture", change.into()));
    }
    list
}

fn import(imported: &Imported) -> Vec<(&'static str, String)> {
    vec![
        (
            "from",
            format!("a capture in the layout {}; header.imported.sources lists what was read with its SHA-256", imported.format),
        ),
        (
            "keyframes",
            "in the order of their file names (numbers in them by their value); header.imported.names has the names".into(),
        ),
        ("time", "index along the capture: no clock is known".into()),
        ("changes", if imported.notes.is_empty() { "none".into() } else { imported.notes.join("; ") }),
    ]
}

fn light(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    if !header.modalities.light {
        return vec![(
            "image",
            "there are none: the Jet picture of the spectrum guides growth, and no metric of images is computed".into(),
        )];
    }
    vec![
        ("image", "8-bit sRGB as in the capture; its exposure and tone curve are not known".into()),
        (
            "depth",
            "where there is any: z-depth (along the optical axis, not along the ray), metres, float32, channel Z, as measured"
                .into(),
        ),
        ("depth_empty", "0 where nothing was measured".into()),
    ]
}

fn spectrum(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    if !header.modalities.radio {
        return vec![("value", "there are none: radio is not trained, and no metric of spectra is computed".into())];
    }
    let value = match header.quantity {
        Quantity::PowerPerSteradian => "linear received power per steradian, as its maker states",
        Quantity::BeamPower => "linear output power of a beam steered at the pixel, as its maker states",
        Quantity::CaponPower => "linear power that Capon's beamformer estimates from the pixel's direction, as its maker states",
        Quantity::Unknown => "linear power in a unit that is not known",
    };
    let carrier = header.frequency_hz.map_or("unknown".into(), |f| format!("{f} Hz"));
    let mut list = vec![
        ("value", value.into()),
        ("unit", format!("{} (linear; dB and Jet are views of it)", header.quantity.unit())),
        ("file", "rf/spectra: EXR, float32, one channel Y, lossless; the unit is the file's attribute `unit` as well".into()),
        ("empty_bin", "0".into()),
        ("carrier", carrier),
    ];
    if let Some(stated) = header.imported.as_ref().and_then(|imported| imported.sensor.as_ref()) {
        list.push(("sensor", sensor(header, stated)));
    }
    list
}

/// The sensor of the spectra, as it was stated.
fn sensor(header: &DatasetHeader, stated: &StatedSensor) -> String {
    let mut words = vec![header.spectrum.map_or("of an unknown kind", SpectrumKind::name).to_owned()];
    if let Some(rx) = header.receiver {
        let rear = match rx.rear {
            RearHalfSpace::Gated => "left out",
            RearHalfSpace::Aliased => "mirrored to the front",
        };
        let [between_columns, between_rows] = rx.spacing_wavelengths;
        words.push(format!(
            "{} rows x {} columns in the plane across the camera's axis, {between_columns} x {between_rows} wavelengths between columns x rows; {:?} elements; \
             arrivals from behind {rear}",
            rx.rows, rx.cols, rx.pattern
        ));
    }
    words.extend(stated.lobe_width_deg.map(|width| format!("lobes of {width} degrees of standard deviation per axis")));
    words.extend(
        stated.mvdr_loading.map(|loading| format!("a diagonal loading of {loading} of the covariance's mean eigenvalue")),
    );
    format!("{}, as its maker states ({})", words.join("; "), stated.stated_by.join(", "))
}

fn radio_image(range: Option<&DbRange>) -> Vec<(&'static str, String)> {
    let Some(range) = range else { return vec![("image", "there are none".into())] };
    vec![
        ("scalar", "(10 log10 S - min_db) / (max_db - min_db), clamped to [0, 1]; 0 where S is 0".into()),
        ("range", format!("one for the whole dataset, {} to {} dB", range.min_db, range.max_db)),
        (
            "image",
            "rf/images: the scalar's Jet colour, 8 bit, rounded to nearest, stored without a further transfer function".into(),
        ),
    ]
}

fn sampling(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    let split = match &header.stated_split {
        Some(_) => "test and training keyframes were stated one by one".to_owned(),
        None => format!("index from 0; test: index % {} == 0, train: the others", header.split.test_every),
    };
    vec![("split", split)]
}
