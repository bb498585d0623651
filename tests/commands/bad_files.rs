//! Wrong files that a user or a record names: each is refused by name, and no command waits for one of them.

use crate::common::stored::stored;
use crate::common::{PATIENCE, carved, json};
use carved_records::RunOutcome;
use serde_json::{Value, json};
use std::io::Read;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// A child process that is killed when the test ends, however it ends.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The exit code of a command and all its output. A command that waits for input is killed and has no exit code.
fn ended(args: &[&str]) -> (Option<i32>, String) {
    let mut child = Ended(carved().args(args).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap());
    let until = Instant::now() + PATIENCE;
    let code = loop {
        if let Some(status) = child.0.try_wait().unwrap() {
            break status.code();
        }
        if Instant::now() > until {
            return (None, "it waits".into());
        }
        std::thread::park_timeout(Duration::from_millis(20));
    };
    let mut said = String::new();
    child.0.stdout.take().unwrap().read_to_string(&mut said).unwrap();
    child.0.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    (code, said)
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn pipe(path: &Path) {
    let _ = std::fs::remove_file(path);
    assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
}

#[test]
fn a_pipe_or_a_device_in_the_place_of_a_file_is_named_and_not_waited_for() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    pipe(&at("pipe"));
    symlink(at("pipe"), at("link.png")).unwrap();
    std::fs::create_dir(at("views")).unwrap();
    image::save_buffer(at("views/a.png"), &[0; 256], 16, 16, image::ColorType::L8).unwrap();
    std::fs::create_dir(at("three")).unwrap();
    for (name, grey) in [("v1.png", 7), ("v2.png", 8), ("v3.png", 9)] {
        image::save_buffer(at("three").join(name), &[grey; 64 * 64], 64, 64, image::ColorType::L8).unwrap();
    }
    std::fs::create_dir(at("pipes")).unwrap();
    pipe(&at("pipes/a.png"));
    let camera = json!({"f": 60000.0, "kx": 0.18, "ky": 0.18, "ux": 8.0, "uy": 8.0, "width": 16, "height": 16, "omega": [0.0]});
    std::fs::write(at("camera.json"), camera.to_string()).unwrap();
    let (pipe, views, pipes, camera, out) = (at("pipe"), at("views"), at("pipes"), at("camera.json"), at("out"));
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/simulated.toml");
    let (first, link, three, outlines) = (at("views/a.png"), at("link.png"), at("three"), at("outlines"));
    for args in [
        &["plate", "check", text(&pipe)][..],
        &["config", "check", text(&pipe)],
        &["import", text(&views), "--even", "--cameras", text(&pipe), "--out", text(&out)],
        &["import", text(&views), "--angles", text(&pipe), "--out", text(&out)],
        &["import", text(&views), "--even", "--settings", text(&pipe), "--out", text(&out)],
        &["import", text(&three), "--even", "--empty", text(&pipe), "--out", text(&out)],
        &["import", text(&views), "--even", "--config", text(&pipe), "--out", text(&out)],
        &["import", text(&pipes), "--even", "--out", text(&out)],
        &["segment", "--out", text(&outlines), "--settings", text(&pipe), text(&first)],
        &["segment", "--out", text(&outlines), "--reference", text(&pipe), text(&first)],
        &["segment", "--out", text(&outlines), text(&link)],
        &["reconstruct", "--views", text(&pipes), "--cameras", text(&camera)],
        &["reconstruct", "--views", text(&views), "--cameras", text(&pipe)],
        &["calibrate", "specimen", "--views", text(&pipes), "--cameras", text(&camera)],
        &["calibrate", "specimen", "--views", text(&views), "--cameras", text(&pipe)],
        &["reference", "show", text(&pipe)],
        &["run", "status", "--token-file", text(&pipe)],
        &["serve", "--config", text(&pipe)],
    ] {
        let (code, said) = ended(args);
        assert!(code.is_some_and(|code| code != 0) && said.contains("a pipe"), "{args:?}: {code:?} {said}");
    }
    for args in [&["plate", "check", "/dev/zero"][..], &["import", text(&views), "--even", "--cameras", "/dev/zero", "--out", text(&out)]] {
        let (code, said) = ended(args);
        assert!(code.is_some_and(|code| code != 0) && said.contains("a device"), "{args:?}: {code:?} {said}");
    }
    let (code, said) = ended(&["plate", "check", text(&views)]);
    assert!(code == Some(1) && said.contains("a folder"), "{code:?} {said}");
    assert_eq!(ended(&["config", "check", config]).0, Some(0));
}

