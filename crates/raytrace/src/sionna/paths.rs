//! Specular and transmitted paths, one by one.
//!
//! Corners in float32 leave the plane of a tilted face undetermined by a micrometre: its triangles have planes of their own, which move a
//! coefficient by some 1e-6 of itself, more near a slab's fringes. A reference may have been evaluated on either reading, the face's one
//! plane or each triangle's own; a path that disagrees on the first is tried on the second.

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
    let apart = every_triangle_an_object(&scene);
    let bvh = Bvh::build(&scene);
    let tx = single(reference.tx);
    let mut comparisons = Vec::new();
    for config in &reference.configs {
        let settings = RadioSettings {
            frequency_hz: reference.frequency_hz,
            max_interactions: config.args.max_depth,
            line_of_sight: config.args.los,
            reflection: config.args.specular_reflection,
            transmission: config.args.refraction,
            diffraction: config.args.diffraction,
            edge_diffraction: config.args.edge_diffraction,
            diffraction_lit_region: config.args.diffraction_lit_region,
            diffraction_model: DiffractionModel::Sionna,
            search: Search::Auto { rays: LATTICE_RAYS },
            tx_antenna: reference.antennas.antenna(),
            rx_antenna: reference.antennas.antenna(),
            ..RadioSettings::default()
        };
        let tracer = RadioTracer::new(&scene, &bvh, settings)?;
        let transmitter = tracer.transmitter(tx)?;
        for result in &config.rx_results {
            let rx = single(reference.rx[result.rx_index]);
            let found = Found { scene: &scene, tx, rx, paths: transmitter.paths(rx)? };
            let by_triangle = || Found::trace(&apart, &RadioTracer::new(&apart, &bvh, settings)?, tx, rx);
            let expected: Vec<&ReferencePath> = result.paths.iter().chain(&result.not_found_by_sionna).collect();
            let mut comparison = compare(&found, by_triangle, &expected)?;
            comparison.name = format!("{}, rx {}", config.name, result.rx_index);
            comparisons.push(comparison);
        }
    }
    Ok(CheckReport::new(&reference.scene, comparisons))
}

/// The scene with every triangle an object of its own, under the name of the object it belongs to, so that no face has several triangles.
fn every_triangle_an_object(scene: &Scene) -> Scene {
    let mut apart = scene.clone();
    apart.objects = scene.triangles.iter().map(|t| scene.objects[t.object as usize].clone()).collect();
    apart.triangles.iter_mut().zip(0..).for_each(|(triangle, number)| triangle.object = number);
    apart
}

/// Paths traced between two points of a scene.
struct Found<'s> {
    scene: &'s Scene,
    tx: DVec3,
    rx: DVec3,
    paths: Vec<Path>,
}

impl<'s> Found<'s> {
    fn trace(scene: &'s Scene, tracer: &RadioTracer<'_>, tx: DVec3, rx: DVec3) -> Result<Self> {
        Ok(Self { scene, tx, rx, paths: tracer.paths(tx, rx)? })
    }

    /// A path's shortest leg, metres: some tracers drop those under a centimetre.
    fn shortest_leg_m(&self, path: &Path) -> f64 {
        let corners = || path.interactions.iter().map(|i| i.vertex);
        let (from, to) = (std::iter::once(self.tx).chain(corners()), corners().chain([self.rx]));
        from.zip(to).map(|(from, to)| from.distance(to)).fold(f64::INFINITY, f64::min)
    }

    /// A path's object names, TX → RX.
    fn objects<'p>(&'p self, path: &'p Path) -> impl Iterator<Item = &'p str> {
        path.interactions.iter().map(|i| self.scene.objects[i.object as usize].name.as_str())
    }

    /// The path that matches a reference path, among those not `taken`: equal interaction types and objects, and the nearest of several
    /// that share them. Distance between the two, metres, and the path's index.
    fn nearest(&self, reference: &ReferencePath, taken: &[bool]) -> Option<(f64, usize)> {
        let same_names =
            |path: &Path| path.types() == reference.types && self.objects(path).eq(reference.objects.iter().map(String::as_str));
        (0..self.paths.len())
            .filter(|&i| !taken.get(i).copied().unwrap_or(false) && same_names(&self.paths[i]))
            .map(|i| (vertex_distance(&self.paths[i], reference), i))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .filter(|n| n.0 <= VERTEX_M)
    }
}

/// |Δa| of a path relative to the reference's.
fn relative_a(path: &Path, reference: &ReferencePath) -> f64 {
    let a = Complex::new(reference.a_f64[0], reference.a_f64[1]);
    (path.a - a).norm() / a.norm()
}

