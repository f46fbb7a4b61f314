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
fn panics_aborts_memory_and_overflowing_stacks_are_found_and_laid_to_their_inputs() {
    let findings = tempfile::tempdir().unwrap();
    let run = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_corf-fuzz"));
        command.args(["--target", "self-check"]).args(more).output().unwrap()
    };
    let output = run(&["--inputs", "5", "--findings", findings.path().to_str().unwrap()]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("4 findings") && text.contains("as asked") && text.contains("5 inputs"), "{text}");
    let mut found: Vec<Vec<u8>> =
        std::fs::read_dir(findings.path()).unwrap().map(|f| std::fs::read(f.unwrap().path()).unwrap()).collect();
    found.sort();
    assert_eq!(found, [b"abort".to_vec(), b"memory".to_vec(), b"panic".to_vec(), b"stack".to_vec()]);
    let first = std::fs::read_dir(findings.path()).unwrap().next().unwrap().unwrap().path();
    assert!(!run(&["--replay", first.to_str().unwrap()]).status.success());
}

#[test]
fn targets_are_known_by_name() {
    let output = Command::new(env!("CARGO_BIN_EXE_corf-fuzz")).args(["--target", "none"]).output().unwrap();
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("one of: gltf"));
}
