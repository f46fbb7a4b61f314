//! Numbers that were wrong or not numbers at all with exit code 0: narrow lobes, antennas that touch, values beyond physics, sizes beyond
//! the memory.

use crate::common::*;
use corf_raytrace::spectrum::Grid;
use corf_scene::{Equirectangular, Pinhole, io};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// One triangle far away below, which nothing reaches: free space for the rest.
fn free_space(folder: &Path, more: &str) -> PathBuf {
    fs::write(folder.join("far.mtl"), "newmtl m\nKd 1 1 1\n").unwrap();
    fs::write(folder.join("far.obj"), "mtllib far.mtl\no far\nusemtl m\nv -90 -50 -89\nv -89 -50 -89\nv -89 -50 -90\nf 1 2 3\n")
        .unwrap();
    let path = folder.join("free.toml");
    let text = format!(
        "[scene]\nfile = \"far.obj\"\n[transmitter]\nposition_m = [0, 0, 0]\n[radio_materials.m]\nid = \"m\"\nitu = \"metal\"\nthickness_m = 0.01\n{more}"
    );
    fs::write(&path, text).unwrap();
    path
}

/// 20·log10(λ/4πd) at 60 GHz.
fn free_space_gain_db(distance_m: f64) -> f64 {
    let wavelength_m = 299_792_458.0 / 60e9;
    20.0 * (wavelength_m / (4.0 * std::f64::consts::PI * distance_m)).log10()
}

