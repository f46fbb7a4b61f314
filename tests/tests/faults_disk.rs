//! Kills, full disks and outputs: a command that was killed works again, nothing it left stays for ever, a file that may not grow is an error,
//! what is read is never written over, and a live folder that goes away is told of.

use crate::common::*;
use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::symlink;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Every path below a folder, relative to it.
fn tree(folder: &Path) -> BTreeSet<PathBuf> {
    let (mut open, mut found) = (vec![folder.to_path_buf()], BTreeSet::new());
    while let Some(at) = open.pop() {
        for entry in fs::read_dir(at).unwrap() {
            let path = entry.unwrap().path();
            found.insert(path.strip_prefix(folder).unwrap().to_path_buf());
            if path.is_dir() && !path.is_symlink() {
                open.push(path);
            }
        }
    }
    found
}

/// What is hidden below a folder, as everything is that a command writes before it is whole.
fn hidden(folder: &Path) -> Vec<PathBuf> {
    let is_hidden = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    tree(folder).into_iter().filter(is_hidden).collect()
}

/// The bytes of every file below a folder.
fn content(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let files = tree(folder).into_iter().filter(|path| folder.join(path).is_file());
    files.map(|path| (path.clone(), fs::read(folder.join(&path)).unwrap())).collect()
}

/// Starts a command, kills it when `ready` says so or it has ended, and says whether it was killed.
fn kill_when(arguments: &[&str], ready: impl Fn() -> bool) -> bool {
    let mut child = start(arguments);
    let begin = Instant::now();
    while !ready() && child.try_wait().unwrap().is_none() {
        assert!(begin.elapsed() < PATIENCE, "corf {arguments:?} did not come to the point");
        std::thread::sleep(Duration::from_millis(1));
    }
    let _ = child.kill();
    child.wait().unwrap().signal() == Some(9)
}

/// Sends a signal to a child.
fn signal(child: &Child, name: &str) {
    let _ = Command::new("kill").args([name, &child.id().to_string()]).stderr(Stdio::null()).status().unwrap();
}

/// A small run on the tiny data set.
fn run_in(folder: &Path) -> PathBuf {
    let run = folder.join("run");
    let few = ["--set", "iterations_per_keyframe=2", "--no-verify", "--device", "cpu"];
    corf_ok(&[&["reconstruct", text(tiny_dataset()), "--out", text(&run)], &few[..]].concat());
    run
}

/// Commands that fill a folder and have no `--resume`, on the tiny data set.
fn filling(out: &Path) -> Vec<Vec<String>> {
    let (data, light) = (text(tiny_dataset()).to_owned(), text(&tiny_dataset().join("optical")).to_owned());
    let out = text(out);
    let mut all: Vec<Vec<String>> = Vec::new();
    for form in ["numpy", "nerfstudio", "rf-3dgs"] {
        all.push(["dataset", "export", &data, "--to", form, "--out", out].map(String::from).to_vec());
    }
    all.push(["dataset", "import", &light, "--from", "colmap", "--out", out].map(String::from).to_vec());
    all
}

fn strs(arguments: &[String]) -> Vec<&str> {
    arguments.iter().map(String::as_str).collect()
}

#[test]
fn a_command_that_was_killed_works_again_and_leaves_nothing_of_the_first_time() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, out) = (folder.path().join("whole"), folder.path().join("out"));
    for (arguments, of_whole) in filling(&out).into_iter().zip(filling(&whole)) {
        corf_ok(&strs(&of_whole));
        let begun = || out.join(".corf-unfinished").exists() && tree(&out).len() > 2;
        assert!(kill_when(&strs(&arguments), begun), "{arguments:?} ended before it was killed");
        assert!(tree(&out).iter().all(|path| path.starts_with(".corf-unfinished")), "{:?}", tree(&out));
        corf_ok(&strs(&arguments));
        assert!(content(&out) == content(&whole), "{arguments:?}: {:?} and {:?}", tree(&out), tree(&whole));
        corf_refuses(&strs(&arguments), &["not empty"]);
        fs::remove_dir_all(&out).unwrap();
        fs::remove_dir_all(&whole).unwrap();
    }
    assert!(hidden(folder.path()).is_empty());
}

