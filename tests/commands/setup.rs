//! `carved setup` on the emulated rig, from no file to a configuration whose bead is right; and with a mistake each.
#![cfg(feature = "aravis")]

use crate::common::{carved, run, stderr, until};
use hardware_sim::scene::{Camera, Contents, Exposure, Placement, Scene, SceneSettings, Specimen};
use hardware_sim::{OutputPin, PixelFormat, Pixels, Rig, RigSettings, Sight};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Arc;

/// Diameter of the bead, um.
const BEAD_UM: f64 = 500.0;

/// Size of the pictures. Small ones are rendered soon, also on a busy machine.
const SIZE_PX: [u32; 2] = [640, 256];
/// Row of the axis in the middle column.
const AXIS_ROW_PX: f64 = 120.0;

/// The capillary is empty until the person says that the bead is loaded. The stored answers show when.
struct Person {
    scene: Scene,
    state: PathBuf,
    look: Look,
}

/// How the rig differs from the usual one.
#[derive(Clone, Copy, PartialEq)]
enum Look {
    Usual,
    /// No capillary is in the picture.
    Without,
    /// The motors turn the other way, and the picture is upside down as in one mirror.
    Reversed,
}

impl Sight for Person {
    fn size(&self) -> (u32, u32) {
        self.scene.size()
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        // Without a set-up the capillary stays as it is.
        let is_loaded = !self.scene.contents().specimens.is_empty();
        let wanted = std::fs::read_to_string(&self.state).map_or(is_loaded, |text| text.contains("\"loaded\":"));
        if wanted && !is_loaded {
            let placement = Placement { y_um: 40.0, ..Placement::default() };
            self.scene.load(Specimen::bead(BEAD_UM).unwrap().placed(placement)).unwrap();
        } else if is_loaded && !wanted {
            self.scene.load(Contents::default()).unwrap();
        }
        let (width, height) = self.size();
        match self.look {
            Look::Usual => self.scene.look(exposure, format),
            Look::Without => Pixels::filled(width, height, format, 190),
            Look::Reversed => {
                assert_eq!(format, PixelFormat::Mono8, "a mosaic cannot be turned upside down");
                let exposure = Exposure { angle_rad: -exposure.angle_rad, ..*exposure };
                let mut pixels = self.scene.look(&exposure, format);
                pixels.bytes = pixels.bytes.chunks(width as usize).rev().flatten().copied().collect();
                pixels
            }
        }
    }
}

