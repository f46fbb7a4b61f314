//! Links against formulas that need no tracer.

#![allow(clippy::unwrap_used)]

use corf_raytrace::radio::channel::{ArrayLink, LinkStatistics, Subcarriers, frequency_response};
use corf_raytrace::radio::export::{Link, PathSet, deepmimo_arrays, sionna_arrays, sionna_json};
use corf_raytrace::radio::{Antenna, AntennaArray, PlanarArray, Polarization, RadioSettings, RadioTracer, SPEED_OF_LIGHT};
use corf_scene::Scene;
use corf_scene::model::{LightMaterial, Material, Object, Permittivity, RadioMaterial, Triangle};
use corf_scene::npz::{Array, Values};
use glam::{DVec3, Vec3};
use std::f64::consts::{PI, TAU};

const F: f64 = 60e9;

/// A ground plane at z = 0 of metal so thick and well conducting that it mirrors.
fn ground() -> Scene {
    let radio = RadioMaterial {
        id: "mirror".into(),
        permittivity: Permittivity::Constant { relative_permittivity: 1.0, conductivity_s_per_m: 1e12 },
        thickness_m: 0.1,
        scattering: Default::default(),
    };
    Scene {
        name: "ground".into(),
        objects: vec![Object { name: "ground".into() }],
        materials: vec![Material { name: "mirror".into(), light: LightMaterial::default(), radio: Some(radio) }],
        positions: vec![Vec3::new(-99.0, -99.0, 0.0), Vec3::new(99.0, -99.0, 0.0), Vec3::new(0.0, 99.0, 0.0)],
        normals: vec![Vec3::Z; 3],
        uvs: vec![[0.0; 2]; 3],
        triangles: vec![Triangle { vertices: [0, 1, 2], material: 0, object: 0 }],
        ..Scene::default()
    }
}

/// Over a mirror a horizontal dipole's image has the opposite sign: h = λ/4π·(e^{−jkd₁}/d₁ − e^{−jkd₂}/d₂), broadside.
#[test]
fn two_rays_over_a_mirror_are_the_textbook_channel() {
    let scene = ground();
    let horizontal = Antenna { polarization: Polarization::H, ..Antenna::default() };
    let settings = RadioSettings { tx_antenna: horizontal, rx_antenna: horizontal, ..RadioSettings::default() };
    let (tx, rx) = (DVec3::new(0.0, 0.0, 2.0), DVec3::new(12.0, 0.0, 1.5));
    let paths = RadioTracer::without_bvh(&scene, settings).unwrap().paths(tx, rx).unwrap();
    assert_eq!(paths.len(), 2);
    let (d1, d2) = (tx.distance(rx), (rx - DVec3::new(0.0, 0.0, -2.0)).length());
    let one = AntennaArray::single(horizontal);
    let rays = ArrayLink { paths: &paths, diffuse: &[], tx: &one, rx: &one, seed: 0 }.rays(0, 0, F);
    let offsets = Subcarriers::of_band(2e9, 101).unwrap().offsets_hz();
    for (h, offset) in frequency_response(&rays, &offsets).iter().zip(&offsets) {
        // Amplitudes are those at the carrier, as in every ray tracer; phases are exact at each frequency.
        let wavelength_m = SPEED_OF_LIGHT / F;
        let amplitude = |d: f64| wavelength_m / (4.0 * PI * d);
        let cycles = |d: f64| (F + offset) * (d / SPEED_OF_LIGHT);
        let (c1, c2) = (TAU * cycles(d1).fract(), TAU * cycles(d2).fract());
        // φ̂ seen from the receiver is the opposite of φ̂ seen from the transmitter: one sign for all.
        let re = amplitude(d2) * c2.cos() - amplitude(d1) * c1.cos();
        let im = amplitude(d1) * c1.sin() - amplitude(d2) * c2.sin();
        // What a conductivity of 1e12 S/m leaves of 1 + r at grazing incidence, and the rounding of 2 400 cycles.
        assert!((h.re - re).hypot(h.im - im) < 1e-4 * amplitude(d1), "{offset}: {h:?} {re} {im}");
    }
    let s = LinkStatistics::of(&paths, &[], [&horizontal; 2], F, 10.0, 0);
    let (p1, p2) = (d1.powi(-2), d2.powi(-2));
    let spread_s = (d2 - d1) / SPEED_OF_LIGHT * (p1 * p2).sqrt() / (p1 + p2);
    assert!((s.delay_spread_s.unwrap() / spread_s - 1.0).abs() < 1e-4);
    assert!((s.k_factor_db.unwrap() - 10.0 * (p1 / p2).log10()).abs() < 1e-3);
    // Both arrive from one azimuth; in zenith they stand apart by the sum of both elevations.
    assert!(s.azimuth_spread_of_arrival_deg.unwrap() < 1e-6);
    let apart_deg = ((2.0f64 - 1.5) / 12.0).atan().to_degrees() + (3.5f64 / 12.0).atan().to_degrees();
    let expected = apart_deg * (p1 * p2).sqrt() / (p1 + p2);
    // The circular law and the linear one differ by a few parts in a thousand at 19°.
    assert!((s.zenith_spread_of_arrival_deg.unwrap() / expected - 1.0).abs() < 0.01);
}

