//! Another transmitter in a room that is known: data sets that share their light, and radio learnt on the geometry of a finished run.

use crate::common::*;
use corf::Field;
use corf_scene::dataset::Dataset;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A place for another transmitter, in the north arm of the lobby.
const TX: &str = "2.2,11.0,2.4";

/// The tiny data set's pair with another transmitter, and a run on the first of the two.
struct Pair {
    folder: tempfile::TempDir,
}

impl Pair {
    fn get() -> &'static Self {
        static PAIR: OnceLock<Pair> = OnceLock::new();
        PAIR.get_or_init(|| {
            let pair = Self { folder: tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap() };
            let config = pair.config();
            corf_ok(&[
                "dataset",
                "generate",
                text(&config),
                "--out",
                text(&pair.dataset()),
                "--tx",
                TX,
                "--light-from",
                text(tiny_dataset()),
            ]);
            let run = pair.run();
            corf_ok(&["reconstruct", text(tiny_dataset()), "--out", text(&run), "--set", "iterations_per_keyframe=20"]);
            pair
        })
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The configuration of the tiny data set.
    fn config(&self) -> PathBuf {
        tiny_cached_config(self.folder.path(), 10)
    }

    fn dataset(&self) -> PathBuf {
        self.at("pair")
    }

    fn run(&self) -> PathBuf {
        self.at("run")
    }
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The files of light of a data set with their hashes.
fn light_files(dataset: &Dataset) -> Vec<(String, String)> {
    let of_light = |path: &str| ["optical/images/", "optical/depth/", "optical/surfaces/"].iter().any(|f| path.starts_with(f));
    dataset.listed_files().filter(|file| of_light(file.0)).map(|file| (file.0.to_owned(), file.2.to_owned())).collect()
}

#[test]
fn a_pair_has_the_light_of_the_first_and_radio_of_its_own() {
    let pair = Pair::get();
    let [first, second] = [tiny_dataset(), &pair.dataset()].map(|folder| Dataset::open(folder).unwrap());
    assert!(light_files(&first).len() == 30 && light_files(&first) == light_files(&second));
    assert_eq!(second.header().light_from.as_ref().unwrap().dataset_hash, first.hash());
    assert_eq!(second.header().exposure_ev, first.header().exposure_ev);
    assert_eq!(second.header().transmitter.unwrap().position_m, [2.2, 11.0, 2.4]);
    let spectrum = |dataset: &Dataset| dataset.keyframe(3).unwrap().radio.unwrap().spectrum;
    assert_ne!(spectrum(&first), spectrum(&second));
    corf_ok(&["dataset", "validate", text(&pair.dataset())]);

    // The same radio, traced beside light of its own.
    let alone = pair.at("alone");
    let base = ["dataset", "generate", text(&pair.config()), "--tx", TX, "--out"].map(str::to_owned);
    let base: Vec<&str> = base.iter().map(String::as_str).collect();
    corf_ok(&[&base[..], &[text(&alone), "--device", "cpu"]].concat());
    let alone = Dataset::open(alone).unwrap();
    assert_eq!(spectrum(&alone), spectrum(&second));
    assert_eq!(light_files(&alone), light_files(&second));

    // What is missing is made by --resume, to the same bytes; a finished one is left as it is.
    let from = ["--light-from", text(tiny_dataset())];
    let resumed = pair.at("resumed");
    let code = interrupt_when(&[&base[..], &[text(&resumed)], &from].concat(), || resumed.join("progress/00002.json").exists());
    assert!(matches!(code, Some(0 | 130)), "{code:?}");
    for _ in 0..2 {
        corf_ok(&[&base[..], &[text(&resumed), "--resume"], &from].concat());
        assert_eq!(Dataset::open(&resumed).unwrap().hash(), second.hash());
    }
    corf_refuses(&[&base[..], &[text(&resumed), "--resume"]].concat(), &["light_from", "another configuration"]);
}

#[test]
fn light_is_taken_from_where_it_would_be_the_same() {
    let pair = Pair::get();
    let (config, out) = (pair.config(), pair.at("no"));
    let base = ["dataset", "generate", text(&config), "--out", text(&out), "--light-from"];
    for (more, words) in [
        (&["--set", "optical.max_bounces=3"][..], &["optical.max_bounces: 64 there, 3 here"][..]),
        (&["--set", "optical.width=100"], &["optical_camera.width: 96 there, 100 here"]),
        (&["--seed", "4"], &["seed: 3 there, 4 here"]),
        (&["--keyframes", "9"], &["10 keyframes there, 9 here"]),
        (&["--set", "way=[0.0, 0.5]"], &["the pose of keyframe 1"]),
    ] {
        let words = [words, &["its light is not the one", "only the transmitter, the carrier"]].concat();
        corf_refuses(&[&base[..], &[text(tiny_dataset())], more].concat(), &words);
    }
    corf_refuses(&[&base[..], &[text(tiny_dataset()), "--device", "cpu"]].concat(), &["--light-from", "--device"]);
    corf_refuses(&[&base[..], &[text(tiny_dataset()), "--tx", "9,0"]].concat(), &["not three numbers"]);
    corf_refuses(&[&base[..], &[text(tiny_dataset()), "--frequency", "60"]].concat(), &["frequency_hz", "hertz"]);
    // A file that is not what its data set says.
    let damaged = pair.at("damaged");
    copy_folder(tiny_dataset(), &damaged);
    let image = damaged.join("optical/images/00004.png");
    let mut bytes = fs::read(&image).unwrap();
    let last = bytes.len() - 20;
    bytes[last] ^= 1;
    fs::write(&image, bytes).unwrap();
    corf_refuses(&[&base[..], &[text(&damaged)]].concat(), &["00004.png", "not the file that its dataset.json tells of"]);
}

#[test]
fn radio_is_learnt_anew_and_nothing_else_is_touched() {
    let pair = Pair::get();
    let (dataset, run, out) = (pair.dataset(), pair.run(), pair.at("anew"));
    let base = ["reconstruct", text(&dataset), "--geometry", text(&run), "--set", "geometry.epochs=3"];
    corf_ok(&[&base[..], &["--out", text(&out)]].concat());
    let [before, after] = [&run, &out].map(|folder| Field::read(folder).unwrap());
    let (a, b) = (&before.gaussians, &after.gaussians);
    assert!((&a.position, &a.rotation, &a.log_scale, &a.light) == (&b.position, &b.rotation, &b.log_scale, &b.light));
    assert!(a.radio.opacity_logit != b.radio.opacity_logit && a.radio.sh != b.radio.sh);
    assert_eq!(after.meta.db_range, Dataset::open(&dataset).unwrap().db_range().unwrap());

    let info = json(&out.join("run.json"));
    let kept = &info["config"]["geometry"];
    assert_eq!(kept["gaussians_sha256"], corf_scene::io::sha256_hex(&fs::read(run.join("coupled.ply")).unwrap()));
    assert_eq!(kept["run"], text(&run));
    assert_eq!((&info["resumed_keyframes"], &info["curve"][2]["progress"]), (&0.into(), &1.0.into()));
    // Images are the run's own; the table says so.
    let printed = corf_ok(&["evaluate", text(&out)]).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(printed.contains("Light and geometry of a finished run kept"), "{printed}");
    corf_ok(&["evaluate", text(&run)]);
    let psnr = |folder: &Path| json(&folder.join("metrics.json"))["means"]["psnr_opt"].as_f64().unwrap();
    assert_eq!(psnr(&run), psnr(&out));
    assert_eq!(json(&out.join("metrics.json"))["uses_ground_truth_depth"], true);

    // The same command gives the same bytes, and leaves what is finished.
    let again = pair.at("again");
    corf_ok(&[&base[..], &["--out", text(&again)]].concat());
    assert!(fs::read(again.join("coupled.ply")).unwrap() == fs::read(out.join("coupled.ply")).unwrap());
    assert!(corf_ok(&[&base[..], &["--out", text(&again), "--resume"]].concat()).contains("radio alone was learnt"));
    // More epochs learn more.
    let longer = pair.at("longer");
    corf_ok(&["reconstruct", text(&dataset), "--geometry", text(&run), "--set", "geometry.epochs=30", "--out", text(&longer)]);
    corf_ok(&["evaluate", text(&longer)]);
    let psnr = |folder: &Path| json(&folder.join("metrics.json"))["means"]["psnr_rf_scalar"].as_f64().unwrap();
    assert!(psnr(&longer) > psnr(&out), "{} dB, {} dB", psnr(&longer), psnr(&out));
}

#[test]
fn a_geometry_that_does_not_belong_is_refused_by_name() {
    let pair = Pair::get();
    let (dataset, run, out) = (pair.dataset(), pair.run(), pair.at("refused"));
    let refuses = |more: &[&str], words: &[&str]| corf_refuses(&[&["reconstruct", "--out", text(&out)], more].concat(), words);
    let own = [text(&dataset), "--geometry", text(&run)];
    let with = |more: &[&str], words: &[&str]| refuses(&[&own[..], more].concat(), words);
    with(&["--protocol", "validation"], &["keyframe 4 is held out", "--protocol test"]);
    with(&["--method", "corf-array"], &["geometry"]);
    with(&["--method", "corf-gs-paper"], &["--method corf-gs"]);
    with(&["--set", "optical_sh_degree=2"], &["of degree 1", "--set optical_sh_degree=1"]);
    with(&["--set", "raster.near_m=0.2"], &["raster.near_m"]);
    with(&["--set", "iterations_per_keyframe=5"], &["iterations_per_keyframe has no effect"]);
    with(&["--set", "depth.prior=none"], &["depth.prior has no effect"]);
    with(&["--set", "geometry.epochs=0"], &["geometry.epochs", "1 to"]);
    with(&["--set", "geometry.run=elsewhere"], &["geometry.run", "leave it out"]);
    with(&["--fine-tune", "2"], &["--fine-tune"]);
    refuses(&[text(&dataset), "--geometry", text(&dataset)], &["holds no finished run"]);
    let lookup = pair.at("lookup");
    corf_ok(&["reconstruct", text(&dataset), "--out", text(&lookup), "--method", "nearest"]);
    refuses(&[text(&dataset), "--geometry", text(&lookup)], &["nearest keeps no Gaussians"]);
    // Another camera, and another room.
    let other = pair.at("other");
    let generate = |config: &str, more: &[&str]| {
        let base = ["dataset", "generate", config, "--out", text(&other), "--device", "cpu", "--keyframes", "4"];
        corf_ok(&[&base[..], more].concat());
    };
    generate(text(&pair.config()), &["--set", "optical.width=80", "--set", "optical.samples_per_pixel=1"]);
    refuses(&[text(&other), "--geometry", text(&run)], &["its camera is another", "96x54 pixels", "80x54"]);
    fs::remove_dir_all(&other).unwrap();
    let small = ["--set", "optical.samples_per_pixel=1", "--set", "rf.width=48", "--set", "rf.height=32"];
    generate(text(&root().join("scenes/room-tiny.toml")), &small);
    refuses(&[text(&other), "--geometry", text(&run)], &["are of different scenes", "the same room"]);
    assert!(!out.exists() || fs::read_dir(&out).unwrap().next().is_none(), "nothing is left of what was refused");
}
