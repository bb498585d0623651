//! `carved calibrate specimen` as its users meet it: profiles of a phantom in a folder, and what must be refused.

use hardware_sim::analytic::{self, Disturbance, Phantom};
use hardware_sim::scene::Camera;
use serde_json::{Value, json};
use std::f64::consts::TAU;
use std::path::Path;
use std::process::{Command, Output};

/// Writes the profiles of a larva's turn of 21 views with one day's drift. Returns the true row of the axis, px.
fn profiles(folder: &Path) -> f64 {
    let nominal = Camera::default();
    let omega: Vec<f64> = (0..21).map(|i| TAU * f64::from(i) / 21.0).collect();
    let drift = Disturbance::drift(2);
    let views = Phantom::larva(4, 1).unwrap().views(&nominal, &omega, &drift);
    for (i, view) in views.iter().enumerate() {
        let c = analytic::coverage(&view.outline, nominal.width, nominal.height);
        image::save_buffer(folder.join(format!("view_{i:03}.png")), &c.data, c.width, c.height, image::ColorType::L8).unwrap();
    }
    let camera = json!({
        "f": nominal.f_um, "kx": nominal.kx_px_per_um, "ky": nominal.ky_px_per_um, "ux": nominal.ux_px, "uy": nominal.uy_px,
        "width": nominal.width, "height": nominal.height, "omega": omega,
    });
    std::fs::write(folder.join("camera.json"), camera.to_string()).unwrap();
    nominal.uy_px + drift.uy_px + views.iter().map(|v| v.dy_px).sum::<f64>() / views.len() as f64
}

fn specimen(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_carved"))
        .current_dir(folder)
        .args(["calibrate", "specimen", "--views", ".", "--cameras", "camera.json"])
        .args(args)
        .output()
        .unwrap()
}

fn report(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn every_objective_finds_the_axis_and_says_what_it_did() {
    let folder = tempfile::tempdir().unwrap();
    let axis_px = profiles(folder.path());
    for (args, within_px) in [
        (&["--voxel", "14"][..], 0.05),
        (&["--objective", "vrv", "--voxel", "14"], 0.12),
        (&["--objective", "vrv", "--voxel", "17.1", "--free", "uy,gamma=1", "--evaluations", "400"], 0.15),
        (&["--objective", "coherence", "--free", "uy,gamma,alpha"], 0.06),
    ] {
        let report = report(&specimen(folder.path(), args));
        let uy_px = report["psi"]["after"]["uy"].as_f64().unwrap();
        assert!((uy_px - axis_px).abs() < within_px, "{args:?}: {uy_px} where {axis_px} is true; {report:#}");
        assert_eq!(report["psi"]["before"]["uy"], json!(511.5));
        assert_eq!(report["psi"]["after"]["omega"].as_array().unwrap().len(), 21);
        assert!(report["evaluations"].as_u64().unwrap() > 0 && report["refusals"] == json!([]), "{report:#}");
        let value = ["vrv_um3", "coherence"].into_iter().find_map(|name| report.get(name)).unwrap();
        assert!(value["after"].as_f64() > value["before"].as_f64(), "{report:#}");
        let expected = if args.contains(&"--objective") { Value::Null } else { json!("passed") };
        assert_eq!(report["gate"]["verdict"], expected, "{report:#}");
    }
}

/// The search must not start with either picture: with noise each of its hundreds of pieces is evaluated hundreds of times, and a large
/// picture takes the memory.
#[test]
fn a_view_that_is_no_silhouette_or_of_another_size_is_refused_by_name_before_the_search() {
    let folder = tempfile::tempdir().unwrap();
    profiles(folder.path());
    let (path, kept) = (folder.path().join("view_005.png"), folder.path().join("kept"));
    std::fs::copy(&path, &kept).unwrap();
    let camera = Camera::default();
    let noise: Vec<u8> =
        (0..camera.width * camera.height).map(|i| if i.wrapping_mul(2_654_435_761) >> 31 == 0 { 0 } else { 255 }).collect();
    image::save_buffer(&path, &noise, camera.width, camera.height, image::ColorType::L8).unwrap();
    for objective in ["vrv", "coherence"] {
        let refused = specimen(folder.path(), &["--objective", objective]);
        let said = stderr(&refused);
        assert!(!refused.status.success() && said.contains("view_005.png is no silhouette") && said.contains("expected 16"), "{said}");
    }
    // The least-squares calibration leaves this view out by itself.
    let found = report(&specimen(folder.path(), &[]));
    assert_eq!(found["left_out"][0]["view"], "view_005.png", "{found:#}");
    // A header that announces more pixels than any memory holds: nothing behind it is read.
    let mut head = std::fs::read(&kept).unwrap();
    head[16..24].copy_from_slice(&[0, 1, 0, 0, 0, 1, 0, 0]);
    let crc = crc32(&head[12..29]);
    head[29..33].copy_from_slice(&crc.to_be_bytes());
    std::fs::write(&path, &head).unwrap();
    let said = stderr(&specimen(folder.path(), &[]));
    assert!(said.contains("view_005.png: the picture is 65536 x 65536 px, which are 4096 MB"), "{said}");
}

/// CRC-32 as in PNG.
fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    !crc
}

#[test]
fn what_may_not_be_freed_is_refused_by_name_and_the_rest_is_searched() {
    let folder = tempfile::tempdir().unwrap();
    let axis_px = profiles(folder.path());
    let output =
        specimen(folder.path(), &["--objective", "vrv", "--voxel", "17.1", "--free", "uy,k,gamma,alpha=45", "--evaluations", "400"]);
    let report = report(&output);
    let refusals: Vec<&str> = report["refusals"].as_array().unwrap().iter().map(|r| r.as_str().unwrap()).collect();
    assert!(refusals[0].starts_with("kx is not freed") && refusals[0].contains("37 %"), "{refusals:?}");
    assert!(refusals[1].starts_with("alpha is bounded to 1 deg"), "{refusals:?}");
    assert!(refusals.iter().all(|r| stderr(&output).contains(r)), "said to who reads no JSON: {}", stderr(&output));
    assert_eq!((&report["free"], &report["psi"]["after"]["kx"]), (&json!(["uy", "gamma", "alpha"]), &report["psi"]["before"]["kx"]));
    assert!((report["psi"]["after"]["uy"].as_f64().unwrap() - axis_px).abs() < 0.15, "{report:#}");

    for (args, said) in [
        (&["--objective", "vrv", "--free", "kx,ky,f"][..], "nothing is left to search. kx is not freed: "),
        (&["--objective", "coherence", "--free", "tilt"], "\"tilt\" is no parameter"),
        (&["--free", "uy"], "least-squares frees uy, gamma, alpha"),
        (&["--objective", "vrv", "--epsilon", "1"], "epsilon is 1"),
        (&["--voxel", "0"], "voxel size is 0"),
    ] {
        let refused = specimen(folder.path(), args);
        assert!(
            !refused.status.success() && refused.stdout.is_empty() && stderr(&refused).contains(said),
            "{args:?}: {}",
            stderr(&refused)
        );
    }
}