#[test]
fn what_a_user_puts_beside_the_leftover_of_a_killed_command_stays() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let arguments = filling(&out).remove(3);
    fs::create_dir_all(out.join(".corf-unfinished/optical")).unwrap();
    fs::write(out.join(".corf-unfinished/optical/half"), "half").unwrap();
    fs::write(out.join("notes.txt"), "mine").unwrap();
    corf_refuses(&strs(&arguments), &["not empty"]);
    assert_eq!(fs::read(out.join("notes.txt")).unwrap(), b"mine");
    fs::remove_file(out.join("notes.txt")).unwrap();
    corf_ok(&strs(&arguments));
    assert!(hidden(folder.path()).is_empty() && out.join("dataset.json").exists());
}

#[test]
fn a_playing_goes_on_where_it_was_killed_and_a_living_one_is_let_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, live) = (folder.path().join("whole"), folder.path().join("live"));
    corf_ok(&["dataset", "play", text(tiny_dataset()), "--to", text(&whole), "--rate", "10000"]);
    let arguments = ["dataset", "play", text(tiny_dataset()), "--to", text(&live), "--rate", "20"];
    let poses = || fs::read_dir(live.join("poses")).map_or(0, Iterator::count);
    assert!(kill_when(&arguments, || poses() >= 3));
    let there = poses();
    assert!((3..10).contains(&there));
    // Another playing, and files that are of none, are not gone on with.
    corf_refuses(&[&arguments[..], &["--keyframes", "9"]].concat(), &["not empty", "--to"]);
    fs::write(live.join("notes.txt"), "mine").unwrap();
    corf_refuses(&arguments, &["not empty"]);
    fs::remove_file(live.join("notes.txt")).unwrap();
    let first = fs::metadata(live.join("poses/00001.json")).unwrap().modified().unwrap();
    let mut child = start(&arguments);
    while poses() <= there && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    corf_refuses(&arguments, &["another run is writing"]);
    assert!(child.wait().unwrap().success());
    assert!(content(&live) == content(&whole), "{:?}", tree(&live));
    assert_eq!(fs::metadata(live.join("poses/00001.json")).unwrap().modified().unwrap(), first, "it is not played twice");
    corf_refuses(&arguments, &["not empty"]);
}

#[test]
fn no_temporary_file_stays_for_ever() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_in(folder.path());
    let pages = folder.path().join("pages");
    fs::create_dir(&pages).unwrap();
    let (ply, page) = (pages.join("a.ply"), pages.join("a.html"));
    let export = ["field", "export", text(&run), "--to", "ply", "--out", text(&ply)];
    let view = ["view", text(&run), "--export", text(&page), "--device", "cpu", "--no-verify"];
    for arguments in [&export[..], &view[..]] {
        let begin = Instant::now();
        corf_ok(arguments);
        let whole = begin.elapsed();
        // Whenever it is killed, the old file is there whole, and nothing beside it once the command has run again.
        for part in 0..8 {
            let at = Instant::now() + whole * part / 8;
            kill_when(arguments, || Instant::now() >= at);
            assert!(hidden(&pages).len() <= 1, "{:?}", hidden(&pages));
        }
        // One of an older version, or of a system without files that have no name.
        fs::write(pages.join(".corf-a1B2c3.tmp"), "half").unwrap();
        corf_ok(arguments);
        assert!(hidden(&pages).is_empty(), "{:?}", hidden(&pages));
    }
    assert_eq!(tree(&pages).len(), 2);
    // One that a living process holds is none of a dead one.
    let held = fs::File::create(pages.join(".corf-living.tmp")).unwrap();
    held.try_lock().unwrap();
    corf_ok(&export);
    assert_eq!(hidden(&pages), [PathBuf::from(".corf-living.tmp")]);
}