fn two_users() -> PathSet<'static> {
    let scene = ground();
    let array = |rows, columns| AntennaArray {
        element: Antenna::default(),
        grid: PlanarArray { rows, columns, spacing_wavelengths: [0.5, 0.5] },
    };
    let tracer = RadioTracer::without_bvh(&scene, RadioSettings::default()).unwrap();
    let transmitters = vec![DVec3::new(0.0, 0.0, 2.0)];
    // The second one below the ground hears nothing through a mirror.
    let receivers = vec![DVec3::new(12.0, 3.0, 1.5), DVec3::new(5.0, 0.0, -1.0)];
    let link = |rx: &DVec3| Link { tx: transmitters[0], rx: *rx, paths: tracer.paths(transmitters[0], *rx).unwrap() };
    PathSet {
        links: receivers.iter().map(link).collect(),
        transmitters,
        receivers,
        frequency_hz: F,
        tx_arrays: vec![array(1, 2)],
        rx_array: array(2, 2),
        object_names: vec!["ground"],
        velocities: None,
    }
}

fn named<'a>(arrays: &'a [Array], name: &str) -> &'a Array {
    arrays.iter().find(|a| a.name == name).unwrap()
}

#[test]
fn sionna_arrays_have_its_shapes_and_sum_to_the_channel() {
    let set = two_users();
    let arrays = sionna_arrays(&set);
    for (name, shape) in [
        ("a_real", vec![2, 4, 1, 2, 2]),
        ("tau", vec![2, 1, 2]),
        ("valid", vec![2, 1, 2]),
        ("interactions", vec![1, 2, 1, 2]),
        ("objects", vec![1, 2, 1, 2]),
        ("vertices", vec![1, 2, 1, 2, 3]),
        ("targets", vec![2, 3]),
    ] {
        assert_eq!(named(&arrays, name).shape, shape, "{name}");
    }
    assert_eq!(named(&arrays, "valid").values, Values::Bool(vec![true, true, false, false]));
    assert_eq!(named(&arrays, "interactions").values, Values::U32(vec![0, 1, 0, 0]));
    assert_eq!(named(&arrays, "objects").values, Values::U32(vec![u32::MAX, 0, u32::MAX, u32::MAX]));
    // Σ a·e^{−j2πfτ} over the paths is the channel matrix.
    let (Values::F64(re), Values::F64(im), Values::F64(tau)) =
        (&named(&arrays, "a_real").values, &named(&arrays, "a_imag").values, &named(&arrays, "tau").values)
    else {
        panic!("types");
    };
    let h = ArrayLink { paths: set.paths(0, 0), diffuse: &[], tx: &set.tx_arrays[0], rx: &set.rx_array, seed: 0 }.matrix(F);
    for row in 0..4 {
        for column in 0..2 {
            let (mut x, mut y) = (0.0, 0.0);
            for i in 0..2 {
                let at = (row * 2 + column) * 2 + i;
                let (sin, cos) = (-TAU * (F * tau[i]).fract()).sin_cos();
                x += re[at] * cos - im[at] * sin;
                y += re[at] * sin + im[at] * cos;
            }
            assert!((x - h.at(row, column).re).hypot(y - h.at(row, column).im) < 1e-12 * h.at(row, column).norm().max(1e-6));
        }
    }
    let json = sionna_json(&set);
    assert_eq!(json["a"].as_array().unwrap().len(), 2);
    assert_eq!(json["tau"][1][0][0], -1.0);
    assert_eq!(json["vertices"][0][0][0][1].as_array().unwrap().len(), 3);
}

