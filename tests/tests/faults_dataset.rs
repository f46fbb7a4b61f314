//! Datasets, records and folders that are not what they seem are told, not used; and nothing but the work itself ends the work.

use crate::common::*;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// A dataset configuration of a small room with a lamp, two transmitters and an edge to diffract at.
struct Room {
    folder: tempfile::TempDir,
}

const SPLIT: [bool; 6] = [true; 6];

impl Room {
    /// The room, lit or not; `rf` goes into the dataset's `[rf]`, `top` before its tables.
    fn new(top: &str, radio: &str, lit: bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let extra = "[transmitters.far]\nposition_m = [5.5, 4.5, 2.0]\n[trajectory]\nheight_m = 1.5\n\
                     waypoints_m = [[1.0, 1.0], [5.0, 1.0], [5.0, 4.0], [1.0, 4.0]]\n";
        let boxes: Boxes<'_> =
            &[("room", "wall", [0.0; 3], [6.0, 5.0, 3.0], SPLIT), ("pillar", "stone", [2.5, 2.0, 0.0], [3.1, 2.6, 2.0], SPLIT)];
        boxes_scene(folder.path(), boxes, [0.5, 0.5, 2.0], extra);
        if lit {
            let mtl = folder.path().join("room.mtl");
            let text = fs::read_to_string(&mtl).unwrap().replace("newmtl stone\nKd 1 1 1", "newmtl stone\nKd 1 1 1\nKe 2 2 2");
            fs::write(mtl, text).unwrap();
        }
        let config = format!(
            "name = \"room\"\nscene = \"room.toml\"\nkeyframes = 4\n{top}\
             [optical]\nwidth = 32\nheight = 18\nsamples_per_pixel = 2\nmax_bounces = 2\n\
             [rf]\nwidth = 24\nheight = 16\nmax_interactions = 2\n{radio}\n[split]\ntest_every = 2\n"
        );
        fs::write(folder.path().join("data.toml"), config).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn edit(&self, name: &str, from: &str, to: &str) {
        let text = fs::read_to_string(self.path(name)).unwrap();
        assert!(text.contains(from), "{name} has no {from}:\n{text}");
        fs::write(self.path(name), text.replace(from, to)).unwrap();
    }

    fn generate(&self, more: &[&str]) -> std::process::Output {
        let (config, out) = (self.path("data.toml"), self.path("out"));
        corf(&[&["dataset", "generate", text(&config), "--out", text(&out)], more].concat())
    }
}

const SPECULAR: &str = "diffuse = false\n";

fn stderr(output: &std::process::Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_finished_dataset_is_resumed_as_what_it_is_alone() {
    let room = Room::new("", SPECULAR, true);
    assert_eq!(room.generate(&[]).status.code(), Some(0));
    let before = fs::read(room.path("out/dataset.json")).unwrap();
    let again = room.generate(&["--resume"]);
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    let refused = |more: &[&str], words: &[&str]| {
        let output = room.generate(&[&["--resume"], more].concat());
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{more:?}\n{said}");
        for word in words {
            assert!(said.contains(word), "{word}:\n{said}");
        }
        assert_eq!(fs::read(room.path("out/dataset.json")).unwrap(), before);
    };
    refused(&["--seed", "7"], &["config.seed: 0 there, 7 here"]);
    refused(&["--keyframes", "5"], &["config.keyframes: 4 there, 5 here"]);
    let changed = |name: &str, from: &str, to: &str, words: &[&str]| {
        room.edit(name, from, to);
        refused(&[], words);
        room.edit(name, to, from);
    };
    changed("data.toml", "width = 32", "width = 33", &["config.optical.width: 32 there, 33 here"]);
    changed("data.toml", "samples_per_pixel = 2", "samples_per_pixel = 3", &["config.optical.samples_per_pixel"]);
    changed("data.toml", "keyframes = 4\n", "keyframes = 4\ntransmitter = \"far\"\n", &["config.transmitter", "\"far\" here"]);
    changed("room.toml", "[0.5, 0.5, 2.0]", "[5.4, 0.5, 2.0]", &["scene.transmitter.position_m", "5.4"]);
    changed("room.obj", "v 2.5 2 2\n", "v 2.5 2 1.9\n", &["the scene's mesh"]);
    // A file that the mesh names is a part of the scene: the room's colours are in another.
    changed("room.mtl", "newmtl wall\nKd 1 1 1", "newmtl wall\nKd 0.5 1 1", &["a file that it names, has changed"]);
    assert_eq!(room.generate(&["--resume"]).status.code(), Some(0));
}

#[test]
fn what_a_kill_left_is_gone_once_it_is_resumed() {
    let room = Room::new("", SPECULAR, true);
    assert_eq!(room.generate(&[]).status.code(), Some(0));
    let out = room.path("out");
    fs::write(out.join("rf/spectra/.corf-aB3dE9.tmp"), "half").unwrap();
    // As between the last file and the removal of what recorded the making.
    fs::create_dir(out.join("progress")).unwrap();
    fs::write(out.join("progress/00001.json"), "{}").unwrap();
    let damaged = corf(&["dataset", "validate", text(&out)]);
    assert_eq!(damaged.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&damaged.stdout).contains("--resume"));
    let again = room.generate(&["--resume"]);
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    assert!(!out.join("rf/spectra/.corf-aB3dE9.tmp").exists() && !out.join("progress").exists());
    corf_ok(&["dataset", "validate", text(&out)]);
    // A folder in which nothing but a beginning of a file is.
    let (bare, config) = (room.path("bare"), room.path("data.toml"));
    fs::create_dir(&bare).unwrap();
    fs::write(bare.join(".corf-x.tmp"), "").unwrap();
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&bare), "--resume"]);
    assert_eq!(fs::read(bare.join("dataset.json")).unwrap(), fs::read(out.join("dataset.json")).unwrap());
}

