//! Diffuse power per type and per object, and the Bartlett map.

use super::reference::{DiffuseCase, DiffuseReference, DiffuseResult, single};
use super::report::Quantity;
use super::{CheckReport, Comparison};
use crate::radio::diffuse::Contribution;
use crate::radio::{Arrival, DiffuseField, DiffuseSettings, Path, PlanarArray, RadioSettings, RadioTracer, Search};
use crate::spectrum::{Bartlett, RearHalfSpace};
use corf_scene::{Result, Scene};
use glam::{DMat3, DVec3};

/// Own quadrature against the reference's, relative.
const QUADRATURE: f64 = 1e-3;
/// Standard errors that the library's Monte Carlo mean may be away.
const STANDARD_ERRORS: f64 = 4.0;
/// Totals per type, dB.
const TOTAL_DB: f64 = 0.1;
/// The Bartlett map, dB, where it is within [`MAP_DEPTH_DB`] of its peak.
const MAP_DB: f64 = 0.2;
const MAP_DEPTH_DB: f64 = 30.0;
/// Directions of the gathering lattice: per-object outlines are then sampled to a few 1e-4.
const DIRECTIONS: usize = 250_000;
/// … where a total is wanted within a tenth of a decibel.
const COARSE_DIRECTIONS: usize = 40_000;

pub(super) fn check(reference: &DiffuseReference) -> Result<CheckReport> {
    let mut comparisons = Vec::new();
    for case in &reference.cases {
        let scene = reference.scene(case)?;
        let settings = RadioSettings {
            frequency_hz: reference.frequency_hz,
            max_depth: case.args.max_depth,
            transmission: case.args.refraction,
            search: Search::Auto { rays: 1_000_000 },
            ..RadioSettings::default()
        };
        let tracer = RadioTracer::without_bvh(&scene, settings)?;
        let tx = single(reference.tx);
        let transmitter = tracer.transmitter(tx)?;
        let sampling = DiffuseSettings { directions: DIRECTIONS, after: 0, min_mirror_sr: 0.0, ..DiffuseSettings::default() };
        let field = DiffuseField::new(&tracer, tx, &sampling)?;
        for result in &case.rx_results {
            let rx = single(reference.rx[result.rx_index]);
            let mut comparison = compare(reference, case, result, &scene, &transmitter.paths(rx)?, &field, rx)?;
            if let Some(expected) = &result.ds_by_reciprocity {
                // Not this scene's DS: the scattering model is not reciprocal (Γ and the lobe belong to the incident side).
                let exchanged = DiffuseField::new(&tracer, rx, &DiffuseSettings { directions: COARSE_DIRECTIONS, ..sampling })?
                    .contributions(tx)?;
                let found = total(&exchanged, |c| direct(c) && c.mirrored_before);
                require_db(&mut comparison, "power of SD with the ends exchanged", found, expected.mean);
            }
            comparison.name = format!("{}, rx {}", case.name, result.rx_index);
            comparisons.push(comparison);
        }
    }
    Ok(CheckReport::new(&format!("{} (diffuse)", reference.scene), comparisons))
}

