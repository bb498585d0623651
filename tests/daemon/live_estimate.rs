//! The live volume estimate in status and events while the capillary turns.
//!
//! ```text
//! test = plate-loader ── status, events ──► carved serve (child) ── pty, GigE ──► emulated rig with one larva
//! ```
#![cfg(feature = "aravis")]

use crate::common::{Daemon, Instrument, QUICK, Rate, json};
use hardware_sim::scene::Specimen;
use serde_json::{Value, json};
use std::cell::RefCell;
use std::io::{BufRead, BufReader};

/// With a rule for an early stop every estimate from view 18 on is made, even if there is no spare time.
const RATE: Rate = Rate { asd: 25, order: "coarse_to_fine", ..QUICK };
const ASD: u64 = RATE.asd as u64;
/// A promised error that no interval reaches, so the turn is complete.
const NEVER: &str = "enabled = true, min_views = 20, spread_percent = 10.0, promised_error_percent = 0.05";
const AT_ONCE: &str = "enabled = true, min_views = 20, spread_percent = 10.0, promised_error_percent = 5.0";

struct Turned {
    /// The `specimen` of each status during the revolution.
    seen: Vec<Value>,
    /// The last status.
    end: Value,
    /// The data of the events of the views, as a reader of the stream gets them.
    views: Vec<Value>,
    recording: Value,
    measurement: Value,
    truth_um3: f64,
}

fn turned(early_stop: &'static str) -> Turned {
    let Instrument { daemon, rig: _rig, scene, data, dir: _dir, .. } =
        Instrument::start(&Rate { early_stop, ..RATE }, "retries = 1", |scene| scene);
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": [{"well": "A01", "dpf": 4}]});
    assert_eq!(daemon.put_run("r1", &plan), 201);
    daemon.wait("the loader to be asked", |s| s["state"] == "Suspended");
    let larva = Specimen::larva(4, 11).unwrap();
    let truth_um3 = larva.truth().hull_volume_um3;
    scene.load(Some(larva)).unwrap();
    assert_eq!(daemon.put_loaded("r1", "A01"), 200);
    let seen = RefCell::new(Vec::new());
    let end = daemon.wait("the run's end", |s| {
        if s["specimen"]["phase"] == "revolve" {
            seen.borrow_mut().push(s["specimen"].clone());
        }
        !s["run"]["outcome"].is_null()
    });
    assert_eq!(end["run"]["outcome"], "succeeded", "{end}");
    let well = data.join("runs/r1/A01");
    Turned {
        seen: seen.into_inner(),
        end,
        views: views(&daemon),
        recording: json(&well.join("recording.json")),
        measurement: json(&well.join("measurement.json"))["measurement"].clone(),
        truth_um3,
    }
}

/// Reads the stream of events until the run ends.
fn views(daemon: &Daemon) -> Vec<Value> {
    let agent: ureq::Agent = ureq::Agent::config_builder().build().into();
    let stream = agent.get(format!("{}/v1/events", daemon.url)).header("Last-Event-ID", "0").call().unwrap();
    let lines = BufReader::new(stream.into_body().into_reader()).lines().map(|line| line.unwrap());
    let events = lines.filter_map(|line| serde_json::from_str::<Value>(line.strip_prefix("data:")?).ok());
    let until_end = events.take_while(|e| e["kind"] != "run.ended");
    until_end.filter(|e| e["kind"] == "view.taken" && e["data"]["closure"] == false).map(|e| e["data"].clone()).collect()
}

fn number(of: &Value, key: &str) -> f64 {
    of[key].as_f64().unwrap_or_else(|| panic!("no {key} in {of}"))
}

const KEYS: [&str; 4] = ["volume_um3", "volume_sd_um3", "volume_views", "converged"];

#[test]
fn a_volume_is_shown_with_its_spread_while_the_capillary_turns_and_is_the_measured_one_in_the_end() {
    let Turned { seen, end, views, recording, measurement, truth_um3 } = turned(NEVER);
    assert_eq!(views.len() as u64, ASD);
    assert!(recording["ended_after_views"].is_null(), "nothing is known to 0.05 %: {}", recording["ended_after_views"]);
    // Six views are too few to determine the axis.
    for view in &views[..6] {
        assert!(KEYS.iter().all(|key| view[key].is_null()) && view["hull_volume_um3"].is_f64(), "{view}");
    }
    let final_um3 = number(&measurement, "volume_um3");
    for (taken, view) in (1..).zip(&views).skip(17) {
        assert_eq!((view["volume_views"].as_u64(), view["converged"].as_bool()), (Some(taken), Some(false)), "{view}");
        let (volume, sd) = (number(view, "volume_um3"), number(view, "volume_sd_um3"));
        assert!(0.001 < sd / volume && sd / volume < 0.03, "{view}");
        // The hull of so few views is 6 % too large. The estimate is right at once and does not sink towards the final volume.
        assert!((volume - final_um3).abs() < (0.02 * final_um3).min(4.0 * sd), "{view}, in the end {final_um3}");
        assert!((volume / truth_um3 - 1.0).abs() < 0.04, "{view}, truly {truth_um3}");
    }
    assert_eq!(views[ASD as usize - 1]["volume_um3"], measurement["volume_um3"], "of all views, to the last bit");
    assert_eq!(views[ASD as usize - 1]["volume_sd_um3"], measurement["volume_sd_um3"]);

    // On a slow computer the first estimate may be ready after the last poll of the turn. The status at the end always has one.
    assert!(seen.iter().any(|s| s["volume_um3"].is_null()), "{seen:?}");
    for specimen in &seen {
        let nothing = specimen["volume_um3"].is_null();
        assert!(KEYS.iter().all(|key| specimen[key].is_null() == nothing), "{specimen}");
        assert_eq!(specimen["hull_volumes_um3"].as_array().unwrap().len() as u64, specimen["view"].as_u64().unwrap());
    }
    // The events agree with the status.
    for specimen in seen.iter().filter(|s| !s["volume_um3"].is_null()) {
        assert!(views.iter().any(|view| KEYS.iter().all(|key| view[key] == specimen[key])), "{specimen}");
    }
    let [specimen, well] = [&end["specimen"], &end["run"]["results"][0]];
    for key in ["volume_um3", "volume_sd_um3"] {
        assert_eq!((&specimen[key], &well[key]), (&measurement[key], &measurement[key]), "{end}");
    }
    assert_eq!((&specimen["volume_views"], &specimen["converged"]), (&json!(ASD), &json!(false)), "{end}");
}

#[test]
fn a_turn_has_converged_where_its_rule_ends_it() {
    let Turned { end, views, recording, measurement, .. } = turned(AT_ONCE);
    let converged: Vec<bool> = views.iter().filter_map(|view| view["converged"].as_bool()).collect();
    let first = views.iter().position(|view| view["converged"] == true).unwrap_or_else(|| panic!("never: {views:?}"));
    assert!(first + 1 >= 20 && !converged[0], "not before 20 views: {views:?}");
    assert_eq!(end["specimen"]["converged"], true, "{end}");
    // Views that were under way when the rule was met are measured too.
    let taken = views.len() as u64;
    let ended = if taken < ASD { json!(taken) } else { Value::Null };
    assert_eq!((&recording["ended_after_views"], &measurement["views"]), (&ended, &json!(taken)));
}
