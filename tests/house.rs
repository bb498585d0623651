//! The rules of the architecture: dependencies point one way, and the science uses no runtime, files, network or clock.

#![allow(clippy::unwrap_used)] // a test may panic; its helpers are part of it

#[path = "common/strict.rs"]
mod strict;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// The modules of the daemon, each with the other modules that it may use. Cargo's manifests define the dependencies between crates.
const MAY_USE: &[(&str, &[&str])] = &[
    ("export", &[]),
    ("config", &[]),
    // Made of records and of what devices report.
    ("api", &[]),
    // Messages to people, made of the status.
    ("notify", &["api", "config"]),
    // It builds its snapshots of API types, and does not know `http`, which serves them.
    ("session", &["api", "export", "config", "notify"]),
    // Stored runs as tables, for the API and the commands.
    ("tables", &[]),
    ("report", &["export", "tables"]),
    ("http", &["api", "config", "notify", "report", "session", "tables"]),
];

/// Crates with the crates of this workspace that they may depend on.
const MAY_DEPEND_ON: &[(&str, &[&str])] = &[
    ("crates/core", &[]),
    ("crates/files", &[]),
    ("crates/pictures", &["carved-core", "carved-files"]),
    ("crates/records", &["carved-core"]),
    ("crates/devices", &["carved-core", "carved-files", "carved-records"]),
    ("crates/store", &["carved-core", "carved-files", "carved-pictures", "carved-records"]),
    ("crates/offline", &["carved-core", "carved-records", "carved-store"]),
    ("crates/validate", &["carved-core", "carved-devices", "carved-records", "hardware-sim"]),
    ("python", &["carved-core", "carved-offline", "carved-records", "carved-store"]),
    // The emulated rig must not share code with carved: a wrong sign in shared code would not show.
    ("hardware-sim", &[]),
];

/// The modules of the science. Each may use those before it, and the macro `ranges!`.
const ORDER_OF_SCIENCE: [&str; 18] = [
    "range",
    "flag",
    "units",
    "frame",
    "statistics",
    "parallel",
    "assay",
    "geometry",
    "profile",
    "inside",
    "carver",
    "calibration",
    "fins",
    "surface",
    "measure",
    "quality",
    "reconstruction",
    "pipeline",
];

const NOT_IN_SCIENCE: &[&str] =
    &["tokio", "std::fs", "std::net", "std::thread", "std::time", "Instant::now", "SystemTime", "jiff", "axum", "tracing", "println!"];

/// What is derived from events must depend neither on the time of the request nor on the disk.
const NOT_IN_RECORDS: &[&str] =
    &["tokio", "std::fs", "std::net", "std::thread", "Instant", "SystemTime", "Timestamp::now", "axum", "tracing", "println!"];

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

/// The files of a module of a crate, without tests. `crates/core` names the science, `.` the daemon.
fn module_sources(of: &str, module: &str) -> Vec<PathBuf> {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join(of).join("src");
    let mut found = Vec::new();
    sources(&src.join(format!("{module}.rs")), &mut found);
    sources(&src.join(module), &mut found);
    assert!(!found.is_empty(), "module {module} has no source: the table is out of date");
    found
}

/// The code of a file without its unit tests and comments. Unit tests in the file itself are its last part.
fn code(path: &Path) -> String {
    let text = std::fs::read_to_string(path).unwrap();
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
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
        for file in module_sources(".", module) {
            for name in used(&code(&file)) {
                if name != *module && !allowed.contains(&name.as_str()) {
                    breaches.push(format!("{}: uses crate::{name}", file.display()));
                }
            }
        }
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
}