/// Runs the command in a shell that lets no file grow beyond so many KiB.
fn with_small_files(kib: u32, arguments: &[&str]) -> std::process::Output {
    let limit = format!("ulimit -f {kib} && exec \"$0\" \"$@\"");
    let program = command(&[]).get_program().to_owned();
    Command::new("bash").arg("-c").arg(limit).arg(program).args(arguments).current_dir(root()).output().unwrap()
}

#[test]
fn a_file_that_may_not_grow_is_an_error_like_a_full_disk() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_in(folder.path());
    let config = tiny_config(folder.path(), 2);
    let scratch = folder.path().join("scratch");
    fs::create_dir(&scratch).unwrap();
    let at = |name: &str| text(&scratch.join(name)).to_owned();
    let (data, few) = (text(tiny_dataset()), "iterations_per_keyframe=2");
    let cases: Vec<Vec<String>> = [
        vec!["reconstruct", data, "--out", &at("run"), "--set", few, "--device", "cpu"],
        vec!["field", "export", text(&run), "--to", "ply", "--out", &at("a.ply")],
        vec!["view", text(&run), "--export", &at("a.html"), "--device", "cpu"],
        vec!["dataset", "generate", text(&config), "--out", &at("generated")],
        vec!["dataset", "play", data, "--to", &at("live"), "--rate", "10000"],
        vec!["scene", "build", "lobby", "--out", &at("lobby.glb")],
        vec!["scene", "export", "scenes/lobby.toml", "--to", "mitsuba", "--out", &at("mitsuba")],
    ]
    .into_iter()
    .map(|case| case.into_iter().map(String::from).collect())
    .chain(filling(&scratch.join("filled")))
    .collect();
    for arguments in cases {
        let output = with_small_files(4, &strs(&arguments));
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}\n{stderr}");
        assert!(stderr.contains(text(&scratch)) && stderr.contains("ulimit -f"), "{arguments:?}\n{stderr}");
        assert!(hidden(&scratch).is_empty(), "{arguments:?}: {:?}", hidden(&scratch));
        for file in ["a.ply", "a.html", "lobby.glb", "filled", "mitsuba", "run/run.json", "generated/dataset.json"] {
            assert!(!scratch.join(file).exists(), "{arguments:?}: {file} looks finished");
        }
    }
}