fn compare(
    reference: &DiffuseReference,
    case: &DiffuseCase,
    result: &DiffuseResult,
    scene: &Scene,
    paths: &[Path],
    field: &DiffuseField<'_, '_>,
    rx: DVec3,
) -> Result<Comparison> {
    let mut c = Comparison { matched: paths.len(), ..Comparison::default() };
    let contributions = field.contributions(rx)?;
    // Totals per type. The library's own DS is not compared: it keeps one such path per plane.
    for (name, expected) in &result.power_by_type {
        let found = match name.as_str() {
            "D" => total(&contributions, |c| direct(c) && !c.mirrored_before),
            "SD" => total(&contributions, |c| direct(c) && c.mirrored_before),
            "LOS" => specular_power(paths, ""),
            types if types.bytes().all(|b| b == b'S') && types.len() <= case.args.max_depth => specular_power(paths, types),
            _ => continue,
        };
        require_db(&mut c, &format!("power of {name}"), found, expected.mean);
    }
    for (name, expected) in &result.power_by_object {
        let from_it = |c: &Contribution| direct(c) && !c.mirrored_before && scene.objects[c.object as usize].name == *name;
        let found = total(&contributions, from_it);
        require(
            &mut c,
            &format!("D from {name}, quadrature"),
            found,
            expected.quadrature_f64,
            QUADRATURE * expected.quadrature_f64,
        );
        let allowed = STANDARD_ERRORS * expected.sionna.sem;
        require(&mut c, &format!("D from {name}, Monte Carlo"), found, expected.sionna.mean, allowed);
    }
    // The map holds what the library found: everything but DS.
    let mut arrivals: Vec<Arrival> = paths.iter().map(|p| Arrival::from_path(p, reference.frequency_hz)).collect();
    arrivals.extend(contributions.iter().filter(|(_, c)| c.after == 0).map(|(direction, c)| Arrival {
        direction: *direction,
        power: c.power,
        delay_s: c.delay_s,
        object: c.object,
        phase_rad: None,
    }));
    compare_map(&mut c, reference, result, &arrivals);
    Ok(c)
}

fn compare_map(c: &mut Comparison, reference: &DiffuseReference, result: &DiffuseResult, arrivals: &[Arrival]) {
    let world_from_array = DMat3::from_rotation_z(reference.array.rx_yaw_rad[result.rx_index]);
    let bartlett = Bartlett::new(arrivals, PlanarArray::default(), world_from_array, RearHalfSpace::Aliased);
    let map = &result.bartlett_noncoherent_db;
    let peak = map.iter().flatten().fold(f64::NEG_INFINITY, |m, v| m.max(*v));
    let (mut worst, mut compared) = (0.0f64, 0);
    for (row, az) in map.iter().zip(&reference.array.az_deg) {
        for (expected, el) in row.iter().zip(&reference.array.el_deg) {
            if *expected < peak - MAP_DEPTH_DB {
                continue;
            }
            let (az, el) = (az.to_radians(), el.to_radians());
            let direction = DVec3::new(el.cos() * az.cos(), el.cos() * az.sin(), el.sin());
            let difference = (10.0 * bartlett.power(direction).log10() - expected).abs();
            worst = if difference.is_finite() { worst.max(difference) } else { f64::INFINITY };
            compared += 1;
        }
    }
    if compared == 0 {
        c.faults.push("the Bartlett map is empty".into());
    }
    require(c, &format!("Bartlett map, worst of {compared}, dB"), worst, 0.0, MAP_DB);
}

/// Lit by the transmitter or one mirror, seen without any.
fn direct(c: &Contribution) -> bool {
    !c.indirect && c.after == 0
}

/// The power of the contributions that `belongs` picks.
fn total(contributions: &[(DVec3, Contribution)], belongs: impl Fn(&Contribution) -> bool) -> f64 {
    contributions.iter().filter(|(_, c)| belongs(c)).map(|(_, c)| c.power).sum()
}

fn specular_power(paths: &[Path], types: &str) -> f64 {
    paths.iter().filter(|p| p.types() == types).map(Path::power).sum()
}

fn require_db(c: &mut Comparison, name: &str, found: f64, expected: f64) {
    let tolerance = expected * (10f64.powf(TOTAL_DB / 10.0) - 1.0);
    require(c, name, found, expected, tolerance);
}

fn require(c: &mut Comparison, name: &str, found: f64, expected: f64, tolerance: f64) {
    let ok = (found - expected).abs() <= tolerance;
    if !ok {
        c.faults.push(format!("{name}: {found:.6e}, the reference has {expected:.6e} ± {tolerance:.1e}"));
    }
    c.quantities.push(Quantity { name: name.to_string(), found, expected, tolerance });
}
