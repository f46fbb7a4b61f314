//! Specular and transmitted paths, one by one.

use super::reference::{ReferenceAngles, ReferencePath, SpecularReference, single};
use super::{CheckReport, Comparison};
use crate::Bvh;
use crate::radio::{Angles, Complex, DiffractionModel, Path, RadioSettings, RadioTracer, SPEED_OF_LIGHT, Search};
use corf_scene::{Result, Scene};
use glam::DVec3;

/// |Δa| relative to |a_f64|: the file keeps nine digits.
const RELATIVE_A: f64 = 1e-6;
/// Unfolded length, metres.
const LENGTH_M: f64 = 1e-5;
/// Angles, radians.
const ANGLE_RAD: f64 = 5e-5;
/// Vertices, metres; also how far a path may be from the reference's to be the same one.
const VERTEX_M: f64 = 1e-3;
/// Total power, dB.
const POWER_DB: f64 = 0.01;
/// Rays of the lattice when a scene has too many faces for all chains.
const LATTICE_RAYS: usize = 2_000_000;

pub(super) fn check(reference: &SpecularReference) -> Result<CheckReport> {
    let scene = reference.scene()?;
    let bvh = Bvh::build(&scene);
    let tx = single(reference.tx);
    let mut comparisons = Vec::new();
    for config in &reference.configs {
        let settings = RadioSettings {
            frequency_hz: reference.frequency_hz,
            max_depth: config.args.max_depth,
            line_of_sight: config.args.los,
            reflection: config.args.specular_reflection,
            transmission: config.args.refraction,
            diffraction: config.args.diffraction,
            edge_diffraction: config.args.edge_diffraction,
            diffraction_lit_region: config.args.diffraction_lit_region,
            diffraction_model: DiffractionModel::Sionna,
            search: Search::Auto { rays: LATTICE_RAYS },
            ..RadioSettings::default()
        };
        let tracer = RadioTracer::new(&scene, &bvh, settings)?;
        let transmitter = tracer.transmitter(tx)?;
        for result in &config.rx_results {
            let found = transmitter.paths(single(reference.rx[result.rx_index]))?;
            let expected: Vec<&ReferencePath> = result.paths.iter().chain(&result.not_found_by_sionna).collect();
            let mut comparison = compare(&scene, &found, &expected);
            comparison.name = format!("{}, rx {}", config.name, result.rx_index);
            comparisons.push(comparison);
        }
    }
    Ok(CheckReport::new(&reference.scene, comparisons))
}

fn compare(scene: &Scene, found: &[Path], expected: &[&ReferencePath]) -> Comparison {
    let mut c = Comparison::default();
    let mut taken = vec![false; found.len()];
    let mut absent = [0; 3];
    for reference in expected {
        let label = label(&reference.types, reference.objects.iter().map(String::as_str));
        // The same path: same interactions, objects and places. Nearest first, where two share all of the names.
        let nearest = (0..found.len())
            .filter(|&i| !taken[i] && same_names(scene, &found[i], reference))
            .map(|i| (vertex_distance(&found[i], reference), i))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((vertex_m, i)) = nearest.filter(|n| n.0 <= VERTEX_M) else {
            c.missing.push(label);
            continue;
        };
        taken[i] = true;
        c.matched += 1;
        let path = &found[i];
        let a = Complex::new(reference.a_f64[0], reference.a_f64[1]);
        let relative_a = (path.a - a).norm() / a.norm();
        let length_m = (path.length_m - reference.length_m).abs();
        let angle = |ours: Angles, theirs: ReferenceAngles| angle_between(ours, Angles { theta: theirs.theta, phi: theirs.phi });
        let columns = [
            reference.aoa.map(|theirs| angle(path.aoa(), theirs)),
            reference.aod.map(|theirs| angle(path.aod(), theirs)),
            reference.delay_s.map(|theirs| (path.delay_s - theirs).abs() * SPEED_OF_LIGHT),
        ];
        columns.iter().zip(&mut absent).filter(|(column, _)| column.is_none()).for_each(|(_, absent)| *absent += 1);
        let [aoa_rad, aod_rad, delay_m] = columns.map(|column| column.unwrap_or(0.0));
        let angle_rad = aoa_rad.max(aod_rad);
        for (what, value, limit) in [
            ("|da|/|a|", relative_a, RELATIVE_A),
            ("length", length_m, LENGTH_M),
            ("delay times c", delay_m, LENGTH_M),
            ("angle", angle_rad, ANGLE_RAD),
        ] {
            if !within(value, limit) {
                c.faults.push(format!("{label}: {what} is off by {value:.2e}, {limit:.0e} is allowed"));
            }
        }
        c.max_relative_a = c.max_relative_a.max(relative_a);
        c.max_length_m = c.max_length_m.max(length_m);
        c.max_angle_rad = c.max_angle_rad.max(angle_rad);
        c.max_vertex_m = c.max_vertex_m.max(vertex_m);
    }
    for (column, count) in ["angle of arrival", "angle of departure", "delay"].iter().zip(absent).filter(|(_, count)| *count > 0)
    {
        c.notes.push(format!("{count} of {} paths have no {column} in the reference: not compared", c.matched));
    }
    if expected.is_empty() {
        c.notes.push("the reference has no path to this receiver".into());
    }
    let name = |o: u32| scene.objects[o as usize].name.as_str();
    for (path, _) in found.iter().zip(&taken).filter(|(_, taken)| !**taken) {
        c.extra.push(label(&path.types(), path.interactions.iter().map(|i| name(i.object))));
    }
    let ours: f64 = found.iter().map(Path::power).sum();
    let theirs: f64 = expected.iter().map(|p| p.a_f64[0].powi(2) + p.a_f64[1].powi(2)).sum();
    c.power_difference_db = if found.is_empty() && expected.is_empty() { 0.0 } else { 10.0 * (ours / theirs).log10() };
    c.faults.extend(c.missing.iter().map(|p| format!("missing: {p}")));
    c.faults.extend(c.extra.iter().map(|p| format!("not in the reference: {p}")));
    if !within(c.power_difference_db.abs(), POWER_DB) {
        c.faults.push(format!("total power is off by {:.3} dB, {POWER_DB} dB is allowed", c.power_difference_db));
    }
    c
}

/// A number that is no number is not within any limit.
fn within(value: f64, limit: f64) -> bool {
    value <= limit
}

fn label<'s>(types: &str, objects: impl Iterator<Item = &'s str>) -> String {
    if types.is_empty() {
        return "line of sight".into();
    }
    format!("{types} [{}]", objects.collect::<Vec<_>>().join(", "))
}

fn same_names(scene: &Scene, path: &Path, reference: &ReferencePath) -> bool {
    path.types() == reference.types
        && path.interactions.len() == reference.objects.len()
        && path.interactions.iter().zip(&reference.objects).all(|(i, name)| scene.objects[i.object as usize].name == *name)
}

fn vertex_distance(path: &Path, reference: &ReferencePath) -> f64 {
    let pairs = path.interactions.iter().zip(&reference.vertices);
    pairs.map(|(i, v)| i.vertex.distance(DVec3::from_array(*v))).fold(0.0, f64::max)
}

/// The larger of the zenith difference and the azimuth difference (modulo 2π, weighed by sinθ: it means nothing at a pole).
fn angle_between(a: Angles, b: Angles) -> f64 {
    let turn = (a.phi - b.phi + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
    (a.theta - b.theta).abs().max(turn.abs() * a.theta.sin().abs())
}