#[test]
fn what_is_read_is_not_written_over() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_in(folder.path());
    let data = folder.path().join("data");
    copy_folder(tiny_dataset(), &data);
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "");
    let at = |name: &str| folder.path().join(name);
    symlink(&run, at("link")).unwrap();
    symlink(run.join("run.json"), at("soft.json")).unwrap();
    fs::hard_link(run.join("coupled.ply"), at("hard.ply")).unwrap();
    fs::hard_link(data.join("dataset.json"), at("hard.html")).unwrap();
    let poses = data.join("trajectory.json");
    let before = [content(&run), content(&data)];
    let scene_before: Vec<_> = ["room.toml", "room.obj", "room.mtl"].map(|name| fs::read(at(name)).unwrap()).to_vec();
    let refuses = |arguments: &[&str], out: &Path| corf_refuses(&[arguments, &[text(out)]].concat(), &["help", text(out)]);
    for inside in [run.join("coupled.ply"), run.join("new.ply"), at("link/new.ply"), at("data/../run/x.ply"), at("hard.ply")] {
        refuses(&["field", "export", text(&run), "--to", "ply", "--out"], &inside);
        refuses(&["field", "export", text(&at("link")), "--to", "splat", "--out"], &inside);
    }
    for inside in [run.join("run.json"), run.join("page.html"), data.join("dataset.json"), at("soft.json"), at("hard.html")] {
        let moved = ["view", text(&run), "--dataset", text(&data), "--no-verify", "--device", "cpu", "--export"];
        refuses(&moved, &inside);
    }
    refuses(&["view", text(&data), "--no-verify", "--export"], &data.join("optical/page.html"));
    let render = ["render", text(&run), "--no-verify", "--dataset", text(&data), "--poses", text(&poses)];
    for inside in [run.join("views"), data.join("views"), at("link/views"), run.clone(), data.clone()] {
        refuses(&[&render[..], &["--resume", "--out"]].concat(), &inside);
    }
    // The data set that a run was made from is read with it.
    refuses(&["field", "export", text(&run), "--to", "ply", "--out"], &tiny_dataset().join("new.ply"));
    let predictions = ["evaluate", text(&run), "--no-verify", "--dataset", text(&data), "--write-predictions"];
    refuses(&predictions, &run.join("predictions"));
    for form in ["numpy", "nerfstudio", "rf-3dgs"] {
        refuses(&["dataset", "export", text(&data), "--to", form, "--out"], &data.join(form));
    }
    refuses(&["dataset", "import", text(&data.join("optical")), "--from", "colmap", "--out"], &data.join("optical/images/again"));
    refuses(&["dataset", "import", text(&data.join("optical")), "--from", "colmap", "--out"], &data.join("optical"));
    refuses(&["dataset", "play", text(&data), "--to"], &data.join("live"));
    refuses(&["reconstruct", text(&data), "--resume", "--out"], &data);
    refuses(&["reconstruct", text(&data), "--out"], &data.join("run"));
    fs::create_dir(at("live")).unwrap();
    refuses(&["reconstruct", "--follow", text(&at("live")), "--out"], &at("live/run"));
    refuses(&["reconstruct", "--follow", text(&at("live")), "--out"], &at("live"));
    for part in ["room.toml", "room.obj", "room.mtl"] {
        refuses(&["paths", text(&scene), "--rx", "3,3,1.5", "--out"], &at(part));
    }
    let plan = at("plan.toml");
    fs::write(&plan, format!("name = \"x\"\ndataset = {data:?}\nseeds = [1]\n[[row]]\nlabel = \"a\"\nmethod = \"corf-gs\"\n"))
        .unwrap();
    refuses(&["bench", "run", text(&plan), "--out"], &data.join("out"));
    refuses(&["bench", "plan", text(&plan), "--resume", "--out"], &data);
    assert!([content(&run), content(&data)] == before, "{:?} {:?}", tree(&run), tree(&data));
    assert!(["room.toml", "room.obj", "room.mtl"].map(|name| fs::read(at(name)).unwrap()).to_vec() == scene_before);
    // What is documented as writing into a run goes on to.
    corf_ok(&["evaluate", text(&run), "--no-verify", "--device", "cpu"]);
    assert!(run.join("metrics.json").exists());
    // And a place outside is as good as ever.
    corf_ok(&["field", "export", text(&run), "--to", "ply", "--out", text(&at("new.ply"))]);
}

/// A follower of a live folder.
struct Follower {
    child: Child,
    run: PathBuf,
    stderr: PathBuf,
}

impl Follower {
    fn start(live: &Path, run: &Path, more: &[&str]) -> Self {
        let arguments = ["reconstruct", "--follow", text(live), "--out", text(run), "--device", "cpu"];
        let few = ["--set", "iterations_per_keyframe=5", "--seed", "3"];
        let stderr = run.with_extension("stderr");
        let file = fs::File::create(&stderr).unwrap();
        let child = command(&[&arguments[..], &few, more].concat()).stdout(Stdio::null()).stderr(file).spawn().unwrap();
        Self { child, run: run.to_path_buf(), stderr }
    }

    fn said(&self) -> String {
        fs::read_to_string(&self.stderr).unwrap()
    }

    fn lines(&self) -> String {
        fs::read_to_string(self.run.join("live.jsonl")).unwrap_or_default()
    }

