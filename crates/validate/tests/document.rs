//! `carved-validate`: the document is written, it contains its goals, and required goals are met.

#![allow(clippy::unwrap_used)] // a test may panic; its helpers are part of it

use std::path::Path;
use std::process::Command;

/// Writes the quick document of some parts. An empty list means all parts.
fn validated(folder: &Path, parts: &[&str]) -> String {
    let mut args = vec!["--quick", "--out", folder.to_str().unwrap()];
    args.extend(parts.iter().flat_map(|part| ["--only", *part]));
    let output = Command::new(env!("CARGO_BIN_EXE_carved-validate")).args(&args).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    std::fs::read_to_string(folder.join("validation.md")).unwrap()
}

fn row<'a>(document: &'a str, starts: &str) -> &'a str {
    document.lines().find(|l| l.starts_with(starts)).unwrap_or_else(|| panic!("no row {starts:?} in\n{document}"))
}

#[test]
fn every_part_has_its_section_and_its_goals() {
    let folder = tempfile::tempdir().unwrap();
    let document = validated(folder.path(), &[]);
    for title in ["1. Beads", "2. Larvae", "3. Solids of known size", "4. Calibration", "5. Faults", "6. What each step is worth"] {
        assert!(document.contains(&format!("## {title}\n")), "{title} is missing");
    }
    assert!(document.contains("## 7. Order of views") && document.contains("## 8. Coverage"));
    assert!(document.contains("Everything here is a simulation"));
    for goal in [
        "1: clean bead",
        "2: finless larva",
        "3: finned larva",
        "4: calibration at ASD 21",
        "5: the paper's carver",
        "6: freeing",
        "7: a blank view",
    ] {
        row(&document, &format!("| {goal}"));
    }
    assert!(row(&document, "| 6: freeing").ends_with("| pass |"), "what VRV may not free is a table of words");
    assert!(
        row(&document, "| 1: clean bead, ellipsoid, capsule, volume").ends_with("| pass |"),
        "exact outlines of one bead, ellipsoid and capsule"
    );
    // Every picture that the document shows exists.
    let shown: Vec<&str> = document.lines().filter(|l| l.starts_with("![")).filter_map(|l| l.split(['(', ')']).nth(1)).collect();
    assert!(shown.len() >= 6, "{shown:?}");
    for plot in shown {
        let svg = std::fs::read_to_string(folder.path().join(plot)).unwrap();
        assert!(svg.starts_with("<svg") && !svg.contains("NaN"), "{plot}");
    }
}

#[test]
fn the_same_command_writes_the_same_document() {
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let [a, b] = folders.each_ref().map(|folder| validated(folder.path(), &["coverage", "faults"]));
    assert_eq!(a, b);
    assert!(a.starts_with("# Validation") && !a.contains("## 1. Beads"), "only what was asked for");
}
