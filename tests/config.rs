//! The shipped configurations and what `carved config check` says of broken ones.

#![allow(clippy::unwrap_used)] // a test may panic; its helpers are part of it

mod common;

use carved::config::Config;
use common::{run, stderr};
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config")
}

#[test]
fn every_shipped_configuration_is_sound() {
    let mut seen = 0;
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            Config::load(&path).unwrap();
            let output = run(&["config", "check", path.to_str().unwrap()]);
            assert!(output.status.success(), "{}", stderr(&output));
            seen += 1;
        }
    }
    assert!(seen >= 2, "simulated.toml and vast-grbl.toml stand in config/, found {seen}");
}

/// Every key that is marked as a default may be left out, and what is left out has the value that is written.
#[test]
fn the_defaults_are_those_that_the_file_names() {
    let text = std::fs::read_to_string(folder().join("simulated.toml")).unwrap();
    let short: String = text.lines().filter(|l| !l.contains("# default")).map(|l| format!("{l}\n")).collect();
    assert!(short.len() < text.len());
    let here = Path::new("here");
    let (whole, short) = (Config::parse(&text, here).unwrap(), Config::parse(&short, here).unwrap());
    assert_eq!(format!("{whole:?}"), format!("{short:?}"));
}

#[test]
fn breaches_name_file_key_value_and_expectation_all_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("broken.toml");
    let text = std::fs::read_to_string(folder().join("simulated.toml")).unwrap();
    let check = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let output = run(&["config", "check", path.to_str().unwrap()]);
        assert!(!output.status.success());
        stderr(&output)
    };
    let said = check(
        &text.replace("asd = 21", "asd = 2").replace("voxel_um = 6.93", "voxel_um = -1.0").replace("width_px = 1024", "width_px = 512"),
    );
    for word in ["broken.toml", "asd = 2", "voxel_um = -1", "1024 x 1024", "512 x 1024"] {
        assert!(said.contains(word), "{word} is not in: {said}");
    }
    let said = check(&text.replace("settle_ms", "setle_ms"));
    assert!(said.contains("setle_ms") && said.contains("broken.toml"), "{said}");
    let said = check(&text.replace("sense = 1 ", "sense = 0 "));
    assert!(said.contains("sense is 0"), "{said}");
    let said = stderr(&run(&["config", "check", "/no/such/file.toml"]));
    assert!(said.contains("/no/such/file.toml"), "{said}");
}
