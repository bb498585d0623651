//! The house's rules: data flows one way, and the science knows no runtime, files, network or clock.

#![allow(clippy::unwrap_used)] // a test may panic; its helpers are part of it

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Every top-level module with the modules of this crate it may use.
const MAY_USE: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("frame", &[]),
    ("range", &[]),
    ("cancel", &[]),
    ("hash", &[]),
    ("regular", &[]),
    ("statistics", &[]),
    ("geometry", &[]),
    ("profile", &["frame", "range", "geometry"]),
    ("carver", &["geometry", "profile"]),
    ("calibration", &["statistics", "geometry", "profile", "carver"]),
    ("surface", &["geometry", "profile", "carver"]),
    ("measure", &["statistics", "geometry", "carver", "calibration", "surface"]),
    ("quality", &["range", "statistics", "calibration", "measure"]),
    ("reconstruction", &["range", "geometry", "profile", "carver", "calibration", "surface", "measure", "quality"]),
    ("pipeline", &["frame", "geometry", "profile", "carver", "calibration", "reconstruction", "surface", "measure", "quality"]),
    ("export", &["surface"]),
    ("device", &["units", "frame", "cancel"]),
    ("acquisition", &["units", "frame", "cancel", "hash", "device"]),
    (
        "config",
        &[
            "units",
            "frame",
            "geometry",
            "profile",
            "measure",
            "quality",
            "reconstruction",
            "pipeline",
            "acquisition",
            "device",
            "http",
            "regular",
            "session",
            "store",
        ],
    ),
    (
        "store",
        &[
            "units",
            "frame",
            "hash",
            "regular",
            "statistics",
            "geometry",
            "profile",
            "surface",
            "measure",
            "quality",
            "pipeline",
            "acquisition",
            "config",
            "session",
        ],
    ),
    (
        "session",
        &[
            "units",
            "frame",
            "cancel",
            "profile",
            "surface",
            "measure",
            "pipeline",
            "quality",
            "export",
            "device",
            "acquisition",
            "config",
            "store",
        ],
    ),
    // `store` to read what runs have left; what the instrument does now comes from `session` alone.
    ("http", &["range", "regular", "session", "store"]),
];

const SCIENCE: &[&str] = &[
    "units",
    "frame",
    "range",
    "statistics",
    "geometry",
    "profile",
    "carver",
    "calibration",
    "surface",
    "measure",
    "quality",
    "reconstruction",
    "pipeline",
];
const NOT_IN_SCIENCE: &[&str] =
    &["tokio", "std::fs", "std::net", "std::thread", "std::time", "Instant::now", "SystemTime", "jiff", "axum", "tracing", "println!"];

fn sources(under: &Path, found: &mut Vec<PathBuf>) {
    if under.is_file() {
        found.push(under.to_owned());
    } else if under.is_dir() {
        for entry in std::fs::read_dir(under).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() || path.extension().is_some_and(|e| e == "rs") && !path.ends_with("tests.rs") {
                sources(&path, found);
            }
        }
    }
}

fn module_sources(module: &str) -> Vec<PathBuf> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut found = Vec::new();
    sources(&src.join(format!("{module}.rs")), &mut found);
    sources(&src.join(module), &mut found);
    assert!(!found.is_empty(), "module {module} has no source: the table is out of date");
    found
}

/// The code of a file without its unit tests and comments.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    code.lines().filter(|l| !l.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
}

/// Names of this crate's modules that a file uses, as `crate::NAME`.
fn used(code: &str) -> BTreeSet<String> {
    code.split("crate::").skip(1).map(|rest| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()).collect()
}

#[test]
fn modules_use_only_what_stands_to_their_left() {
    let mut breaches = Vec::new();
    for (module, allowed) in MAY_USE {
        for file in module_sources(module) {
            for name in used(&code(&file)) {
                if name != *module && !allowed.contains(&name.as_str()) {
                    breaches.push(format!("{}: uses crate::{name}", file.display()));
                }
            }
        }
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
}

/// The status is polled: only the routes of results, and events older than memory holds, read the disk.
#[test]
fn only_results_and_old_events_read_the_store() {
    let reads: Vec<String> = module_sources("http")
        .into_iter()
        .filter(|file| code(file).contains("app.reader"))
        .map(|file| file.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(reads.iter().map(String::as_str).collect::<BTreeSet<_>>(), BTreeSet::from(["events.rs", "results.rs"]));
}

#[test]
fn the_table_names_every_module() {
    let lib = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/lib.rs")).unwrap();
    let modules: BTreeSet<_> = lib.lines().filter_map(|l| l.strip_prefix("pub mod ")).map(|l| l.trim_end_matches(';')).collect();
    let mut table: BTreeSet<_> = MAY_USE.iter().map(|(m, _)| *m).collect();
    // The commands are the edge where everything is put together.
    table.insert("cli");
    assert_eq!(modules, table);
}

#[test]
fn the_science_knows_no_runtime_files_network_or_clock() {
    let mut breaches = Vec::new();
    for module in SCIENCE {
        for file in module_sources(module) {
            let code = code(&file);
            for word in NOT_IN_SCIENCE.iter().filter(|w| code.contains(**w)) {
                breaches.push(format!("{}: {word}", file.display()));
            }
        }
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
}

#[test]
fn the_emulated_rig_knows_nothing_of_carved() {
    let manifest = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("hardware-sim/Cargo.toml")).unwrap();
    let dependencies = manifest.split("[dependencies]").nth(1).unwrap();
    assert!(
        !dependencies.lines().any(|l| l.starts_with("carved")),
        "hardware-sim depends on carved: a sign wrong in one would be wrong in both"
    );
}