    /// Waits until something is so.
    fn until(&mut self, what: &str, is_so: impl Fn(&Self) -> bool) {
        let begin = Instant::now();
        while !is_so(self) {
            let ended = self.child.try_wait().unwrap();
            assert!(ended.is_none(), "{what}: it ended with {ended:?}\n{}", self.said());
            assert!(begin.elapsed() < PATIENCE, "{what}\n{}", self.said());
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn end(mut self, code: i32) -> String {
        let status = self.child.wait().unwrap();
        assert_eq!(status.code(), Some(code), "{}", self.said());
        self.said()
    }
}

fn trained(follower: &Follower) -> usize {
    follower.lines().matches("\"event\":\"trained\"").count()
}

/// Plays the tiny data set aside, and opens a live folder of its first keyframes.
struct Capture {
    from: PathBuf,
    live: PathBuf,
}

impl Capture {
    fn open(scratch: &Path) -> Self {
        let capture = Self { from: scratch.join("played"), live: scratch.join("live") };
        corf_ok(&["dataset", "play", text(tiny_dataset()), "--to", text(&capture.from), "--rate", "10000"]);
        for folder in ["images", "spectra", "poses"] {
            fs::create_dir_all(capture.live.join(folder)).unwrap();
        }
        fs::copy(capture.from.join("capture.toml"), capture.live.join("capture.toml")).unwrap();
        capture
    }

    fn copy(&self, name: &str) {
        let part = self.live.join(format!("{name}.part"));
        fs::copy(self.from.join(name), &part).unwrap();
        fs::rename(part, self.live.join(name)).unwrap();
    }

    fn without_pose(&self, number: usize) {
        self.copy(&format!("images/{number:05}.png"));
        self.copy(&format!("spectra/{number:05}.exr"));
    }

    fn keyframe(&self, number: usize) {
        self.without_pose(number);
        self.copy(&format!("poses/{number:05}.json"));
    }

    fn end(&self) {
        fs::write(self.live.join("end"), "").unwrap();
    }
}

#[test]
fn a_folder_that_goes_away_is_told_of_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let capture = Capture::open(folder.path());
    let mut follower = Follower::start(&capture.live, &folder.path().join("run"), &[]);
    (1..=3).for_each(|number| capture.keyframe(number));
    follower.until("three are trained", |f| trained(f) == 3);
    for name in ["poses", "images"] {
        let gone = format!("{name} IS GONE");
        fs::rename(capture.live.join(name), capture.live.join("aside")).unwrap();
        follower.until(&gone, |f| f.said().contains(&gone) && f.lines().contains(&gone));
        assert_eq!(follower.said().matches(&gone).count(), 1, "it is said once");
        fs::rename(capture.live.join("aside"), capture.live.join(name)).unwrap();
        follower.until("there again", |f| f.said().contains(&format!("{name} is there again")));
    }
    capture.keyframe(4);
    follower.until("the fourth is trained", |f| trained(f) == 4);
    fs::remove_dir_all(&capture.live).unwrap();
    let said = follower.end(0);
    assert!(said.contains("4 trained") || folder.path().join("run/run.json").exists(), "{said}");
    let record: serde_json::Value = serde_json::from_slice(&fs::read(folder.path().join("run/run.json")).unwrap()).unwrap();
    assert_eq!((record["live"]["ended_by"].as_str(), record["live"]["trained"].as_u64()), (Some("folder-gone"), Some(4)));
    // A file is no live folder.
    fs::write(folder.path().join("file"), "").unwrap();
    let (file, no) = (folder.path().join("file"), folder.path().join("no"));
    corf_refuses(&["reconstruct", "--follow", text(&file), "--out", text(&no)], &["is no folder", "help"]);
}

#[test]
fn a_file_that_is_still_being_written_is_waited_for_a_moment() {
    let folder = tempfile::tempdir().unwrap();
    let capture = Capture::open(folder.path());
    let mut follower = Follower::start(&capture.live, &folder.path().join("run"), &[]);
    capture.keyframe(1);
    follower.until("it follows", |f| f.said().contains("following"));
    // In halves, and the next keyframe between them.
    capture.without_pose(2);
    for name in ["images/00002.png", "poses/00002.json"] {
        let whole = fs::read(capture.from.join(name)).unwrap();
        fs::write(capture.live.join(name), &whole[..whole.len() / 2]).unwrap();
        if name.starts_with("poses") {
            capture.keyframe(3);
            std::thread::sleep(Duration::from_millis(100));
            fs::write(capture.live.join("images/00002.png"), fs::read(capture.from.join("images/00002.png")).unwrap()).unwrap();
            fs::write(capture.live.join(name), whole).unwrap();
        }
    }
    follower.until("three are trained", |f| trained(f) == 3 || f.said().contains("REFUSED"));
    // Longer than it takes to look at pose files again.
    std::thread::sleep(Duration::from_millis(1200));
    capture.end();
    let said = follower.end(0);
    assert!(!said.contains("REFUSED"), "{said}");
}

#[test]
fn what_is_no_regular_file_is_refused_by_name_and_the_run_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let capture = Capture::open(folder.path());
    let at = |name: &str| capture.live.join(name);
    let fifo = |name: &str| assert!(Command::new("mkfifo").arg(at(name)).status().unwrap().success());
    (1..=2).for_each(|number| capture.keyframe(number));
    // Poses that are none.
    fifo("poses/00011.json");
    fs::create_dir(at("poses/00012.json")).unwrap();
    symlink("00013.json", at("poses/00013.json")).unwrap();
    symlink("/dev/zero", at("poses/00014.json")).unwrap();
    let _socket = std::os::unix::net::UnixListener::bind(at("poses/00015.json")).unwrap();
    // Images and spectra that are none.
    let with_pose =
        |number: usize| fs::copy(capture.from.join("poses/00003.json"), at(&format!("poses/{number:05}.json"))).unwrap();
    fifo("images/00021.png");
    fs::copy(capture.from.join("spectra/00003.exr"), at("spectra/00021.exr")).unwrap();
    with_pose(21);
    fs::create_dir(at("images/00022.png")).unwrap();
    with_pose(22);
    capture.without_pose(3);
    fs::rename(at("images/00003.png"), at("images/00023.png")).unwrap();
    symlink("/dev/zero", at("spectra/00023.exr")).unwrap();
    with_pose(23);
    symlink("00024.png", at("images/00024.png")).unwrap();
    with_pose(24);
    // A pose without end, and one that is no text.
    fs::write(at("poses/00025.json"), vec![b' '; 1 << 20]).unwrap();
    fs::write(at("poses/00026.json"), [0xff, 0xfe, 0]).unwrap();
    capture.end();
    let run = folder.path().join("run");
    let said = Follower::start(&capture.live, &run, &[]).end(0);
    let record: serde_json::Value = serde_json::from_slice(&fs::read(run.join("run.json")).unwrap()).unwrap();
    let refused = record["live"]["refused"].as_array().unwrap();
    let files: BTreeSet<&str> = refused.iter().filter_map(|pair| pair[0].as_str()).collect();
    let expected = [11, 12, 13, 14, 15, 21, 22, 23, 24, 25, 26].map(|number| format!("poses/{number:05}.json"));
    assert_eq!(files, expected.iter().map(String::as_str).collect(), "{said}");
    assert_eq!(record["live"]["trained"].as_u64(), Some(2), "{said}");
}

