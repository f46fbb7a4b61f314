//! Diffuse power per type and per object, and the Bartlett map.
//!
//! Chains that end in a scattering are compared one type at a time: D, SD and what came through slabs alone before (RD, RRD) by quadrature
//! over the surfaces, all others by photons that follow that chain alone. What follows a scattering is not compared: the library loses it.

use super::reference::{DiffuseReference, DiffuseResult, Estimate, single};
use super::report::ComparedQuantity;
use super::{CheckReport, Comparison};
use crate::radio::diffuse::{Event, Scattered, WorldExtent};
use crate::radio::{Arrival, DiffuseField, DiffuseSettings, Path, PlanarArray, RadioSettings, RadioTracer, Search};
use crate::spectrum::{Bartlett, RearHalfSpace};
use corf_scene::{Result, Scene};
use glam::{DMat3, DVec3};
use std::collections::BTreeMap;

/// Own quadrature against the reference's, relative.
const QUADRATURE: f64 = 1e-3;
/// Standard errors that the library's Monte Carlo mean may be away.
const STANDARD_ERRORS: f64 = 4.0;
/// Totals per type, dB.
const TOTAL_DB: f64 = 0.1;
/// Tolerance of a type's power beside its standard error, as a share of all diffuse power: the library's mean of weaker types rests on a
/// few rays, and its standard error means little.
const NEGLIGIBLE: f64 = 1e-3;
/// The Bartlett map, dB, where it is within [`MAP_DEPTH_DB`] of its peak.
const MAP_DB: f64 = 0.2;
const MAP_DEPTH_DB: f64 = 30.0;
/// Directions of the gathering lattice behind a map.
const DIRECTIONS: usize = 250_000;
/// Directions of the gathering lattice where a total is wanted within a tenth of a decibel.
const COARSE_DIRECTIONS: usize = 40_000;
/// Photons for one type of chain. Where few come, theirs are spread over neighbouring patches: a lobe scattered twice behind a pane came out
/// 4 % too bright with a fourth of them.
const PHOTONS: usize = 8_000_000;
/// Photons for all types of chains together behind a map.
const PHOTONS_OF_MAP: usize = 2_000_000;
/// Side of the patches that one type's fall on, metres: half-lit ones of which a receiver sees the dark half count too much (RD by a tenth
/// and SRD by a fifth at 0.16 m, next to the edge of a board).
const PATCH_M: f64 = 0.04;

pub(super) fn check(reference: &DiffuseReference) -> Result<CheckReport> {
    let mut comparisons = Vec::new();
    for case in &reference.cases {
        let scene = reference.scene(case)?;
        let settings = RadioSettings {
            frequency_hz: reference.frequency_hz,
            max_interactions: case.args.max_depth,
            transmission: case.args.refraction,
            search: Search::Auto { rays: 1_000_000 },
            ..RadioSettings::default()
        };
        let tracer = RadioTracer::without_bvh(&scene, settings)?;
        let tx = single(reference.tx);
        let transmitter = tracer.transmitter(tx)?;
        let coarse = DiffuseSettings {
            directions: COARSE_DIRECTIONS,
            after: 0,
            min_mirror_sr: 0.0,
            photons: 0,
            ..DiffuseSettings::default()
        };
        let field = DiffuseField::new(&tracer, tx, &coarse)?;
        let of_map = DiffuseSettings { directions: DIRECTIONS, photons: PHOTONS_OF_MAP, ..coarse };
        let everything = DiffuseField::new(&tracer, tx, &of_map)?;
        let mut chains = BTreeMap::new();
        for name in case.rx_results.iter().flat_map(|r| r.power_by_type.keys()) {
            if let Some(chain) = events(name, case.args.max_depth)
                && !chains.contains_key(name)
            {
                let sampling = DiffuseSettings { photons: PHOTONS, patch_size_m: PATCH_M, ..coarse };
                chains.insert(name.clone(), DiffuseField::of_chain(&tracer, tx, &sampling, &chain)?);
            }
        }
        for result in &case.rx_results {
            let rx = single(reference.rx[result.rx_index]);
            let mut comparison = Comparison { name: format!("{}, rx {}", case.name, result.rx_index), ..Comparison::default() };
            let paths = transmitter.paths(rx)?;
            comparison.matched = paths.len();
            let scattered = field.by_quadrature(rx)?;
            let mut by_type = BTreeMap::new();
            for name in result.power_by_type.keys() {
                let found = match chains.get(name) {
                    Some(chain) => Some(chain.contributions(rx)?.iter().map(|(_, c)| c.power).sum()),
                    None => power_of(name, case.args.max_depth, &paths, &scattered),
                };
                by_type.extend(found.map(|found| (name.as_str(), found)));
            }
            compare_types(&mut comparison, result, &by_type);
            compare_objects(&mut comparison, result, &scene, &scattered);
            if let Some(expected) = &result.ds_by_reciprocity {
                // Not this scene's DS: the scattering model is not reciprocal (Γ and the lobe belong to the incident side).
                let found = DiffuseField::new(&tracer, rx, &coarse)?.by_quadrature(tx)?.mirrored.iter().sum();
                require(&mut comparison, "power of SD with the ends exchanged", found, expected.mean, allowed(expected));
            }
            // The map holds what the library found: everything but what follows a scattering.
            let mut arrivals: Vec<Arrival> = paths.iter().map(|p| Arrival::from_path(p, reference.frequency_hz)).collect();
            arrivals.extend(everything.gather(rx, everything.antenna(), &WorldExtent::Sphere)?);
            compare_map(&mut comparison, reference, result, &arrivals, map_allowed(result, case.args.seeds));
            comparisons.push(comparison);
        }
    }
    Ok(CheckReport::new(&format!("{} (diffuse)", reference.scene), comparisons))
}