/// The mean over keyframes of the power of all paths that the dataset wrote, dB relative to 1 W transmitted.
fn mean_power_db(dataset: &Path) -> f64 {
    let mut powers = Vec::new();
    for file in fs::read_dir(dataset.join("rf/paths")).unwrap() {
        let lines = corf_scene::io::read_gzip_text(file.unwrap().path()).unwrap();
        let paths = lines.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        powers.push(paths.filter_map(|p| Some(p["a"][0].as_f64()?.powi(2) + p["a"][1].as_f64()?.powi(2))).sum::<f64>());
    }
    10.0 * (powers.iter().sum::<f64>() / powers.len() as f64).log10()
}

#[test]
fn what_is_measured_of_the_radio_half_is_what_is_generated() {
    let mut seen = Vec::new();
    for (top, radio) in [
        ("", "diffuse = false\nwrite_paths = true\n"),
        ("", "diffuse = false\nwrite_paths = true\ndiffraction = true\n"),
        ("transmitter = \"far\"\n", "diffuse = false\nwrite_paths = true\ndiffraction = true\n"),
    ] {
        let room = Room::new(top, radio, true);
        assert_eq!(room.generate(&[]).status.code(), Some(0));
        let config = room.path("data.toml");
        let answer: Value = serde_json::from_str(&corf_ok(&["bench", "radio", text(&config), "--json"])).unwrap();
        let (measured, made) = (answer["mean_specular_db"].as_f64().unwrap(), mean_power_db(&room.path("out")));
        assert!((measured - made).abs() < 1e-6, "{top}{radio}: {measured} dB measured, {made} dB made");
        assert!(answer["mean_diffuse_db"].is_null() && answer["directions"].is_null(), "the dataset has no scattered power");
        assert_eq!(answer["diffraction"].as_bool(), Some(radio.contains("diffraction")));
        seen.push(measured);
    }
    assert!((seen[0] - seen[1]).abs() > 1e-4 && (seen[1] - seen[2]).abs() > 0.01, "{seen:?}");
    let room = Room::new("", SPECULAR, true);
    let config = room.path("data.toml");
    corf_refuses(&["bench", "radio", text(&config), "--photons", "10"], &["--photons", "no scattered power", "diffuse = true"]);
}

