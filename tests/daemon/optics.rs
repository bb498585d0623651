//! Light, camera position or scale fail during a run. The run is held, the larva stays in the capillary, and it is measured after a person
//! has repaired the instrument.
//!
//! ```text
//! test = plate-loader, or a sampler's plate ──► carved serve (child) ── pty, GigE ──► emulated rig behind a lamp that this test dims
//! ```
#![cfg(feature = "aravis")]

use crate::common::{Daemon, Instrument, QUICK};
use hardware_sim::sampler::Next;
use hardware_sim::scene::{Camera, Contents, Exposure, Scene, SceneSettings, Specimen};
use hardware_sim::{PixelFormat, Pixels, SamplerSettings, Sight};
use serde_json::{Value, json};
use std::cell::Cell;
use std::sync::{Arc, Mutex};

/// What is between the scene and the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Optics {
    Sound,
    /// Light in percent of the nominal light.
    Dimmed(u32),
    /// The same, from this exposure of the rig on.
    DimmedFrom(u64, u32),
    /// The same, at this exposure only.
    DimmedOnce(u64, u32),
    /// The camera looks past the capillary at the lamp.
    NoCapillary,
    /// Somebody has mounted a lens of twice the magnification.
    TwiceTheLens,
    /// The coupling is loose: the motor turns, the capillary does not.
    LooseCoupling,
}

struct Before {
    scene: Arc<Scene>,
    /// The same capillary, seen through the lens of twice the magnification.
    magnified: Scene,
    optics: Arc<Mutex<Optics>>,
}

impl Before {
    fn new(scene: Arc<Scene>, optics: Arc<Mutex<Optics>>) -> Self {
        let settings = scene.settings().clone();
        let camera = Camera {
            kx_px_per_um: 2.0 * settings.camera.kx_px_per_um,
            ky_px_per_um: 2.0 * settings.camera.ky_px_per_um,
            ..settings.camera
        };
        let magnified = Scene::new(SceneSettings { camera, ..settings });
        Self { scene, magnified, optics }
    }
}

impl Sight for Before {
    fn size(&self) -> (u32, u32) {
        self.scene.size()
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        if *self.optics.lock().unwrap() == Optics::TwiceTheLens {
            self.magnified.load(Contents::clone(&self.scene.contents())).unwrap();
            return self.magnified.look(exposure, format);
        }
        let is_loose = *self.optics.lock().unwrap() == Optics::LooseCoupling;
        let angle_rad = if is_loose { 0.3 } else { exposure.angle_rad };
        let mut seen = self.scene.look(&Exposure { angle_rad, ..*exposure }, format);
        let percent = match *self.optics.lock().unwrap() {
            Optics::NoCapillary => return Pixels::filled(seen.width, seen.height, format, 190),
            Optics::Dimmed(percent) => percent,
            Optics::DimmedFrom(from, percent) if exposure.number >= from => percent,
            Optics::DimmedOnce(at, percent) if exposure.number == at => percent,
            Optics::Sound | Optics::DimmedFrom(..) | Optics::DimmedOnce(..) | Optics::TwiceTheLens | Optics::LooseCoupling => 100,
        };
        seen.bytes.iter_mut().for_each(|byte| *byte = (u32::from(*byte) * percent / 100) as u8);
        seen
    }
}

struct Bench {
    instrument: Instrument,
    optics: Arc<Mutex<Optics>>,
    /// How many larvae came.
    larvae: Cell<u64>,
}

/// Loading takes 2 s, so that the empty capillary is seen before the specimen comes, also on a busy machine.
const SLOWLY: SamplerSettings = SamplerSettings { load_s: 20.0, eject_s: 1.5, bounce_s: 0.004 };

const POLICY: &str = "retries = 1, bead_gate = \"off\"";

impl Bench {
    fn with(sampler: Option<SamplerSettings>, policy: &str, more: &[(&str, String)]) -> Self {
        let optics = Arc::new(Mutex::new(Optics::Sound));
        let before = Arc::clone(&optics);
        let instrument = Instrument::filled_by(sampler, &QUICK, policy, more, |scene| Arc::new(Before::new(scene, before)));
        Self { instrument, optics, larvae: Cell::new(0) }
    }

    /// Another larva for each well: the same one twice is noticed.
    fn another_larva(&self) -> Specimen {
        self.larvae.set(self.larvae.get() + 1);
        Specimen::larva(4, self.larvae.get()).unwrap()
    }

    fn new(policy: &str) -> Self {
        Self::with(None, policy, &[])
    }

    fn daemon(&self) -> &Daemon {
        &self.instrument.daemon
    }

    fn set(&self, optics: Optics) {
        *self.optics.lock().unwrap() = optics;
    }

