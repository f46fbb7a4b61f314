//! Depth priors that are not made here: maps in a folder, a network's weights; and none at all, where a dataset has no depth.

use crate::common::*;
use corf_scene::dataset::Dataset;
use corf_scene::io::{encode_exr_f32, encode_png16, write_atomic};
use corf_scene::npz::{Array, Values};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// Fewer steps than by default, for time; with a quarter of these, chance decides more than depth does.
const STEPS: &str = "iterations_per_keyframe=40";

/// Options of `corf reconstruct`, each behind its own `--set`.
fn reconstruct<'a>(dataset: &'a Path, out: &'a Path, options: &'a [String]) -> Vec<&'a str> {
    let mut arguments = vec!["reconstruct", text(dataset), "--out", text(out), "--set", STEPS];
    options.iter().for_each(|o| arguments.extend(["--set", o]));
    arguments
}

fn folder_options(folder: &Path, kind: &str) -> Vec<String> {
    vec!["depth.prior=\"folder\"".into(), format!("depth.folder={folder:?}"), format!("depth.folder_kind=\"{kind}\"")]
}

/// A map of each keyframe's depth under its image's name, as `write` makes it of the depth in metres.
fn maps(folder: &Path, write: impl Fn(&Path, &str, &corf_scene::Raster<f32>)) -> PathBuf {
    let dataset = Dataset::open(tiny_dataset()).unwrap();
    for index in 0..dataset.len() {
        let depth = dataset.keyframe(index).unwrap().light.unwrap().depth_m.unwrap();
        write(folder, &format!("{:05}", index + 1), &depth);
    }
    folder.to_owned()
}

fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// PSNR of light and RF of a run's evaluation, and whether it says that it used ground truth.
fn evaluated(run: &Path) -> (f64, f64, bool) {
    let metrics: Value = serde_json::from_str(&corf_ok(&["evaluate", text(run), "--json"])).unwrap();
    let mean = |key: &str| metrics["means"][key].as_f64().unwrap();
    (mean("psnr_opt"), mean("psnr_rf_jet"), metrics["uses_ground_truth_depth"].as_bool().unwrap())
}