#[test]
fn a_swapped_file_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    copy_folder(tiny_dataset(), &data);
    let reconstruct =
        |out: &'static str| ["reconstruct", text(tiny_dataset()), "--method", "nearest", "--out", out].map(str::to_owned);
    let of_data = |out: &Path, more: &[&str]| -> Vec<String> {
        let mut all = reconstruct("").to_vec();
        (all[1], all[5]) = (text(&data).to_owned(), text(out).to_owned());
        all.extend(more.iter().map(|m| (*m).to_owned()));
        all
    };
    let arguments = |all: &[String]| all.iter().map(|a| Box::leak(a.clone().into_boxed_str()) as &str).collect::<Vec<&str>>();
    corf_ok(&arguments(&of_data(&run, &[])));
    let json = |path: PathBuf| -> Value { serde_json::from_slice(&fs::read(path).unwrap()).unwrap() };
    assert_eq!(json(run.join("run.json"))["dataset_verified"], true);
    corf_ok(&["evaluate", text(&run)]);
    let honest = json(run.join("metrics.json"));
    assert_eq!(honest["dataset_verified"], true);
    // The held-out spectrum of keyframe 8 becomes that of its neighbour: a valid file, and another measurement.
    fs::copy(data.join("rf/spectra/00008.exr"), data.join("rf/spectra/00009.exr")).unwrap();
    let plan = folder.path().join("plan.toml");
    let row = "[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n";
    fs::write(&plan, format!("name = \"t\"\ndataset = {data:?}\nseeds = [1]\n{row}")).unwrap();
    let words = ["rf/spectra/00009.exr", "SHA-256"];
    let other = folder.path().join("other");
    corf_refuses(&arguments(&of_data(&other, &[])), &words);
    assert!(!other.exists(), "nothing is begun with it");
    corf_refuses(&["evaluate", text(&run)], &words);
    let poses = data.join("trajectory.json");
    corf_refuses(&["render", text(&run), "--poses", text(&poses), "--out", text(&folder.path().join("r"))], &words);
    corf_refuses(&["bench", "run", text(&plan), "--out", text(&folder.path().join("b"))], &words);
    // Whoever does not want to know has it in the record.
    corf_ok(&arguments(&of_data(&other, &["--no-verify"])));
    assert_eq!(json(other.join("run.json"))["dataset_verified"], false);
    corf_ok(&["evaluate", text(&run), "--no-verify"]);
    let other = json(run.join("metrics.json"));
    assert_eq!(other["dataset_verified"], false);
    assert_ne!(other["means"]["psnr_rf_jet"], honest["means"]["psnr_rf_jet"], "the swapped file matters");
    let out = folder.path().join("b2");
    corf_ok(&["bench", "run", text(&plan), "--out", text(&out), "--no-verify"]);
    assert!(fs::read_to_string(out.join("table.md")).unwrap().contains("not checked against their recorded SHA-256"));
    // A file of another dataset, one that is missing, the poses.
    fs::remove_file(data.join("optical/depth/00002.exr")).unwrap();
    corf_refuses(&["evaluate", text(&run)], &["optical/depth/00002.exr"]);
}

#[test]
fn nothing_listens_and_the_work_is_done_all_the_same() {
    if !Path::new("/dev/full").exists() {
        return;
    }
    let full = || Stdio::from(fs::File::options().write(true).open("/dev/full").unwrap());
    let room = Room::new("", SPECULAR, true);
    let (config, out) = (room.path("data.toml"), room.path("out"));
    let generate = ["dataset", "generate", text(&config), "--out", text(&out)];
    let status = command(&generate).stderr(full()).stdout(Stdio::null()).status().unwrap();
    assert_eq!(status.code(), Some(0));
    assert!(out.join("dataset.json").exists());
    // An error keeps its code, told or not.
    let status = command(&["scene", "info", "no/such.glb"]).stderr(full()).stdout(Stdio::null()).status().unwrap();
    assert_eq!(status.code(), Some(2));
    // A result that nobody can have is an error, and no panic.
    let scene = room.path("room.toml");
    for arguments in [&["scene", "info", text(&scene)][..], &["--help"], &["dataset", "generate", "--help"], &["--version"]] {
        let output = command(arguments).stdout(full()).stderr(Stdio::piped()).output().unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains("standard output") && !said.contains("panicked"), "{arguments:?}: {said}");
    }
}