    fn put(&self, wells: &[&str]) {
        let wells: Vec<Value> = wells.iter().map(|well| json!({"well": well, "specimen": "larva", "dpf": 4})).collect();
        let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells});
        let (code, said) = self.daemon().send("PUT", "/v1/runs/r1", &plan);
        assert_eq!(code, 201, "{said}");
    }

    fn bring(&self, well: &str) {
        let asked = |s: &Value| s["state"] == "Suspended" && s["plate"]["bring"] == well;
        self.daemon().wait("the loader to be asked", asked);
        self.instrument.scene.load(Some(self.another_larva())).unwrap();
        assert_eq!(self.daemon().put_loaded("r1", well), 200);
    }

    /// Puts a larva on the sampler's plate once the daemon waits for it.
    fn give(&self) {
        self.daemon().wait("the load", |s| s["specimen"]["phase"] == "load");
        let (brought, taken) = (self.instrument.scene.clone(), self.instrument.scene.clone());
        let larva = self.another_larva();
        let bring = Box::new(move || brought.load(Some(larva.clone())).unwrap());
        let take_away = Box::new(move || taken.load(Contents::default()).unwrap());
        self.instrument.rig.sampler().unwrap().give(Next { bring, take_away });
    }

    /// Waits until the run is held. Checks that this fault is the only one, that it needs an operator, that the larva of `well` is in the
    /// capillary, and that nobody is asked to take it out.
    fn held(&self, well: &str, code: &str) -> Value {
        let status = self.daemon().wait("the hold", |s| s["state"] == "Held" || !s["run"]["outcome"].is_null());
        self.is_held(&status, well, code);
        status
    }

    fn is_held(&self, status: &Value, well: &str, code: &str) {
        self.is_held_by(status, well, code, "optics");
    }

    fn is_held_by(&self, status: &Value, well: &str, code: &str, category: &str) {
        assert_eq!(status["state"], "Held", "{status}");
        let faults = status["faults"].as_array().unwrap();
        assert_eq!((faults.len(), &faults[0]["code"]), (1, &json!(code)), "{status}");
        assert_eq!((&faults[0]["operator_required"], &faults[0]["category"]), (&json!(true), &json!(category)), "{status}");
        assert_eq!((&status["specimen"]["well"], &status["specimen"]["in_capillary"]), (&json!(well), &json!(true)), "{status}");
        assert_eq!((&status["plate"]["needs"], &status["plate"]["removable"]), (&Value::Null, &json!(false)), "{status}");
        let results = status["run"]["results"].as_array().unwrap();
        assert_eq!(results.iter().find(|r| r["well"] == well).unwrap()["outcome"], Value::Null, "the larva is not to blame: {status}");
        assert_eq!(status["run"]["wells"]["failed"], 0, "{status}");
        assert_ne!(self.instrument.scene.contents().specimens.len(), 0, "the larva was ejected");
    }

    /// The run does not continue while the fault stands. A person acknowledges the fault and then continues the run.
    fn go_on(&self, status: &Value) {
        let (code, problem) = self.daemon().send("POST", "/v1/runs/r1/unhold", &Value::Null);
        assert_eq!((code, &problem["code"]), (409, &json!("fault_stands")), "{problem}");
        self.daemon().go_on("r1", &status["faults"][0]);
    }

    /// Waits for the end of the run. The loader must not be asked for anything.
    fn ends(&self) -> Value {
        let status = self.daemon().wait("the run's end", |s| {
            assert!(s["state"] != "Suspended" && s["plate"]["bring"].is_null(), "the loader is asked for what is inside: {s}");
            !s["run"]["outcome"].is_null() || s["state"] == "Held"
        });
        assert_eq!((&status["run"]["outcome"], &status["faults"]), (&json!("succeeded"), &json!([])), "{status}");
        status
    }

    fn events(&self, kind: &str, well: &str) -> Vec<Value> {
        let text = std::fs::read_to_string(self.instrument.data.join("events.jsonl")).unwrap();
        let events = text.lines().map(|l| serde_json::from_str::<Value>(l).unwrap());
        events.filter(|e| e["kind"] == kind && e["well"] == well).collect()
    }
}

