//! `carved serve` beside a program that turns the capillary itself and stores pictures, with the configuration shipped for it.
//!
//! ```text
//! test ── VastProgram ── TIFF files ──► folder of the plate ──► carved serve (child)
//!   └──────────────────────── HTTP: plan, status, results ──────────────┘
//! ```

use crate::common::{Daemon, json};
use hardware_sim::scene::{Scene, SceneSettings, Specimen, Truth};
use hardware_sim::vast_program::{Manner, Mistake, VastProgram, VastProgramSettings};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

const VIEWS: u32 = 12;
const RUN: &str = "r1";

/// The daemon and the other program on one folder.
struct Pair {
    dir: tempfile::TempDir,
    config: PathBuf,
    daemon: Daemon,
    program: VastProgram,
}

impl Pair {
    fn start() -> Self {
        Self::with("", false)
    }

    fn with(extra: &str, repeats_first: bool) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let pictures = dir.path().join("pictures");
        std::fs::create_dir(&pictures).unwrap();
        let mut text = std::fs::read_to_string(format!("{}/config/vast-folder.toml", env!("CARGO_MANIFEST_DIR"))).unwrap();
        for (from, to) in [
            ("127.0.0.1:8420", "127.0.0.1:0".to_owned()),
            ("/var/lib/carved", dir.path().join("data").display().to_string()),
            ("/mnt/vast", pictures.display().to_string()),
            ("repeats_first = false", format!("repeats_first = {repeats_first}")),
            ("[methods.standard]", format!("poll_ms = 20\nquiet_ms = 100\n{extra}\n[methods.standard]")),
        ] {
            assert!(text.contains(from), "the shipped configuration has no {from:?}");
            text = text.replace(from, &to);
        }
        let config = dir.path().join("carved.toml");
        std::fs::write(&config, text).unwrap();
        let daemon = Daemon::serve(&config, &dir.path().join("data"));
        let camera = hardware_sim::scene::Camera { width: 1024, height: 200, ux_px: 511.5, uy_px: 99.5, ..Default::default() };
        let scene = Scene::new(SceneSettings { camera, ..SceneSettings::default() });
        let settings = VastProgramSettings {
            folder: pictures.join("P-017"),
            views: VIEWS,
            repeats_first,
            step: Duration::ZERO,
            // Longer than the time of quiet: size and time alone do not tell that a picture is complete.
            pause: Duration::from_millis(250),
            manners: Manner::ALL.to_vec(),
        };
        Self { dir, config, daemon, program: VastProgram::new(Arc::new(scene), settings) }
    }

    fn plan(&self, wells: &[&str]) {
        let map: Vec<Value> = wells.iter().map(|well| json!({"well": well, "specimen": "bead"})).collect();
        let plan = json!({"plate_barcode": "P-017", "method": "standard", "operator": "test", "plate_map": map});
        assert_eq!(self.daemon.put_run(RUN, &plan), 201);
    }

    /// A run that waits for its first picture.
    fn waits(&self, wells: &[&str]) -> Value {
        self.plan(wells);
        self.daemon.wait("the wait for pictures", |s| s["doing"].as_str().unwrap().starts_with("Waiting for the pictures"))
    }

    /// The other program stores a well, while the daemon reads.
    fn stores(&mut self, well: &str, specimen: Option<Specimen>, mistake: Option<Mistake>) {
        self.program.turn(well, specimen, mistake, &rest).unwrap();
    }

    fn measurement(&self, well: &str) -> Value {
        json(&self.dir.path().join("data/runs").join(RUN).join(well).join("measurement.json"))
    }

    fn outcomes(status: &Value) -> Vec<String> {
        let results = status["run"]["results"].as_array().unwrap();
        results.iter().map(|well| format!("{} {}", well["well"].as_str().unwrap(), well["outcome"].as_str().unwrap())).collect()
    }
}

/// The pace of the other program.
fn rest(time: Duration) -> bool {
    let until = Instant::now() + time;
    while let Some(left) = until.checked_duration_since(Instant::now()) {
        std::thread::park_timeout(left);
    }
    false
}

const BEAD_UM: f64 = 500.0;

fn bead() -> Specimen {
    Specimen::bead(BEAD_UM).unwrap()
}

fn is_fault(status: &Value, code: &str) -> bool {
    status["faults"].as_array().unwrap().iter().any(|fault| fault["code"] == code)
}

/// Deviation from the bead's true volume, %.
fn error_percent(measurement: &Value) -> f64 {
    let Truth { volume_um3, .. } = bead().truth();
    100.0 * (measurement["measurement"]["volume_um3"].as_f64().unwrap() / volume_um3 - 1.0)
}