#[test]
fn modules_of_the_science_use_only_what_stands_before_them() {
    let mut breaches = Vec::new();
    for (at, module) in ORDER_OF_SCIENCE.iter().enumerate() {
        for file in module_sources("crates/core", module) {
            for name in used(&code(&file)) {
                if name != "ranges" && !ORDER_OF_SCIENCE[..=at].contains(&name.as_str()) {
                    breaches.push(format!("{}: uses crate::{name}", file.display()));
                }
            }
        }
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
    assert_eq!(modules_of("crates/core"), BTreeSet::from(ORDER_OF_SCIENCE.map(str::to_owned)));
}

/// The status is polled, so it must not read the disk. Only the routes of results, and of events older than the memory holds, may do so.
#[test]
fn only_results_and_old_events_read_the_store() {
    let reads: Vec<String> = module_sources(".", "http")
        .into_iter()
        .filter(|file| code(file).contains("app.reader"))
        .map(|file| file.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    assert_eq!(reads.iter().map(String::as_str).collect::<BTreeSet<_>>(), BTreeSet::from(["events.rs", "results.rs"]));
}

/// The files that carry out what the driver's parts decide call each other in one direction. No part names `driver_state`, so none can act.
#[test]
fn what_carries_out_the_decisions_of_the_driver_calls_in_one_direction() {
    let driver = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/session/driver");
    let calls = [
        ("driver_state", &[][..]),
        ("reports", &["driver_state"]),
        ("missing", &["driver_state"]),
        ("course", &["driver_state", "missing"]),
        ("checks", &["driver_state", "course"]),
        ("people", &["driver_state"]),
        ("queue", &["driver_state"]),
        ("requests", &["driver_state", "course", "people", "queue"]),
        ("restart", &["driver_state", "missing", "course", "people", "queue"]),
    ];
    for (file, may_call) in calls {
        let code = code(&driver.join(format!("{file}.rs")));
        for (other, _) in calls.iter().filter(|(other, _)| *other != file && !may_call.contains(other)) {
            assert!(!names(&code, other), "{file}.rs must not use {other}.rs");
        }
    }
    let mut files = Vec::new();
    sources(&driver, &mut files);
    for file in files {
        let name = file.strip_prefix(&driver).unwrap().with_extension("");
        let is_part = !name.starts_with("tests") && !calls.iter().any(|(other, _)| name == Path::new(other));
        // `mod.rs` waits for what comes next and passes it on.
        assert!(!is_part || name == Path::new("mod") || !names(&code(&file), "driver_state"), "{} is a part", file.display());
    }
}

/// Rooms whose modules must not use each other in a circle, each with its path in the crate.
const WITHOUT_CIRCLES: &[(&str, &str)] = &[
    ("crates/store/src", ""),
    ("crates/core/src/profile", "profile::"),
    ("src/http", "http::"),
    ("src/session", "session::"),
    ("src/session/worker", "session::worker::"),
    ("src/report", "report::"),
    ("src/config", "config::"),
];

#[test]
fn modules_of_a_room_do_not_use_each_other_in_a_circle() {
    for (room, path) in WITHOUT_CIRCLES {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join(room);
        let mut files = Vec::new();
        sources(&root, &mut files);
        let mut uses: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for file in &files {
            let below = file.strip_prefix(&root).unwrap().with_extension("");
            let parts: Vec<_> = below.iter().map(|part| part.to_string_lossy().into_owned()).collect();
            let is_of_tests = parts.iter().any(|part| ["tests", "testing", "power_loss"].contains(&part.as_str()));
            if is_of_tests || ["mod", "lib"].contains(&parts[0].as_str()) {
                continue;
            }
            let depth = parts.len() - usize::from(parts.last().is_some_and(|last| last == "mod"));
            let prefixes = [format!("crate::{path}"), "super::".repeat(depth)];
            uses.entry(parts[0].clone()).or_default().extend(prefixes.iter().flat_map(|prefix| behind(prefix, &code(file))));
        }
        // A module that uses no other one, or that no other one uses, is in no circle. What is left without all of these is.
        loop {
            let (known, before) = (uses.clone(), uses.len());
            for (module, others) in &mut uses {
                others.retain(|other| other != module && known.contains_key(other));
            }
            uses.retain(|module, others| !others.is_empty() && known.iter().any(|(user, used)| user != module && used.contains(module)));
            if uses.len() == before {
                break;
            }
        }
        assert!(uses.is_empty(), "{room}: these modules use each other in a circle: {uses:#?}");
    }
}

/// The names that directly follow a path, alone or in a list of braces.
fn behind(prefix: &str, code: &str) -> BTreeSet<String> {
    let name = |text: &str| text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut found = BTreeSet::new();
    for (at, _) in code.match_indices(prefix).filter(|(at, _)| !code[..*at].ends_with("super::")) {
        let rest = &code[at + prefix.len()..];
        let Some(list) = rest.strip_prefix('{') else {
            found.insert(name(rest));
            continue;
        };
        let mut depth = 0;
        let ends = |c: char| {
            depth += i32::from(c == '{') - i32::from(c == '}');
            depth < 0 || depth == 0 && c == ','
        };
        found.extend(list.split(';').next().unwrap_or_default().split(ends).map(name));
    }
    found
}

/// Whether the code names this module in a path.
fn names(code: &str, module: &str) -> bool {
    let is_of_a_name = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(module).any(|(at, _)| {
        let (before, after) = (&code[..at], &code[at + module.len()..]);
        let is_whole = !before.ends_with(is_of_a_name) && !after.starts_with(is_of_a_name);
        let is_listed = before.rsplit([';', '}']).next().is_some_and(|line| line.trim_start().starts_with("use super::"));
        is_whole && (after.starts_with("::") || is_listed)
    })
}

/// What is written describes itself for the contract only if the daemon asks for it: by the feature `schema` of the records.
#[test]
fn what_is_written_describes_itself_for_the_api_only_as_a_feature() {
    for folder in ["crates/core", "crates/records", "crates/devices", "crates/store"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder).join("Cargo.toml");
        let manifest: toml::Table = std::fs::read_to_string(&path).unwrap().parse().unwrap();
        let utoipa = manifest["dependencies"].get("utoipa");
        let is_feature = utoipa.is_some_and(|it| it.get("optional").and_then(toml::Value::as_bool) == Some(true));
        assert!(utoipa.is_none() || is_feature && folder == "crates/records", "{folder}");
    }
}

#[test]
fn the_table_names_every_module() {
    let mut table: BTreeSet<_> = MAY_USE.iter().map(|(m, _)| (*m).to_owned()).collect();
    // The commands assemble everything, so they may use every module.
    table.insert("cli".to_owned());
    assert_eq!(modules_of("."), table);
}

/// The modules that the root of a crate declares.
fn modules_of(of: &str) -> BTreeSet<String> {
    let lib = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(of).join("src/lib.rs")).unwrap();
    let declared = lib.lines().filter_map(|line| line.strip_prefix("pub ").unwrap_or(line).strip_prefix("mod "));
    declared.map(|name| name.trim_end_matches(';').to_owned()).collect()
}