/// 10·log10 Σ P·dΩ of an image.
fn integral_db(path: &Path, grid: Grid) -> f64 {
    let image = io::read_exr_f32(path).unwrap();
    assert_eq!((image.width(), image.height()), (grid.width(), grid.height()));
    let sum: f64 = (0..image.pixels().len())
        .map(|i| f64::from(image.pixels()[i]) * grid.pixel_solid_angle_sr(i % image.width(), i / image.width()))
        .sum();
    10.0 * sum.log10()
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_lobe_narrower_than_a_pixel_keeps_its_power() {
    let folder = tempfile::tempdir().unwrap();
    let scene = shared("faults/lobes/s.toml").unwrap_or_else(|| free_space(folder.path(), ""));
    let expected = free_space_gain_db(5.0);
    assert!((expected + 81.99).abs() < 0.01);
    let mut number = 0;
    let mut check = |grid: Grid, towards: &str| {
        number += 1;
        let out = folder.path().join(format!("{number}"));
        let size = format!("{}x{}", grid.width(), grid.height());
        let kind = if matches!(grid, Grid::Sphere(_)) { "sphere" } else { "pinhole" };
        let more = ["--size", &size, "--grid", kind, "--towards", towards, "--out", text(&out), "--no-diffuse"];
        corf_ok(&[&["spectrum", text(&scene), "--rx", "5,0,0"], &more[..]].concat());
        let seen = integral_db(&out.join("mpc.exr"), grid);
        assert!((seen - expected).abs() < 0.05, "{size} {kind}, towards {towards}: {seen:.2} dB instead of {expected:.2}");
    };
    // A pixel of 32 columns is 3.6 degrees in the middle: looking 0 to 0.3 m aside moves the lobe across one.
    for towards in ["0,0,0", "0,0.08,0", "0,0.16,0.16", "0,0.23,0.05", "0,0.31,0.2"] {
        for (width, height) in [(32, 24), (10, 8), (96, 64)] {
            check(Grid::Pinhole(Pinhole::from_horizontal_fov(width, height, 90.0)), towards);
        }
        check(Grid::Sphere(Equirectangular { width: 72, height: 36 }), towards);
    }
    // The transmitter at the sphere's pole.
    check(Grid::Sphere(Equirectangular { width: 72, height: 36 }), "5,0,1");
}

#[test]
fn a_lobe_that_does_not_fit_is_told_what_would() {
    let refused = |lobe: &str, directions: &str, words: &[&str]| {
        let arguments = ["spectrum", "scenes/lobby.toml", "--rx", "7.4,1.95,1.6", "--out", "/nonexistent/out"];
        corf_refuses(&[&arguments[..], &["--lobe-deg", lobe, "--directions", directions]].concat(), words);
    };
    refused("2", "250000", &["wider", "at most 1 degree"]);
    refused("0.5", "100000", &["narrower", "at least 372000 directions", "0.964 to 1 degree"]);
    refused("1", "10000", &["at least 93000 directions"]);
    refused("1e-300", "250000", &["0.01 to 90 degrees"]);
}

#[test]
fn antennas_within_two_wavelengths_are_doubtful_and_touching_ones_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = free_space(folder.path(), "");
    let paths = |rx: &str, more: &[&str]| corf(&[&["paths", text(&scene), "--rx", rx], more].concat());
    let said = |output: &std::process::Output| String::from_utf8_lossy(&output.stderr).into_owned();
    // λ/2π = 0.795 mm.
    for rx in ["1e-6,0,0", "0,0.00079,0", "0,0,0"] {
        corf_refuses(&["paths", text(&scene), "--rx", rx], &["receiver at", "transmitter", "795.2"]);
        corf_refuses(&["diffuse", text(&scene), "--rx", rx], &["receiver at", "transmitter"]);
        let out = folder.path().join("refused");
        corf_refuses(
            &["spectrum", text(&scene), "--rx", rx, "--towards", "1,0,0", "--out", text(&out), "--no-diffuse"],
            &["receiver at", "transmitter"],
        );
        assert!(!out.exists());
    }
    let near = paths("0,0.0009,0", &[]);
    assert_eq!(near.status.code(), Some(0));
    assert!(said(&near).contains("warning: receiver: it is 900.000 µm from the transmitter"), "{}", said(&near));
    let value: Value = serde_json::from_slice(&near.stdout).unwrap();
    assert!((value["total_power_db"].as_f64().unwrap() - free_space_gain_db(0.9e-3)).abs() < 1e-6);
    assert!(said(&paths("0,0.0099,0", &[])).contains("9.90 mm"));
    assert!(!said(&paths("0,0.0101,0", &[])).contains("warning"));
    // Of arrays the nearest elements count: eight columns half a wavelength apart reach 8.74 mm to the side.
    let array = ["--rx-array", "8x8"];
    assert!(said(&paths("0,0.018,0", &array)).contains("warning: receiver"));
    corf_refuses(&[&["paths", text(&scene), "--rx", "0,0.00874,0.00125"], &array[..]].concat(), &["receiver at", "µm"]);
}

#[test]
fn a_coverage_cell_at_the_transmitter_is_left_out_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let scene = free_space(folder.path(), "");
    let out = folder.path().join("map");
    // 5 x 5 cells of 2 mm, the transmitter at the centre of the middle one.
    let plane = ["--plane", "-0.005,-0.005,0", "0.005,-0.005,0", "-0.005,0.005,0", "--cell", "0.002"];
    let output = corf(&[&["coverage", text(&scene), "--out", text(&out), "--json"], &plane[..]].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("warning: coverage plane: 24 cells are within 2 wavelengths"), "{said}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["cells_without_value"], 1);
    assert_eq!(report["cells_too_near_a_transmitter"]["excluded"], 1);
    assert_eq!(report["cells_too_near_a_transmitter"]["doubtful"], 24);
    let map = io::read_exr_f32(out.join("coverage.exr")).unwrap();
    assert!(map[(2, 2)].is_nan());
    assert!((10.0 * f64::from(map[(3, 2)]).log10() - free_space_gain_db(2e-3)).abs() < 1e-3);
}

