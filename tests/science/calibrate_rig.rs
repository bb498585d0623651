//! `carved calibrate scale`, `beads` and `history` as their users meet them: recordings with known numbers, and what must be refused.

use crate::beads::{Bead, run};
use carved_core::measure::references::limb::BeadMaterial;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn calibrate(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_carved")).current_dir(folder).arg("calibrate").args(args).output().unwrap()
}

fn answer(folder: &Path, args: &[&str]) -> Value {
    let output = calibrate(folder, args);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(folder: &Path, args: &[&str], with: &[&str]) {
    let output = calibrate(folder, args);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && with.iter().all(|w| said.contains(w)), "{args:?}: {said}");
}

fn near(found: &Value, wanted: f64) {
    let found = found.as_f64().unwrap();
    assert!((found - wanted).abs() < 1e-9 * wanted.abs(), "{found} is not {wanted}");
}

#[test]
fn a_micrometer_gives_the_lines_to_paste() {
    let dir = tempfile::tempdir().unwrap();
    let scale = |more: &[&str]| answer(dir.path(), &[&["scale", "--rig", "vast-1", "--reading-px", "0.3"], more].concat());
    let report = scale(&["--micrometer", "1000,182,1000,182.2", "--micrometer-across", "500,120"]);
    near(&report["kx_px_per_um"], 0.1821);
    near(&report["kx_sd_px_per_um"], 0.3 / 2e6_f64.sqrt());
    near(&report["ky_px_per_um"], 0.24);
    near(&report["scale_sd_percent"], 100.0 * (0.3 / 500.0) / 0.24);
    let lines: Vec<&str> = report["toml"].as_array().unwrap().iter().map(|l| l.as_str().unwrap()).collect();
    assert_eq!((lines[0], lines[4]), ("[optics]", "scale_sd_percent = 0.2500"), "{lines:?}");
    assert!(lines[1].starts_with("kx_px_per_um = 0.182100000 ") && lines[2].starts_with("ky_px_per_um = 0.240000000 "), "{lines:?}");
    // The text to paste is TOML.
    let pasted: toml::Table = lines.join("\n").parse().unwrap();
    assert_eq!(pasted["methods"]["NAME"]["calibration"]["scale_sd_percent"].as_float(), Some(0.25));
    let again = scale(&["--micrometer", "1000,182,1000,182.2", "--micrometer-across", "500,120"]);
    assert_eq!(report["id"], again["id"]);
    assert_ne!(report["id"], scale(&["--micrometer", "1000,182,1000,182.4"])["id"]);
    assert_eq!(scale(&["--micrometer", "1000,182"])["ky_px_per_um"], Value::Null);
    for (numbers, with) in [("1000,182,7", &["3 numbers"][..]), ("1000,-2", &["is -2"]), ("1000,182,1000,91", &["182 px", "136.5 px"])] {
        let args = ["scale", "--rig", "vast-1", "--reading-px", "0.3", "--micrometer", numbers];
        refused(dir.path(), &args, with);
    }
    refused(dir.path(), &["scale"], &["--micrometer"]);
}

#[test]
fn certified_beads_and_a_bore_correct_the_scale_of_today() {
    let dir = tempfile::tempdir().unwrap();
    let k = 1.0 / 5.5;
    // Mean 505 of 500, scatter 5 / sqrt(3) and the certificate's 1.
    run(dir.path(), "beads", "vast-1", &[Bead(20, 500.0, 1.0, 511.0), Bead(20, 505.0, 1.0, 511.0), Bead(20, 510.0, 1.0, 511.0)]);
    let report = answer(dir.path(), &["scale", "--bead-um", "500", "--bead-sd", "1", "--bead-material", "opaque", "beads"]);
    near(&report["kx_px_per_um"], 1.01 * k);
    near(&report["scale_sd_percent"], 100.0 * (5.0 / 3.0_f64.sqrt() / 505.0).hypot(0.002));
    // Clear beads look smaller than they are; of an unknown material, by an unknown part of this.
    let [looks_um, sd_um] = BeadMaterial::Polystyrene.apparent_um(500.0);
    let report = answer(dir.path(), &["scale", "--bead-um", "500", "--bead-sd", "1", "--bead-material", "polystyrene", "beads"]);
    near(&report["kx_px_per_um"], k * 505.0 / looks_um);
    near(&report["scale_sd_percent"], 100.0 * (5.0 / 3.0_f64.sqrt() / 505.0).hypot(sd_um.hypot(1.0) / looks_um));
    let report = answer(dir.path(), &["scale", "--bead-um", "500", "--bead-sd", "1", "beads"]);
    near(&report["kx_px_per_um"], 1.01 * k);
    let [_, sd_um] = BeadMaterial::Unknown.apparent_um(500.0);
    near(&report["scale_sd_percent"], 100.0 * (5.0 / 3.0_f64.sqrt() / 505.0).hypot(sd_um.hypot(1.0) / 500.0));
    assert_eq!(report["rig"], "vast-1");
    // The walls are 650, 655, 660 um apart, the certificate says 655.
    let report = answer(dir.path(), &["scale", "--bore-um", "655", "beads"]);
    assert_eq!(report["kx_px_per_um"], Value::Null);
    near(&report["ky_px_per_um"], k);
    near(&report["ky_sd_percent"], 100.0 * 5.0 / 3.0_f64.sqrt() / 655.0);
    // A sphere that is measured 1 % too long: two thirds of the error are in its length, one third in its width.
    run(dir.path(), "long", "vast-1", &[Bead(20, 500.0, 1.01, 511.0), Bead(21, 500.0, 1.01, 511.0)]);
    let report = answer(dir.path(), &["scale", "--bead-um", "500", "--bead-sd", "1", "long"]);
    near(&report["kx_px_per_um"], k * 3.0 * 1.01 / 3.01);
    near(&report["ky_px_per_um"], k * 3.0 / 3.01);
    run(dir.path(), "air", "vast-1", &[Bead(20, 500.0, 0.75, 511.0)]);
    refused(dir.path(), &["scale", "--bead-um", "500", "--bead-sd", "1", "air"], &["air/A01", "0.7500", "0.02"]);
    refused(dir.path(), &["scale", "--bead-um", "500", "--bead-sd", "1", "beads/A01"], &["1 measured", "2 or more", "--bead-spread"]);
    answer(dir.path(), &["scale", "--bead-um", "500", "--bead-sd", "1", "--bead-spread", "25", "beads/A01"]);
}

