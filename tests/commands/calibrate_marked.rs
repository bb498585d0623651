//! `carved calibrate marked` on rendered turns whose sense and mirror are known: pictures, `carved import`, the command.

use crate::common::{carved, stderr};
use hardware_sim::scene::{Camera, Capillary, Contents, Exposure, InkDot, Marks, Nuisances, Scene, SceneSettings, Specimen};
use image::{RgbImage, imageops};
use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Output;

const VIEWS: u32 = 16;

/// How the rig is really built, in contrast to what carved is told.
#[derive(Clone, Copy)]
struct Built {
    /// Sign of omega for a positive move of the axis.
    sense: f64,
    left_for_right: bool,
    upside_down: bool,
}

const AS_TOLD: Built = Built { sense: 1.0, left_for_right: false, upside_down: false };

/// The mark at the first view: near side, upper half, right end.
fn ink() -> InkDot {
    InkDot { x_um: 2100.0, angle_rad: -0.8, radius_um: 55.0, opacity: 0.9 }
}

fn dirty() -> Nuisances {
    let window = Marks { scratches: 4, dust: 25, contrast: 0.5 };
    let glass = Marks { scratches: 3, dust: 12, contrast: 0.35 };
    Nuisances { seed: 11, window, glass, ..Nuisances::default() }
}

/// Renders a turn and imports it with the rotation sense that the configuration states.
fn turn(dir: &Path, built: Built, ink: Option<InkDot>, nuisances: Nuisances, contents: impl Into<Contents>) -> PathBuf {
    let camera = Camera { height: 224, uy_px: 111.5, gamma_rad: 0.004, ..Camera::default() };
    let scene =
        Scene::new(SceneSettings { camera, capillary: Capillary { ink, ..Capillary::default() }, nuisances, ..SceneSettings::default() });
    scene.load(contents).unwrap();
    let frames = dir.join("frames");
    std::fs::create_dir_all(&frames).unwrap();
    let mut angles = String::new();
    for i in 0..=VIEWS {
        let degrees = 360.0 * f64::from(i) / f64::from(VIEWS);
        writeln!(angles, "{degrees}").unwrap();
        let rgb = scene.render(&Exposure { angle_rad: built.sense * degrees.to_radians(), number: u64::from(i) });
        let mut picture = RgbImage::from_raw(rgb.width, rgb.height, rgb.data).unwrap();
        if built.left_for_right {
            picture = imageops::flip_horizontal(&picture);
        }
        if built.upside_down {
            picture = imageops::flip_vertical(&picture);
        }
        picture.save(frames.join(format!("view_{i:02}.png"))).unwrap();
    }
    std::fs::write(dir.join("angles.txt"), angles).unwrap();
    let out = dir.join("turn");
    let mut import = carved();
    import.arg("import").arg(frames).arg("--angles").arg(dir.join("angles.txt")).args(["--closure", "--out"]).arg(&out);
    let imported = import.output().unwrap();
    assert!(imported.status.success(), "{}", stderr(&imported));
    out
}

fn marked(recording: &Path, said: [&str; 3], out: &Path) -> Output {
    let [side, edge, end] = said;
    let args = ["--mark-side", side, "--mark-edge", edge, "--mark-end", end, "--out"];
    carved().args(["calibrate", "marked"]).arg(recording).args(args).arg(out).output().unwrap()
}

