//! Views of a run: other cameras, circles, poses of other programs, and videos of them.

use crate::common::*;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

/// A small run in a folder of its own.
fn small_run() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let few = ["--set", "iterations_per_keyframe=3", "--device", "cpu"];
    corf_ok(&[&["reconstruct", text(tiny_dataset()), "--out", text(&run)][..], &few].concat());
    (folder, run)
}

fn pixels(path: &Path) -> (u32, u32) {
    image::image_dimensions(path).unwrap()
}

/// Runs a command that finds programs in `bin` alone.
fn with_path(bin: &Path, arguments: &[&str]) -> Output {
    command(arguments).env("PATH", bin).output().unwrap()
}

#[test]
fn images_have_the_size_and_the_view_that_is_asked_for() {
    let (folder, run) = small_run();
    let at = |name: &str| folder.path().join(name);
    let render = |out: &Path, more: &[&str]| {
        corf_ok(&[&["render", text(&run), "--out", text(out), "--device", "cpu"][..], more].concat());
    };
    render(&at("wide"), &["--orbit", "2", "--size", "120x50", "--fov", "120"]);
    assert_eq!((pixels(&at("wide/images/00001.png")), pixels(&at("wide/jet/00002.png"))), ((120, 50), (48, 32)));
    assert!(!at("wide/images/00003.png").exists());
    // Twice as many pixels of the same view: every other one is what it was, but for what lies between.
    let poses = tiny_dataset().join("trajectory.json");
    render(&at("own"), &["--poses", text(&poses)]);
    render(&at("same"), &["--poses", text(&poses), "--size", "96x54"]);
    let own = |name: &str| fs::read(at("own").join(name)).unwrap();
    assert!(own("images/00003.png") == fs::read(at("same/images/00003.png")).unwrap(), "the dataset's own size is its camera");
    // The frames of transforms.json are the trajectory's, in OpenGL's axes.
    let transforms = tiny_dataset().join("optical/transforms.json");
    render(&at("opengl"), &["--poses", text(&transforms)]);
    for name in ["images/00003.png", "jet/00010.png"] {
        assert!(own(name) == fs::read(at("opengl").join(name)).unwrap(), "{name}");
    }
    // About a keyframe, with a radius that is next to nothing: what the keyframe saw.
    render(&at("about"), &["--orbit", "3", "--keyframe", "2", "--radius", "0.001"]);
    let image = |path: PathBuf| image::open(path).unwrap().into_rgb8();
    let (a, b) = (image(at("about/images/00002.png")), image(at("own/images/00003.png")));
    let error: f64 =
        a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / a.as_raw().len() as f64;
    assert!(error < 4.0, "{error}");
    let refuses = |more: &[&str], words: &[&str]| {
        corf_refuses(&[&["render", text(&run), "--out", text(&at("none"))][..], more].concat(), words);
        assert!(!at("none").exists());
    };
    refuses(&[], &["--poses"]);
    refuses(&["--orbit", "3", "--fov", "190"], &["--fov"]);
    refuses(&["--orbit", "3", "--size", "7"], &["--size"]);
    refuses(&["--orbit", "3", "--keyframe", "10"], &["the dataset has 10"]);
    refuses(&["--orbit", "3", "--radius", "0"], &["--radius"]);
    corf_refuses(&["render", text(&run), "--out", text(&at("wide")), "--orbit", "2", "--resume"], &["another camera"]);
}

#[cfg(unix)]
#[test]
fn a_video_has_every_frame_or_is_none() {
    use std::os::unix::fs::PermissionsExt;
    let (folder, run) = small_run();
    let bin = folder.path().join("bin");
    fs::create_dir(&bin).unwrap();
    let video = folder.path().join("turn.mp4");
    let render = |out: &str| {
        let out = folder.path().join(out);
        let arguments = ["render", text(&run), "--orbit", "4", "--out", text(&out), "--video", text(&video), "--device", "cpu"];
        with_path(&bin, &arguments)
    };
    let stderr = |output: &Output| String::from_utf8_lossy(&output.stderr).into_owned();
    let without = render("without");
    assert_eq!(without.status.code(), Some(2));
    assert!(stderr(&without).contains("not on PATH") && !folder.path().join("without").exists(), "{}", stderr(&without));
    // An ffmpeg that counts the pictures it is given and leaves out as many as it is told.
    let ffmpeg = |left_out: usize| {
        let script = format!(
            "#!/bin/sh\nif [ \"$1\" = -version ]; then echo 'ffmpeg version test'; exit 0; fi\nfor last; do :; done\nn=0\nfor f in ./*.png; do n=$((n+1)); \
             done\necho \"frame=$((n-{left_out}))\" > \"$last\"\necho \"frame=$((n-{left_out}))\"\necho progress=end\n"
        );
        fs::write(bin.join("ffmpeg"), script).unwrap();
        fs::set_permissions(bin.join("ffmpeg"), fs::Permissions::from_mode(0o755)).unwrap();
    };
    ffmpeg(1);
    let lossy = render("lossy");
    assert_eq!(lossy.status.code(), Some(2), "{}", stderr(&lossy));
    assert!(stderr(&lossy).contains("3 frames of 4") && !video.exists(), "{}", stderr(&lossy));
    assert!(folder.path().join("lossy/images/00004.png").exists(), "the pictures stay");
    ffmpeg(0);
    let whole = render("whole");
    assert_eq!(whole.status.code(), Some(0), "{}", stderr(&whole));
    assert_eq!(fs::read_to_string(&video).unwrap(), "frame=4\n");
}