struct Bench {
    rig: Rig,
    dir: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        Self::with(Look::Usual, RigSettings::default())
    }

    fn with(look: Look, settings: RigSettings) -> Self {
        let dir = tempfile::tempdir().unwrap();
        // The scale and the axis are not those that a shipped configuration names.
        let k = 1.0 / 5.2;
        let [width, height] = SIZE_PX;
        let ux_px = (f64::from(width) - 1.0) / 2.0;
        let size = Camera { width, height, ux_px, ..Camera::default() };
        let camera = Camera { kx_px_per_um: k, ky_px_per_um: k, uy_px: AXIS_ROW_PX, gamma_rad: 0.006, ..size };
        let scene = Scene::new(SceneSettings { camera, ..SceneSettings::default() });
        let person = Person { scene, state: dir.path().join("rig.setup.json"), look };
        let rig = Rig::start(RigSettings { time_scale: 10.0, ..settings }, Arc::new(person)).unwrap();
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
            ("width", SIZE_PX[0].to_string()),
            ("height", SIZE_PX[1].to_string()),
            ("data_dir", format!("{:?}", self.path("data").to_str().unwrap())),
            ("empty", "\"yes\"".into()),
            ("bore_um", "650".into()),
            ("bead_um", format!("{BEAD_UM}")),
            ("loaded", "\"yes\"".into()),
            ("motion", "\"yes\"".into()),
            ("sense", "\"down\"".into()),
        ];
        let usual = usual.into_iter().filter(|(key, _)| !changes.iter().any(|(changed, _)| changed == key));
        let changed = changes.iter().map(|(key, value)| (*key, (*value).to_owned()));
        let lines: Vec<String> = usual.chain(changed).map(|(key, value)| format!("{key} = {value}\n")).collect();
        let file = self.path("answers.toml");
        std::fs::write(&file, lines.concat()).unwrap();
        file
    }

    fn command(&self, answers: &Path) -> Command {
        let mut command = carved();
        command.arg("setup").arg("--out").arg(self.path("rig.toml")).arg("--answers").arg(answers);
        command
    }

    fn setup(&self, changes: &[(&str, &str)]) -> Output {
        self.command(&self.answers(changes)).output().unwrap()
    }

    /// A set-up that ends well. Returns what it said.
    fn done(&self, changes: &[(&str, &str)]) -> String {
        let output = self.setup(changes);
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && said.contains("The bead is right"), "{said}\n{}", stderr(&output));
        said
    }

    /// `carved setup check` with the configuration that was written, and with changes in it.
    fn check(&self, changes: &[(&str, &str)]) -> Output {
        let config = self.path("rig.toml");
        let text = std::fs::read_to_string(&config).unwrap();
        let changed = changes.iter().fold(text, |text, (from, to)| {
            assert!(text.contains(from), "the configuration has no {from:?}");
            text.replace(from, to)
        });
        let checked = self.path("checked.toml");
        std::fs::write(&checked, changed).unwrap();
        let answers = self.path("check.toml");
        std::fs::write(&answers, format!("bead_um = {BEAD_UM}\nloaded = \"yes\"\nmotion = \"yes\"\n")).unwrap();
        carved().args(["setup", "check", "--config"]).arg(checked).arg("--answers").arg(answers).output().unwrap()
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
    let bench = Bench::new();
    let output = bench.setup(&[]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{said}\n{}", stderr(&output));
    let config = bench.path("rig.toml");
    for (table, key, expected, within) in [
        ("optics", "kx_px_per_um", 1.0 / 5.2, 0.001),
        ("optics", "ky_px_per_um", 1.0 / 5.2, 0.001),
        ("optics", "uy_px", AXIS_ROW_PX, 0.1),
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

    let checked = bench.check(&[]);
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    let right = ["right  turn", "right  closure", "right  bead"];
    assert!(checked.status.success() && right.iter().all(|line| said.contains(line)), "{said}\n{}", stderr(&checked));
    let checked = bench.check(&[("steps_per_revolution = [500, 1]", "steps_per_revolution = [400, 1]")]);
    let said = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(!checked.status.success() && said.contains("WRONG  turn") && said.contains("[500, 1] is likely"), "{said}");
}

#[test]
fn a_rig_that_turns_the_other_way_and_is_seen_in_a_mirror_is_set_up() {
    let bench = Bench::with(Look::Reversed, RigSettings::default());
    bench.done(&[("pixel_format", "\"Mono8\""), ("sense", "\"up\"")]);
    let config = bench.path("rig.toml");
    // Row and roll are those of the mirror image.
    for (table, key, expected, within) in [
        ("optics", "ky_px_per_um", 1.0 / 5.2, 0.001),
        ("optics", "uy_px", 255.0 - AXIS_ROW_PX, 0.1),
        ("optics", "gamma_deg", -0.006_f64.to_degrees(), 0.1),
        ("acquisition", "sense", -1.0, 0.0),
    ] {
        let found = number(&config, table, key);
        assert!((found - expected).abs() <= within, "{table}.{key} = {found}, expected {expected}");
    }
}

/// A rig whose light the controller switches shows nothing while it is off.
#[test]
fn the_light_is_on_while_pictures_are_taken_and_off_after_them() {
    let bench = Bench::with(Look::Usual, RigSettings { light: Some(OutputPin::Flood), ..RigSettings::default() });
    bench.refused(&[], &["The file of answers has no further answer"]);
    std::fs::remove_file(bench.path("rig.setup.json")).unwrap();
    bench.done(&[("light", "\"flood_coolant\"")]);
    assert!(!bench.rig.outputs().is_on(OutputPin::Flood));
    let switched = bench.rig.outputs().switched();
    assert!(switched.contains(&(OutputPin::Flood, true)), "{switched:?}");
    assert!(bench.check(&[]).status.success());
    assert!(!bench.rig.outputs().is_on(OutputPin::Flood));
}

/// A set-up whose answers come line by line.
struct Lines {
    child: Child,
    out: BufReader<std::process::ChildStdout>,
}

impl Lines {
    fn start(bench: &Bench) -> Self {
        let mut child = bench.command(Path::new("-")).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        Self { child, out }
    }

    fn answer(&mut self, lines: &[&str]) {
        let stdin = self.child.stdin.as_mut().unwrap();
        for line in lines {
            writeln!(stdin, "{line}").unwrap();
        }
    }

    /// Reads up to the line with these words.
    fn until(&mut self, words: &str) -> String {
        let mut said = String::new();
        while !said.contains(words) {
            assert_ne!(self.out.read_line(&mut said).unwrap(), 0, "ended before {words:?}: {said}");
        }
        said
    }

    /// The exit code, and everything that was not read yet.
    fn end(mut self) -> (Option<i32>, String) {
        drop(self.child.stdin.take());
        let mut said = String::new();
        std::io::Read::read_to_string(&mut self.out, &mut said).unwrap();
        let output = self.child.wait_with_output().unwrap();
        (output.status.code(), said + &stderr(&output))
    }
}

#[test]
fn a_signal_stops_the_motors_and_the_light_and_the_same_command_goes_on() {
    let bench = Bench::with(Look::Usual, RigSettings { light: Some(OutputPin::Flood), ..RigSettings::default() });
    let (port, camera) = (bench.rig.serial_path(), bench.rig.camera_address().to_string());
    let (port, data) = (port.to_str().unwrap(), bench.path("data"));
    let mut lines = Lines::start(&bench);
    // Empty lines take the default. The bore is typed as 60 by mistake, and one answer is taken back.
    lines.answer(&["bench", port, "501", "back", "500", "", "flood_coolant", &camera, "", "640", "256", data.to_str().unwrap(), "yes"]);
    lines.answer(&["60", "650", "500", "", "yes", "yes"]);
    let said = lines.until("The capillary turns twice");
    assert!(said.contains("60 um; expected 100 to 5000 um"), "{said}");
    until("the axis turns in the light", || bench.rig.shaft().is_turning() && bench.rig.outputs().is_on(OutputPin::Flood));
    let pid = lines.child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let (code, said) = lines.end();
    assert!(code.is_some_and(|code| code != 0) && said.contains("stopped: the motors were told to stop"), "{code:?} {said}");
    assert!(!bench.rig.shaft().is_turning() && !bench.rig.outputs().is_on(OutputPin::Flood));
    assert!(bench.path("rig.setup.json").exists() && !bench.path("rig.toml").exists());

    // It goes on at the confirmation, and asks nothing that was answered.
    let mut lines = Lines::start(&bench);
    lines.answer(&["yes", "down", "bead"]);
    let (code, said) = lines.end();
    assert!(code == Some(0) && said.contains("Going on with the answers") && said.contains("The bead is right"), "{code:?} {said}");
    assert!(!said.contains("Certified diameter of the bead"), "{said}");

    // Standard input that ends before the set-up does is named.
    let mut lines = Lines::start(&bench);
    lines.answer(&["again"]);
    let (code, said) = lines.end();
    assert!(code != Some(0) && said.contains("standard input ended before the set-up did"), "{said}");
}

/// `carved setup` on the rig that it emulates itself, with each controller but Grbl, which the other tests here have.
#[test]
fn each_controller_is_set_up() {
    for (controller, steps, identity) in [("tmcl", "6400", "TMCM"), ("zaber", "6400", "Zaber"), ("relay", "500", "relay")] {
        let dir = tempfile::tempdir().unwrap();
        let (config, answers) = (dir.path().join("rig.toml"), dir.path().join("answers.toml"));
        let data = dir.path().join("data");
        let text = format!("steps = {steps}\nbore_um = 650\nempty = \"yes\"\nloaded = \"yes\"\nmotion = \"yes\"\ndata_dir = {data:?}\n");
        std::fs::write(&answers, text + "sense = \"down\"\n").unwrap();
        let mut command = carved();
        command.args(["setup", "--simulate", "--time-scale", "10", "--controller", controller]);
        let output = command.arg("--out").arg(&config).arg("--answers").arg(&answers).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && said.contains("The bead is right"), "{controller}: {said}\n{}", stderr(&output));
        assert!(said.contains(identity) && (number(&config, "optics", "ky_px_per_um") * 5.2 - 1.0).abs() < 0.005, "{said}");
    }
    // Those that have nothing to be set up say where their configuration is described.
    for (controller, page) in [("vast-bridge", "docs/vast.md"), ("folder", "docs/vast-folder.md")] {
        let dir = tempfile::tempdir().unwrap();
        let (config, answers) = (dir.path().join("rig.toml"), dir.path().join("answers.toml"));
        std::fs::write(&answers, "").unwrap();
        let mut command = carved();
        let output =
            command.args(["setup", "--simulate", "--controller", controller]).arg("--out").arg(&config).arg("--answers").arg(&answers);
        let output = output.output().unwrap();
        assert!(!output.status.success() && !config.exists(), "{controller}");
        assert!(stderr(&output).contains(page), "{controller}: {}", stderr(&output));
    }
}

/// A busy computer loses frames, most of all the first of an acquisition.
#[test]
fn a_frame_that_is_lost_is_taken_again() {
    let bench = Bench::new();
    bench.rig.faults().camera().drop_frames(1);
    bench.done(&[]);
}

#[test]
fn a_wrong_number_of_steps_is_found_and_the_right_one_proposed() {
    Bench::new().refused(&[("steps", "400")], &["The steps per turn are wrong", "400 are configured", "500 is likely"]);
    // The same person takes the proposal.
    let bench = Bench::new();
    let output = bench.setup(&[("steps", "[400, 500]"), ("loaded", "\"yes\""), ("motion", "[\"yes\", \"yes\"]")]);
    assert!(output.status.success(), "{}\n{}", String::from_utf8_lossy(&output.stdout), stderr(&output));
}

#[test]
fn numbers_that_cannot_be_meant_are_refused_at_their_question() {
    let bench = Bench::new();
    bench.refused(&[("bore_um", "60")], &["bore_um: 60 um; expected 100 to 5000 um"]);
    let bench = Bench::new();
    bench.refused(&[("bead_um", "5000")], &["bead_um: 5000 um; expected 20 to 4500 um"]);
    let bench = Bench::new();
    bench.refused(&[("bead_um", "50")], &["A bead of 50 um in a bore of 650 um; usual are 130 to"]);
    // Said twice, it is believed until the bead is measured.
    let bench = Bench::new();
    bench.refused(&[("bead_um", "[50, 50]")], &["but 50 um are stated", "One of both numbers is wrong"]);
}

#[test]
fn a_picture_without_walls_and_a_port_without_controller_are_named() {
    Bench::with(Look::Without, RigSettings::default()).refused(&[], &["No walls of a capillary are seen"]);
    let (_master, slave) = serialport::TTYPort::pair().unwrap();
    let silent = format!("{:?}", serialport::SerialPort::name(&slave).unwrap());
    drop(slave);
    Bench::new().refused(&[("controller", &silent)], &["Nobody answers at", "carved doctor"]);
    Bench::new().refused(&[("controller", "\"/dev/no-such-port\"")], &["/dev/no-such-port"]);
}

#[test]
fn nobody_is_asked_where_nobody_can_answer() {
    let dir = tempfile::tempdir().unwrap();
    let output = carved().arg("setup").arg("--out").arg(dir.path().join("rig.toml")).stdin(std::process::Stdio::null()).output().unwrap();
    assert!(!output.status.success() && stderr(&output).contains("--answers"), "{}", stderr(&output));
}

#[test]
fn a_file_with_an_answer_to_no_question_is_refused_with_the_questions() {
    let dir = tempfile::tempdir().unwrap();
    let (answers, out) = (dir.path().join("answers.toml"), dir.path().join("carved.toml"));
    std::fs::write(&answers, "name = \"vast-1\"\nbore_mm = 0.65\n").unwrap();
    let output = run(&["setup", "--answers", answers.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    let said = stderr(&output);
    assert!(!output.status.success() && said.contains("\"bore_mm\"") && said.contains("bore_um"), "{said}");
    assert!(!out.exists());
}