/// Number of slabs before the scattering in a type of chain without mirrors, D, RD, RRD and so on; `None` for all other types.
fn slabs_before(types: &str) -> Option<usize> {
    types.strip_suffix('D').filter(|before| before.bytes().all(|b| b == b'R')).map(str::len)
}

/// The events of a type that photons are asked about: it ends in a scattering, and no quadrature knows it.
fn events(types: &str, max_depth: usize) -> Option<Vec<Event>> {
    if slabs_before(types).is_some() || types == "SD" || !types.ends_with('D') || types.len() > max_depth {
        return None;
    }
    types
        .chars()
        .map(|letter| match letter {
            'S' => Some(Event::Specular),
            'R' => Some(Event::Transmitted),
            'D' => Some(Event::Scattered),
            _ => None,
        })
        .collect()
}

/// Power of an interaction type by quadrature or the image method, linear; `None` where neither covers it.
fn power_of(types: &str, max_depth: usize, paths: &[Path], scattered: &Scattered) -> Option<f64> {
    match types {
        "SD" if max_depth >= 2 => Some(scattered.mirrored.iter().sum()),
        "LOS" => Some(specular_power(paths, "")),
        types if types.bytes().all(|b| b"SR".contains(&b)) && types.len() <= max_depth => Some(specular_power(paths, types)),
        types => scattered.straight.get(slabs_before(types)?).map(|of_object| of_object.iter().sum()),
    }
}

/// Holds every type against the reference's, and all that ends in a scattering together.
fn compare_types(c: &mut Comparison, result: &DiffuseResult, found: &BTreeMap<&str, f64>) {
    let expected = |name: &str| result.power_by_type[name];
    let diffuse = || found.iter().filter(|(name, _)| name.ends_with('D'));
    let mean = diffuse().map(|(name, _)| expected(name).mean).sum();
    let sem = diffuse().map(|(name, _)| expected(name).sem.powi(2)).sum::<f64>().sqrt();
    for (name, power) in found {
        let negligible = if name.ends_with('D') { NEGLIGIBLE * mean } else { 0.0 };
        require(c, &format!("power of {name}"), *power, expected(name).mean, allowed(&expected(name)) + negligible);
    }
    if mean > 0.0 {
        let total = diffuse().map(|(_, power)| power).sum();
        require(c, "power that ends in a scattering", total, mean, allowed(&Estimate { mean, sem }));
    }
}

fn compare_objects(c: &mut Comparison, result: &DiffuseResult, scene: &Scene, scattered: &Scattered) {
    for (name, expected) in &result.power_by_object {
        let objects = scene.objects.iter().zip(scattered.straight.iter().take(1).flatten());
        let found = objects.filter(|(object, _)| object.name == *name).map(|(_, power)| power).sum();
        require(c, &format!("D from {name}, quadrature"), found, expected.quadrature_f64, QUADRATURE * expected.quadrature_f64);
        let sionna = expected.sionna;
        require(c, &format!("D from {name}, Monte Carlo"), found, sionna.mean, STANDARD_ERRORS * sionna.sem);
    }
}

/// The tolerance of a map: its own, and what the library's mean over its seeds may be off at most of its directions, dB.
fn map_allowed(result: &DiffuseResult, seeds: usize) -> f64 {
    MAP_DB + STANDARD_ERRORS * result.bartlett_std_db_single_seed_median / (seeds.max(1) as f64).sqrt()
}

fn compare_map(c: &mut Comparison, reference: &DiffuseReference, result: &DiffuseResult, arrivals: &[Arrival], allowed_db: f64) {
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
    require(c, &format!("Bartlett map, worst of {compared}, dB"), worst, 0.0, allowed_db);
}

fn specular_power(paths: &[Path], types: &str) -> f64 {
    paths.iter().filter(|p| p.types() == types).map(Path::power).sum()
}

/// The tolerance of a total: its own, and what the library's mean may be off.
fn allowed(expected: &Estimate) -> f64 {
    expected.mean * (10f64.powf(TOTAL_DB / 10.0) - 1.0) + STANDARD_ERRORS * expected.sem
}

fn require(c: &mut Comparison, name: &str, found: f64, expected: f64, tolerance: f64) {
    let ok = (found - expected).abs() <= tolerance;
    if !ok {
        c.faults.push(format!("{name}: {found:.6e}, the reference has {expected:.6e} ± {tolerance:.1e}"));
    }
    c.quantities.push(ComparedQuantity { name: name.to_string(), found, expected, tolerance });
}