/// A follower that is killed now and then comes to the field of one that is not, whatever has become of the live folder.
#[test]
fn a_live_run_that_was_killed_goes_on_with_what_it_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let capture = Capture::open(folder.path());
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let more = ["--protocol", "test"];
    Follower::start(&capture.from, &whole, &more).end(0);

    let mut follower = Follower::start(&capture.live, &broken, &more);
    (1..=4).for_each(|number| capture.keyframe(number));
    // Refused, and never to be heard of again.
    fs::write(capture.live.join("poses/x.json"), "{}").unwrap();
    follower.until("some are trained", |f| trained(f) >= 3);
    follower.child.kill().unwrap();
    follower.child.wait().unwrap();
    assert!(!broken.join("run.json").exists());
    // Somebody else's command does not go on with it.
    let other = ["reconstruct", "--follow", text(&capture.live), "--out", text(&broken), "--seed", "4"];
    corf_refuses(&other, &["unfinished run of another", "help"]);
    corf_refuses(&["reconstruct", text(tiny_dataset()), "--out", text(&broken)], &["not empty"]);

    // Its files are gone from the live folder meanwhile, and others have come.
    let mut follower = Follower::start(&capture.live, &broken, &more);
    follower.until("it goes on", |f| f.said().contains("going on with the unfinished run"));
    for number in 1..=2 {
        for name in [format!("poses/{number:05}.json"), format!("images/{number:05}.png"), format!("spectra/{number:05}.exr")] {
            fs::remove_file(capture.live.join(name)).unwrap();
        }
    }
    (5..=7).for_each(|number| capture.keyframe(number));
    follower.until("another is trained", |f| f.lines().contains("\"number\":6"));
    // Twice: at once, without a field.
    signal(&follower.child, "-INT");
    signal(&follower.child, "-INT");
    let status = follower.child.wait().unwrap();
    assert!(status.code() == Some(130) || status.success(), "{status:?} {}", follower.said());
    if status.code() == Some(130) {
        (8..=10).for_each(|number| capture.keyframe(number));
        capture.end();
        Follower::start(&capture.live, &broken, &more).end(0);
        let bytes = |run: &Path, name: &str| fs::read(run.join(name)).unwrap();
        assert!(bytes(&whole, "coupled.ply") == bytes(&broken, "coupled.ply"), "the same keyframes, the same field");
        let poses = "dataset/trajectory.json";
        assert!(bytes(&whole, poses) == bytes(&broken, poses));
        let record: serde_json::Value = serde_json::from_slice(&bytes(&broken, "run.json")).unwrap();
        let live = &record["live"];
        assert_eq!((live["trained"].as_u64(), live["held_out"].as_u64()), (Some(8), Some(2)), "{live}");
        assert!(live["resumed"].as_u64().unwrap() >= 4, "{live}");
    }
    assert!(corf_ok(&["dataset", "validate", text(&broken.join("dataset"))]).contains("passed"));
    for left in ["unfinished.json", "dataset/progress", "checkpoint"] {
        assert!(!broken.join(left).exists(), "{left}");
    }
    assert!(hidden(&broken).is_empty());
    corf_refuses(&["reconstruct", "--follow", text(&capture.live), "--out", text(&broken)], &["not empty"]);
}