#[test]
fn a_dataset_whose_platform_passes_the_transmitter_is_refused_before_a_file() {
    let folder = tempfile::tempdir().unwrap();
    // The loop passes its first waypoint, where keyframe 0 stands.
    let way = "[trajectory]\nheight_m = 0.0\nheight_amplitude_m = 0\nwaypoints_m = [[0.0005, 0], [3, 1], [3, 3]]\n";
    let scene = free_space(folder.path(), way);
    let config = folder.path().join("d.toml");
    let body = "name = \"d\"\nscene = \"free.toml\"\nkeyframes = 4\n[optical]\nwidth = 8\nheight = 8\nsamples_per_pixel = 1\n[rf]\nwidth = 8\nheight = 8\ndiffuse = false\n";
    fs::write(&config, body).unwrap();
    let out = folder.path().join("out");
    corf_refuses(
        &["dataset", "generate", text(&config), "--out", text(&out)],
        &["of the platform's way", "µm from the transmitter"],
    );
    assert!(!out.exists());
    let validated = corf(&["scene", "validate", text(&scene)]);
    assert_eq!(validated.status.code(), Some(1));
}

/// A room of concrete with its own permittivity, a lamp in the MTL file, and a dataset file beside it.
fn room(folder: &Path, material: &str, emission: &str, scale: f64, dataset: &str) -> (PathBuf, PathBuf) {
    let mut obj = String::from("mtllib r.mtl\no room\nusemtl m\n");
    for i in 0..8 {
        let corner = |bit: usize, side: f64| if i >> bit & 1 > 0 { side * scale } else { 0.0 };
        obj += &format!("v {} {} {}\n", corner(0, 6.0), corner(1, 5.0), corner(2, 3.0));
    }
    obj += "f 1 5 7 3\nf 2 4 8 6\nf 1 2 6 5\nf 3 7 8 4\nf 1 3 4 2\nf 5 6 8 7\n";
    fs::write(folder.join("r.obj"), obj).unwrap();
    fs::write(folder.join("r.mtl"), format!("newmtl m\nKd 0.5 0.5 0.5\nKe {emission}\n")).unwrap();
    let scene = folder.join("room.toml");
    let way = "[trajectory]\nwaypoints_m = [[2, 2], [4, 2], [4, 4]]\nheight_m = 1.5\n";
    let text = format!(
        "[scene]\nfile = \"r.obj\"\n[transmitter]\nposition_m = [1, 1, 2]\n[radio_materials.m]\nid = \"m\"\nscattering_coefficient = 0.3\n{material}\n{way}"
    );
    fs::write(&scene, text).unwrap();
    let config = folder.join("d.toml");
    let defaults = "name = \"d\"\nscene = \"room.toml\"\nkeyframes = 2\n[optical]\nwidth = 8\nheight = 6\nsamples_per_pixel = 1\nmax_bounces = 2\n[rf]\nwidth = 8\nheight = 6\npatch_size_m = 0.5\ndirections = 100000\nphotons = 1000\nrays = 1000\nmax_interactions = 2\n";
    let (from, to) = dataset.split_once('|').unwrap_or_default();
    let text = defaults.replace(from, to);
    assert!(from.is_empty() || text != defaults, "{from}");
    fs::write(&config, text).unwrap();
    (scene, config)
}

const CONCRETE: &str = "relative_permittivity = 5.24\nconductivity_s_per_m = 1.1\nthickness_m = 0.1";