#[test]
fn science_and_records_know_no_runtime_files_network_or_clock() {
    let mut breaches = Vec::new();
    for (folder, words) in [("crates/core/src", NOT_IN_SCIENCE), ("crates/records/src", NOT_IN_RECORDS)] {
        let mut files = Vec::new();
        sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join(folder), &mut files);
        assert!(!files.is_empty());
        for file in files {
            let code = code(&file);
            for word in words.iter().filter(|w| code.contains(**w)) {
                breaches.push(format!("{}: {word}", file.display()));
            }
        }
    }
    assert!(breaches.is_empty(), "{}", breaches.join("\n"));
}

#[test]
fn crates_depend_only_on_what_stands_to_their_left() {
    for (folder, allowed) in MAY_DEPEND_ON {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder).join("Cargo.toml");
        let manifest: toml::Table = std::fs::read_to_string(&path).unwrap().parse().unwrap();
        let used: Vec<&String> = manifest["dependencies"]
            .as_table()
            .unwrap()
            .keys()
            .filter(|name| name.starts_with("carved") || *name == "hardware-sim")
            .collect();
        assert!(used.iter().all(|name| allowed.contains(&name.as_str())), "{folder} depends on {used:?}, may depend on {allowed:?}");
    }
}

/// Crates with other features are compiled again: two minutes of processor time for the wheel of `python/check test`, and more for a test of
/// this package after those of the workspace.
#[test]
fn all_tests_and_the_python_module_share_one_build() {
    let crates = |of: &[&str]| -> BTreeSet<String> {
        let listed = std::process::Command::new(env!("CARGO"))
            .args(["tree", "--locked", "--prefix", "none", "--format", "{p} with {f}"])
            .args(of)
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .unwrap();
        assert!(listed.status.success(), "{}", String::from_utf8_lossy(&listed.stderr));
        String::from_utf8(listed.stdout).unwrap().lines().map(|line| line.trim_end_matches(" (*)").to_owned()).collect()
    };
    let of_workspace = crates(&["--workspace", "--edges", "normal,build,dev"]);
    let of_package = crates(&["--package", "carved", "--edges", "normal,build,dev"]);
    let other: Vec<_> = of_package.difference(&of_workspace).collect();
    assert!(other.is_empty(), "the workspace has these with other features, see [dev-dependencies] in Cargo.toml: {other:#?}");
    let of_module = crates(&["--package", "carved-python", "--features", "shared-build", "--edges", "normal"]);
    let other: Vec<_> = of_module.difference(&of_workspace).filter(|line| !line.starts_with("carved-python ")).collect();
    assert!(other.is_empty(), "the tests have these with other features, see shared-build in python/Cargo.toml: {other:#?}");
}

