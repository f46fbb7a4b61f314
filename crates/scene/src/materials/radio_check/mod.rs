//! Validation of a scene for radio tracing: materials, closed bodies, and the positions of transmitters and receivers.
//!
//! A triangle is a slab of its material's `thickness_m`. A sheet is therefore one slab and a closed body two, and both are sound. Three
//! things are not, and are said here rather than traced: a body that lacks a part of its surface (rays through the hole cross one slab
//! less than their neighbours), a closed plate thinner than its two slabs (a pane of 8 mm modelled with both faces and `thickness_m =
//! 0.008` is 16 mm of glass), and an antenna inside of a body.

mod config;

use crate::config::SceneConfig;
use crate::finding::Finding;
use crate::mounting::Surfaces;
use crate::parts::{self, ConnectedPart};
use crate::solids::Solids;
use crate::words::counted;
use crate::{Error, Result, Scene, Severity, near_field, trajectory};
use glam::DVec3;
use std::collections::BTreeMap;

/// Poses at which a trajectory is looked at.
const POSES: usize = 256;
/// Coordinates above this, metres, have steps of 0.06 mm.
const FAR_M: f64 = 512.0;

/// Everything about a scene that radio at `frequency_hz` cannot be traced over (errors), or over which it likely means something else than
/// was meant (warnings). Indices of the scene must be in range.
pub fn radio_findings(scene: &Scene, frequency_hz: f64) -> Vec<Finding> {
    let mut findings = material_findings(scene, frequency_hz);
    findings.extend(body_findings(scene));
    findings.extend(far_finding(scene));
    findings
}

/// A warning where a scene lies so far from the origin that single precision is coarser than what keeps rays off the surfaces they leave.
pub fn far_finding(scene: &Scene) -> Option<Finding> {
    let bounds = scene.bounds()?;
    let far_m = f64::from(bounds.min.abs().max(bounds.max.abs()).max_element());
    let step_mm = 1e3 * ((far_m as f32).next_up() - far_m as f32);
    let what = format!("its corners lie up to {far_m:.0} m from the origin, where single precision has steps of {step_mm:.2} mm");
    let help = "paths are that inexact and scattered power comes out too low: give the scene file an offset_m under [scene], or move the model to the origin";
    // What is as large as that is not helped by moving it.
    let size_m = f64::from(bounds.max.distance(bounds.min));
    (far_m > FAR_M && far_m > size_m).then(|| Finding::new(Severity::Warning, scene.name.as_str(), what, help))
}

/// Radio properties at the carrier: errors of materials in use, notes of others.
pub fn material_findings(scene: &Scene, frequency_hz: f64) -> Vec<Finding> {
    let name = scene.name.as_str();
    let mut used = vec![false; scene.materials.len()];
    scene.triangles.iter().for_each(|t| used[t.material as usize] = true);
    let mut findings = Vec::new();
    for (material, used) in scene.materials.iter().zip(used) {
        let place = format!("{name}: material \"{}\"", material.name);
        let Some(radio) = &material.radio else {
            if used {
                let help = format!(
                    "add [radio_materials.\"{}\"] to the scene's TOML, or extras.corf_radio to the material",
                    material.name
                );
                findings.push(Finding::error(place, "it has no radio properties", help));
            }
            continue;
        };
        let problem = radio.validate(&place).and_then(|()| radio.complex_permittivity(frequency_hz).map(|_| ()));
        if let Err(Error::Invalid { place: inner, what, help }) = problem {
            // The inner place names the radio material, behind this one's or alone.
            let of_radio = inner.strip_prefix(&place).unwrap_or(&inner).trim_start_matches(": ");
            let (severity, unused) = if used { (Severity::Error, "") } else { (Severity::Note, "; no triangle uses it") };
            findings.push(Finding::new(severity, place.as_str(), format!("{of_radio}: {what}{unused}"), help));
        }
    }
    findings
}