#[test]
fn wells_are_measured_while_another_program_stores_them_in_its_own_order() {
    let mut pair = Pair::start();
    let status = pair.waits(&["A01", "A02", "A03", "A04"]);
    assert_eq!(status["hardware"]["rotation"]["outside"], true, "{status}");
    assert_eq!(status["hardware"]["rotation"]["can_stop"], false, "{status}");
    pair.stores("A02", Some(bead()), None);
    let status = pair.daemon.wait("the first result", |s| s["run"]["wells"]["succeeded"] == 1 || s["run"]["wells"]["flagged"] == 1);
    assert_eq!(status["run"]["outcome"], Value::Null, "{status}");
    // Nobody is in A01. In A03 the program leaves out a view and goes on.
    pair.stores("A01", None, None);
    pair.stores("A03", Some(bead()), Some(Mistake::LeavesOut(3)));
    pair.stores("A04", Some(bead()), None);
    let status = pair.daemon.wait_for_outcome();
    let outcomes = Pair::outcomes(&status);
    assert!(outcomes[0] == "A01 skipped" && outcomes[2] == "A03 failed", "{outcomes:?}");
    let why = status["run"]["results"][2]["reason"].as_str().unwrap();
    assert!(why.contains("view 3 is missing") && why.contains("well A04"), "{why}");
    for well in ["A02", "A04"] {
        let measurement = pair.measurement(well);
        let error = error_percent(&measurement);
        assert!(error.abs() < 1.0, "{well}: {error} %");
        // Without a picture at 360 deg nobody knows whether the bead has moved, and the result says so.
        assert!(has_flag(&measurement, "no_closure") && measurement["closure"].is_null(), "{well}: {}", measurement["flags"]);
    }
    let recording = json(&pair.dir.path().join("data/runs").join(RUN).join("A02/recording.json"));
    let ledger = recording["ledger"].as_array().unwrap();
    assert_eq!((ledger.len(), ledger.iter().filter(|entry| entry["closure"] == true).count()), (VIEWS as usize, 0));
}

fn has_flag(measurement: &Value, flag: &str) -> bool {
    measurement["flags"].as_array().unwrap().iter().any(|raised| raised == flag)
}

#[test]
fn a_picture_at_360_deg_closes_the_turn() {
    let mut pair = Pair::with("", true);
    pair.waits(&["A01"]);
    pair.stores("A01", Some(bead()), None);
    pair.daemon.wait_for_outcome();
    let measurement = pair.measurement("A01");
    assert!(!has_flag(&measurement, "no_closure"), "{}", measurement["flags"]);
    assert!(measurement["closure"]["iou"].as_f64().unwrap() > 0.98, "{}", measurement["closure"]);
    let recording = json(&pair.dir.path().join("data/runs").join(RUN).join("A01/recording.json"));
    let ledger = recording["ledger"].as_array().unwrap();
    assert_eq!((ledger.len(), ledger.iter().filter(|entry| entry["closure"] == true).count()), (VIEWS as usize + 1, 1));
}

#[test]
fn pictures_from_before_the_run_are_asked_about_and_wells_without_any_are_skipped_at_the_end() {
    let mut pair = Pair::with("end_after_s = 2", false);
    pair.stores("A02", Some(bead()), None);
    pair.plan(&["A01", "A02"]);
    let status = pair.daemon.wait("the question", |s| is_fault(s, "pictures_earlier"));
    assert!(status["run"]["outcome"].is_null(), "{status}");
    let fault = &status["faults"][0];
    assert!(fault["message"].as_str().unwrap().contains("12 picture(s)"), "{fault}");
    pair.daemon.wait("the hold", |s| s["state"] == "Held");
    pair.daemon.go_on(RUN, fault);
    let status = pair.daemon.wait_for_outcome();
    assert_eq!(status["run"]["results"][0]["reason"], "no_pictures", "{status}");
    assert_eq!(Pair::outcomes(&status)[0], "A01 skipped");
    assert!(error_percent(&pair.measurement("A02")).abs() < 1.0);
}

#[test]
fn a_share_that_is_lost_in_mid_turn_holds_the_run_and_the_run_catches_up() {
    let mut pair = Pair::start();
    pair.waits(&["A01"]);
    pair.stores("A01", Some(bead()), Some(Mistake::StopsAfter(5)));
    pair.daemon.wait("five views", |s| s["specimen"]["view"] == 5);
    let (here, away) = (pair.dir.path().join("pictures"), pair.dir.path().join("away"));
    std::fs::rename(&here, &away).unwrap();
    let status = pair.daemon.wait("the fault", |s| s["state"] == "Held" && is_fault(s, "pictures_lost"));
    assert!(status["faults"][0]["what_to_do"].as_str().unwrap().contains("share is mounted"), "{status}");
    std::fs::rename(&away, &here).unwrap();
    pair.program.go_on("A01", 6, None, &rest).unwrap();
    let status = pair.daemon.wait_for_outcome();
    assert!(!is_fault(&status, "pictures_lost"), "{status}");
    assert!(error_percent(&pair.measurement("A01")).abs() < 1.0);
}