#[test]
fn numbers_beyond_physics_are_refused_where_they_stand() {
    let folder = tempfile::tempdir().unwrap();
    for (from, to, words) in [
        ("5.24", "1e300", ["relative_permittivity = 1e300", "1 to 1e5"]),
        ("1.1", "1e300", ["conductivity_s_per_m = 1e300", "1e9"]),
        ("0.1", "1e-300", ["thickness_m = 1e-300", "above 0"]),
    ] {
        let (scene, _) = room(folder.path(), &CONCRETE.replace(from, to), "1 1 1", 1.0, "");
        corf_refuses(&["paths", text(&scene), "--rx", "4,3,1.5"], &words);
    }
    let (scene, config) = room(folder.path(), CONCRETE, "1 1 1", 1.0, "");
    let scene = text(&scene);
    let out = folder.path().join("out");
    let paths = ["paths", scene, "--rx", "4,3,1.5"];
    let spectrum = ["spectrum", scene, "--rx", "4,3,1.5", "--no-diffuse", "--out", text(&out)];
    for (command, more, words) in [
        (&paths[..], "--tx-power-dbm=1e308", ["tx_power_dbm", "dBm"]),
        (&paths, "--tx=1e308,0,0", ["1e308", "metres"]),
        (&paths, "--rx=1e7,0,0", ["1e7", "metres"]),
        (&spectrum, "--towards=1e308,0,0", ["1e308", "metres"]),
        (&spectrum, "--range-db=1e300", ["dynamic_range_db", "1 to 80"]),
        (&spectrum, "--range-db=1e-300", ["dynamic_range_db", "1 to 80"]),
        (&spectrum, "--bandwidth=1e300", ["bandwidth_hz", "hertz"]),
        (&spectrum, "--fov-deg=1e-300", ["horizontal_fov_deg", "0.01 to 179"]),
    ] {
        corf_refuses(&[command, &[more]].concat(), &words);
    }
    let scene_text = fs::read_to_string(scene).unwrap();
    for (from, to, words) in [
        ("[1, 1, 2]", "[1e38, 1, 2]", ["transmitter.position_m", "metres"]),
        ("[[2, 2]", "[[1e38, 2]", ["waypoints_m[0]", "metres"]),
        ("[radio_materials", "[radio]\nfrequency_hz = 1e300\n[radio_materials", ["radio.frequency_hz", "hertz"]),
        ("[radio_materials", "[receiver]\nspacing_wavelengths = 1e300\n[radio_materials", ["spacing_wavelengths", "wavelengths"]),
    ] {
        fs::write(scene, scene_text.replace(from, to)).unwrap();
        corf_refuses(&paths, &words);
        corf_refuses(&["dataset", "generate", text(&config), "--out", text(&out)], &words);
    }
    assert!(!out.exists());
}

#[test]
fn light_beyond_physics_and_vertices_beyond_the_earth_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let (_, config) = room(folder.path(), CONCRETE, "1e38 1e38 1e38", 1.0, "");
    corf_refuses(&["dataset", "generate", text(&config), "--out", text(&out)], &["material \"m\"", "emits"]);
    let (scene, config) = room(folder.path(), CONCRETE, "1 1 1", 1e30, "");
    corf_refuses(&["paths", text(&scene), "--rx", "4,3,1.5"], &["vertex", "metres"]);
    corf_refuses(&["dataset", "generate", text(&config), "--out", text(&out)], &["vertex", "metres"]);
    assert!(!out.exists());
    // What is bright but possible is rendered.
    let (_, config) = room(folder.path(), CONCRETE, "1e8 1e8 1e8", 1.0, "");
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&out)]);
}