/// Bodies with holes: a warning for each object. Plates thinner than their two slabs: a note for all of them.
pub fn body_findings(scene: &Scene) -> Vec<Finding> {
    let object = |part: &ConnectedPart| scene.objects[part.object as usize].name.as_str();
    let parts = parts::parts(scene);
    let mut findings = hole_findings(scene, &parts);
    let plates: Vec<(&ConnectedPart, f64, u32)> =
        parts.iter().filter_map(|part| part.thinner_than_its_slabs(scene).map(|(t, material)| (part, t, material))).collect();
    if let Some((part, thickness_m, material)) = plates.first() {
        let slab = &scene.materials[*material as usize];
        let what = format!(
            "{} closed plates are thinner than their two slabs, as one of \"{}\": {:.1} mm thick, 2 x {:.1} mm of \"{}\"",
            plates.len(),
            object(part),
            1e3 * thickness_m,
            1e3 * slab.radio.as_ref().map_or(0.0, |r| r.thickness_m),
            slab.name
        );
        let help = "waves pass both faces: model a plate as one sheet, or give its material half the thickness";
        findings.push(Finding::new(Severity::Note, scene.name.as_str(), what, help));
    }
    findings
}

/// A warning for every object with a body that has a hole, about the largest of them.
fn hole_findings(scene: &Scene, parts: &[ConnectedPart]) -> Vec<Finding> {
    let mut worst: BTreeMap<u32, (&ConnectedPart, DVec3)> = BTreeMap::new();
    for part in parts {
        if let Some(at) = part.hole(scene) {
            let known = worst.entry(part.object).or_insert((part, at));
            if part.area_m2 > known.0.area_m2 {
                *known = (part, at);
            }
        }
    }
    let finding = |(object, (part, at)): (u32, (&ConnectedPart, DVec3))| {
        let place = format!("{}: object \"{}\"", scene.name, scene.objects[object as usize].name);
        let what = format!(
            "a body of {:.2} m² with a hole: {}, one of them at ({:.3}, {:.3}, {:.3})",
            part.area_m2,
            counted(part.rim.len(), "open edge"),
            at.x,
            at.y,
            at.z
        );
        let help = "rays through the hole cross one slab less than others: close the surface; where its faces are meant as single sheets, nothing is wrong";
        Finding::new(Severity::Warning, place, what, help)
    };
    worst.into_iter().map(finding).collect()
}