#[test]
fn a_killed_daemon_reads_what_was_stored_meanwhile() {
    let mut pair = Pair::start();
    pair.waits(&["A01", "A02"]);
    pair.stores("A01", Some(bead()), Some(Mistake::StopsAfter(5)));
    pair.daemon.wait("five views", |s| s["specimen"]["view"] == 5);
    pair.daemon.kill();
    pair.program.go_on("A01", 6, None, &rest).unwrap();
    pair.stores("A02", Some(bead()), None);
    pair.daemon = Daemon::serve(&pair.config, &pair.dir.path().join("data"));
    pair.daemon.wait_for_outcome();
    for well in ["A01", "A02"] {
        let error = error_percent(&pair.measurement(well));
        assert!(error.abs() < 1.0, "{well}: {error} %");
    }
}

/// Somebody copied the folder of a well. The daemon was started again between the two.
#[test]
fn a_well_that_has_the_pictures_of_another_one_fails_and_names_it() {
    let mut pair = Pair::start();
    pair.waits(&["A01", "A02", "A03"]);
    pair.stores("A01", Some(bead()), None);
    pair.daemon.wait("the first result", |s| s["run"]["wells"]["succeeded"] == 1 || s["run"]["wells"]["flagged"] == 1);
    pair.daemon.kill();
    let folder = pair.dir.path().join("pictures/P-017");
    for view in 1..=VIEWS {
        let name = |well: &str| folder.join(format!("W_{well}_1_{view}.tiff"));
        std::fs::copy(name("A01"), name("A02")).unwrap();
    }
    pair.daemon = Daemon::serve(&pair.config, &pair.dir.path().join("data"));
    pair.stores("A03", Some(bead()), None);
    let status = pair.daemon.wait_for_outcome();
    assert!(Pair::outcomes(&status)[1] == "A02 failed", "{status}");
    let why = status["run"]["results"][1]["reason"].as_str().unwrap();
    assert!(why.contains("wells A01 and A02 have the same pictures"), "{why}");
    assert!(error_percent(&pair.measurement("A03")).abs() < 1.0);
}

#[test]
fn a_picture_at_which_the_decoder_panics_fails_its_well_and_the_daemon_lives() {
    let mut pair = Pair::with("next_picture_s = 10", false);
    pair.waits(&["A01", "A02"]);
    pair.stores("A01", Some(bead()), Some(Mistake::StopsAfter(3)));
    let tiles = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/commands/data/parsers/picture/planar-tiles.tif");
    std::fs::copy(tiles, pair.dir.path().join("pictures/P-017/W_A01_1_4.tiff")).unwrap();
    let status = pair.daemon.wait("the well", |s| s["run"]["wells"]["failed"] == 1);
    let why = status["run"]["results"][0]["reason"].as_str().unwrap();
    assert!(why.contains("W_A01_1_4.tiff") && why.contains("save it again with another program"), "{why}");
    // The same process goes on.
    pair.stores("A02", Some(bead()), None);
    let after = pair.daemon.wait_for_outcome();
    assert_eq!(after["boot_id"], status["boot_id"], "{after}");
    assert!(error_percent(&pair.measurement("A02")).abs() < 1.0);
}

#[test]
fn pictures_of_another_size_hold_the_run_with_both_sizes() {
    let pair = Pair::start();
    pair.waits(&["A01"]);
    let folder = pair.dir.path().join("pictures/P-017");
    std::fs::create_dir_all(&folder).unwrap();
    write_grey(&folder.join("W_A01_1_1.tiff"), 320, 100);
    let status = pair.daemon.wait("the fault", |s| is_fault(s, "pictures_unfit"));
    let detail = status["faults"][0]["message"].as_str().unwrap();
    assert!(detail.contains("320 x 100 px") && detail.contains("1024 x 200 px"), "{detail}");
}

fn write_grey(path: &Path, width: u32, height: u32) {
    image::GrayImage::from_pixel(width, height, image::Luma([200])).save(path).unwrap();
}

#[test]
fn the_simulated_program_and_the_daemon_measure_the_demo_plate() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data");
    let daemon = Daemon::start(&data, &["--controller", "folder", "--time-scale", "50"]);
    let status = daemon.wait_for_outcome();
    assert_eq!((&status["mode"], &status["run"]["outcome"]), (&json!("simulated"), &json!("succeeded")), "{status}");
    for result in status["run"]["results"].as_array().unwrap().iter().filter(|result| result["well"] != "A04") {
        let folder = daemon.run_folder().join(result["well"].as_str().unwrap());
        let (measurement, truth) = (json(&folder.join("measurement.json")), json(&folder.join("recording.json")));
        let (found, true_um3) =
            (measurement["measurement"]["volume_um3"].as_f64().unwrap(), truth["truth"]["hull_volume_um3"].as_f64().unwrap());
        let sd = measurement["measurement"]["volume_sd_um3"].as_f64().unwrap();
        assert!((found - true_um3).abs() < 3.0 * sd, "{}: {found} +- {sd}, true {true_um3} um3", result["well"]);
    }
}
