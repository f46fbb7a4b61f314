//! Conventions of a dataset (frames, units, encodings) in words: `dataset.json`'s `conventions`.

mod imported;

use super::header::{DatasetHeader, Quantity};
use crate::color::TONE_KNEE;
use crate::config::{DatasetConfig, LightMethod, RearHalfSpace, SpectrumKind};
use crate::keyframe::DbRange;
use std::collections::BTreeMap;

/// Topic → question → answer. Numbers are those of this dataset; where a machine should read them they stand in `header` as well.
pub type Conventions = BTreeMap<String, BTreeMap<String, String>>;

/// The axes of an [`crate::Equirectangular`] image.
pub const EQUIRECTANGULAR_AXES: &str = "equirectangular in the array frame; columns from azimuth +180 (left edge) to -180 degrees, rows from \
                                        elevation +90 (top) to -90 degrees, boresight in the middle, pixel centres at +0.5";

/// The conventions of the dataset that `header` describes and whose spectra, where there are some, were mapped to images over `range`.
pub(super) fn of(header: &DatasetHeader, range: Option<&DbRange>) -> Conventions {
    if let Some(imported) = &header.imported {
        return owned(imported::topics(header, imported, range).into());
    }
    let mut frames = frames();
    if let Some([x, y, z]) = header.offset_m() {
        let moved = format!(
            "right-handed, z up, metres; x and y as in the scene file, which takes ({x}, {y}, {z}) m off its mesh (header.scene.scene.offset_m)"
        );
        frames.iter_mut().filter(|(question, _)| *question == "world").for_each(|(_, answer)| answer.clone_from(&moved));
    }
    let Some(range) = range else { return owned(vec![("frames", frames), ("cameras", cameras(header))]) };
    let topics: [Topic; 10] = [
        ("frames", frames),
        ("angles", angles()),
        ("cameras", cameras(header)),
        ("optical", light(header)),
        ("spectrum", spectrum(header)),
        ("rf_image", radio_image(header, range)),
        ("antennas", antennas(header)),
        ("propagation", propagation(header)),
        ("sampling", sampling(header)),
        ("files", files(header)),
    ];
    owned(topics.into())
}

/// A topic, its questions and their answers.
type Topic = (&'static str, Vec<(&'static str, String)>);

fn owned(topics: Vec<Topic>) -> Conventions {
    let one = |(topic, answers): Topic| {
        (topic.to_string(), answers.into_iter().map(|(question, answer)| (question.to_string(), answer)).collect())
    };
    topics.into_iter().map(one).collect()
}

fn frames() -> Vec<(&'static str, String)> {
    vec![
        ("world", "right-handed, z up, metres; x and y as in the scene file".into()),
        ("camera", "OpenCV: x right, y down, z forward (optical axis)".into()),
        ("array", "boresight x = camera z, y = -camera x (left), z = -camera y (up); it turns with the camera".into()),
        ("pose", "world_from_camera: 4x4 by rows, maps camera coordinates to world coordinates, metres; time in seconds".into()),
        (
            "colmap",
            "sparse/0/images.txt holds the inverse, camera_from_world: qw qx qy qz tx ty tz, Hamilton quaternion, OpenCV axes"
                .into(),
        ),
        ("transforms_json", "camera-to-world in OpenGL axes (x right, y up, z backward); the world is not re-oriented".into()),
    ]
}

fn angles() -> Vec<(&'static str, String)> {
    vec![
        ("zenith", "theta in [0, pi] from +z, radians".into()),
        ("azimuth", "phi = atan2(y, x) in (-pi, pi], radians, counter-clockwise seen from +z".into()),
        (
            "arrival",
            "angles of arrival point from the receiver towards the last interaction (against propagation), world frame".into(),
        ),
        ("departure", "angles of departure point from the transmitter along propagation, world frame".into()),
        ("polarisation_basis", "theta^ = (cos t cos p, cos t sin p, -sin t), phi^ = k x theta^".into()),
    ]
}

fn cameras(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    let mut list = vec![
        ("projection", "pinhole without distortion, u = fx x/z + cx, v = fy y/z + cy, in optical/ and rf/ alike".into()),
        ("intrinsics", "pixels; (0, 0) is the outer corner of the top left pixel, pixel centres are at +0.5".into()),
        ("co_location", "the optical and the RF camera share position and axes; only their intrinsics differ".into()),
    ];
    if header.sphere.is_some() {
        list.push(("sphere", format!("rf/sphere: {EQUIRECTANGULAR_AXES}")));
    }
    list
}