/// Transmitters and trajectory poses inside of bodies, on top of one another (errors), or outside of the scene's bounds (warnings).
pub fn placement_findings(config: &SceneConfig, scene: &Scene) -> Vec<Finding> {
    let (solids, surfaces) = (Solids::of(scene), Surfaces::of(scene));
    let mut findings = Vec::new();
    // Antennas on surfaces stand off them, on their side.
    let mut mounted = |place: String, position: DVec3, facing: Option<DVec3>| match surfaces.mount(&place, position, facing) {
        Ok(mount) => mount.map_or(position, |mount| mount.position()),
        Err(error) => {
            findings.push(Finding::from(error));
            position
        }
    };
    let poses = config.trajectory.as_ref().and_then(|t| trajectory::generate(t, POSES).ok()).unwrap_or_default();
    let place = format!("{}: trajectory", config.source.display());
    let poses: Vec<DVec3> = poses
        .iter()
        .map(|p| &p.world_from_camera)
        .map(|pose| mounted(place.clone(), pose.translation, Some(pose.transform_vector(DVec3::Z))))
        .collect();
    let named = config.transmitters.iter().map(|(name, t)| (format!("transmitters.{name}"), t));
    let file = config.source.display();
    let object = |index: u32| scene.objects[index as usize].name.as_str();
    let help = "move it out; if the object is a room, let its faces look into the room (turn their winding)";
    let all: Vec<(String, DVec3)> = std::iter::once(("transmitter".to_owned(), &config.transmitter))
        .chain(named)
        .map(|(key, t)| {
            let tx = mounted(format!("{file}: {key}.position_m"), t.position(), t.facing());
            (key, tx)
        })
        .collect();
    for (key, tx) in all {
        if let Some(at) = solids.parting(tx, tx) {
            let what = format!("{tx} lies inside the closed object \"{}\"", object(at.object));
            findings.push(Finding::error(format!("{file}: {key}.position_m"), what, help));
            continue;
        }
        // The way is closed: from each pose to the next, the first again behind the last.
        let legs = poses.iter().zip(poses.iter().cycle().skip(1));
        if let Some(distance_m) = legs.map(|(a, b)| distance_to_leg_m(tx, *a, *b)).min_by(f64::total_cmp) {
            let place = format!("{file}: {key}.position_m, of the platform's way");
            findings.extend(near_field::finding(&place, distance_m, config.radio.frequency_hz));
        }
        let parted = |p: &DVec3| solids.parting(tx, *p).filter(|at| at.holds_second != at.holds_first);
        if let Some((i, at)) = poses.iter().enumerate().find_map(|(i, p)| parted(p).map(|at| (i, at))) {
            let what = match at.holds_second {
                true => format!(
                    "at {}, {} % of the way, the platform is inside the closed object \"{}\"",
                    poses[i],
                    100 * i / POSES,
                    object(at.object)
                ),
                false => format!(
                    "at {} the platform leaves the closed object \"{}\" that holds the {key}",
                    poses[i],
                    object(at.object)
                ),
            };
            findings.push(Finding::error(format!("{file}: trajectory.waypoints_m"), what, help));
        }
    }
    findings.extend(outside_findings(config, scene, &poses));
    findings
}

/// Warnings of transmitters and of a way that lie outside of the box around all that the scene holds. That is sound around an open scene
/// (a wall, a piece of street), and a mistake of units, axes or origins around a room.
fn outside_findings(config: &SceneConfig, scene: &Scene, poses: &[DVec3]) -> Vec<Finding> {
    let Some(bounds) = scene.bounds() else { return Vec::new() };
    let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
    let beyond_m = |p: DVec3| (p - p.clamp(min, max)).length();
    let file = config.source.display();
    let help = format!(
        "the scene reaches from {min:.2} to {max:.2} m: nothing is wrong where it is meant to be open; otherwise check units, axes and origin"
    );
    let named = config.transmitters.iter().map(|(name, t)| (format!("transmitters.{name}"), t));
    let mut findings = Vec::new();
    for (key, transmitter) in std::iter::once(("transmitter".to_owned(), &config.transmitter)).chain(named) {
        let tx = transmitter.position();
        if beyond_m(tx) > 0.0 {
            let what = format!("{tx} lies {:.2} m outside of the scene", beyond_m(tx));
            findings.push(Finding::new(Severity::Warning, format!("{file}: {key}.position_m"), what, help.as_str()));
        }
    }
    let outside: Vec<&DVec3> = poses.iter().filter(|p| beyond_m(**p) > 0.0).collect();
    if let Some(farthest) = outside.iter().max_by(|a, b| beyond_m(***a).total_cmp(&beyond_m(***b))) {
        let share = (100 * outside.len()).div_ceil(poses.len());
        let what =
            format!("{share} % of the way lies outside of the scene, up to {:.2} m, as at {farthest:.2}", beyond_m(**farthest));
        findings.push(Finding::new(Severity::Warning, format!("{file}: trajectory"), what, help.as_str()));
    }
    findings
}

