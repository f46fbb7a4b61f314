//! What the program says of itself: completions, the machine, the keys of its files.

use crate::common::*;
use serde_json::Value;

#[test]
fn every_shell_gets_completions_of_all_commands() {
    for shell in ["bash", "zsh", "fish", "powershell"] {
        let script = corf_ok(&["completions", shell]);
        for word in ["reconstruct", "dataset", "play", "when-behind", "threads"] {
            assert!(script.contains(word), "{shell} lacks {word}");
        }
    }
    corf_refuses(&["completions", "csh"], &["csh"]);
}

#[test]
fn the_doctor_answers_whatever_the_machine_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let output = command(&["doctor", "--json"]).env("PATH", folder.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(0));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["program"]["version"], env!("CARGO_PKG_VERSION"));
    assert!(report["memory_available_bytes"].as_f64().unwrap() > 1e6 && report["program"]["threads"].as_u64().unwrap() >= 1);
    for part in ["gpu", "lpips", "oidn", "ffmpeg"] {
        assert!(report[part]["found"].is_boolean() && !report[part]["what"].as_str().unwrap().is_empty(), "{part}");
    }
    assert_eq!(report["ffmpeg"]["found"], false);
    let text = corf_ok(&["doctor", "--lpips", "/nowhere"]);
    assert!(text.contains("processor") && text.contains("/nowhere holds no weights"), "{text}");
}

#[test]
fn keys_are_explained_and_others_are_refused() {
    let text = corf_ok(&["config", "--explain", "corf-gs-fast", "--key", "iterations"]);
    assert!(text.contains("iterations_per_keyframe  (integer, default 40)"), "{text}");
    let keys: Value = serde_json::from_str(&corf_ok(&["config", "--explain", "scene", "--json"])).unwrap();
    let position = keys.as_array().unwrap().iter().find(|k| k["key"] == "transmitter.position_m").unwrap();
    assert!(position["meaning"].as_str().unwrap().contains("metres") && position["required"] == true, "{position}");
    assert!(corf_ok(&["config", "--explain", "plan"]).contains("row[].method"));
    corf_refuses(&["config", "--explain", "nothing"], &["the methods are", "plan"]);
    corf_refuses(&["config", "--explain", "scene", "--key", "zzz"], &["no key"]);
}
