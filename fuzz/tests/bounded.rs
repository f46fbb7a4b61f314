//! Every parser on some inputs of a fixed seed; the long run is a command of README.md.

use std::process::Command;

#[test]
fn no_parser_panics_aborts_hangs_or_takes_a_gibibyte() {
    let findings = tempfile::tempdir().unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_corf-fuzz"))
        .args(["--inputs", "20000", "--seconds-per-target", "5", "--seed", "7", "--findings"])
        .arg(findings.path())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    // Every target ran its corpus at least, and read a part of what it was given.
    for line in text.lines() {
        let inputs: u64 = line.split_whitespace().nth(1).and_then(|n| n.parse().ok()).unwrap();
        assert!(inputs > 50 && !line.contains(" 0.0 %"), "{line}");
    }
    assert_eq!(text.lines().count(), corf_fuzz::target::TARGETS.len(), "{text}");
}

#[test]
fn what_is_wrong_is_found_and_said() {
    let output = Command::new(env!("CARGO_BIN_EXE_corf-fuzz")).args(["--target", "none"]).output().unwrap();
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("one of: gltf"));
}
