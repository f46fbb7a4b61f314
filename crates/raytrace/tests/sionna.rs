//! The tracer against reference paths in f64, and proof that the comparison can fail.

#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::print_stderr)]

#[path = "../../../tests/shared.rs"]
mod reference_data;

use corf_raytrace::sionna::{self, Reference, SpecularReference};
use reference_data::shared;

fn specular(name: &str) -> Option<SpecularReference> {
    let path = shared(&format!("sionna/{name}.json"))?;
    match Reference::load(&path).unwrap() {
        Reference::Specular(reference) => Some(reference),
        Reference::Diffuse(_) => panic!("{name} is not a specular reference"),
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn every_reference_path_is_found_and_nothing_else() {
    for (name, comparisons) in [("box_room", 3), ("metal_obstacles", 3), ("glass_partition", 6)] {
        let Some(path) = shared(&format!("sionna/{name}.json")) else { continue };
        let report = sionna::check(&path).unwrap();
        println!("{report}");
        assert_eq!(report.comparisons.len(), comparisons);
        assert!(report.passed, "{report}");
    }
}

#[test]
fn a_room_of_tilted_faces_agrees() {
    // Made by tools/check_rooms.py. Some coefficients are those of a triangle's own plane, not of the one it shares with the rest of its face.
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/references/attic-specular.json");
    let report = sionna::check(&path).unwrap();
    let paths: usize = report.comparisons.iter().map(|c| c.matched).sum();
    assert!(report.passed && paths == 380, "{paths} {report}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn two_percent_more_permittivity_in_the_glass_fails() {
    for name in ["box_room", "metal_obstacles", "glass_partition"] {
        let Some(mut reference) = specular(name) else { continue };
        reference.materials.get_mut("m_glass").unwrap().eps_r *= 1.02;
        assert!(!sionna::check_specular(&reference).unwrap().passed, "{name}");
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_path_too_few_or_too_many_fails() {
    let Some(reference) = specular("box_room") else { return };
    let mut fewer = reference.clone();
    fewer.configs[0].rx_results[1].paths.remove(20);
    let report = sionna::check_specular(&fewer).unwrap();
    assert!(!report.passed && report.comparisons[1].extra.len() == 1);
    let mut more = reference.clone();
    let mut invented = more.configs[0].rx_results[1].paths[20].clone();
    invented.vertices[0][0] += 0.1;
    more.configs[0].rx_results[1].paths.push(invented);
    let report = sionna::check_specular(&more).unwrap();
    assert!(!report.passed && report.comparisons[1].missing.len() == 1);
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn what_cannot_be_compared_is_said() {
    let Some(reference) = specular("metal_obstacles") else { return };
    let mut without_angles = reference.clone();
    for path in &mut without_angles.configs[0].rx_results[0].paths {
        (path.aoa, path.delay_s) = (None, None);
    }
    let report = sionna::check_specular(&without_angles).unwrap();
    assert!(report.passed, "{report}");
    let notes = report.comparisons[0].notes.join("; ");
    assert!(notes.contains("angle of arrival") && notes.contains("delay") && !notes.contains("departure"), "{notes}");
    assert!(report.to_string().contains("not compared"));
    let mut nothing = reference.clone();
    nothing.configs[0].rx_results.clear();
    let error = sionna::check_specular(&nothing).unwrap_err().to_string();
    assert!(error.contains("rx_results is empty") && error.contains(&nothing.configs[0].name), "{error}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn without_a_line_of_sight_slabs_are_still_seen_through() {
    let Some(mut reference) = specular("glass_partition") else { return };
    let with_slabs = reference.configs.iter().position(|c| c.args.refraction).unwrap();
    reference.configs.drain(..with_slabs);
    reference.configs[0].args.los = false;
    assert!(!sionna::check_specular(&reference).unwrap().passed, "one receiver is in line of sight");
    let results = reference.configs[0].rx_results.iter_mut();
    results.for_each(|result| result.paths.retain(|path| !path.types.is_empty()));
    let straight = reference.configs[0].rx_results.iter().flat_map(|r| &r.paths).any(|path| path.types == "R");
    let report = sionna::check_specular(&reference).unwrap();
    assert!(straight && report.passed, "{report}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn the_antennas_are_the_files() {
    let Some(path) = shared("sionna/box_room.json") else { return };
    let with = |pattern: &str, polarization: &str| {
        let mut file: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        file["antennas"] =
            serde_json::json!({ "pattern": pattern, "polarization": polarization, "orientation": [0.3, 0.0, 0.0] });
        let reference: Result<SpecularReference, _> = serde_json::from_value(file);
        reference.map_err(|e| e.to_string()).and_then(|r| sionna::check_specular(&r).map_err(|e| e.to_string()))
    };
    // Turned about the vertical, an isotropic element is the same, and a dipole is another one.
    assert!(with("iso", "V").unwrap().passed);
    assert!(!with("dipole", "V").unwrap().passed && !with("iso", "H").unwrap().passed);
    assert!(with("cross-eyed", "V").unwrap_err().contains("cross-eyed"));
    assert!(with("iso", "VH").unwrap_err().contains("two ports"));
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn diffraction_is_traced_where_the_reference_asks_for_it() {
    // The cabinet's vertical edges and those of its top diffract, as one body and as loose quads alike; sionna-rt was asked for none.
    let Some(mut reference) = specular("metal_obstacles") else { return };
    reference.configs[0].args.diffraction = true;
    let edges = |report: &sionna::CheckReport| report.comparisons[0].extra.iter().filter(|path| path.contains('X')).count();
    let of_quads = edges(&sionna::check_specular(&reference).unwrap());
    let side = |o: &sionna::ReferenceObject| o.name.starts_with("cabinet");
    let triangles = reference.objects.iter().filter(|o| side(o)).flat_map(|o| o.triangles.clone()).collect();
    let material = reference.objects.iter().find(|o| side(o)).unwrap().material.clone();
    reference.objects.retain(|o| !side(o));
    reference.objects.push(sionna::ReferenceObject { name: "cabinet".into(), material, triangles });
    let report = sionna::check_specular(&reference).unwrap();
    let edges = edges(&report);
    assert_eq!(edges, of_quads);
    assert!(!report.passed && edges > 20, "{edges}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn diffuse_power_and_the_bartlett_map_agree() {
    let Some(path) = shared("sionna/box_room_diffuse.json") else { return };
    let report = sionna::check(&path).unwrap();
    println!("{report}");
    assert_eq!(report.comparisons.len(), 6);
    assert!(report.passed, "{report}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn one_percent_more_scattering_fails() {
    let Some(path) = shared("sionna/box_room_diffuse.json") else { return };
    let Reference::Diffuse(mut reference) = Reference::load(&path).unwrap() else { panic!("not a diffuse reference") };
    reference.cases.truncate(1);
    reference.cases[0].rx_results.truncate(1);
    reference.materials.get_mut("m_concrete").unwrap().scattering_coefficient *= 1.01;
    let report = sionna::check_diffuse(&reference).unwrap();
    assert!(!report.passed, "{report}");
}
