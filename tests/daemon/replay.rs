//! `carved replay` on a run that the daemon measured on the emulated rig. The stored result is reproduced bit for bit, the result of
//! another method is shown beside it, and altered or missing files are named. No stored file is ever changed.
#![cfg(feature = "aravis")]

use crate::common::bench::{Bench, bead};
use crate::common::{copy_folder, json, run, stderr};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::{Arc, Mutex, Weak};

/// A data folder with the run `r1`: a bead of 500 um in A01 with a few views.
fn stored() -> Arc<tempfile::TempDir> {
    // Measured once for all tests that run at the same time.
    static SHARED: Mutex<Weak<tempfile::TempDir>> = Mutex::new(Weak::new());
    let mut shared = SHARED.lock().unwrap();
    if let Some(there) = shared.upgrade() {
        return there;
    }
    let bench = Bench::new();
    let daemon = bench.serve(&[("asd = 21", "asd = 9".into()), ("voxel_um = 6.93", "voxel_um = 17.1".into())], "");
    let status = bench.measured(&daemon, "r1", "standard", &[bead("A01", 500.0)]);
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
    daemon.signal("TERM");
    assert_eq!(daemon.ended(), Some(0));
    let kept = Arc::new(tempfile::tempdir().unwrap());
    copy_folder(&bench.data(), kept.path());
    *shared = Arc::downgrade(&kept);
    kept
}

/// A copy that a test may damage, and its run.
fn copy_of(stored: &tempfile::TempDir) -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    copy_folder(stored.path(), &dir.path().join("data"));
    let run = dir.path().join("data/runs/r1");
    (dir, run)
}

fn hashes(folder: &Path) -> BTreeMap<PathBuf, [u8; 32]> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(hashes(&path));
        } else {
            let hash = Sha256::digest(std::fs::read(&path).unwrap()).into();
            found.insert(path, hash);
        }
    }
    found
}

fn replay(run_folder: &Path, args: &[&str]) -> (Option<i32>, String) {
    told(&run(&[&["replay", run_folder.to_str().unwrap()], args].concat()))
}

fn told(output: &Output) -> (Option<i32>, String) {
    (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned() + &stderr(output))
}

#[test]
fn a_stored_run_comes_out_again_bit_for_bit() {
    let stored = stored();
    let (_dir, r1) = copy_of(&stored);
    let before = hashes(&r1);
    for wells in [&[][..], &["A01"]] {
        let (code, said) = replay(&r1, wells);
        assert_eq!((code, said.as_str()), (Some(0), "A01: identical, bit for bit (measurement.json, mesh.ply)\n"));
    }
    assert_eq!(hashes(&r1), before);
    let (code, said) = replay(&r1, &["B07"]);
    assert!(code == Some(1) && said.contains("B07"), "a well that is not there is no success: {said}");
    let (code, said) = replay(&r1.join("A01"), &[]);
    assert!(code == Some(1) && said.contains("no run.json"), "{said}");
}