#[test]
fn beads_are_judged_kept_and_never_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let beads = [Bead(19, 490.0, 0.75, 511.0), Bead(20, 505.0, 0.752, 511.2), Bead(20, 496.0, 0.748, 511.1)];
    run(dir.path(), "one", "vast-1", &beads);
    let args = ["beads", "one", "--out", "kept"];
    let report = answer(dir.path(), &args);
    near(&report["diameter_um"]["mean"], 497.0);
    near(&report["diameter_um"]["sd"], 57.0_f64.sqrt());
    // |497 - 500| sqrt(2) / sqrt(38), and Student's t with two degrees of freedom.
    near(&report["against"]["score"]["t_score"], 3.0 * (2.0 / 38.0_f64).sqrt());
    assert!((report["against"]["score"]["critical"].as_f64().unwrap() - 9.924_843).abs() < 1e-5);
    near(&report["against"]["scale_sd_percent"], 5.0 / 3.0_f64.sqrt());
    assert!((report["refraction"]["ky_over_kx"].as_f64().unwrap() - 1.3333).abs() < 1e-3, "{report:#}");
    assert!(report["refraction"]["words"].as_str().unwrap().starts_with("air"));
    near(&report["uy_px"]["mean"], 511.1);
    assert!((report["uy_px"]["sd"].as_f64().unwrap() - 0.1).abs() < 1e-9);
    near(&report["uy_turn_sd_px"], 0.02);
    let file = dir.path().join(format!("kept/calibration-2026-11-20-{}.json", report["id"].as_str().unwrap()));
    let kept = std::fs::read(&file).unwrap();
    assert_eq!(serde_json::from_slice::<Value>(&kept).unwrap(), report);
    refused(dir.path(), &args, &["exists already"]);
    assert_eq!(std::fs::read(&file).unwrap(), kept);
    run(dir.path(), "other", "vast-2", &[Bead(20, 500.0, 1.0, 511.0)]);
    refused(dir.path(), &["beads", "one", "other"], &["\"vast-2\"", "\"vast-1\""]);
    refused(dir.path(), &["beads", "one/A01", "one/A01"], &["named twice"]);
    refused(dir.path(), &["beads", "one", "--nominal-um", "0"], &["--nominal-um is 0"]);
}

#[test]
fn history_is_reported_in_the_order_of_measuring_with_its_drift() {
    let dir = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for (name, day, uy_px) in [("b", 24, 512.0), ("a", 20, 511.0), ("c", 22, 511.5)] {
        run(dir.path(), name, "vast-<1>", &[Bead(day, 500.0, 1.0, uy_px), Bead(day, 502.0, 1.002, uy_px)]);
        let report = answer(dir.path(), &["beads", name]);
        files.push(format!("calibration-2026-11-{day}-{}.json", report["id"].as_str().unwrap()));
    }
    let mut args = vec!["history", "--svg", "plot.svg"];
    args.extend(files.iter().map(String::as_str));
    let output = calibrate(dir.path(), &args);
    let told = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let at = |text: &str| told.find(text).unwrap_or_else(|| panic!("no {text} in {told}"));
    assert!(at("2026-11-20T") < at("2026-11-22T") && at("2026-11-22T") < at("2026-11-24T"), "{told}");
    // A drift of 1 px in four days.
    assert!(told.lines().any(|l| l.trim_start().starts_with("uy_px") && l.contains("+0.2500 +- 0.0000")), "{told}");
    let svg = std::fs::read_to_string(dir.path().join("plot.svg")).unwrap();
    assert_eq!(svg.matches("<circle").count(), 12);
    assert!(svg.contains("vast-&lt;1&gt;") && svg.ends_with("</svg>\n"), "{svg}");
    refused(dir.path(), &["history", &files[0], &files[0]], &["twice"]);
    std::fs::write(dir.path().join("no.json"), "{}").unwrap();
    refused(dir.path(), &["history", "no.json"], &["no.json", "missing field"]);
}
