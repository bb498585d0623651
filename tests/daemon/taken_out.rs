//! A person reports a specimen as out while a driven sampler works. The specimen that comes next must not be measured under its well.
#![cfg(feature = "aravis")]

use crate::common::{Instrument, QUICK};
use hardware_sim::SamplerSettings;
use hardware_sim::sampler::Next;
use hardware_sim::scene::{Contents, Specimen};
use serde_json::{Value, json};

const SAMPLER: SamplerSettings = SamplerSettings { load_s: 20.0, eject_s: 1.5, bounce_s: 0.004 };

#[test]
fn what_comes_after_a_report_out_is_not_measured_under_that_well() {
    let trigger = [("driver = \"loader\"", "driver = \"trigger\"\ndone_output = true".to_owned())];
    let instrument = Instrument::filled_by(Some(SAMPLER), &QUICK, "bead_gate = \"off\"", &trigger, |scene| scene);
    let daemon = &instrument.daemon;
    let wells = ["A01", "A02", "A03"].map(|well| json!({"well": well, "specimen": "larva", "dpf": 4}));
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells});
    assert_eq!(daemon.put_run("r1", &plan), 201);
    let give = |seed| {
        let (larva, brought, taken) = (Specimen::larva(4, seed).unwrap(), instrument.scene.clone(), instrument.scene.clone());
        let bring = Box::new(move || brought.load(Some(larva.clone())).unwrap());
        let take_away = Box::new(move || taken.load(Contents::default()).unwrap());
        instrument.rig.sampler().unwrap().give(Next { bring, take_away });
    };
    let is_at = |s: &Value, well: &str, phase: &str| s["specimen"]["well"] == well && s["specimen"]["phase"] == phase;
    let out_in_phase = |well: &str, phase: &str| {
        daemon.wait("the phase", |s| is_at(s, well, phase));
        assert_eq!(daemon.put_unloaded("r1", well), 200);
        let status = daemon.wait("the hold", |s| s["state"] == "Held" || !s["run"]["outcome"].is_null());
        assert_eq!((&status["state"], &status["faults"]), (&json!("Held"), &json!([])), "{status}");
        assert_eq!(daemon.post("/v1/runs/r1/unhold"), 200);
    };
    out_in_phase("A01", "load");
    daemon.wait("the next load", |s| is_at(s, "A02", "load"));
    give(1);
    out_in_phase("A02", "revolve");
    daemon.wait("the last load", |s| is_at(s, "A03", "load"));
    give(2);
    let status = daemon.wait("the run's end", |s| !s["run"]["outcome"].is_null());
    let outcomes = [0, 1, 2].map(|at| status["run"]["results"][at]["outcome"].clone());
    assert_eq!(outcomes, ["interrupted", "interrupted", "succeeded"], "{status}");
    assert!(!instrument.data.join("runs/r1/A02/measurement.json").exists());
}

#[test]
fn a_specimen_that_was_on_its_way_when_the_run_was_aborted_keeps_the_next_run_out() {
    let trigger = [("driver = \"loader\"", "driver = \"trigger\"\ndone_output = true".to_owned())];
    let instrument = Instrument::filled_by(Some(SAMPLER), &QUICK, "bead_gate = \"off\"", &trigger, |scene| scene);
    let daemon = &instrument.daemon;
    let plan = |plate: &str| {
        let wells = json!([{"well": "A01", "specimen": "larva", "dpf": 4}]);
        json!({"plate_barcode": plate, "method": "standard", "operator": "test", "plate_map": wells})
    };
    assert_eq!(daemon.put_run("r1", &plan("P-1")), 201);
    daemon.wait("the load", |s| s["specimen"]["phase"] == "load");
    assert_eq!(daemon.post("/v1/runs/r1/abort"), 200);
    let status = daemon.wait("the run's end", |s| s["state"] == "Aborted");
    let plate = &status["plate"];
    assert_eq!((&status["ready"], &plate["removable"], &plate["take_out"]), (&json!(false), &json!(false), &json!("A01")), "{status}");
    assert_eq!(daemon.put_run("r2", &plan("P-2")), 409);
    assert_eq!(daemon.put_unloaded("r1", "A01"), 200);
    daemon.wait("an empty capillary", |s| s["ready"] == true);
    assert_eq!(daemon.put_run("r2", &plan("P-2")), 201);
}
