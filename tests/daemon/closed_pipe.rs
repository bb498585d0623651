//! Output without a reader: `carved ... | head -1`, or a log whose reader has died. Commands end quietly; a daemon continues.
#![cfg(feature = "aravis")]

use crate::common::stored::stored;
use crate::common::{Daemon, carved};
use carved_records::RunOutcome;
use serde_json::json;
use std::path::Path;
use std::process::Stdio;

/// The exit code with which a shell reports a program that SIGPIPE ended.
const PIPE_CLOSED: i32 = 141;

/// A pipe whose read end is closed.
fn closed() -> Stdio {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    writer.into()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_command_whose_output_nobody_reads_ends_without_a_word() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    stored(&at("data"), "r1", Some(RunOutcome::Failed));
    std::fs::write(at("map.csv"), "well\nA01\n").unwrap();
    std::fs::write(at("bad.csv"), "well\nZ99\n").unwrap();
    let (data, run, a01, map, bad) = (at("data"), at("data/runs/r1"), at("data/runs/r1/A01"), at("map.csv"), at("bad.csv"));
    let (copies, none) = (at("copies"), at("none"));
    let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/simulated.toml");
    let references = concat!(env!("CARGO_MANIFEST_DIR"), "/config/references/guo2017-fixed.toml");
    for (args, code) in [
        (&["doctor", "--no-cameras", "--port", text(&none)][..], PIPE_CLOSED),
        (&["doctor"], PIPE_CLOSED),
        (&["plate", "check", text(&map)], PIPE_CLOSED),
        (&["plate", "check", text(&map), "--json"], PIPE_CLOSED),
        (&["config", "check", config], PIPE_CLOSED),
        (&["reference", "show", references], PIPE_CLOSED),
        (&["measure", text(&a01)], PIPE_CLOSED),
        (&["replay", text(&run), "A01"], PIPE_CLOSED),
        (&["index", "rebuild", text(&data)], PIPE_CLOSED),
        (&["prune", text(&data)], PIPE_CLOSED),
        (&["archive", text(&run), "--to", text(&copies)], PIPE_CLOSED),
        (&["reconstruct", "--views", text(&none), "--cameras", text(&none)], PIPE_CLOSED),
        // These commands write nothing to standard output.
        (&["plate", "check", text(&bad)], 3),
        (&["config", "check", text(&none)], 1),
        (&["calibrate", "specimen", "--views", text(&none), "--cameras", text(&none)], 1),
        (&["run", "status", "--token-file", text(&none)], 1),
        (&["--help"], 0),
        (&["--version"], 0),
    ] {
        let output = carved().args(args).stdout(closed()).stderr(Stdio::piped()).output().unwrap();
        let said = crate::common::stderr(&output);
        assert!(!said.contains("panicked") && !said.contains("roken pipe"), "{args:?}: {said}");
        assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
        // A closed standard error makes no difference either.
        let status = carved().args(args).stdout(Stdio::null()).stderr(closed()).status().unwrap();
        assert!(status.code().is_some_and(|code| code != 101 && code != PIPE_CLOSED), "{args:?}: {status:?}");
    }
}

/// The reader of the log dies during a turn.
#[test]
fn a_daemon_whose_log_nobody_reads_turns_and_measures_on() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = Daemon::unread(&data, &["--time-scale", "10", "--small"]);
    let wells = json!([{"well": "A01", "specimen": "bead"}, {"well": "A02", "specimen": "bead"}]);
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells});
    // The demo's own plate may be under way; its table is printed at its end.
    daemon.wait("the demo's end", |s| !s["run"]["outcome"].is_null() && s["ready"] == true);
    assert_eq!(daemon.put_run("r1", &plan), 201);
    let status = daemon.wait("the end", |s| s["run"]["id"] == "r1" && !s["run"]["outcome"].is_null());
    assert_eq!(status["run"]["outcome"], "succeeded", "{status}");
    daemon.signal("TERM");
    assert_eq!(daemon.ended(), Some(0), "it ends in order");
}