#[test]
fn a_folder_of_maps_serves_as_well_as_the_depth_it_was_made_of() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    // Exact depth in three units: aligned, all say the same, but for the digits of a PNG.
    let relative = maps(&place("relative"), |folder, stem, depth| {
        let inverse = depth.map(|z| if *z > 0.0 && z.is_finite() { 7.0 / z + 0.3 } else { 0.0 });
        let shape = [depth.height(), depth.width()];
        write_atomic(folder.join(format!("{stem}.npy")), &Array::new("x", &shape, Values::F32(inverse.into_vec())).to_npy())
            .unwrap();
    });
    let metres = maps(&place("metres"), |folder, stem, depth| {
        write_atomic(folder.join(format!("{stem}.exr")), &encode_exr_f32(depth, "Z").unwrap()).unwrap();
    });
    let millimetres = maps(&place("millimetres"), |folder, stem, depth| {
        let values = depth.map(|z| (5000.0 * z).round().clamp(0.0, 65535.0) as u16);
        write_atomic(folder.join(format!("{stem}.png")), &encode_png16(&values).unwrap()).unwrap();
    });
    let mut png = folder_options(&millimetres, "depth-metric");
    png.push("depth.png_scale=5000".into());
    let simulated = place("simulated-run");
    corf_ok(&reconstruct(tiny_dataset(), &simulated, &[]));
    let (light, _, owned_up) = evaluated(&simulated);
    assert!(owned_up);
    for (name, options) in
        [("npy", folder_options(&relative, "inverse-relative")), ("exr", folder_options(&metres, "depth-relative")), ("png", png)]
    {
        let run = place(name);
        corf_ok(&reconstruct(tiny_dataset(), &run, &options));
        let info = json_of(&run.join("run.json"));
        assert_eq!(info["config"]["reconstruction"]["depth"]["prior"], "folder");
        let (psnr, _, owned_up) = evaluated(&run);
        assert!(!owned_up, "{name}: what is in a folder is not known to be ground truth");
        // Depth without error: not worse than the simulated prior's by more than chance, which is 1.3 dB from seed to seed on so little (10.3 to 12.9
        // dB; exact depth 12.7 to 13.0).
        assert!(psnr > light - 1.3, "{name}: {psnr} dB, the simulated prior {light} dB");
    }

    // The same maps and seed give the same bytes.
    let (whole, options) = (place("npy"), folder_options(&relative, "inverse-relative"));
    let again = place("again");
    corf_ok(&reconstruct(tiny_dataset(), &again, &options));
    assert!(fs::read(whole.join("coupled.ply")).unwrap() == fs::read(again.join("coupled.ply")).unwrap());

    // What is wrong with one map is said before anything is begun.
    let last = relative.join("00010.npy");
    let out = place("refused");
    fs::write(&last, &fs::read(&last).unwrap()[..500]).unwrap();
    corf_refuses(&reconstruct(tiny_dataset(), &out, &options), &["00010.npy", "help"]);
    let wide = Array::new("x", &[54, 54], Values::F32(vec![1.0; 54 * 54])).to_npy();
    fs::write(&last, wide).unwrap();
    corf_refuses(&reconstruct(tiny_dataset(), &out, &options), &["00010.npy", "keyframe 9", "54x54", "96x54"]);
    fs::remove_file(&last).unwrap();
    corf_refuses(&reconstruct(tiny_dataset(), &out, &options), &["keyframe 9", "00010.npy", "depth_prior.py"]);
    let absent = folder_options(&place("absent"), "inverse-relative");
    corf_refuses(&reconstruct(tiny_dataset(), &out, &absent), &["absent", "no such folder"]);
    corf_refuses(&reconstruct(tiny_dataset(), &out, &["depth.prior=\"folder\"".into()]), &["depth.folder"]);
    assert!(!out.exists());
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn weights_serve_as_a_prior_and_others_are_refused() {
    let Some(weights) = shared("weights/depth_anything_tiny/model.safetensors") else { return };
    let weights = weights.canonicalize().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (run, out) = (folder.path().join("run"), folder.path().join("refused"));
    let options = |weights: &Path| {
        vec!["depth.prior=\"depth-anything\"".into(), format!("depth.weights={weights:?}"), "depth.input_px=56".into()]
    };
    corf_ok(&reconstruct(tiny_dataset(), &run, &options(&weights)));
    assert!(!evaluated(&run).2);
    let cut = folder.path().join("cut.safetensors");
    fs::write(&cut, &fs::read(&weights).unwrap()[..5000]).unwrap();
    corf_refuses(&reconstruct(tiny_dataset(), &out, &options(&cut)), &["cut.safetensors", "help"]);
    corf_refuses(&reconstruct(tiny_dataset(), &out, &["depth.prior=\"depth-anything\"".into()]), &["depth.weights"]);
    assert!(!out.exists());
}

#[test]
fn without_a_prior_a_dataset_needs_no_depth() {
    let folder = tempfile::tempdir().unwrap();
    let (blind, run, out) = (folder.path().join("blind"), folder.path().join("run"), folder.path().join("refused"));
    copy_folder(tiny_dataset(), &blind);
    // As a dataset of photographs would be: neither depth nor surfaces, on disk or in the list of files.
    let mut header = json_of(&blind.join("dataset.json"));
    header["files"].as_object_mut().unwrap().retain(|name, _| {
        let stays = !["optical/depth", "optical/surfaces"].iter().any(|folder| name.starts_with(folder));
        if !stays {
            fs::remove_file(blind.join(name)).unwrap();
        }
        stays
    });
    fs::write(blind.join("dataset.json"), serde_json::to_vec_pretty(&header).unwrap()).unwrap();
    corf_ok(&reconstruct(&blind, &run, &["depth.prior=none".into()]));
    let (light, radio, owned_up) = evaluated(&run);
    // Seeds 1 to 3: 8.1 to 10.4 dB of light, 9.3 to 9.5 of RF; a third less is no field.
    assert!(light > 6.0 && radio > 7.0 && !owned_up, "{light} {radio}");
    let poses = blind.join("trajectory.json");
    corf_ok(&["render", text(&run), "--poses", text(&poses), "--out", text(&folder.path().join("views"))]);
    // The default prior says what it lacks, and what to do.
    corf_refuses(&reconstruct(&blind, &out, &[]), &["the data set has none", "depth.prior=none"]);
}