#[test]
fn a_pipe_in_a_record_is_named_and_not_waited_for() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    stored(&data, "r1", Some(RunOutcome::Failed));
    let run = data.join("runs/r1");
    let (a01, copies) = (run.join("A01"), dir.path().join("copies"));
    let spoiled = |name: &str, args: &[&str]| {
        let file = run.join(name);
        let kept = std::fs::read(&file).unwrap();
        pipe(&file);
        let (code, said) = ended(args);
        std::fs::remove_file(&file).unwrap();
        std::fs::write(&file, kept).unwrap();
        assert!(code == Some(1) && said.contains("a pipe"), "{name} {args:?}: {code:?} {said}");
    };
    for name in ["A01/frames/view_001.png", "A01/recording.json", "A01/SHA256SUMS"] {
        spoiled(name, &["measure", text(&a01)]);
        spoiled(name, &["replay", text(&run), "A01"]);
        spoiled(name, &["archive", text(&run), "--to", text(&copies)]);
    }
    for args in [
        &["measure", text(&run)][..],
        &["replay", text(&run)],
        &["archive", text(&run), "--to", text(&copies)],
        &["prune", text(&data), "r1"],
        &["prune", text(&data)],
        &["index", "rebuild", text(&data)],
    ] {
        spoiled("run.json", args);
    }
}

/// Changes one value of a JSON file and removes the sums beside it, like a person who edits the file on purpose.
fn with(file: &Path, pointer: &str, value: Value) {
    let mut content = json(file);
    *content.pointer_mut(pointer).unwrap() = value;
    std::fs::write(file, content.to_string()).unwrap();
    let _ = std::fs::remove_file(file.with_file_name("SHA256SUMS"));
}

#[test]
fn a_run_of_a_newer_carved_is_not_computed() {
    let dir = tempfile::tempdir().unwrap();
    stored(dir.path(), "r1", Some(RunOutcome::Failed));
    let run = dir.path().join("runs/r1");
    with(&run.join("run.json"), "/schema", "carved.run/7".into());
    for command in ["replay", "measure"] {
        let (code, said) = ended(&[command, text(&run)]);
        assert!(code == Some(1) && said.contains("carved.run/7") && said.contains("carved.run/1"), "{command}: {said}");
        assert!(said.contains("run.json"), "{command}: {said}");
    }
}

#[test]
fn names_in_a_record_that_lead_out_of_it_are_refused() {
    let spoils: [(&str, &str, Value); 8] = [
        ("A01/recording.json", "/specimen/well", "../../x".into()),
        ("A01/recording.json", "/specimen/well", "A49".into()),
        ("A01/recording.json", "/run", "../r1".into()),
        ("A01/recording.json", "/method_name", "/etc/passwd".into()),
        ("run.json", "/id", "../r1".into()),
        ("run.json", "/plan/plate_map/0/well", "../../x".into()),
        ("run.json", "/wells/0/well", "..".into()),
        ("run.json", "/wells/0/well", "A01/frames".into()),
    ];
    for (file, pointer, value) in spoils {
        let dir = tempfile::tempdir().unwrap();
        stored(dir.path(), "r1", Some(RunOutcome::Failed));
        let run = dir.path().join("runs/r1");
        with(&run.join(file), pointer, value.clone());
        // A run's folder stands for its measured recordings.
        std::fs::write(run.join("A01/measurement.json"), "{}").unwrap();
        let mut commands: Vec<Vec<&str>> = vec![vec!["replay", text(&run), "A01"]];
        commands.push(if file == "run.json" { vec!["archive", text(&run), "--to", "/nowhere"] } else { vec!["measure", text(&run)] });
        for args in commands {
            let (code, said) = ended(&args);
            // The quotes matter: a bare `..` occurs in every path that leads upwards.
            let found = format!("{:?}", value.as_str().unwrap());
            assert!(
                code == Some(1) && said.contains(&found) && said.contains(file.rsplit('/').next().unwrap()),
                "{args:?}: {code:?} {said}"
            );
        }
    }
    let dir = tempfile::tempdir().unwrap();
    stored(dir.path(), "r1", Some(RunOutcome::Failed));
    let run: PathBuf = dir.path().join("runs/r1");
    for well in ["../r1/A01", "/A01", "..", "A01/.."] {
        let (code, said) = ended(&["replay", text(&run), well]);
        assert!(code == Some(1) && said.contains("is no well of a run"), "{well}: {said}");
    }
}

#[test]
fn a_plate_map_with_an_open_quote_is_refused_by_the_line_of_the_quote() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("map.csv");
    std::fs::write(&file, "well,compound\nA01,DMSO\nA02,\"DMSO\n").unwrap();
    let (code, said) = ended(&["plate", "check", text(&file)]);
    assert!(code == Some(3) && said.contains("map.csv: line 3: a quote opens"), "{code:?} {said}");
    std::fs::write(&file, "well,compound\nA01,DMSO\nA02,\"DMSO\"\n").unwrap();
    assert_eq!(ended(&["plate", "check", text(&file)]).0, Some(0));
}
