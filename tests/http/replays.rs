//! Stored wells measured again by another method, as clients ask for it.

use crate::rig::Rig;
use carved::api::{RunStatus, WellCounts};
use carved_records::{Mode, RunOutcome, SpecimenOutcome};
use carved_store::{Claim, Recording, RecordingWriter, RunRecord, Store};
use serde_json::{Value, json};

/// Stores a run of a well with a recording that has no view, and one without a recording.
fn stored(rig: &Rig, id: &str, outcome: Option<RunOutcome>) {
    let (store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    let plan = json!({"plate_barcode": "P-1", "method": "m", "operator": "kim", "plate_map": [{"well": "A01"}, {"well": "A02"}]});
    let method = json!({"asd": 3, "order": "sequential", "epsilon": 0.05, "voxel_um": 20.0});
    let (plan, method) = (serde_json::from_value(plan).unwrap(), serde_json::from_value(method).unwrap());
    let mut record = RunRecord::new(id, plan, method, Mode::Simulated, None);
    let planned = record.plan.plate_map[0].clone();
    let of_rig = json!({
        "name": "rig", "pixel_format": "Mono8", "steps_per_revolution": [500, 1], "sense": 1,
        "camera": {"f": 60000.0, "kx": 0.18, "ky": 0.18, "ux": 8.0, "uy": 8.0, "width": 16, "height": 16},
        "rotation_identity": "axis", "camera_identity": "camera"
    });
    let recording = Recording::new(id, planned, Mode::Simulated, serde_json::from_value(of_rig).unwrap(), "m", record.method.clone());
    RecordingWriter::create(&store.run_folder(id).join("A01"), recording, None).unwrap().close().unwrap();
    if let Some(outcome) = outcome {
        record.wells.iter_mut().for_each(|well| well.end(SpecimenOutcome::Failed, Some("no light")));
        record.end(outcome);
    }
    store.save_run(&record).unwrap();
}

#[test]
fn what_cannot_be_measured_again_is_refused_with_the_way_out() {
    let rig = Rig::start();
    stored(&rig, "done", Some(RunOutcome::Failed));
    stored(&rig, "open", None);
    let put = |path: &str, body: Value| rig.put(&format!("/v1/runs/{path}"), &body.to_string());
    assert_eq!(rig.get("/v1/runs/nobody/replays").problem(), "unknown_run");
    assert_eq!(put("nobody/replays/standard", json!({})).problem(), "unknown_run");
    assert_eq!(put("open/replays/standard", json!({})).problem(), "run_open");
    for (name, body, pointer, words) in [
        (".m", json!({}), "", "no name for results"),
        ("other", json!({}), "", "there are: standard"),
        ("other", json!({"settings": "asd = "}), "/settings", "not the keys of a `[methods.NAME]` table"),
        ("other", json!({"settings": "asd = 21\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = -1.0"}), "/settings", "voxel_um"),
        ("standard", json!({"wells": ["A02"]}), "/wells", "A02"),
        ("standard", json!({"wells": ["H12"]}), "/wells", "H12"),
        ("standard", json!({}), "/wells", "no well of run done has numbers"),
    ] {
        let answer = put(&format!("done/replays/{name}"), body.clone());
        let error = &answer.json()["errors"][0];
        assert_eq!((answer.problem().as_str(), error["pointer"].as_str()), ("invalid_replay", Some(pointer)), "{body}");
        assert!(error["detail"].as_str().unwrap().contains(words), "{error}");
    }
    let run = json!({
        "id": "new", "external_id": null, "method": "m", "operator": "kim", "results": [], "started": "", "ended": null, "eta_s": null,
        "wells": WellCounts::default(), "outcome": null,
    });
    let run: RunStatus = serde_json::from_value(run).unwrap();
    rig.driver.publish(|status| status.run = Some(run));
    let answer = put("done/replays/standard", json!({"wells": ["A01"]}));
    assert!(answer.problem() == "run_under_way" && answer.text().contains("run new is under way"), "{}", answer.text());
    assert_eq!(rig.get("/v1/runs/done/replays").json(), json!({"progress": null, "results": []}));
}

#[test]
fn a_well_that_cannot_be_measured_is_named_with_the_reason() {
    let rig = Rig::start();
    stored(&rig, "done", Some(RunOutcome::Failed));
    let begun = rig.put(
        "/v1/runs/done/replays/few",
        &json!({"wells": ["A01"], "settings": "asd = 3\norder = \"sequential\"\nepsilon = 0.05\nvoxel_um = 20.0"}).to_string(),
    );
    assert_eq!(begun.status, 202, "{}", begun.text());
    let deadline = std::time::Instant::now() + crate::wire::PATIENCE;
    let ended = loop {
        let found = rig.get("/v1/runs/done/replays").json();
        if found["progress"]["done"] == 1 {
            break found;
        }
        assert!(std::time::Instant::now() < deadline, "{found}");
        std::thread::yield_now();
    };
    let progress = &ended["progress"];
    assert_eq!((&progress["name"], &progress["wells"], &progress["waits"]), (&json!("few"), &json!(1), &json!(false)));
    assert!(progress["failed"][0]["well"] == "A01" && progress["failed"][0]["reason"] != "", "{progress}");
    assert_eq!(ended["results"], json!([]));
}