#[test]
fn another_method_is_put_beside_and_what_is_there_stays() {
    let stored = stored();
    let (dir, r1) = copy_of(&stored);
    let before = hashes(&r1);
    let file = dir.path().join("coarse.toml");
    let method =
        |voxel_um: u32| std::fs::write(&file, format!("asd = 3\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = {voxel_um}.0\n"));
    method(30).unwrap();
    let by = || replay(&r1, &["--method", file.to_str().unwrap()]);
    let (code, said) = by();
    assert!(code == Some(0) && said.contains("A01/replays/coarse: written"), "{said}");
    let beside = r1.join("A01/replays/coarse");
    let after = hashes(&r1);
    let [new, old]: [BTreeMap<_, _>; 2] = [true, false].map(|is| after.iter().filter(|(p, _)| p.starts_with(&beside) == is).collect());
    assert!(old.into_iter().eq(&before), "what was stored is what it was");
    let names: Vec<_> = new.keys().map(|path| path.file_name().unwrap().to_str().unwrap()).collect();
    assert_eq!(names, ["SHA256SUMS", "measurement.json", "mesh.ply", "replay.json"]);
    let sums = std::process::Command::new("sha256sum").args(["--check", "--quiet", "SHA256SUMS"]).current_dir(&beside).output().unwrap();
    assert!(sums.status.success(), "{}", told(&sums).1);
    let numbers = |folder: &Path| json(&folder.join("measurement.json"))["measurement"].clone();
    let (ours, theirs) = (numbers(&beside), numbers(&r1.join("A01")));
    assert_eq!((&ours["voxel_size_um"], &ours["views"]), (&30.0.into(), &3.into()));
    assert_eq!((&theirs["voxel_size_um"], &theirs["views"]), (&17.1.into(), &9.into()));
    assert_eq!(json(&beside.join("replay.json"))["method"]["voxel_um"], 30.0);

    let (code, said) = by();
    assert!(code == Some(0) && said.contains("identical, bit for bit, to what is there"), "{said}");
    assert_eq!(hashes(&r1), after);
    // Another method of this name, and a result that was altered later.
    method(40).unwrap();
    let (code, said) = by();
    assert!(code == Some(1) && said.contains("coarse") && said.contains("nothing is overwritten"), "{said}");
    assert_eq!(hashes(&r1), after);
    method(30).unwrap();
    altered(&beside.join("measurement.json"), "\"views\": 3", "\"views\": 4");
    let spoiled = hashes(&r1);
    let (code, said) = by();
    assert!(code == Some(1) && said.contains("coarse/measurement.json") && said.contains("SHA-256"), "{said}");
    assert_eq!(hashes(&r1), spoiled);
}

fn altered(file: &Path, from: &str, to: &str) {
    let text = std::fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{} has no {from:?}", file.display());
    std::fs::write(file, text.replacen(from, to, 1)).unwrap();
}

#[test]
fn what_was_altered_is_reported_by_its_name_and_not_mended() {
    type Spoil = fn(&Path);
    let spoils: [(Spoil, &[&str]); 5] = [
        (|a01| drop(std::fs::copy(a01.join("frames/view_001.png"), a01.join("frames/view_002.png"))), &["view_002.png", "SHA-256"]),
        (
            |a01| {
                let path = a01.join("frames/view_004.png");
                let bytes = std::fs::read(&path).unwrap();
                std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
            },
            &["view_004.png"],
        ),
        (
            |a01| {
                let path = a01.join("measurement.json");
                let volume = json(&path)["measurement"]["volume_um3"].to_string();
                altered(&path, &volume, &format!("1{volume}"));
            },
            &["A01: differs: measurement.json at /measurement/", "volume_um3"],
        ),
        (
            |a01| {
                let mut bytes = std::fs::read(a01.join("mesh.ply")).unwrap();
                *bytes.last_mut().unwrap() ^= 1;
                std::fs::write(a01.join("mesh.ply"), bytes).unwrap();
            },
            &["A01: differs: mesh.ply (measurement.json is identical)"],
        ),
        (|a01| altered(&a01.join("recording.json"), "\"epsilon\": 0.05", "\"epsilon\": 0.06"), &["recording.json", "SHA-256"]),
    ];
    let stored = stored();
    for (spoil, names) in spoils {
        let (_dir, r1) = copy_of(&stored);
        spoil(&r1.join("A01"));
        let spoiled = hashes(&r1);
        let (code, said) = replay(&r1, &[]);
        assert_eq!(code, Some(1), "{names:?}: {said}");
        assert!(names.iter().all(|name| said.contains(name)) && !said.contains("A01: identical"), "{names:?}: {said}");
        assert!(said.contains("1 of 1 specimen(s)"), "{said}");
        assert_eq!(hashes(&r1), spoiled, "{names:?}: nothing is mended");
    }
}