#[test]
fn deepmimo_matrices_rebuild_the_narrowband_channel() {
    let set = two_users();
    let arrays = deepmimo_arrays(&set, 0);
    let column = |name: &str| match &named(&arrays, name).values {
        Values::F32(v) => v.clone(),
        _ => panic!("{name}"),
    };
    let (power, phase, inter) = (column("power"), column("phase"), column("inter"));
    assert!(power[2..].iter().all(|p| p.is_nan()) && power[0] >= power[1]);
    assert_eq!(&inter[..2], [0.0, 1.0]);
    // Σ √P·e^{jφ} is the channel of one antenna at the carrier, to float32's degrees.
    let one = AntennaArray::single(Antenna::default());
    let h = ArrayLink { paths: set.paths(0, 0), diffuse: &[], tx: &one, rx: &one, seed: 0 }.matrix(F);
    let (mut x, mut y) = (0.0, 0.0);
    for i in 0..2 {
        let (amplitude, angle) = (10f64.powf(f64::from(power[i]) / 20.0), f64::from(phase[i]).to_radians());
        x += amplitude * angle.cos();
        y += amplitude * angle.sin();
    }
    assert!((x - h.at(0, 0).re).hypot(y - h.at(0, 0).im) < 1e-5 * h.at(0, 0).norm().max(1e-6), "{x} {y} {:?}", h.at(0, 0));
    // The receiver stands towards azimuth atan2(3, 12) of the transmitter, a little below its horizon: a zenith angle above 90°.
    assert!((column("aod_az")[0] - 3f32.atan2(12.0).to_degrees()).abs() < 1e-4 && column("aod_el")[0] > 90.0);
    assert_eq!(named(&arrays, "inter_pos").shape, [2, 2, 1, 3]);
    assert!(column("inter_pos")[..3].iter().all(|v| v.is_nan()) && column("inter_pos")[5].abs() < 1e-6);
}

/// Paths include all that couples into any port, and powers are those of all ports: a horizontal wave at a dual-polarised receiver, and the
/// reverse, where the transmitter's other port takes half of the power along.
#[test]
fn no_port_is_overlooked() {
    let scene = ground();
    let [h, v, both] =
        [Polarization::H, Polarization::V, Polarization::VH].map(|p| Antenna { polarization: p, ..Antenna::default() });
    let (tx, rx) = (DVec3::new(0.0, 0.0, 2.0), DVec3::new(12.0, 0.0, 1.5));
    let link = |from: Antenna, to: Antenna| {
        let settings = RadioSettings { tx_antenna: from, rx_antenna: to, ..RadioSettings::default() };
        let paths = RadioTracer::without_bvh(&scene, settings).unwrap().paths(tx, rx).unwrap();
        let gain_db = LinkStatistics::of(&paths, &[], [&from, &to], F, 0.0, 0);
        (paths.len(), gain_db.path_gain_db, gain_db.path_gain_coherent_db, gain_db.line_of_sight)
    };
    let (_, alone, coherent, _) = link(h, h);
    let close = |a: Option<f64>, b: Option<f64>, off: f64| (a.unwrap() - b.unwrap() - off).abs() < 1e-9;
    let (count, gain, coherent_gain, direct) = link(h, both);
    assert!(count == 2 && direct && close(gain, alone, 0.0) && close(coherent_gain, coherent, 0.0), "{gain:?} {alone:?}");
    let (count, gain, coherent_gain, direct) = link(both, h);
    let half_db = 10.0 * 0.5f64.log10();
    assert!(count == 2 && direct && close(gain, alone, half_db) && close(coherent_gain, coherent, half_db), "{gain:?}");
    // Level with each other, nothing horizontal couples into a vertical element.
    assert_eq!(link(h, v).0, 0);
}