fn light(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    let light = match header.config.as_ref().map(|c| c.light.method) {
        Some(LightMethod::Cached) => {
            "cached: what diffuse surfaces receive is worked out once at points in the world and interpolated between them, for all \
             keyframes; mirrors, highlights, glass and emitters are traced per pixel. Biased: contact shadows are blurred by up to the \
             spacing of those points (1 to 4 cm, more far away), very rough highlights are read off the received light, light that has \
             met a rough highlight sees textures averaged and no normal maps, pixels whose paths agree get fewer of them"
        }
        Some(LightMethod::Path) => "path: unbiased path tracing of every pixel by itself; what is off is noise",
        None => "unknown",
    };
    let light = match &header.light_adapter {
        Some(adapter) => format!("{light}; traced on the GPU {adapter}, which rounds otherwise than the processor does"),
        None => light.to_owned(),
    };
    let light = match &header.denoiser {
        Some(name) => {
            format!(
                "{light}, taken out by {name} with albedo and normals: biased, and on processors of another kind by other roundings"
            )
        }
        None => light,
    };
    vec![
        ("light", light),
        (
            "lamps",
            "a pixel's paths that see an emitter straight are developed apart from the others and mixed by their shares".into(),
        ),
        ("image", "8-bit sRGB (IEC 61966-2-1), exposed and developed alike in all keyframes".into()),
        (
            "exposure",
            format!(
                "x = radiance x 2^{}; linear up to the knee {knee}, above it highlights roll off as {knee} + {rest:.1} (1 - exp(-(x - \
                 {knee})/{rest:.1})); then the sRGB transfer function",
                header.exposure_ev.map_or("(unknown)".into(), |ev| ev.to_string()),
                knee = TONE_KNEE,
                rest = 1.0 - TONE_KNEE
            ),
        ),
        ("linear", "linear radiance, Rec. 709 primaries, float32, channels R G B, before exposure (where written)".into()),
        ("depth", "z-depth (along the optical axis, not along the ray), metres, float32, channel Z".into()),
        ("depth_empty", "0 where nothing was hit".into()),
        (
            "depth_png",
            "optical/depth_mm: the same depth in whole millimetres, 16 bit; 0 where nothing was hit or beyond 65.535 m (where written)".into(),
        ),
        (
            "guides",
            "optical/albedo: total reflectance, optical/normals: shading normal in the world frame, each of what the pixel sees first through \
             panes, mean over the pixel's paths (so normals are shorter than 1 across edges), EXR, float32, R G B (where written)"
                .into(),
        ),
        ("surface", "index into header.objects, uint32, channel id; 4294967295 where nothing was hit".into()),
    ]
}

fn spectrum(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    let radio = header.config.as_ref().map(|c| c.radio);
    let value = match header.quantity {
        Quantity::PowerPerSteradian => "linear received power per steradian, relative to 1 W transmitted",
        Quantity::BeamPower => "linear output power of a beam steered at the pixel, relative to 1 W transmitted",
        Quantity::CaponPower => {
            "linear power that Capon's beamformer estimates from the pixel's direction, relative to 1 W transmitted"
        }
        Quantity::Unknown => "linear power in a unit that is not known",
    };
    let bandwidth = radio.map_or("the bandwidth".into(), |radio| format!("{} Hz", radio.bandwidth_hz));
    let Some(kind) = header.spectrum else { return vec![("value", value.into())] };
    let (formed, phases) = match kind {
        SpectrumKind::Mpc => (
            format!(
                "mpc: every arrival's |a|^2 spread by a von Mises-Fisher lobe of standard deviation {} degrees per axis and unit integral \
                 over solid angle",
                radio.map_or("unknown".into(), |radio| radio.lobe_width_deg.to_string())
            ),
            "noncoherent: powers add".to_string(),
        ),
        SpectrumKind::Bartlett => (
            "bartlett: P(u) = sum_i |a_i|^2 |v(u)^H v(u_i)|^2 / N^2, N elements, uniform weights".into(),
            "noncoherent: the mean over the arrivals' phases".into(),
        ),
        SpectrumKind::BartlettCoherent => (
            format!("bartlett-coherent: P(u) = sum_l |v(u)^H x_l|^2 / N^2 over delay taps l of 1/({bandwidth})"),
            drawn_phases(header),
        ),
        SpectrumKind::Mvdr => (
            format!(
                "mvdr: P(u) = 1 / (v(u)^H R^-1 v(u)), R = sum_l x_l x_l^H + e tr(R)/N I over delay taps l of 1/({bandwidth}), e = {}",
                radio.map_or("unknown".into(), |radio| radio.mvdr_loading.to_string())
            ),
            drawn_phases(header),
        ),
    };
    vec![
        ("value", value.into()),
        ("unit", format!("{} (linear; dB and Jet are views of it)", header.quantity.unit())),
        ("formed", formed),
        ("phases", phases),
        ("evaluated", "at the direction of every pixel's centre; nothing is resampled".into()),
        ("file", "rf/spectra: EXR, float32, one channel Y, lossless; the unit is the file's attribute `unit` as well".into()),
        ("empty_bin", "0".into()),
        ("rear_half_space", rear(header)),
        (
            "share_in_frame",
            "rf_frames.share_in_frame: of all power that arrives at the receiver, the share from directions inside the RF frame"
                .into(),
        ),
    ]
}

