//! What a run says of devices, checkpoints and sizes, where no GPU is needed to see it.

use crate::common::*;
use std::fs;
#[cfg(unix)]
use std::io::Read;
#[cfg(unix)]
use std::process::Stdio;

/// A spectrum of 17x9 pixels beside an image of 33x19: two levels of the image, one of the spectrum.
#[test]
fn fewer_levels_of_the_spectrum_are_heeded() {
    let folder = tempfile::tempdir().unwrap();
    let scene = root().join("scenes/room.toml").canonicalize().unwrap();
    let config = folder.path().join("t.toml");
    let body = format!(
        "name = \"s33\"\nscene = {scene:?}\nkeyframes = 8\nseed = 1\n[optical]\nwidth = 33\nheight = 19\nmethod = \"path\"\n\
         samples_per_pixel = 2\nmax_bounces = 2\n[rf]\nwidth = 17\nheight = 9\npatch_size_m = 0.5\n"
    );
    fs::write(&config, body).unwrap();
    let dataset = folder.path().join("s33");
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&dataset)]);
    let out = |name: &str| folder.path().join(name);
    for (name, sets, refused) in [
        ("fewer", ["pyramid_levels=2", "rf_pyramid_levels=1"], None),
        ("as-many", ["pyramid_levels=2", "finest_share=1.0"], Some("`pyramid_levels`")),
        ("two", ["pyramid_levels=2", "rf_pyramid_levels=2"], Some("`rf_pyramid_levels`")),
        ("deep", ["pyramid_levels=3", "rf_pyramid_levels=1"], Some("`pyramid_levels`")),
    ] {
        let out = out(name);
        let steps = "iterations_per_keyframe=5";
        let arguments = ["reconstruct", text(&dataset), "--device", "cpu", "--out", text(&out), "--set", steps];
        let arguments = [&arguments[..], &["--set", sets[0], "--set", sets[1]]].concat();
        match refused {
            None => drop(corf_ok(&arguments)),
            Some(key) => corf_refuses(&arguments, &[key, "below 8 pixels", "help"]),
        }
        // What is refused leaves nothing, so that the corrected command finds its place empty.
        assert_eq!((out.join("run.json").exists(), out.exists()), (refused.is_none(), refused.is_none()), "{name}");
    }
}

/// The messages of a reconstruction that is interrupted when `ready` says so.
#[cfg(unix)]
fn last_words(arguments: &[&str], ready: impl Fn() -> bool) -> String {
    let mut child = command(arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let begin = std::time::Instant::now();
    while !ready() && child.try_wait().unwrap().is_none() {
        assert!(begin.elapsed() < PATIENCE, "corf {arguments:?} did not come to the point");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130), "{said}");
    said
}

/// What is said at the end of an interrupt is what is on disk.
#[cfg(unix)]
#[test]
fn an_interrupt_says_what_it_kept() {
    let folder = tempfile::tempdir().unwrap();
    // Long enough that an interrupt comes before the end.
    let common = ["reconstruct", text(tiny_dataset()), "--device", "cpu", "--set", "iterations_per_keyframe=400", "--out"];
    let none = folder.path().join("none");
    let arguments = [&common[..], &[text(&none), "--checkpoint-every", "0"]].concat();
    let said = last_words(&arguments, || none.join("config.json").exists());
    assert!(said.contains("nothing is kept") && !said.contains("goes on from there"), "{said}");
    assert!(!none.join("checkpoint").exists() && !none.join("run.json").exists());

    let some = folder.path().join("some");
    let arguments = [&common[..], &[text(&some), "--checkpoint-every", "2"]].concat();
    let said = last_words(&arguments, || some.join("checkpoint").exists());
    let kept = format!("{} holds ", some.join("checkpoint").display());
    let count = said.split(&kept).nth(1).and_then(|rest| rest.split(' ').next()).and_then(|count| count.parse::<u64>().ok());
    let count = count.unwrap_or_else(|| panic!("{said}"));
    assert!(count >= 2 && said.contains("--resume goes on from there"), "{said}");

    // On the processor whatever the number of threads; and as many keyframes came from the checkpoint as were said to.
    corf_ok(&[&arguments[..], &["--resume", "--threads", "1"]].concat());
    let run: serde_json::Value = serde_json::from_slice(&fs::read(some.join("run.json")).unwrap()).unwrap();
    assert_eq!(run["resumed_keyframes"].as_u64(), Some(count));
}