#[test]
fn a_live_run_whose_folder_went_with_the_kill_ends_with_what_it_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let capture = Capture::open(folder.path());
    let run = folder.path().join("run");
    let mut follower = Follower::start(&capture.live, &run, &[]);
    (1..=4).for_each(|number| capture.keyframe(number));
    follower.until("four are trained", |f| trained(f) == 4);
    follower.child.kill().unwrap();
    follower.child.wait().unwrap();
    fs::remove_dir_all(&capture.live).unwrap();
    Follower::start(&capture.live, &run, &[]).end(0);
    let record: serde_json::Value = serde_json::from_slice(&fs::read(run.join("run.json")).unwrap()).unwrap();
    let live = &record["live"];
    // What is said to be trained was on the disk before.
    assert_eq!(["trained", "resumed", "arrived"].map(|key| live[key].as_u64()), [Some(4); 3], "{live}");
    assert_eq!(live["ended_by"].as_str(), Some("folder-gone"), "{live}");
    assert!(corf_ok(&["dataset", "validate", text(&run.join("dataset"))]).contains("passed"));
}

#[test]
fn links_that_lead_nowhere_are_there_and_not_waited_for() {
    let folder = tempfile::tempdir().unwrap();
    let capture = Capture::open(folder.path());
    let run = folder.path().join("run");
    let nowhere = folder.path().join("nowhere");
    symlink(folder.path().join("gone"), &nowhere).unwrap();
    corf_refuses(&["reconstruct", "--follow", text(&nowhere), "--out", text(&run)], &["leads to none", "help"]);
    // The mark of the end is there, whatever it is.
    (1..=2).for_each(|number| capture.keyframe(number));
    symlink("gone", capture.live.join("end")).unwrap();
    Follower::start(&capture.live, &run, &[]).end(0);
    let other = folder.path().join("other");
    let description = capture.live.join("capture.toml");
    fs::remove_file(&description).unwrap();
    symlink("gone", &description).unwrap();
    corf_refuses(
        &["reconstruct", "--follow", text(&capture.live), "--out", text(&other)],
        &["capture.toml", "leads nowhere", "help"],
    );
    assert!(!other.exists());
}