#[test]
fn light_that_is_cut_after_the_first_well_holds_the_run_and_the_same_larva_is_measured_once_it_is_back() {
    let bench = Bench::new(POLICY);
    bench.put(&["A01", "A02"]);
    bench.bring("A01");
    bench.daemon().wait("the second well", |s| s["plate"]["bring"] == "A02" && s["run"]["wells"]["pending"] == 1);
    bench.set(Optics::Dimmed(8));
    let exposures = bench.instrument.rig.exposures().len();
    bench.bring("A02");
    let status = bench.held("A02", "picture_light");
    let said = status["faults"][0].to_string();
    for word in ["A02", "lamp", "in the capillary"] {
        assert!(said.contains(word), "{word}: {said}");
    }
    assert!(status["doing"].as_str().unwrap().contains("light"), "{status}");
    // Two attempts with two frames each, and no turn. On a busy machine a late frame is triggered again.
    let taken = bench.instrument.rig.exposures().len() - exposures;
    assert!((4..21).contains(&taken), "{taken} exposures: a larva was turned in the dark");
    assert!(bench.instrument.data.join("runs/r1/A02/SHA256SUMS").is_file(), "the recording is closed");

    // After a crash the daemon still knows that the larva is inside, and its well.
    let Bench { instrument, optics, larvae } = bench;
    let bench = Bench { instrument: instrument.restarted("KILL"), optics, larvae };
    let status = bench.daemon().wait("the held run", |s| s["run"]["id"] == "r1" && s["state"] == "Held");
    bench.is_held(&status, "A02", "picture_light");

    bench.set(Optics::Sound);
    bench.go_on(&status);
    let status = bench.ends();
    assert_eq!(status["run"]["wells"]["total"], 2, "{status}");
    assert!(status["run"]["results"][1]["volume_um3"].as_f64().is_some(), "{status}");
    assert_eq!(bench.events("well.awaited", "A02").len(), 1, "the loader was asked for it again");
    assert_eq!(bench.events("specimen.done", "A02").len(), 1);
    let interrupted = bench.events("specimen.interrupted", "A02");
    assert_eq!((interrupted.len(), &interrupted[0]["data"]["kept"]), (1, &json!(true)), "{interrupted:?}");
}

/// The motor reports every step, and every picture is good. Only the pictures of the larva show that the capillary stands still.
#[test]
fn a_capillary_that_does_not_turn_with_its_motor_holds_the_run_with_the_larva_inside() {
    let bench = Bench::new(POLICY);
    bench.set(Optics::LooseCoupling);
    bench.put(&["A01"]);
    bench.bring("A01");
    let held = |s: &Value| s["state"] == "Held" || !s["run"]["outcome"].is_null();
    let status = bench.daemon().wait("the hold", held);
    bench.is_held_by(&status, "A01", "rotation_suspect", "motion");
    let said = status["faults"][0].to_string();
    for word in ["A01", "does not turn", "coupling"] {
        assert!(said.contains(word), "{word}: {said}");
    }
    // Nothing is repaired: the fault comes back, and the larva stays.
    bench.go_on(&status);
    let status = bench.daemon().wait("the second hold", |s| s["state"] == "Held" && s["faults"][0]["seq"].as_u64() > Some(1));
    bench.is_held_by(&status, "A01", "rotation_suspect", "motion");
    bench.set(Optics::Sound);
    bench.go_on(&status);
    let status = bench.ends();
    assert!(status["run"]["results"][0]["volume_um3"].as_f64().is_some(), "{status}");
    assert_eq!(bench.events("well.awaited", "A01").len(), 1, "the loader was asked for it again");
}

/// `interrupted = "skip"` gives up specimens whose position is lost. A specimen that the instrument could not see is not given up.
#[test]
fn a_capillary_that_is_out_of_view_holds_the_run_whatever_the_policy_says_of_interrupted_specimens() {
    let bench = Bench::new("retries = 0, interrupted = \"skip\", bead_gate = \"off\"");
    bench.set(Optics::NoCapillary);
    bench.put(&["A01"]);
    bench.bring("A01");
    let status = bench.held("A01", "capillary_not_seen");
    // Nothing is repaired: the fault comes back, and the larva stays.
    bench.go_on(&status);
    let status = bench.daemon().wait("the second hold", |s| s["state"] == "Held" && s["faults"][0]["seq"].as_u64() > Some(1));
    bench.is_held(&status, "A01", "capillary_not_seen");
    bench.set(Optics::Sound);
    bench.go_on(&status);
    bench.ends();
    assert_eq!(bench.events("well.awaited", "A01").len(), 1);
}

/// A vendor's sampler loads and ejects by itself. It must neither eject the larva nor load the next one.
#[test]
fn a_driven_sampler_keeps_the_larva_that_the_instrument_could_not_see() {
    let trigger = [("driver = \"loader\"", "driver = \"trigger\"\ndone_output = true".to_owned())];
    let bench = Bench::with(Some(SLOWLY), POLICY, &trigger);
    let machine = || bench.instrument.rig.sampler().unwrap();
    bench.set(Optics::NoCapillary);
    bench.put(&["A01"]);
    bench.give();
    let status = bench.held("A01", "capillary_not_seen");
    assert_eq!(machine().ejected(), 0, "the larva was ejected");
    bench.set(Optics::Sound);
    bench.go_on(&status);
    bench.ends();
    assert_eq!(machine().ejected(), 1);
    assert!(bench.events("specimen.phase", "A01").iter().all(|e| e["data"]["phase"] != "eject" || e["data"]["in_capillary"] == true));
}

