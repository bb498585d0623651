//! `carved calibrate gate` as its users meet it: recordings of beads with known numbers, a history of gates, and what must fail.

use crate::beads::{Bead, run};
use carved_core::quality::gate::GateVerdict;
use carved_records::Mode;
use carved_store::gates;
use serde_json::Value;
use std::path::Path;

/// Three beads with the numbers that this instrument usually measures.
fn usual(day: u32) -> Vec<Bead> {
    let off = f64::from(day % 3) - 1.0;
    (0..3).map(|i| Bead(day, 495.0 + 5.0 * f64::from(i) + 0.3 * off, 1.001 + 0.0003 * off, 511.5 + 0.1 * off)).collect()
}

fn gated(folder: &Path, args: &[&str]) -> (bool, Value, String) {
    let output = crate::common::carved().current_dir(folder).args(["calibrate", "gate"]).args(args).output().unwrap();
    let gate = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.success(), gate, crate::common::stderr(&output))
}

#[test]
fn gates_of_many_days_make_a_history_and_a_jump_is_seen_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let under = folder.path();
    for day in 1..=6 {
        run(under, &format!("day{day}"), "rig", &usual(day));
        let (passed, gate, said) = gated(under, &[&format!("day{day}"), "--out", "kept"]);
        assert!(passed, "{said}");
        let wanted = if day <= 5 { "no_history" } else { "passed" };
        assert_eq!(
            (gate["gate"]["verdict"].as_str(), gate["gate"]["history"].as_u64()),
            (Some(wanted), Some(u64::from(day) - 1)),
            "{said}"
        );
        assert!(said.contains("can miss a bias of less than"), "the power is stated: {said}");
    }
    // These numbers are within every limit of the method, but the axis has moved on this rig.
    let moved: Vec<Bead> = usual(7).into_iter().map(|Bead(day, d, a, uy)| Bead(day, d, a, uy + 3.0)).collect();
    run(under, "moved", "rig", &moved);
    let (passed, gate, said) = gated(under, &["moved", "--out", "kept"]);
    assert!(!passed && gate["gate"]["verdict"] == "failed" && said.contains("uy_px jumped") && said.contains("--begin-history"), "{said}");
    let newest = gates::newest(&under.join("kept"), "rig", Mode::Simulated).unwrap().unwrap();
    let at = |hour: &str| format!("2026-11-{hour}:00:00Z").parse().unwrap();
    assert!(newest.found.gate.verdict == GateVerdict::Failed && !newest.stands(at("07T10")));
    // The failed gate does not count as history, and a gate that begins a new history has none.
    let (passed, gate, _) = gated(under, &["moved", "--out", "kept", "--begin-history"]);
    assert!(passed && gate["gate"]["verdict"] == "no_history");
    let newest = gates::newest(&under.join("kept"), "rig", Mode::Simulated).unwrap().unwrap();
    assert!(newest.stands(at("07T10")) && newest.stands(at("08T08")) && !newest.stands(at("08T10")), "24 h from 7 November, 9 h");
    run(under, "day8", "rig", &usual(8));
    let (_, gate, _) = gated(under, &["day8", "--out", "kept", "--dry-run"]);
    assert_eq!(gate["gate"]["history"], 1, "only what came since the new beginning");
    assert_eq!(gates::all(&under.join("kept"), "rig", Mode::Simulated).unwrap().len(), 8, "a dry run keeps nothing");
    assert!(gates::all(&under.join("kept"), "other", Mode::Simulated).unwrap().is_empty());
}

#[test]
fn the_same_well_of_two_runs_is_one_bead_and_too_few_are_no_gate() {
    let folder = tempfile::tempdir().unwrap();
    let under = folder.path();
    run(under, "morning", "rig", &usual(1));
    run(under, "again", "rig", &usual(2));
    let (passed, gate, said) = gated(under, &["morning", "again", "--dry-run"]);
    let numbers = &gate["gate"]["numbers"];
    assert!(passed && numbers["beads"] == 3 && numbers["turns"] == 6, "{said}");
    assert!((numbers["repeat_um"].as_f64().unwrap() - 0.3).abs() < 1e-9, "{numbers}");
    let (passed, gate, said) = gated(under, &["morning/A01", "morning/A02", "--dry-run"]);
    assert!(!passed && gate["gate"]["verdict"] == "too_few_beads" && said.contains("3 are needed"), "{said}");
    assert!(gates::after_run(&under.join("morning"), &under.join("kept")).unwrap().unwrap().found.gate.verdict.passes());
    std::fs::remove_dir_all(under.join("again/A03")).unwrap();
    assert_eq!(gates::after_run(&under.join("again"), &under.join("kept")).unwrap(), None, "two beads are no gate");
}

#[test]
fn beads_of_two_rigs_and_a_gate_that_is_kept_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let under = folder.path();
    run(under, "one", "rig", &usual(1));
    run(under, "two", "other", &usual(2));
    let (passed, _, said) = gated(under, &["one", "two", "--dry-run"]);
    assert!(!passed && said.contains("\"rig\"") && said.contains("\"other\""), "{said}");
    assert!(gated(under, &["one"]).0);
    let (passed, _, said) = gated(under, &["one"]);
    assert!(!passed && said.contains("kept already"), "{said}");
    let ky: Vec<Bead> = usual(3).into_iter().map(|Bead(day, d, _, uy)| Bead(day, d, 1.02, uy)).collect();
    run(under, "air", "rig", &ky);
    let (passed, _, said) = gated(under, &["air"]);
    assert!(!passed && said.contains("aspect_off 0.0200") && said.contains("kx and ky"), "{said}");
}