/// Distance of a point from the straight segment between two others, metres.
fn distance_to_leg_m(point: DVec3, from: DVec3, to: DVec3) -> f64 {
    let along = to - from;
    let t = ((point - from).dot(along) / along.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    point.distance(from + along * t)
}

/// The first error among findings, as one.
///
/// # Errors
/// That one.
pub fn refuse(findings: Vec<Finding>) -> Result<()> {
    match findings.into_iter().find(|f| f.severity == Severity::Error) {
        Some(Finding { place, what, help, .. }) => Err(Error::invalid(place, what, help)),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::from_toml;
    use crate::model::{Material, Object, Permittivity, RadioMaterial, Triangle};
    use glam::Vec3;

    fn scene() -> Scene {
        let radio = |itu: &str, thickness_m: f64| RadioMaterial {
            id: itu.into(),
            permittivity: Permittivity::Itu(itu.into()),
            thickness_m,
            scattering: Default::default(),
        };
        let material = |name: &str, radio| Material { name: name.into(), light: Default::default(), radio: Some(radio) };
        Scene {
            name: "test".into(),
            materials: vec![
                material("wall", radio("concrete", 0.1)),
                material("pane", radio("glass", 0.008)),
                material("bricks", radio("brick", 0.1)),
            ],
            ..Scene::default()
        }
    }

    /// Adds a box as one object; `faces` picks of −x, +x, −y, +y, −z, +z.
    fn add_box(scene: &mut Scene, name: &str, material: u32, min: Vec3, max: Vec3, faces: [bool; 6]) {
        let object = scene.objects.len() as u32;
        scene.objects.push(Object { name: name.into() });
        let first = scene.positions.len() as u32;
        scene.positions.extend((0..8).map(|i| Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), max, min)));
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        for (q, _) in quads.iter().zip(faces).filter(|(_, on)| *on) {
            for corners in [[q[0], q[1], q[2]], [q[0], q[2], q[3]]] {
                scene.triangles.push(Triangle { vertices: corners.map(|c| first + c), material, object });
            }
        }
    }

    const CLOSED: [bool; 6] = [true; 6];

    #[test]
    fn models_far_from_the_origin_are_told() {
        let mut scene = Scene { positions: vec![Vec3::new(-3.0, 400.0, 0.0)], ..Scene::default() };
        assert!(far_finding(&scene).is_none());
        scene.positions[0].x = 500_000.0;
        let finding = far_finding(&scene).unwrap().to_string();
        assert!(finding.contains("500000 m") && finding.contains("31.25 mm"), "{finding}");
    }

    #[test]
    fn a_body_with_a_hole_is_named_and_sheets_are_not() {
        let texts = |faces: [bool; 6]| {
            let mut s = scene();
            add_box(&mut s, "crate", 0, Vec3::ZERO, Vec3::ONE, faces);
            body_findings(&s).iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert!(texts(CLOSED).is_empty());
        let open = texts([true, true, true, true, true, false]);
        assert!(open.len() == 1 && open[0].contains("\"crate\"") && open[0].contains("4 open edges"), "{open:?}");
        assert_eq!(texts([true, true, true, true, false, false]).len(), 1);
        // A sheet and a corner of two of them.
        assert!(texts([true, false, false, false, false, false]).is_empty());
        assert!(texts([true, false, true, false, false, false]).is_empty());
    }

    #[test]
    fn a_hole_that_another_surface_closes_is_none() {
        let mut s = scene();
        add_box(&mut s, "house", 0, Vec3::ZERO, Vec3::ONE, [true, true, true, true, false, true]);
        assert_eq!(body_findings(&s).len(), 1);
        add_box(
            &mut s,
            "ground",
            0,
            Vec3::new(-5.0, -5.0, 0.0),
            Vec3::new(5.0, 5.0, 0.5),
            [false, false, false, false, true, false],
        );
        assert!(body_findings(&s).is_empty());
    }

    #[test]
    fn a_plate_of_two_slabs_thicker_than_itself_is_named() {
        let count = |depth: f32| {
            let mut s = scene();
            add_box(&mut s, "pane", 1, Vec3::ZERO, Vec3::new(depth, 1.0, 2.0), CLOSED);
            body_findings(&s)
                .iter()
                .filter(|f| f.to_string().contains("\"pane\"") && f.to_string().contains("2 x 8.0 mm"))
                .count()
        };
        assert_eq!((count(0.008), count(0.0159), count(0.016), count(0.1)), (1, 1, 0, 0));
    }

    #[test]
    fn only_materials_in_use_are_errors_and_all_of_them_are_said() {
        let mut s = scene();
        add_box(&mut s, "box", 0, Vec3::ZERO, Vec3::ONE, CLOSED);
        let unused = material_findings(&s, 60e9);
        assert!(
            unused.len() == 1 && unused[0].severity == Severity::Note && unused[0].to_string().contains("bricks"),
            "{unused:?}"
        );
        assert!(refuse(unused).is_ok());
        s.materials[0].radio.as_mut().unwrap().thickness_m = 0.0;
        s.triangles[0].material = 2;
        s.triangles[1].material = 1;
        s.materials[1].radio = None;
        let all: Vec<String> = material_findings(&s, 60e9).iter().map(ToString::to_string).collect();
        for (text, words) in all.iter().zip([["wall", "thickness_m"], ["pane", "no radio"], ["bricks", "40 GHz"]]) {
            assert!(words.iter().all(|w| text.contains(w)), "{all:?}");
        }
        assert!(all.len() == 3 && refuse(material_findings(&s, 60e9)).is_err());
    }

    #[test]
    fn antennas_inside_of_bodies_are_located() {
        let mut s = scene();
        add_box(&mut s, "room", 0, Vec3::ZERO, Vec3::new(8.0, 8.0, 3.0), CLOSED);
        add_box(&mut s, "pillar", 0, Vec3::new(3.0, 3.0, 0.0), Vec3::new(4.0, 4.0, 3.0), CLOSED);
        let texts = |tx: &str, waypoints: &str| {
            let text = format!(
                "[scene]\nfile = \"room.glb\"\n[transmitter]\nposition_m = {tx}\n[trajectory]\nheight_m = 1.5\nwaypoints_m = {waypoints}\n"
            );
            let config: SceneConfig = from_toml(&text, "t.toml").unwrap();
            placement_findings(&config, &s).iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        let around = "[[1.5, 1.5], [6.5, 1.5], [6.5, 6.5], [1.5, 6.5]]";
        assert!(texts("[1.0, 1.0, 2.0]", around).is_empty());
        let inside = texts("[3.5, 3.5, 2.0]", around);
        assert!(
            inside.len() == 1 && inside[0].contains("\"pillar\"") && inside[0].contains("transmitter.position_m"),
            "{inside:?}"
        );
        let through = texts("[1.0, 1.0, 2.0]", "[[1.5, 3.5], [6.5, 3.5], [6.5, 6.5], [1.5, 6.5]]");
        assert!(through.len() == 1 && through[0].contains("waypoints_m") && through[0].contains("\"pillar\""), "{through:?}");
        let outside = texts("[9.0, 1.0, 2.0]", around);
        assert!(outside.len() == 2 && outside[0].contains("\"room\""), "{outside:?}");
        assert!(outside[1].starts_with("warning") && outside[1].contains("lies 1.00 m outside of the scene"), "{outside:?}");
        // A wall alone surrounds nobody: that is told and not refused.
        let mut wall = scene();
        add_box(&mut wall, "wall", 0, Vec3::ZERO, Vec3::new(8.0, 0.2, 3.0), CLOSED);
        let text = "[scene]\nfile = \"w.glb\"\n[transmitter]\nposition_m = [1.0, 1.2, 2.0]\n[trajectory]\nheight_m = 1.5\nwaypoints_m = [[1, 1], [4, 1], [4, 3]]\n";
        let config: SceneConfig = from_toml(text, "t.toml").unwrap();
        let open = placement_findings(&config, &wall);
        assert!(open.len() == 2 && open.iter().all(|f| f.severity == Severity::Warning), "{open:?}");
        assert!(open[0].what.contains("1.00 m outside") && open[1].what.contains("100 % of the way"), "{open:?}");
        config.check_placement(&wall).unwrap();
    }
}