#[cfg(unix)]
#[test]
fn a_reader_that_has_gone_away_ends_nothing() {
    let room = Room::new("", SPECULAR, true);
    let scene = room.path("room.toml");
    for arguments in [&["--help"][..], &["scene", "info", text(&scene)]] {
        // The reading end is closed before a word is written.
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let output = command(arguments).stdout(writer).stderr(Stdio::piped()).output().unwrap();
        assert_eq!((output.status.code(), stderr(&output)), (Some(0), String::new()), "{arguments:?}");
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let status = command(&["scene", "info", "no/such.glb"]).stderr(writer).stdout(Stdio::null()).status().unwrap();
        assert_eq!(status.code(), Some(2));
    }
}

/// Waits until a started command has made a file, or has ended.
fn wait_for(child: &mut Child, file: &Path) {
    let begin = Instant::now();
    while !file.exists() && child.try_wait().unwrap().is_none() {
        assert!(begin.elapsed() < Duration::from_secs(60), "{} did not come", file.display());
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[cfg(unix)]
#[test]
fn the_second_of_two_runs_into_one_folder_is_refused() {
    let room = Room::new("", SPECULAR, true);
    room.edit("data.toml", "keyframes = 4", "keyframes = 5000");
    let (config, out) = (room.path("data.toml"), room.path("out"));
    let generate = ["dataset", "generate", text(&config), "--out", text(&out), "--resume"];
    let mut first = start(&generate);
    wait_for(&mut first, &out.join("dataset.partial.json"));
    corf_refuses(&generate, &["another run is writing into this folder"]);
    corf_refuses(&["reconstruct", text(tiny_dataset()), "--out", text(&out), "--resume"], &["another run is writing"]);
    // A process that is killed holds nothing.
    first.kill().unwrap();
    first.wait().unwrap();
    let mut next = start(&generate);
    wait_for(&mut next, &out.join("progress/00003.json"));
    assert!(next.try_wait().unwrap().is_none(), "it goes on where the killed one was");
    next.kill().unwrap();
    next.wait().unwrap();
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_every_long_command_in_time() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    corf_ok(&["reconstruct", text(tiny_dataset()), "--method", "corf-gs-fast", "--out", text(&run), "--device", "cpu"]);
    let poses: Vec<Value> = {
        let file: Value = serde_json::from_slice(&fs::read(tiny_dataset().join("trajectory.json")).unwrap()).unwrap();
        let poses = file["keyframes"].as_array().unwrap().iter().map(|k| k["world_from_camera"].clone());
        poses.cycle().take(20_000).collect()
    };
    let many = folder.path().join("poses.json");
    fs::write(&many, serde_json::to_string(&poses).unwrap()).unwrap();
    let at = |name: &str| text(&folder.path().join(name)).to_owned();
    let (coverage, views) = (at("coverage"), at("views"));
    let lobby = text(&root().join("scenes/lobby.toml")).to_owned();
    let lobby147 = text(&root().join("scenes/lobby147.toml")).to_owned();
    let [dataset, spectra] = [at("dataset"), at("spectra")];
    // Units of work that take much longer than anybody waits: tens of millions of directions, photons or rays at once.
    let commands: Vec<Vec<&str>> = vec![
        vec!["diffuse", &lobby, "--rx", "7,4,1.6", "--directions", "20000000", "--photons", "50000000"],
        vec!["paths", &lobby, "--rx", "7,4,1.6", "--diffuse", "--depth", "3", "--rx-trajectory", "10000"],
        vec!["coverage", &lobby, "--height", "1.6", "--cell", "0.02", "--depth", "3", "--out", &coverage],
        vec!["spectrum", &lobby, "--rx", "7,4,1.6", "--directions", "20000000", "--out", &spectra],
        vec!["bench", "radio", &lobby147, "--photons", "90000000"],
        vec!["bench", "step", "--gaussians", "2000000", "--device", "cpu"],
        vec!["dataset", "generate", &lobby147, "--out", &dataset],
        vec!["render", text(&run), "--poses", text(&many), "--out", &views, "--device", "cpu"],
    ];
    for arguments in commands {
        let mut child = command(&arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(1500));
        let begin = Instant::now();
        let running = child.try_wait().unwrap().is_none();
        std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        let output = child.wait_with_output().unwrap();
        assert!(running, "{arguments:?} had ended: {}", stderr(&output));
        assert_eq!(output.status.code(), Some(130), "{arguments:?}: {}", stderr(&output));
        assert!(begin.elapsed() < Duration::from_millis(2900), "{arguments:?} took {:?}", begin.elapsed());
    }
}

#[test]
fn a_dark_dataset_and_a_transmitter_outside_are_told() {
    let dark = Room::new("", SPECULAR, false);
    let output = dark.generate(&[]);
    assert_eq!(output.status.code(), Some(0));
    assert!(stderr(&output).contains("all 4 images are black"), "{}", stderr(&output));
    let out = dark.path("out");
    let validated = corf_ok(&["dataset", "validate", text(&out)]);
    assert!(validated.contains("warning") && validated.contains("all 4 images are black"), "{validated}");
    assert_eq!(corf(&["dataset", "validate", text(&out), "--strict"]).status.code(), Some(1));
    assert_eq!(dark.generate(&["--resume", "--strict"]).status.code(), Some(1));
    assert!(stderr(&dark.generate(&["--resume"])).contains("black"), "and told again");

    // A wall alone, seen from a loop that turns away from it: open, and empty half of the way.
    let open = Room::new("", SPECULAR, true);
    let wall: Boxes<'_> = &[("wall", "stone", [-5.0, 8.0, 0.0], [12.0, 8.2, 3.0], [false, false, true, false, false, false])];
    let extra = "[trajectory]\nheight_m = 1.5\nwaypoints_m = [[1.0, 1.0], [5.0, 1.0], [5.0, 4.0], [1.0, 4.0]]\n";
    boxes_scene(open.folder.path(), wall, [0.5, 0.5, 2.0], extra);
    let scene = open.path("room.toml");
    let validated = corf_ok(&["scene", "validate", text(&scene)]);
    assert!(validated.contains("7.50 m outside of the scene") && validated.contains("100 % of the way"), "{validated}");
    assert_eq!(corf(&["scene", "validate", text(&scene), "--strict"]).status.code(), Some(1));
    let refused = open.generate(&["--strict"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("outside of the scene") && !open.path("out").exists());
    let output = open.generate(&[]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("outside of the scene") && said.contains("depth images are empty"), "{said}");
}

#[test]
fn one_training_keyframe_makes_no_field() {
    let room = Room::new("", SPECULAR, true);
    room.edit("data.toml", "keyframes = 4", "keyframes = 2");
    assert_eq!(room.generate(&[]).status.code(), Some(0));
    let (out, run) = (room.path("out"), room.path("run"));
    let arguments = ["reconstruct", text(&out), "--out", text(&run), "--device", "cpu"];
    corf_refuses(&arguments, &["at least 2 training keyframes", "has 1"]);
    assert!(!run.exists());
}

#[test]
fn records_hold_numbers_and_tables_hold_text() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (folder.path().join("plan.toml"), folder.path().join("out"));
    let label = "=50% {a}_b & #1 ~^ <b>`c`</b> \u{1b}[31m";
    let rows = format!("[[row]]\nlabel = {}\nmethod = \"nearest\"\n", serde_json::to_string(label).unwrap());
    fs::write(&plan, format!("name = \"x <i>\"\ndataset = {:?}\nseeds = [1]\n{rows}", tiny_dataset())).unwrap();
    let printed = corf_ok(&["bench", "run", text(&plan), "--out", text(&out)]);
    assert!(!printed.contains('\u{1b}') && printed.contains("\\u001b[31m"), "{printed}");
    let read = |name: &str| fs::read_to_string(out.join(name)).unwrap();
    assert!(read("table.tex").contains(r"=50\% \{a\}\_b \& \#1 \textasciitilde{}\textasciicircum{} \textless{}b"));
    assert!(read("table.csv").contains("\n\"'=50% {a}_b"), "{}", read("table.csv"));
    assert!(read("table.md").starts_with("# x &lt;i&gt;") && read("table.md").contains(r"&lt;b&gt;\`c\`&lt;/b&gt;"));
    let report = read("report.html");
    assert!(report.contains("&lt;b&gt;`c`&lt;/b&gt;") && !report.contains("<b>`c`") && !report.contains('\u{1b}'));

    let cell = fs::read_dir(out.join("cells")).unwrap().next().unwrap().unwrap().path();
    let sound = fs::read_to_string(&cell).unwrap();
    let value: Value = serde_json::from_str(&sound).unwrap();
    for (pointer, bad, words) in [
        ("/frames/0/psnr_rf_jet", "1.7e308", ["frames[0].psnr_rf_jet", "1.7e308"]),
        ("/means/psnr_opt", "-1.7e308", ["means.psnr_opt", "1.7e308"]),
        ("/seconds", "1.7e308", ["seconds", "1.7e308"]),
        ("/curve/0/seconds", "1.7e308", ["curve[0].seconds", "1.7e308"]),
        ("/frames/0/psnr_opt", "null", ["frames[0].psnr_opt is null", "help"]),
        ("/peak_error_median_p90_deg/1", "null", ["peak_error_median_p90_deg[1] is null", "help"]),
    ] {
        let mut damaged = value.clone();
        *damaged.pointer_mut(pointer).unwrap() = serde_json::from_str(bad).unwrap();
        fs::write(&cell, damaged.to_string()).unwrap();
        corf_refuses(&["bench", "report", text(&out)], &words);
        corf_refuses(&["bench", "table", text(&out)], &words);
    }
    fs::write(&cell, &sound).unwrap();
    corf_ok(&["bench", "report", text(&out)]);
}

/// The transmitter in one room of metal, the way through another.
#[test]
fn a_data_set_that_hears_nothing_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let mut obj = String::from("mtllib two.mtl\nusemtl metal\n");
    for (room, x) in [0.0, 10.0].into_iter().enumerate() {
        obj += &format!("o room{room}\n");
        for i in 0..8 {
            let corner = |axis: usize, most: f64| if i >> axis & 1 == 1 { most } else { 0.0 };
            obj += &format!("v {} {} {}\n", x + corner(0, 4.0), corner(1, 4.0), corner(2, 2.6));
        }
        // Faces look into the room.
        for quad in [[2, 6, 4, 0], [5, 7, 3, 1], [4, 5, 1, 0], [3, 7, 6, 2], [1, 3, 2, 0], [6, 7, 5, 4]] {
            obj += &format!("f {}\n", quad.map(|corner: usize| (8 * room + corner + 1).to_string()).join(" "));
        }
    }
    fs::write(at("two.obj"), obj).unwrap();
    fs::write(at("two.mtl"), "newmtl metal\nKd 0.5 0.5 0.5\n").unwrap();
    let scene = "[scene]\nfile = \"two.obj\"\n[transmitter]\nposition_m = [2, 2, 2]\n[trajectory]\nheight_m = 1.5\n\
                 waypoints_m = [[11, 1], [13, 1], [13, 3], [11, 3]]\n[radio_materials.metal]\nitu = \"metal\"\nthickness_m = 0.01\n";
    fs::write(at("two.toml"), scene).unwrap();
    let config = "name = \"silent\"\nscene = \"two.toml\"\nkeyframes = 2\nseed = 1\n[optical]\nwidth = 32\nheight = 18\nmethod = \"path\"\n\
                  samples_per_pixel = 1\nmax_bounces = 1\n[rf]\nwidth = 24\nheight = 16\n";
    fs::write(at("silent.toml"), config).unwrap();
    fs::create_dir(at("mine")).unwrap();
    for out in ["new", "mine"] {
        let (config, out) = (at("silent.toml"), at(out));
        corf_refuses(
            &["dataset", "generate", text(&config), "--out", text(&out)],
            &["no keyframe received any power", "nothing was kept"],
        );
    }
    assert!(!at("new").exists() && fs::read_dir(at("mine")).unwrap().next().is_none());
}