/// Compares what was found with what is expected; `by_triangle` finds the paths between the triangles' own planes.
fn compare<'t>(
    found: &Found<'_>,
    by_triangle: impl Fn() -> Result<Found<'t>>,
    expected: &[&ReferencePath],
) -> Result<Comparison> {
    let mut c = Comparison::default();
    let mut taken = vec![false; found.paths.len()];
    let mut absent = [0; 3];
    let (mut apart, mut on_triangles): (Option<Found<'t>>, usize) = (None, 0);
    for reference in expected {
        let label = label(&reference.types, reference.objects.iter().map(String::as_str));
        let Some((mut vertex_m, i)) = found.nearest(reference, &taken) else {
            c.missing.push(label);
            continue;
        };
        taken[i] = true;
        c.matched += 1;
        let mut path = &found.paths[i];
        if !within(relative_a(path, reference), RELATIVE_A) {
            let apart = match &mut apart {
                Some(found) => found,
                none => none.insert(by_triangle()?),
            };
            let nearest = apart.nearest(reference, &[]).map(|(vertex_m, i)| (vertex_m, &apart.paths[i]));
            if let Some((there_m, other)) = nearest.filter(|n| within(relative_a(n.1, reference), RELATIVE_A)) {
                (path, vertex_m) = (other, there_m);
                on_triangles += 1;
            }
        }
        let relative_a = relative_a(path, reference);
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
    if on_triangles > 0 {
        c.notes.push(format!(
            "{on_triangles} paths agree where every triangle has its own plane, not one with the rest of its face"
        ));
    }
    if expected.is_empty() {
        c.notes.push("the reference has no path to this receiver".into());
    }
    for (path, _) in found.paths.iter().zip(&taken).filter(|(_, taken)| !**taken) {
        let (label, gain_db) = (label(&path.types(), found.objects(path)), 10.0 * path.power().log10());
        c.extra.push(format!("{label}, {gain_db:.1} dB, its shortest leg {:.4} m", found.shortest_leg_m(path)));
    }
    let ours: f64 = found.paths.iter().map(Path::power).sum();
    let theirs: f64 = expected.iter().map(|p| p.a_f64[0].powi(2) + p.a_f64[1].powi(2)).sum();
    c.power_difference_db = if found.paths.is_empty() && expected.is_empty() { 0.0 } else { 10.0 * (ours / theirs).log10() };
    c.faults.extend(c.missing.iter().map(|p| format!("missing: {p}")));
    c.faults.extend(c.extra.iter().map(|p| format!("not in the reference: {p}")));
    if !within(c.power_difference_db.abs(), POWER_DB) {
        c.faults.push(format!("total power is off by {:.3} dB, {POWER_DB} dB is allowed", c.power_difference_db));
    }
    Ok(c)
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

fn vertex_distance(path: &Path, reference: &ReferencePath) -> f64 {
    let pairs = path.interactions.iter().zip(&reference.vertices);
    pairs.map(|(i, v)| i.vertex.distance(DVec3::from_array(*v))).fold(0.0, f64::max)
}

/// The larger of the zenith difference and the azimuth difference (modulo 2π, weighed by sinθ: it means nothing at a pole).
fn angle_between(a: Angles, b: Angles) -> f64 {
    let turn = (a.phi - b.phi + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
    (a.theta - b.theta).abs().max(turn.abs() * a.theta.sin().abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sionna::reference::{ReferenceAntennas, ReferenceConfig, ReferenceMaterial, ReferenceObject, ReferencePaths};

    /// A tilted sheet over a floor, whose float32 corners are in no one plane.
    fn tilted() -> SpecularReference {
        let quad = |name: &str, [a, b, c, d]: [[f64; 3]; 4]| ReferenceObject {
            name: name.into(),
            material: "plasterboard".into(),
            triangles: vec![[a, b, c], [a, c, d]],
        };
        let material = ReferenceMaterial {
            eps_r: 2.73,
            eps_im: 0.119,
            thickness: 0.013,
            scattering_coefficient: 0.0,
            xpd: 0.0,
            pattern: "lambertian".into(),
            alpha_r: None,
            alpha_i: None,
            lambda: None,
        };
        let args = serde_json::json!({ "max_depth": 3, "refraction": true });
        SpecularReference {
            scene: "tilted".into(),
            frequency_hz: 60e9,
            antennas: ReferenceAntennas::default(),
            materials: [("plasterboard".into(), material)].into(),
            objects: vec![
                quad("floor", [[0.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.0, 4.4, 0.0], [0.0, 4.4, 0.0]]),
                quad("sheet", [[4.3, 1.1, 0.9], [4.7, 1.5, 0.9], [4.8, 1.5, 1.4], [4.4, 1.1, 1.4]]),
            ],
            tx: [0.8, 0.9, 1.9],
            rx: (0..40).map(|i| [5.5, 1.0 + 0.15 * f64::from(i % 8), 0.2 + 0.25 * f64::from(i / 8)]).collect(),
            configs: vec![ReferenceConfig {
                name: "d3".into(),
                args: serde_json::from_value(args).unwrap(),
                rx_results: Vec::new(),
            }],
        }
    }

    /// Fills in reference results from the paths on the planes of the single triangles.
    fn on_triangles(mut reference: SpecularReference) -> SpecularReference {
        let scene = every_triangle_an_object(&reference.scene().unwrap());
        let tracer = RadioTracer::without_bvh(&scene, RadioSettings::default()).unwrap();
        for (rx_index, rx) in reference.rx.iter().enumerate() {
            let found = Found::trace(&scene, &tracer, single(reference.tx), single(*rx)).unwrap();
            let recorded = |path: &Path| ReferencePath {
                types: path.types(),
                objects: found.objects(path).map(String::from).collect(),
                vertices: path.interactions.iter().map(|i| i.vertex.to_array()).collect(),
                length_m: path.length_m,
                delay_s: Some(path.delay_s),
                a_f64: [path.a.re, path.a.im],
                aoa: None,
                aod: None,
            };
            let paths = found.paths.iter().map(recorded).collect();
            let result = ReferencePaths { rx_index, total_power_db: None, paths, not_found_by_sionna: Vec::new() };
            reference.configs[0].rx_results.push(result);
        }
        reference
    }

    #[test]
    fn either_reading_of_a_face_passes_and_nothing_else() {
        let mut reference = on_triangles(tilted());
        let report = check(&reference).unwrap();
        assert!(report.passed, "{report}");
        let noted =
            report.comparisons.iter().any(|c| c.notes.iter().any(|note| note.contains("every triangle has its own plane")));
        assert!(noted, "the two readings never differ by 1e-6: this says nothing\n{report}");
        reference.materials.get_mut("plasterboard").unwrap().thickness *= 1.0 + 1e-5;
        assert!(!check(&reference).unwrap().passed);
    }
}