fn drawn_phases(header: &DatasetHeader) -> String {
    format!(
        "resolved paths keep theirs; every diffuse arrival is given one, uniform in [0, 2 pi), keyed by seed {}, its direction, delay and \
         power",
        header.seed
    )
}

fn rear(header: &DatasetHeader) -> String {
    let rear = header.receiver.map(|receiver| receiver.rear);
    match (header.spectrum, rear) {
        (None, _) | (_, None) => "unknown".into(),
        (Some(SpectrumKind::Mpc), _) => "mpc knows where each arrival comes from; those from behind the camera are outside the frame".into(),
        (_, Some(RearHalfSpace::Gated)) => {
            "gated: a planar array cannot tell front from back, and arrivals from behind its plane are left out before the beam is formed"
                .into()
        }
        (_, Some(RearHalfSpace::Aliased)) => "aliased: arrivals from behind the array's plane appear mirrored in front of it".into(),
    }
}

fn radio_image(header: &DatasetHeader, range: &DbRange) -> Vec<(&'static str, String)> {
    let mut list = vec![
        ("scalar", "(10 log10 S - min_db) / (max_db - min_db), clamped to [0, 1]; 0 where S is 0".into()),
        (
            "range",
            format!(
                "one for the whole dataset, {} to {} dB: from the strongest pixel of all keyframes, rounded up to a whole decibel so that no \
                 peak is clipped, down by {} dB",
                range.min_db, range.max_db, header.dynamic_range_db
            ),
        ),
        ("image", "rf/images: the scalar's colour, 8 bit, rounded to nearest, stored without a further transfer function".into()),
        (
            "colormap",
            "jet: R 0-1 over .35-.66, hold to .89, .5 at 1; G 0-1 over .125-.375, hold to .64, 0 at .91; B .5-1 by .11, hold to .34, 0 at .65"
                .into(),
        ),
        ("db", "rf/db: 10 log10 S, EXR, float32, channel Y; empty bins hold min_db (where written)".into()),
    ];
    if let Some(tutorial) = &header.tutorial_range {
        list.push((
            "tutorial",
            format!(
                "rf-tutorial/images, for comparison with published sets only: |a| instead of |a|^2 summed on a 3 pixels/degree \
                 equirectangular grid with a 9x9 Gaussian of 1 degree, 10 log10, clipped to {:.2} to {:.2} dB as found at the first and the \
                 middle keyframe, Jet, then resampled bilinearly",
                tutorial.min_db, tutorial.max_db
            ),
        ));
    }
    list
}

fn antennas(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    let Some(rx) = &header.receiver else { return vec![("receiver_array", "unknown".into())] };
    let receiver_element = format!(
        "{:?} pattern, {:?} polarised, fixed to the array's axes; V is along theta^ of the antenna's own frame, H along phi^, cross is \
         -45 and +45 degrees from theta^ to phi^; powers add over a receiver's ports",
        rx.pattern, rx.polarization
    );
    let mut list = vec![
        (
            "receiver_array",
            format!(
                "{} rows x {} columns in the array's y-z plane, {} x {} wavelengths between columns x rows; element i = column*rows + row at \
                 y = (column - (columns-1)/2)*d_y, z = -(row - (rows-1)/2)*d_z",
                rx.rows, rx.cols, rx.spacing_wavelengths[0], rx.spacing_wavelengths[1]
            ),
        ),
        (
            "steering",
            match rx.pattern.elements() {
                None => "v_m(u) = exp(+j 2 pi p_m.u), p_m in wavelengths, u from the array towards the source; isotropic elements".into(),
                Some(_) => "v_m(u) = exp(+j 2 pi p_m.u), p_m in wavelengths, u from the array towards the source, by which beams are steered; element m receives \
                            a wave times h_m(u), its response in receiver.pattern over the root of the elements' mean gain"
                    .into(),
            },
        ),
        ("receiver_element", receiver_element),
        (
            "transmit_power",
            "1 W altogether (0 dBW): values are channel gains; shared by the ports, which send independent signals".into(),
        ),
    ];
    if let Some(tx) = &header.transmitter {
        let beam = if tx.rows * tx.cols > 1 {
            let direction = tx.beam.unwrap_or_default();
            format!(
                "{} rows x {} columns, {:?} wavelengths apart, equal amplitudes, phased towards azimuth {} and elevation {} degrees of their \
                 own frame; coupling neglected",
                tx.rows, tx.cols, tx.spacing_wavelengths, direction.azimuth_deg, direction.elevation_deg
            )
        } else {
            "one element".into()
        };
        list.push((
            "transmitter",
            format!(
                "fixed at {:?} m; {:?} pattern, {:?} polarised; R_z(yaw) R_y(pitch) R_x(roll) turns its boresight +x; {beam}",
                tx.position_m, tx.pattern, tx.polarization
            ),
        ));
    }
    list
}

