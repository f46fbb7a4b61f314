//! Reflection losses that were measured at 60 GHz beside what the materials' models give: the table of docs/validation.md.

#![allow(clippy::unwrap_used)]

use corf_raytrace::radio::fresnel::slab_response;
use corf_raytrace::radio::materials::Slab;
use corf_scene::model::{Permittivity, RadioMaterial};

/// Carrier of the measurements.
const FREQUENCY_HZ: f64 = 60e9;
/// Angles of incidence that means are over, degrees: those of single bounces between antennas in one room.
const ANGLES_DEG: std::ops::RangeInclusive<u32> = 0..=70;

/// A surface of NIST's library (usnistgov/qd-realization, src/material_libraries), its mean reflection loss there (`mu_RL`, dB), and the slab that a scene
/// would have for it: name, thickness, and the scattering coefficient of the lobby's material of that name.
const SURFACES: [(&str, f64, &str, f64, f64); 10] = [
    ("lecture room, right wall", 10.80, "plasterboard", 0.0125, 0.4),
    ("lecture room, left wall", 10.70, "plasterboard", 0.0125, 0.4),
    ("lecture room, bottom wall", 9.84, "plasterboard", 0.0125, 0.4),
    ("lecture room, top wall", 9.27, "plasterboard", 0.0125, 0.4),
    ("lecture room, tables", 6.58, "wood", 0.025, 0.8),
    ("lecture room, ceiling (and floor)", 6.90, "ceiling_board", 0.015, 0.4),
    ("data centre, wall and columns", 7.53, "concrete", 0.2, 0.4),
    ("data centre, ceiling (and floor)", 10.00, "ceiling_board", 0.015, 0.4),
    ("data centre, side of a rack", 15.82, "metal", 0.001, 0.1),
    ("data centre, top of a rack", 7.77, "metal", 0.001, 0.1),
];

/// Loss of the specular part, dB: of the mean over angles and both polarisations of (1 − S²)·|R|².
fn loss_db(name: &str, thickness_m: f64, s: f64) -> f64 {
    let material = RadioMaterial {
        id: name.into(),
        permittivity: Permittivity::Itu(name.into()),
        thickness_m,
        scattering: Default::default(),
    };
    let (relative, imaginary) = material.complex_permittivity(FREQUENCY_HZ).unwrap();
    let slab = Slab::new(name, relative, imaginary, thickness_m, material.scattering, FREQUENCY_HZ).unwrap();
    let powers = ANGLES_DEG.map(|angle| {
        let response = slab_response(&slab, f64::from(angle).to_radians().cos());
        0.5 * (response.r_te.norm_squared() + response.r_tm.norm_squared())
    });
    let mean = powers.sum::<f64>() / ANGLES_DEG.count() as f64;
    -10.0 * ((1.0 - s * s) * mean).log10()
}

#[test]
fn the_table_of_measured_reflection_losses_is_what_the_models_give() {
    let mut lines = vec![];
    let (mut sum, mut squares) = (0.0, 0.0);
    for (surface, measured, material, thickness_m, s) in SURFACES {
        let model = loss_db(material, thickness_m, s);
        let bias = model - measured;
        (sum, squares) = (sum + bias, squares + bias * bias);
        let slab = format!("`{material}`, {} mm, S {s}", 1e3 * thickness_m);
        lines.push(format!("| {surface} | {measured:.1} | {slab} | {model:.1} | {bias:+.1} |"));
    }
    let n = SURFACES.len() as f64;
    lines.push(format!("| mean, root mean square | | | | {:+.1}, {:.1} |", sum / n, (squares / n).sqrt()));
    let table = lines.join("\n");
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/validation.md");
    let page = std::fs::read_to_string(path).unwrap();
    assert!(page.contains(&table), "docs/validation.md does not have this table:\n{table}");
    // A check of the formula beside the code under test: a half-space of concrete at normal incidence, 20·log10 of 0.393.
    assert!((loss_db("concrete", 1.0, 0.0) + 20.0 * 0.393f64.log10()).abs() < 1.0);
}