fn told(recording: &Path, said: [&str; 3]) -> Value {
    let kept = tempfile::tempdir().unwrap();
    let output = marked(recording, said, kept.path());
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(recording: &Path, said: [&str; 3], with: &[&str]) {
    let kept = tempfile::tempdir().unwrap();
    let output = marked(recording, said, kept.path());
    assert!(!output.status.success() && with.iter().all(|w| stderr(&output).contains(w)), "{said:?}: {}", stderr(&output));
    assert_eq!(std::fs::read_dir(kept.path()).unwrap().count(), 0, "what is refused is not kept");
}

#[test]
fn every_sense_and_every_mirror_is_found_through_noise_and_dirt_and_a_specimen() {
    let bead = || Specimen::bead(500.0).unwrap();
    for (sense, left_for_right, upside_down) in
        [(1.0, false, false), (-1.0, false, false), (1.0, true, false), (-1.0, true, false), (1.0, false, true), (-1.0, true, true)]
    {
        let dir = tempfile::tempdir().unwrap();
        let built = Built { sense, left_for_right, upside_down };
        let recording = turn(dir.path(), built, Some(ink()), dirty(), bead());
        let report = told(&recording, ["near", "top", "right"]);
        // With the picture upside down a downward motion appears upward: the sense that is found is that of the picture.
        let agrees = (sense > 0.0) != upside_down;
        assert_eq!(report["sense_agrees"], agrees, "{sense} {left_for_right} {upside_down}: {report:#}");
        assert_eq!(report["sense"], if agrees { 1 } else { -1 });
        assert_eq!((&report["left_for_right"], &report["upside_down"]), (&left_for_right.into(), &upside_down.into()), "{report:#}");
        assert_eq!(report["mirrored"], left_for_right != upside_down);
        let mark = &report["mark"];
        let number = |key: &str| mark[key].as_f64().unwrap();
        // 361 um of glass to a third of a pixel, and the lines of the walls to a pixel.
        assert!((number("radius_um") - 361.0).abs() < 7.0 && (number("wall_radius_um") - 361.0).abs() < 7.0, "{mark:#}");
        assert!(number("residual_px") < 1.0 && number("closure_px") < 1.0, "{mark:#}");
        // 382 px from the middle, at 361 um of a distance of 60 mm: 2.30 px of perspective, in both rotation senses.
        assert!((mark["perspective_px"][0].as_f64().unwrap() - 2.30).abs() < 0.5, "{mark:#}");
        assert!((mark["perspective_px"][1].as_f64().unwrap() - 2.30).abs() < 0.1, "{mark:#}");
    }
}

#[test]
fn a_calibration_is_kept_with_its_day_and_never_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let recording = turn(dir.path(), AS_TOLD, Some(ink()), Nuisances::default(), None::<Specimen>);
    let kept = dir.path().join("kept");
    let output = marked(&recording, ["near", "top", "right"], &kept);
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let day = &report["measured"].as_str().unwrap()[..10];
    let file = kept.join(format!("marked-{day}-{}.json", report["id"].as_str().unwrap()));
    assert_eq!(serde_json::from_slice::<Value>(&std::fs::read(&file).unwrap()).unwrap(), report);
    let again = marked(&recording, ["near", "top", "right"], &kept);
    assert!(!again.status.success() && stderr(&again).contains("exists already"), "{}", stderr(&again));
    // The stated side is wrong: far and moving down would mean the other sense, but the perspective is that of the near side.
    refused(&recording, ["far", "top", "right"], &["said to be far", "-2.30 px", "+2.28 px"]);
}

#[test]
fn what_does_not_tell_is_refused_with_both_numbers() {
    let case = |ink: Option<InkDot>, nuisances: Nuisances, with: &[&str]| {
        let dir = tempfile::tempdir().unwrap();
        refused(&turn(dir.path(), AS_TOLD, ink, nuisances, None::<Specimen>), ["near", "top", "right"], with);
    };
    let quiet = Nuisances::default;
    // Dirt on the window does not move.
    let window = Marks { scratches: 6, dust: 40, contrast: 0.8 };
    case(None, Nuisances { seed: 3, window, ..quiet() }, &["no mark was found", "of 16 views", "10 or more"]);
    case(Some(InkDot { angle_rad: -1.45, ..ink() }), quiet(), &["7 deg from where the near and the far half meet", "15 or more"]);
    case(Some(InkDot { angle_rad: -0.1, ..ink() }), quiet(), &["6 deg from where the upper and the lower half meet", "15 or more"]);
    case(Some(InkDot { x_um: 150.0, ..ink() }), quiet(), &["27 px from the picture's middle", "51 or more"]);
}