fn propagation(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    let mut list = vec![
        ("carrier", header.frequency_hz.map_or("unknown".into(), |f| format!("{f} Hz"))),
        ("time", "e^{+j omega t}; permittivity e_r - j sigma/(omega e_0)".into()),
        (
            "coefficient",
            "h = sum a e^{-j 2 pi f tau}: a carries no propagation phase; line of sight V to V is +lambda/(4 pi d), real".into(),
        ),
        (
            "materials",
            "header.materials: every radio material in use with its source and its values at the carrier; slabs of finite thickness".into(),
        ),
    ];
    if let Some(DatasetConfig { radio, .. }) = &header.config {
        let on = |yes: bool| if yes { "yes" } else { "no" };
        list.push((
            "interactions",
            format!(
                "line of sight: yes; specular reflection: yes; straight transmission through slabs: {}; diffraction: {}; diffuse \
                 scattering: {}; at most {} interactions a path; header.config.rf has every setting",
                on(radio.transmission),
                if radio.diffraction { "at most one a path" } else { "no" },
                on(radio.diffuse),
                radio.max_interactions
            ),
        ));
    }
    list
}

fn sampling(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    let mut list = vec![
        ("positions", "one path set a position; every keyframe has its own position".into()),
        ("seeds", format!("{}; every draw is keyed by (seed, stage, item), whatever the number of threads", header.seed)),
        (
            "specular",
            "exact image method in float64: coefficients are not sampled, candidate chains of more than one face are found by a lattice of \
             rays on large scenes"
                .into(),
        ),
    ];
    if let Some(DatasetConfig { radio, .. }) = header.config.as_ref().filter(|c| c.radio.diffuse) {
        list.push((
            "diffuse",
            format!(
                "{} directions over the sphere at the receiver, more where they disagree; patches of {} m, {} photons for light of more than one interaction \
                 before the last scattering",
                radio.directions, radio.patch_size_m, radio.photons
            ),
        ));
    }
    if let Some(error) = &header.sampling_error {
        list.push((
            "standard_error",
            format!(
                "of the diffuse sampling, from two independent samplings at {} keyframes: total power {:.4} dB, pixels within 30 dB of a \
                 spectrum's peak {:.3} dB (rms)",
                error.keyframes, error.total_db, error.pixels_db
            ),
        ));
    }
    let split = &header.split;
    list.push((
        "split",
        format!(
            "index from 0 along the trajectory; test: index % {0} == 0, train: the others; validation: index % {0} == {1}, to be taken from the \
             training ones while constants are chosen; second split: split.held_out_segment against the rest",
            split.test_every,
            split.test_every / 2
        ),
    ));
    list
}

fn files(header: &DatasetHeader) -> Vec<(&'static str, String)> {
    let mut list = vec![
        (
            "names",
            "file stems count from 00001, indices from 0; files lists size and SHA-256 of every file but dataset.json".into(),
        ),
        ("written_by", "generator: tool and version; header.config and header.scene: the resolved configurations".into()),
    ];
    if header.config.as_ref().is_some_and(|c| c.radio.write_paths) {
        list.push((
            "paths",
            "rf/paths: gzip, one JSON object a line; a path has types and objects in TX to RX order, interactions as Sionna's flags (1 specular, \
             2 diffuse, 4 refraction, 8 diffraction), vertices (m), a [re, im], tau (s), theta_r, phi_r, theta_t, phi_t; the last line, \
             `diffuse`, holds the total and the power by object"
                .into(),
        ));
    }
    list
}