#[test]
fn a_pruned_run_says_where_its_frames_are_and_comes_out_again_there() {
    let stored = stored();
    let (dir, r1) = copy_of(&stored);
    let (data, copies) = (dir.path().join("data"), dir.path().join("copies"));
    let done = |args: &[&str]| {
        let (code, said) = told(&run(args));
        assert_eq!(code, Some(0), "{args:?}: {said}");
    };
    done(&["archive", r1.to_str().unwrap(), "--to", copies.to_str().unwrap()]);
    done(&["prune", data.to_str().unwrap(), "--yes"]);
    assert!(!r1.join("A01/frames/view_000.png").exists());
    let before = hashes(&r1);
    let copy = copies.canonicalize().unwrap().join("r1");
    let way = format!("carved measure {}", copy.join("A01").display());
    let a01 = r1.join("A01");
    let tried = || [replay(&r1, &[]), told(&run(&["measure", a01.to_str().unwrap()]))];
    for (code, said) in tried() {
        assert!(code == Some(1) && said.contains("view_000.png: the frame is not here any more") && said.contains(&way), "{said}");
    }
    // The recommended command works.
    let output = run(&["measure", copy.join("A01").to_str().unwrap()]);
    assert_eq!(serde_json::from_slice::<Value>(&output.stdout).unwrap()["stored"], "identical", "{}", stderr(&output));
    let (code, said) = replay(&copy, &[]);
    assert!(code == Some(0) && said.contains("A01: identical"), "{said}");

    std::fs::rename(&copies, dir.path().join("unplugged")).unwrap();
    for (code, said) in tried() {
        assert!(code == Some(1) && said.contains(copy.to_str().unwrap()) && said.contains("is not there now"), "{said}");
    }
    // The run was never archived, and its folder was removed by hand.
    std::fs::remove_dir_all(r1.join("archives")).unwrap();
    for (code, said) in tried() {
        assert!(code == Some(1) && said.contains("view_000.png: the frame is missing; the recording lists it"), "{said}");
    }
    assert!(hashes(&r1).into_iter().eq(before.into_iter().filter(|(path, _)| !path.starts_with(r1.join("archives")))));
}

/// The numbers of an earlier build lack fields that this build has. The fields that it wrote are reproduced, which is what the command
/// checks.
#[test]
fn numbers_of_an_earlier_build_are_the_same_where_only_fields_were_added() {
    let stored = stored();
    let (_dir, r1) = copy_of(&stored);
    let a01 = r1.join("A01");
    let mut numbers = json(&a01.join("measurement.json"));
    numbers.as_object_mut().unwrap().remove("shape").unwrap();
    for view in numbers["views"].as_array_mut().unwrap() {
        view.as_object_mut().unwrap().remove("overlap_percent").unwrap();
    }
    let write = |numbers: &Value| std::fs::write(a01.join("measurement.json"), serde_json::to_vec(numbers).unwrap()).unwrap();
    write(&numbers);
    let measure = || run(&["measure", a01.to_str().unwrap()]);
    let output = measure();
    assert!(output.status.success() && stderr(&output).contains("same (2 fields are new)"), "{}", stderr(&output));
    let line: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&line["stored"], &line["new_fields"]), (&"same".into(), &serde_json::json!(["/shape", "/views/-/overlap_percent"])));
    let (code, said) = replay(&r1, &[]);
    assert_eq!((code, said.as_str()), (Some(0), "A01: same (2 fields are new) (measurement.json; mesh.ply is identical)\n"));

    // A field that is no longer computed, and a different value.
    for (key, value) in [("before", Value::from(1.0)), ("uncalibrated", Value::from("another reason"))] {
        let mut other = numbers.clone();
        other[key] = value;
        write(&other);
        let output = measure();
        let said = stderr(&output);
        assert!(output.status.code() == Some(1) && said.contains(&format!("A01 (at /{key})")), "{key}: {said}");
        assert_eq!(serde_json::from_slice::<Value>(&output.stdout).unwrap()["stored"], "differs", "{key}");
    }
}