/// The daemon dies while the larva waits in the capillary of a driven sampler. The restarted daemon continues with this larva.
#[test]
fn a_larva_that_a_driven_sampler_keeps_outlasts_a_crash() {
    let trigger = [("driver = \"loader\"", "driver = \"trigger\"\ndone_output = true".to_owned())];
    let bench = Bench::with(Some(SLOWLY), POLICY, &trigger);
    bench.set(Optics::Dimmed(8));
    bench.put(&["A01"]);
    bench.give();
    bench.held("A01", "picture_light");
    let Bench { instrument, optics, larvae } = bench;
    let bench = Bench { instrument: instrument.restarted("KILL"), optics, larvae };
    let status = bench.daemon().wait("the held run", |s| s["run"]["id"] == "r1" && s["state"] == "Held");
    bench.is_held(&status, "A01", "picture_light");
    bench.set(Optics::Sound);
    bench.go_on(&status);
    bench.ends();
    assert_eq!(bench.instrument.rig.sampler().unwrap().ejected(), 1);
}

/// The judging frame is exposure 0 and view 0 is exposure 1. The light fails at view 7 of 21.
#[test]
fn light_that_goes_out_in_mid_turn_holds_the_run() {
    let bench = Bench::new(POLICY);
    bench.set(Optics::DimmedFrom(8, 8));
    bench.put(&["A01"]);
    bench.bring("A01");
    let status = bench.held("A01", "picture_light");
    bench.set(Optics::Sound);
    bench.go_on(&status);
    bench.ends();
}

/// A frame that a flicker spoils, the judging one or a view, is taken again. The run is not held.
#[test]
fn one_dark_frame_holds_no_run() {
    for (at, policy) in [(0, "retries = 0, bead_gate = \"off\""), (6, POLICY)] {
        let bench = Bench::new(policy);
        bench.set(Optics::DimmedOnce(at, 8));
        bench.put(&["A01"]);
        bench.bring("A01");
        let status = bench.ends();
        let flags = status["run"]["results"][0]["flags"].as_array().unwrap();
        assert!(!flags.contains(&json!("bad_view")), "{status}");
        assert_eq!(bench.events("specimen.interrupted", "A01").len(), 0);
    }
}

/// A configured scale of 1.8 instead of 0.18 px per um gives a bore of 65 um, in which no larva fits.
#[test]
fn a_scale_that_the_capillary_contradicts_holds_the_run() {
    let scale = ["kx_px_per_um", "ky_px_per_um"].map(|key| (key, "0.18181818181818182", "1.8181818181818182"));
    let changes: Vec<(String, String)> = scale.iter().map(|(key, from, to)| (format!("{key} = {from}"), format!("{key} = {to}"))).collect();
    let changes: Vec<(&str, String)> = changes.iter().map(|(from, to)| (from.as_str(), to.clone())).collect();
    let bench = Bench::with(None, POLICY, &changes);
    bench.put(&["A01"]);
    bench.bring("A01");
    let status = bench.held("A01", "scale_off");
    let said = status["faults"][0]["message"].as_str().unwrap();
    assert!(said.contains("ky_px_per_um = 1.8") && said.contains("box_um"), "{said}");
}

/// The bore of 650 um then looks 1300 um wide. A box of 1000 um does not contradict this, only a configured bore does.
#[test]
fn a_lens_of_twice_the_scale_holds_the_run_where_the_bore_is_configured() {
    let bore = [("[rotation]", "bore_um = 650.0\n[rotation]".to_owned())];
    let bench = Bench::with(None, POLICY, &bore);
    bench.put(&["A01", "A02"]);
    bench.bring("A01");
    bench.daemon().wait("the second well", |s| s["plate"]["bring"] == "A02" && s["run"]["wells"]["pending"] == 1);
    bench.set(Optics::TwiceTheLens);
    bench.bring("A02");
    let status = bench.held("A02", "scale_off");
    let said = status["faults"][0]["message"].as_str().unwrap();
    let seen_um: f64 = said.split("bore measures ").nth(1).and_then(|s| s.split(' ').next()).unwrap().parse().unwrap();
    // The line of a wall is found to one px: 2 px of 236 are 11 um.
    assert!((seen_um - 1300.0).abs() < 15.0 && said.contains("optics.bore_um is 650 um") && said.contains("20 %"), "{said}");
    bench.set(Optics::Sound);
    bench.go_on(&status);
    bench.ends();
}