#[test]
fn a_strict_run_leaves_no_test_out() {
    strict::holds(&[
        // These data are no part of the project: a clone without them must pass, and cargo reports their tests as ignored.
        (cfg!(has_shared) || std::env::var_os("CARVED_SHARED").is_none(), "CARVED_SHARED does not name a folder of shared data"),
        (cfg!(has_python), "no Python 3 with venv: apt-get install python3-venv"),
        (cfg!(has_rscript), "no Rscript: apt-get install r-base-core"),
        (cfg!(has_promtool), "no promtool: apt-get install prometheus"),
        (cfg!(has_systemd_analyze), "no systemd-analyze: apt-get install systemd"),
        (cfg!(has_root), "not built as root: mounting a small file system needs it"),
        (cfg!(feature = "aravis"), "built without the feature aravis"),
    ]);
}

/// Long lines of prose are hard to compare and to read in a terminal. Lines of tables, code, images and comments cannot be wrapped.
#[test]
fn prose_is_wrapped_at_120_characters() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let listed = std::process::Command::new("git").args(["ls-files", "*.md"]).current_dir(root).output().unwrap();
    let files = String::from_utf8(listed.stdout).unwrap();
    // Without git, as in an unpacked archive, the pages that every reader opens are checked.
    let files = if files.is_empty() { "README.md\nARCHITECTURE.md\nCONTRIBUTING.md\nCHANGELOG.md".to_owned() } else { files };
    let mut breaches = Vec::new();
    for file in files.lines() {
        let Ok(text) = std::fs::read_to_string(root.join(file)) else { continue };
        let mut is_code = false;
        for (number, line) in (1..).zip(text.lines()) {
            is_code ^= line.trim_start().starts_with("```");
            let is_prose = !is_code && !["|", "![", "<", "[!["].iter().any(|start| line.trim_start().starts_with(start));
            if is_prose && line.chars().count() > 120 {
                breaches.push(format!("{file}:{number}: {} characters", line.chars().count()));
            }
        }
    }
    assert!(breaches.is_empty(), "wrap at 120 characters:\n{}", breaches.join("\n"));
}
