//! `carved serve` on an emulated rig in the test's own process, and the test as its plate-loader.
//!
//! ```text
//! test = plate-loader ── HTTP ──► carved serve (child) ── pty, GigE ──► emulated rig
//! ```

use super::{Daemon, configured, patient, port, small_frames, small_scene};
use hardware_sim::scene::{Contents, Scene, Specimen};
use hardware_sim::{Rig, RigSettings, Sight};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const TIME_SCALE: f64 = 10.0;

/// An emulated rig on which several daemons are started, one after the other.
pub struct Bench {
    pub rig: Rig,
    pub scene: Arc<Scene>,
    dir: tempfile::TempDir,
}

impl Bench {
    /// As `new`, with a camera that sees what `sight` makes of the scene.
    pub fn seen_by<S: Sight + 'static>(sight: impl FnOnce(&Arc<Scene>) -> Arc<S>) -> Self {
        let scene = small_scene();
        let settings = RigSettings { time_scale: TIME_SCALE, ..RigSettings::default() };
        let rig = Rig::start(settings, sight(&scene)).unwrap();
        Self { rig, scene, dir: tempfile::tempdir().unwrap() }
    }

    pub fn new() -> Self {
        Self::seen_by(Arc::clone)
    }

    /// The data folder of the daemons.
    pub fn data(&self) -> PathBuf {
        self.dir.path().join("data")
    }

    pub fn folder(&self) -> &Path {
        self.dir.path()
    }

    /// Starts a daemon with the shipped configuration, with `changes` in it and `more` appended.
    pub fn serve(&self, changes: &[(&str, String)], more: &str) -> Daemon {
        let usual = [port(&self.rig), ("settle_ms = 50", format!("settle_ms = {:.0}", 50.0 / TIME_SCALE))];
        let changes = [&usual[..], &small_frames(), &patient(), changes].concat();
        let (config, data) = configured("vast-grbl.toml", self.folder(), &self.rig, &changes);
        std::fs::write(&config, std::fs::read_to_string(&config).unwrap() + more).unwrap();
        Daemon::serve(&config, &data)
    }

    /// Measures a plate of these specimens, loaded well by well, until the run ends. The last specimen is taken out. Returns the last
    /// status.
    pub fn measured(&self, daemon: &Daemon, run: &str, method: &str, specimens: &[(&str, Value, Specimen)]) -> Value {
        let wells: Vec<&Value> = specimens.iter().map(|(_, planned, _)| planned).collect();
        let (code, said) = daemon.send("PUT", &format!("/v1/runs/{run}"), &plan(method, &json!(wells)));
        assert_eq!(code, 201, "{said}");
        for (well, _, specimen) in specimens {
            let asked = |s: &Value| s["state"] == "Suspended" && s["plate"]["needs"].as_str().is_some_and(|n| n.contains(well));
            daemon.wait("the loader to be asked", asked);
            self.scene.load(Contents::from(specimen.clone())).unwrap();
            assert_eq!(daemon.put_loaded(run, well), 200);
        }
        let over = |s: &Value| s["run"]["id"] == run && !s["run"]["outcome"].is_null();
        let status = daemon.wait("the run's end", over);
        assert_eq!(daemon.put_unloaded(run, specimens.last().unwrap().0), 200);
        status
    }
}

pub fn plan(method: &str, wells: &Value) -> Value {
    json!({"plate_barcode": "P-1", "method": method, "operator": "test", "plate_map": wells})
}

/// A bead, as the plan's entry and as a specimen.
pub fn bead(well: &str, diameter_um: f64) -> (&str, Value, Specimen) {
    (well, json!({"well": well, "specimen": "bead"}), Specimen::bead(diameter_um).unwrap())
}

/// A larva of 4 dpf; nothing but its age is known. Each column of the plate has another one.
pub fn larva(well: &str) -> (&str, Value, Specimen) {
    let seed = well[1..].parse().unwrap();
    (well, json!({"well": well, "specimen": "larva", "dpf": 4}), Specimen::larva(4, seed).unwrap())
}