#[test]
fn sizes_are_refused_before_the_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    // A model in hundredths of a millimetre instead of metres: 600 km by 500 km in patches of half a metre.
    let (scene, config) = room(folder.path(), CONCRETE, "1 1 1", 1e5, "");
    let words = ["patches of 0.5 m", "GB", "in metres"];
    corf_refuses(&["dataset", "generate", text(&config), "--out", text(&out)], &words);
    corf_refuses(&["diffuse", text(&scene), "--rx", "4,3,1.5", "--patch-size", "0.5", "--directions", "1000"], &words);
    // Patches as large as a town fit; tiles of light on half a million square kilometres do not.
    let (_, config) = room(folder.path(), CONCRETE, "1 1 1", 1e5, "patch_size_m = 0.5|patch_size_m = 900");
    corf_refuses(&["dataset", "generate", text(&config), "--out", text(&out)], &["tiles of light", "in metres", "method path"]);
    for (change, words) in [
        ("keyframes = 2|keyframes = 1000000000", ["keyframes", "at most 100000"]),
        ("photons = 1000\n|photons = 1000000000\n", ["rf.photons", "100 000 000"]),
        ("rays = 1000\n|rays = 1000000000\n", ["rf.rays", "100 000 000"]),
        ("samples_per_pixel = 1|samples_per_pixel = 4000000000", ["samples_per_pixel", "65536"]),
        ("max_bounces = 2|max_bounces = 4000000000", ["max_bounces", "1024"]),
        ("patch_size_m = 0.5|patch_size_m = 1e300", ["patch_size_m", "1000 m"]),
    ] {
        let (_, config) = room(folder.path(), CONCRETE, "1 1 1", 1.0, change);
        corf_refuses(&["dataset", "generate", text(&config), "--out", text(&out)], &words);
    }
    let (scene, _) = room(folder.path(), CONCRETE, "1 1 1", 1.0, "");
    let scene = text(&scene);
    let paths = ["paths", scene, "--rx", "4,3,1.5"];
    for (more, words) in [
        (&["--threads", "0"][..], ["--threads", "1..=1024"]),
        (&["--threads", "1000000000"], ["--threads", "1..=1024"]),
        (&["--rays", "1000000000000"], ["rays", "100 000 000"]),
        (&["--rx-trajectory", "1000000000000"], ["--rx-trajectory", "at most 1000000"]),
        (&["--bandwidth", "1e11", "--subcarriers", "1000000000000"], ["--subcarriers", "at most"]),
        (&["--tx-array", "64x64", "--rx-array", "64x64", "--rx-trajectory", "900000"], ["receivers", "GB"]),
    ] {
        corf_refuses(&[&paths, more].concat(), &words);
    }
    corf_refuses(&["coverage", scene, "--height", "1.5", "--cell", "1e-300", "--out", text(&out)], &["cells", "16 million"]);
    corf_refuses(&["diffuse", scene, "--rx", "4,3,1.5", "--replicas", "1000000000000"], &["--replicas"]);
    assert!(!out.exists());
}

#[test]
fn an_image_one_pixel_wide_is_metered_in_no_time() {
    let folder = tempfile::tempdir().unwrap();
    let (_, config) =
        room(folder.path(), CONCRETE, "1 1 1", 1.0, "width = 8\nheight = 6\nsamples|width = 1\nheight = 4000\nsamples");
    let out = folder.path().join("out");
    let started = std::time::Instant::now();
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&out)]);
    // 64 columns and as many times the rows were 16 million pixels in each of two poses.
    assert!(started.elapsed().as_secs() < 60);
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_way_or_a_ray_beyond_all_numbers_ends() {
    let Some(tiny) = shared("faults/fuzz/bvh/tiny.toml") else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    corf_refuses(&["dataset", "generate", text(&tiny), "--out", text(&out)], &["waypoints_m[1]", "1e38", "metres"]);
    assert!(!out.exists());
}

#[test]
fn constants_with_which_a_reconstruction_diverges_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    for (setting, words) in [
        ("optimizer.epsilon=0.0", ["optimizer.epsilon", "1e-30"]),
        ("optimizer.rf.sh_dc=1e30", ["optimizer.rf.sh_dc", "0 to 10"]),
        ("rf_weight=1e38", ["rf_weight", "1e6"]),
        ("depth.far_m=1e300", ["depth.far_m", "1e6"]),
        ("raster.near_m=1e-30", ["raster.near_m", "1e-6"]),
    ] {
        let arguments = ["reconstruct", text(tiny_dataset()), "--method", "corf-gs", "--out", text(&out), "--set", setting];
        corf_refuses(&arguments, &words);
        assert!(!out.join("run.json").exists());
    }
}
