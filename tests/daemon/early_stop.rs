//! A turn that ends early: the axis stops, the closure view is taken, the outcome has the number of views and of planned views, and the
//! recording reproduces the numbers.
#![cfg(feature = "aravis")]

use crate::common::bench::{Bench, larva};
use crate::common::{PATIENCE, json, run, stderr};
use hardware_sim::scene::{Exposure, Scene};
use hardware_sim::{PixelFormat, Pixels, Sight};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::sync::{Arc, Condvar, Mutex};
use std::time::Instant;

/// An odd number, so that no two views are mirror images.
const PLANNED: usize = 45;
/// 17 views give a slice its eight harmonics.
const LEAST: usize = 17;

/// The scene, slowed down to the speed of the carving: a view is shown only after the last view but one was carved. The early stop thus
/// comes in time on any computer.
struct Paced {
    scene: Arc<Scene>,
    pace: Mutex<Pace>,
    carved: Condvar,
}

#[derive(Default)]
struct Pace {
    /// Angles that were shown. A lost frame that is taken again adds no angle.
    angles: BTreeSet<i64>,
    carved: usize,
    is_over: bool,
}

impl Sight for Paced {
    fn size(&self) -> (u32, u32) {
        self.scene.size()
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        let mut pace = self.pace.lock().unwrap();
        pace.angles.insert((exposure.angle_rad * 1e6).round() as i64);
        let shown = pace.angles.len();
        // The first picture is the one that judges the well.
        let waits = |pace: &mut Pace| !pace.is_over && pace.carved + 2 < shown;
        drop(self.carved.wait_timeout_while(pace, PATIENCE, waits).unwrap());
        self.scene.look(exposure, format)
    }
}

#[test]
fn a_turn_ends_as_soon_as_its_volume_is_known_and_says_so() {
    let mut sight = None;
    let bench = Bench::seen_by(|scene| {
        let paced = Arc::new(Paced { scene: scene.clone(), pace: Mutex::default(), carved: Condvar::new() });
        sight = Some(paced.clone());
        paced
    });
    let sight = sight.unwrap();
    // Loose limits, so that the rule fires as soon as it may. Other tests check the numbers of the rule.
    let early = "asd = 45\nearly_stop = { enabled = true, min_views = 17, last = 2, spread_percent = 10.0, promised_error_percent = 10.0 }";
    let changes = [
        ("asd = 21", early.to_owned()),
        ("order = \"sequential\"", "order = \"coarse_to_fine\"".to_owned()),
        ("voxel_um = 6.93", "voxel_um = 17.1".to_owned()),
    ];
    let daemon = bench.serve(&changes, "");
    let status = std::thread::scope(|scope| {
        scope.spawn(|| {
            let (began, mut revision) = (Instant::now(), 0);
            while began.elapsed() < PATIENCE {
                let status = daemon.get(&format!("/v1/status?wait=25&after={revision}"));
                revision = status["revision"].as_u64().unwrap();
                let mut pace = sight.pace.lock().unwrap();
                pace.carved = status["specimen"]["view"].as_u64().unwrap_or(0) as usize;
                pace.is_over = !status["run"]["outcome"].is_null();
                sight.carved.notify_all();
                if pace.is_over {
                    break;
                }
            }
        });
        bench.measured(&daemon, "r1", "standard", &[larva("A01")])
    });
    let well = &status["run"]["results"][0];
    assert_eq!(well["outcome"], "succeeded", "{status}");
    let a01 = bench.data().join("runs/r1/A01");
    let recording = json(&a01.join("recording.json"));
    let ledger = recording["ledger"].as_array().unwrap();
    let views = ledger.iter().filter(|e| e["closure"] == false).count();
    // One more view is under way when the rule decides.
    assert!((LEAST..=LEAST + 3).contains(&views), "{views} views");
    assert_eq!((&recording["ended_after_views"], &recording["method"]["asd"]), (&json!(views), &json!(PLANNED)));
    assert_eq!((&well["views"], &well["views_planned"]), (&json!(views), &json!(PLANNED)), "{well}");

    // The axis made no further stop, and the closure view is one turn after the first.
    let [first, last] = [&ledger[0], ledger.last().unwrap()];
    assert_eq!((&last["closure"], ledger.len()), (&json!(true), views + 1));
    assert_eq!(last["achieved_steps"].as_i64().unwrap() - first["achieved_steps"].as_i64().unwrap(), 500);
    assert_eq!(sight.pace.lock().unwrap().angles.len(), views + 1, "where pictures were taken; the look is one of the first view's place");

    let stored = json(&a01.join("measurement.json"));
    assert_eq!((&stored["measurement"]["planned_views"], stored["closure"].is_null()), (&json!(views), false), "{}", stored["closure"]);
    let output = run(&["measure", a01.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(serde_json::from_slice::<Value>(&output.stdout).unwrap()["stored"], "identical");
}
