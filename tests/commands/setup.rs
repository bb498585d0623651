//! `carved setup` on the emulated rig, from no file to a configuration whose bead is right; and with a mistake each.
#![cfg(feature = "aravis")]

use crate::common::{carved, run, stderr};
use hardware_sim::scene::{Camera, Exposure, Placement, Scene, SceneSettings, Specimen};
use hardware_sim::{PixelFormat, Pixels, Rig, RigSettings, Sight};
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::Arc;

/// Diameter of the bead, um.
const BEAD_UM: f64 = 500.0;

/// The capillary is empty until the person says that the bead is loaded. The stored answers show when.
struct Person {
    scene: Scene,
    state: PathBuf,
    /// A capillary is in the picture.
    has_capillary: bool,
}

impl Sight for Person {
    fn size(&self) -> (u32, u32) {
        self.scene.size()
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        if self.scene.contents().specimens.is_empty() && std::fs::read_to_string(&self.state).is_ok_and(|text| text.contains("\"loaded\":"))
        {
            let placement = Placement { y_um: 40.0, ..Placement::default() };
            self.scene.load(Specimen::bead(BEAD_UM).unwrap().placed(placement)).unwrap();
        }
        if !self.has_capillary {
            let (width, height) = self.size();
            return Pixels::filled(width, height, format, 190);
        }
        self.scene.look(exposure, format)
    }
}

struct Bench {
    rig: Rig,
    dir: tempfile::TempDir,
}

impl Bench {
    fn new(has_capillary: bool) -> Self {
        let dir = tempfile::tempdir().unwrap();
        // The scale and the axis are not those that a shipped configuration names.
        let k = 1.0 / 5.2;
        let camera = Camera { kx_px_per_um: k, ky_px_per_um: k, uy_px: 498.0, gamma_rad: 0.006, ..Camera::default() };
        let settings = SceneSettings { camera, ..SceneSettings::default() };
        let person = Person { scene: Scene::new(settings), state: dir.path().join("rig.setup.json"), has_capillary };
        let rig = Rig::start(RigSettings { time_scale: 10.0, ..RigSettings::default() }, Arc::new(person)).unwrap();
        Self { rig, dir }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// The answers of a person who makes no mistake, with some of them replaced.
    fn answers(&self, changes: &[(&str, &str)]) -> PathBuf {
        let usual = [
            ("name", "\"bench\"".to_owned()),
            ("controller", format!("{:?}", self.rig.serial_path().to_str().unwrap())),
            ("steps", "500".into()),
            ("camera", format!("\"{}\"", self.rig.camera_address())),
            ("data_dir", format!("{:?}", self.path("data").to_str().unwrap())),
            ("empty", "\"yes\"".into()),
            ("bore_um", "650".into()),
            ("bead_um", format!("{BEAD_UM}")),
            ("loaded", "\"yes\"".into()),
            ("motion", "\"yes\"".into()),
            ("sense", "\"down\"".into()),
        ];
        let changed = |key: &str| changes.iter().find(|(k, _)| *k == key).map(|(_, v)| (*v).to_owned());
        let lines = usual.map(|(key, value)| format!("{key} = {}\n", changed(key).unwrap_or(value)));
        let file = self.path("answers.toml");
        std::fs::write(&file, lines.concat()).unwrap();
        file
    }

    fn setup(&self, changes: &[(&str, &str)]) -> Output {
        let answers = self.answers(changes);
        carved().arg("setup").arg("--out").arg(self.path("rig.toml")).arg("--answers").arg(answers).output().unwrap()
    }

    /// A set-up that ends with these words, and writes no configuration.
    fn refused(&self, changes: &[(&str, &str)], words: &[&str]) {
        let output = self.setup(changes);
        let said = stderr(&output);
        assert!(!output.status.success() && words.iter().all(|w| said.contains(w)), "{}\n{said}", String::from_utf8_lossy(&output.stdout));
        assert!(!self.path("rig.toml").exists());
    }
}

fn number(config: &Path, table: &str, key: &str) -> f64 {
    let table: toml::Table = std::fs::read_to_string(config).unwrap().parse::<toml::Table>().unwrap()[table].as_table().unwrap().clone();
    table[key].as_float().or(table[key].as_integer().map(|n| n as f64)).unwrap()
}

#[test]
fn a_rig_is_set_up_from_nothing_and_its_bead_is_right() {
    let bench = Bench::new(true);
    let output = bench.setup(&[]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}\n{}", stderr(&output));
    let config = bench.path("rig.toml");
    for (table, key, expected, within) in [
        ("optics", "kx_px_per_um", 1.0 / 5.2, 0.001),
        ("optics", "ky_px_per_um", 1.0 / 5.2, 0.001),
        ("optics", "uy_px", 498.0, 0.1),
        ("optics", "gamma_deg", 0.006_f64.to_degrees(), 0.1),
        ("optics", "bore_um", 650.0, 0.0),
        ("acquisition", "sense", 1.0, 0.0),
    ] {
        let found = number(&config, table, key);
        assert!((found - expected).abs() <= within, "{table}.{key} = {found}, expected {expected}: {said}");
    }
    let checked = run(&["config", "check", config.to_str().unwrap()]);
    assert!(checked.status.success(), "{}", stderr(&checked));
    assert!(said.contains("The bead is right") && said.contains("carved serve --config"), "{said}");
    assert!(!bench.path("rig.setup.json").exists(), "the answers are not needed any more");
}

#[test]
fn a_wrong_number_of_steps_is_found_and_the_right_one_proposed() {
    Bench::new(true).refused(&[("steps", "400")], &["The steps per turn are wrong", "400 are configured", "500 is likely"]);
    // The same person takes the proposal.
    let bench = Bench::new(true);
    let output = bench.setup(&[("steps", "[400, 500]"), ("loaded", "\"yes\""), ("motion", "[\"yes\", \"yes\"]")]);
    assert!(output.status.success(), "{}\n{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
}

#[test]
fn numbers_that_cannot_be_meant_are_refused_at_their_question() {
    let bench = Bench::new(true);
    bench.refused(&[("bore_um", "60")], &["bore_um: 60 um; expected 100 to 5000 um"]);
    let bench = Bench::new(true);
    bench.refused(&[("bead_um", "5000")], &["bead_um: 5000 um; expected 20 to 4500 um"]);
    let bench = Bench::new(true);
    bench.refused(&[("bead_um", "50")], &["A bead of 50 um in a bore of 650 um; usual are 130 to"]);
    // Said twice, it is believed until the bead is measured.
    let bench = Bench::new(true);
    bench.refused(&[("bead_um", "[50, 50]")], &["but 50 um are stated", "One of both numbers is wrong"]);
}

#[test]
fn a_picture_without_walls_and_a_port_without_controller_are_named() {
    Bench::new(false).refused(&[], &["No walls of a capillary are seen"]);
    let (_master, slave) = serialport::TTYPort::pair().unwrap();
    let silent = format!("{:?}", serialport::SerialPort::name(&slave).unwrap());
    drop(slave);
    Bench::new(true).refused(&[("controller", &silent)], &["Nobody answers at", "carved doctor"]);
    Bench::new(true).refused(&[("controller", "\"/dev/no-such-port\"")], &["/dev/no-such-port"]);
}

#[test]
fn nobody_is_asked_where_nobody_can_answer() {
    let dir = tempfile::tempdir().unwrap();
    let output = carved().arg("setup").arg("--out").arg(dir.path().join("rig.toml")).stdin(std::process::Stdio::null()).output().unwrap();
    assert!(!output.status.success() && stderr(&output).contains("--answers"), "{}", stderr(&output));
}
