//! Results of past runs, as clients read them.

use crate::client::{carved, text, url};
use crate::gates;
use crate::rig::Rig;
use carved_core::flag::Flag;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_records::{EventData, Mode, RunOutcome, SpecimenOutcome};
use carved_store::{Claim, MEASUREMENT, Recording, RecordingWriter, RunRecord, Store, set_aside};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::Read;

fn record(id: &str, started: &str, barcode: &str) -> RunRecord {
    let plan = json!({"plate_barcode": barcode, "method": "m", "operator": "kim", "plate_map": [{"well": "A01", "dpf": 3, "compound": "DMSO"}, {"well": "A02"}]});
    let method = json!({"asd": 3, "order": "sequential", "epsilon": 0.05, "voxel_um": 20.0});
    let (plan, method) = (serde_json::from_value(plan).unwrap(), serde_json::from_value(method).unwrap());
    let mut record = RunRecord::new(id, plan, method, Mode::Simulated, None);
    record.started = started.into();
    record
}

/// Stores a recording with two views, the second of which was taken twice, a mesh and numbers. Returns the mesh and the frames of the
/// views.
fn recorded(store: &Store, run: &RunRecord, well: usize) -> (Vec<u8>, [Vec<u8>; 2]) {
    let planned = run.plan.plate_map[well].clone();
    let folder = store.run_folder(&run.id).join(&planned.well);
    let rig = json!({
        "name": "rig", "pixel_format": "Mono8", "steps_per_revolution": [500, 1], "sense": 1,
        "camera": {"f": 60000.0, "kx": 0.18, "ky": 0.18, "ux": 8.0, "uy": 8.0, "width": 16, "height": 16},
        "rotation_identity": "axis", "camera_identity": "camera"
    });
    let recording = Recording::new(&run.id, planned, Mode::Simulated, serde_json::from_value(rig).unwrap(), "m", run.method.clone());
    let mut writer = RecordingWriter::create(&folder, recording, None).unwrap();
    for (view, retake) in [(0u32, 0), (1, 0), (1, 1)] {
        let frame = RawFrame::new(16, 16, PixelFormat::Mono8, vec![(view + retake) as u8 + 7; 256]).unwrap();
        let sha256: String = Sha256::digest(frame.bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        let entry = json!({"view": view, "commanded_steps": 0, "achieved_steps": 0, "epoch": 1, "omega": f64::from(view), "moved_ms": 0.0,
            "settle_ms": 0.0, "grab_ms": 0.0, "frame_id": view, "attempts": 1, "sha256": sha256, "closure": false, "retake": retake});
        writer.add_view(serde_json::from_value(entry).unwrap(), &frame).unwrap();
    }
    let mesh = format!("ply\n{} {well}\n", run.id).into_bytes();
    writer.add_detection(&RawFrame::new(16, 16, PixelFormat::Mono8, vec![3; 256]).unwrap(), None).unwrap();
    writer.add_file("mesh.ply", &mesh).unwrap();
    writer.add_json(MEASUREMENT, &json!({"mode": "simulated", "measurement": {"volume_um3": 2.5e8}, "flags": ["moved"]})).unwrap();
    writer.close().unwrap();
    (mesh, ["view_000.png", "view_001.retake-1.png"].map(|name| std::fs::read(folder.join("frames").join(name)).unwrap()))
}

fn ids(page: &Value) -> Vec<&str> {
    page["runs"].as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap()).collect()
}

#[test]
fn runs_are_listed_newest_first_page_by_page_and_filtered() {
    let rig = Rig::start();
    assert_eq!(rig.get("/v1/runs").problem(), "index", "a folder without an index");
    let (store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    assert_eq!(rig.get("/v1/runs").json(), json!({"runs": [], "next": null}));
    // Two runs of one moment, whose times would sort wrongly as text.
    let runs =
        [("a", "2026-01-01T00:00:00.5Z"), ("b", "2026-01-01T00:00:00Z"), ("c-1", "2026-01-01T00:00:00.5Z"), ("d", "2026-02-01T00:00:00Z")];
    for (id, started) in runs {
        let mut run = record(id, started, if id == "b" { "P-2" } else { "P-1" });
        run.wells[0].end(SpecimenOutcome::Succeeded, None);
        if id != "d" {
            run.wells[1].end(SpecimenOutcome::Skipped, Some("empty"));
            run.end(RunOutcome::Succeeded);
        }
        store.save_run(&run).unwrap();
    }
    let all = rig.get("/v1/runs").json();
    assert_eq!((ids(&all), &all["next"]), (vec!["d", "c-1", "a", "b"], &Value::Null));
    let first = &all["runs"][0];
    assert_eq!((&first["outcome"], &first["wells"]["pending"], &first["wells"]["succeeded"]), (&Value::Null, &json!(1), &json!(1)));
    let mut seen = Vec::new();
    let mut path = "/v1/runs?limit=1".to_owned();
    loop {
        let page = rig.get(&path).json();
        seen.extend(ids(&page).into_iter().map(str::to_owned));
        let Some(next) = page["next"].as_str() else { break };
        path = format!("/v1/runs?limit=1&cursor={next}");
    }
    assert_eq!(seen, ["d", "c-1", "a", "b"]);
    for (query, expected) in [
        ("plate_barcode=P-2", vec!["b"]),
        ("outcome=open", vec!["d"]),
        ("outcome=succeeded&limit=2", vec!["c-1", "a"]),
        ("mode=hardware", vec![]),
        ("operator=kim'%20OR%201=1--", vec![]),
    ] {
        assert_eq!(ids(&rig.get(&format!("/v1/runs?{query}")).json()), expected, "{query}");
    }
    for bad in ["limit=0", "limit=201", "limit=x", "cursor=d", "cursor=x-d", "nonsense=1"] {
        let answer = rig.get(&format!("/v1/runs?{bad}"));
        assert_eq!((answer.status, answer.problem().as_str()), (400, "bad_query"), "{bad}");
    }
}

#[test]
fn a_run_and_a_specimen_are_read_whole_with_links_that_lead_to_the_files() {
    let rig = Rig::start();
    let (store, mut journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    // Events of the well's first attempt, of another well, and of the newest attempt, whose closure view is not part of the model.
    for (well, kind, data) in [
        ("A01", "view.taken", json!({"hull_volume_um3": 9e8})),
        ("A01", "specimen.phase", json!({"phase": "position"})),
        ("A01", "view.taken", json!({"hull_volume_um3": 5e8})),
        ("A02", "view.taken", json!({"hull_volume_um3": 7e8})),
        ("A01", "view.taken", json!({"hull_volume_um3": 3e8})),
        ("A01", "view.taken", json!({"hull_volume_um3": null, "closure": true})),
    ] {
        journal.append(Some("r1"), Some(well), EventData::of(kind, data)).unwrap();
    }
    let mut run = record("r1", "2026-01-01T00:00:00Z", "P-1");
    let (earlier, _) = recorded(&store, &run, 0);
    store.save_run(&run).unwrap();
    set_aside(&store.run_folder("r1"), "A01").unwrap();
    std::fs::write(store.run_folder("r1").join("A01.attempt-1/mesh.ply.txt"), "no file of ours").unwrap();
    let (mesh, [first, retaken]) = recorded(&store, &run, 0);
    run.wells[0].end(SpecimenOutcome::Succeeded, None);
    run.end(RunOutcome::Partial);
    store.save_run(&run).unwrap();

    let answer = rig.get("/v1/runs/r1");
    let detail = answer.json();
    assert_eq!((&detail["outcome"], &detail["results"][0]["outcome"]), (&json!("partial"), &json!("succeeded")));
    assert_eq!(detail["method_settings"]["asd"], 3);
    assert_eq!(detail["plan"]["plate_map"][0], json!({"well": "A01", "specimen": "larva", "dpf": 3.0, "compound": "DMSO"}));
    let tag = answer.header("etag").unwrap().to_owned();
    assert_eq!(rig.send("GET", "/v1/runs/r1", &[("If-None-Match", &tag)], "").status, 304);

    let path = detail["specimens"][0].as_str().unwrap();
    let specimen = rig.get(path).json();
    assert_eq!(specimen["measurement"]["flags"], json!(["moved"]));
    assert_eq!((&specimen["attempt"], &specimen["earlier_attempts"]), (&json!(0), &json!([1])));
    assert_eq!(specimen["hull_volumes_um3"], json!([5e8, 3e8]));
    assert_eq!(specimen["links"]["mesh_glb"], Value::Null, "there is none");
    assert_eq!(specimen["links"]["views"].as_array().unwrap().len(), 2);
    let link = |name: &str| specimen["links"][name].as_str().unwrap().to_owned();
    let judged = std::fs::read(store.run_folder("r1").join("A01/frames/detect.png")).unwrap();
    for (path, content_type, bytes) in [
        (link("detection"), "image/png", &judged),
        (link("mesh_ply"), "application/octet-stream", &mesh),
        (specimen["links"]["views"][0].as_str().unwrap().to_owned(), "image/png", &first),
        (specimen["links"]["views"][1].as_str().unwrap().to_owned(), "image/png", &retaken),
    ] {
        let answer = rig.get(&path);
        assert_eq!((answer.status, answer.header("content-type"), &answer.body), (200, Some(content_type), bytes), "{path}");
        let tag = answer.header("etag").unwrap().to_owned();
        let again = rig.send("GET", &path, &[("If-None-Match", &tag)], "");
        assert_eq!((again.status, again.body.len(), again.header("etag")), (304, 0, Some(tag.as_str())), "{path}");
    }
    let before = rig.get(&format!("{path}?attempt=1")).json();
    assert_eq!((&before["result"], &before["attempt"], &before["hull_volumes_um3"]), (&Value::Null, &json!(1), &json!([])));
    assert_eq!(rig.get(before["links"]["mesh_ply"].as_str().unwrap()).body, earlier);

    // A file that differs from its recorded sum is not served.
    std::fs::write(store.run_folder("r1").join("A01/mesh.ply"), "altered").unwrap();
    let altered = rig.get(&link("mesh_ply"));
    assert_eq!((altered.status, altered.problem().as_str()), (500, "altered"));
    std::fs::write(store.run_folder("r1").join("run.json"), r#"{"schema": "carved.run/99"}"#).unwrap();
    let newer = rig.get("/v1/runs/r1");
    assert_eq!((newer.status, newer.problem().as_str()), (500, "newer_format"));
}

#[test]
fn no_name_leads_out_of_the_run_folders() {
    let rig = Rig::start();
    let (store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    let run = record("r1", "2026-01-01T00:00:00Z", "P-1");
    recorded(&store, &run, 0);
    store.save_run(&run).unwrap();
    std::fs::write(rig.data.path().join("run.json"), "{}").unwrap();
    for path in [
        "/v1/runs/..",
        "/v1/runs/%2e%2e",
        "/v1/runs/..%2fr1",
        "/v1/runs/.hidden",
        "/v1/runs/r1%00",
        "/v1/runs/none",
        "/v1/runs/r1/specimens/A02",
        "/v1/runs/r1/specimens/..",
        "/v1/runs/r1/specimens/A01%2fframes",
        "/v1/runs/r1/specimens/A01.attempt-1",
        "/v1/runs/r1/specimens/A01?attempt=7",
        "/v1/runs/r1/specimens/A01/mesh.glb",
        "/v1/runs/%2e%2e/specimens/A01/mesh.ply",
        "/v1/runs/r1/specimens/A01/views/9.png",
        "/v1/runs/r1/specimens/A01/views/..%2f..%2frecording.json",
        "/v1/runs/r1/specimens/A01/views/+1.png",
        "/v1/runs/r1/specimens/A01/views/9.jpg",
        "/v1/runs/r1/specimens/A01/views/0.gif",
        "/v1/runs/r1/specimens/A01/views/0",
        "/v1/runs/none/files.tar",
        "/v1/runs/%2e%2e/files.tar",
        "/v1/runs/none/events",
        "/v1/runs/r1/specimens/A01/profiles/0.png",
    ] {
        let answer = rig.get(path);
        assert_eq!(answer.status, 404, "{path}");
        assert!(!answer.problem().is_empty(), "{path}");
    }
    assert_eq!(rig.get("/v1/runs/r1/specimens/A01/views/0.png").status, 200);
    assert_eq!(rig.get("/v1/runs/r1/specimens/A01?attempt=x").status, 400);
}

#[test]
fn a_frame_is_shown_as_a_picture_of_the_width_that_is_asked_for() {
    let rig = Rig::start();
    let (store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    let run = record("r1", "2026-01-01T00:00:00Z", "P-1");
    recorded(&store, &run, 0);
    store.save_run(&run).unwrap();
    let views = "/v1/runs/r1/specimens/A01/views";
    // The frames have 16 x 16 px; they are not enlarged.
    for path in ["0.jpg", "1.jpg?width=4096", "detection.jpg?width=32"] {
        let answer = rig.get(&format!("{views}/{path}"));
        assert_eq!((answer.status, answer.header("content-type")), (200, Some("image/jpeg")), "{path}");
        assert_eq!(answer.body[..2], [0xff, 0xd8], "{path}: a JPEG begins so");
        let tag = answer.header("etag").unwrap().to_owned();
        let again = rig.send("GET", &format!("{views}/{path}"), &[("If-None-Match", &tag)], "");
        assert_eq!((again.status, again.body.len()), (304, 0), "{path}");
    }
    let tags: Vec<_> =
        ["0.jpg", "0.jpg?width=40", "0.png"].map(|p| rig.get(&format!("{views}/{p}")).header("etag").unwrap().to_owned()).into();
    assert!(tags[0] != tags[1] && tags[1] != tags[2] && tags[0] != tags[2], "{tags:?}: each picture has a tag of its own");
    for path in ["0.jpg?width=31", "0.jpg?width=9000", "0.jpg?width=x", "0.png?width=100"] {
        let answer = rig.get(&format!("{views}/{path}"));
        assert_eq!((answer.status, answer.problem().as_str()), (400, "bad_query"), "{path}");
    }
    let frame = store.run_folder("r1").join("A01/frames/view_000.png");
    std::fs::write(frame, "altered").unwrap();
    assert_eq!(rig.get(&format!("{views}/0.jpg")).problem(), "altered");
}

/// The files of a tar archive by their names.
fn unpacked(tar: &[u8]) -> BTreeMap<String, Vec<u8>> {
    let mut archive = tar::Archive::new(tar);
    let entries = archive.entries().unwrap().map(|entry| {
        let mut entry = entry.unwrap();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        (entry.path().unwrap().display().to_string(), bytes)
    });
    entries.collect()
}

#[test]
fn a_run_is_downloaded_whole_with_the_hashes_that_were_recorded() {
    let rig = Rig::start();
    let (store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    let mut run = record("r1", "2026-01-01T00:00:00Z", "P-1");
    let (mesh, [first, _]) = recorded(&store, &run, 0);
    store.save_run(&run).unwrap();
    set_aside(&store.run_folder("r1"), "A01").unwrap();
    recorded(&store, &run, 0);
    let open = rig.get("/v1/runs/r1/files.tar");
    assert_eq!((open.status, open.problem().as_str()), (409, "run_open"));
    run.end(RunOutcome::Partial);
    store.save_run(&run).unwrap();

    let answer = rig.get("/v1/runs/r1/files.tar");
    assert_eq!((answer.status, answer.header("content-type")), (200, Some("application/x-tar")));
    assert_eq!(answer.header("content-disposition"), Some("attachment; filename=\"r1.tar\""));
    let files = unpacked(&answer.body);
    assert_eq!(files["r1/A01/mesh.ply"], mesh);
    assert_eq!(files["r1/A01.attempt-1/frames/view_000.png"], first);
    let sums = String::from_utf8(files["r1/SHA256SUMS"].clone()).unwrap();
    let listed: BTreeMap<&str, &str> = sums.lines().filter_map(|line| line.split_once("  ")).map(|(hash, name)| (name, hash)).collect();
    assert_eq!(listed.len() + 1, files.len(), "every file but the list itself");
    let hash = |bytes: &[u8]| Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    for (name, bytes) in &files {
        let name = name.strip_prefix("r1/").unwrap();
        assert!(name == "SHA256SUMS" || listed[name] == hash(bytes), "{name}");
    }

    // A file that was altered after it was recorded is sent with the hash that was recorded, so that the reader sees the difference.
    std::fs::write(store.run_folder("r1").join("A01/mesh.ply"), "altered").unwrap();
    let files = unpacked(&rig.get("/v1/runs/r1/files.tar").body);
    let sums = String::from_utf8(files["r1/SHA256SUMS"].clone()).unwrap();
    assert_eq!(files["r1/A01/mesh.ply"], b"altered");
    assert!(sums.contains(&format!("{}  A01/mesh.ply\n", hash(&mesh))), "{sums}");
}

#[test]
fn the_copies_of_a_run_are_named_with_it() {
    let rig = Rig::start();
    let (store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    let mut run = record("r1", "2026-01-01T00:00:00Z", "P-1");
    recorded(&store, &run, 0);
    run.end(RunOutcome::Partial);
    store.save_run(&run).unwrap();
    assert_eq!(rig.get("/v1/runs/r1").json()["copies"], json!([]));
    let to = tempfile::tempdir().unwrap();
    let receipt = carved_store::archive(&store.run_folder("r1"), to.path(), carved_store::Packing::Files).unwrap();
    let copies = rig.get("/v1/runs/r1").json()["copies"].clone();
    let destination = to.path().canonicalize().unwrap().join("r1");
    let expected = json!([{
        "archived": receipt.archived, "destination": destination.display().to_string(),
        "bytes": receipt.bytes, "files": receipt.files.len()
    }]);
    assert_eq!(copies, expected);
    // A receipt that cannot be read takes nothing else of the run away.
    std::fs::write(store.run_folder("r1").join("archives/9.json"), "{").unwrap();
    assert_eq!(rig.get("/v1/runs/r1").json()["copies"], json!([]));
}

#[test]
fn bead_gates_are_listed_with_the_limits_that_their_history_gives() {
    let rig = Rig::start();
    let (_store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    assert_eq!(rig.get("/v1/bead-gates").json(), json!({"gates": []}));
    let folder = rig.data.path().join("calibrations");
    gates::keep(&folder);
    std::fs::write(folder.join("gate-broken.json"), "{").unwrap();
    let listed = rig.get("/v1/bead-gates").json();
    let days: Vec<_> = listed["gates"].as_array().unwrap().iter().map(|gate| gate["measured"].as_str().unwrap()[..10].to_owned()).collect();
    assert_eq!(days, (1..=7).map(|day| format!("2026-01-{day:02}")).collect::<Vec<_>>());
    let diameter = |day: usize| listed["gates"][day - 1]["quantities"][0].clone();
    assert_eq!((&diameter(1)["name"], &diameter(1)["mean"]), (&json!("diameter_um"), &json!(502.0)));
    assert_eq!((&diameter(1)["upper_limit"], &diameter(1)["jumped"]), (&Value::Null, &json!(false)), "five earlier gates are needed");
    let last = diameter(7);
    let upper = last["upper_limit"].as_f64().unwrap();
    assert!(last["mean"].as_f64().unwrap() > upper && last["jumped"] == true, "{last}");
    assert!((last["history_mean"].as_f64().unwrap() - 501.5).abs() < 1e-9, "{last}");
    assert_eq!(listed["gates"][6]["quantities"].as_array().unwrap().len(), 5, "no residual was measured");
}

#[test]
fn the_events_of_a_run_are_read_in_parts_without_its_views() {
    let rig = Rig::start();
    let (store, mut journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    store.save_run(&record("r1", "2026-01-01T00:00:00Z", "P-1")).unwrap();
    for i in 0..1003 {
        journal
            .append(Some("r1"), Some("A01"), EventData::of("specimen.phase", json!({"phase": "load", "in_capillary": i % 2 == 0})))
            .unwrap();
        if i % 100 == 0 {
            journal.append(Some("r1"), Some("A01"), EventData::of("view.taken", json!({}))).unwrap();
            journal.append(Some("r2"), None, EventData::of("run.started", Value::Null)).unwrap();
        }
    }
    let first = rig.get("/v1/runs/r1/events").json();
    let events = first["events"].as_array().unwrap();
    assert_eq!(events.len(), 1000);
    assert!(events.iter().all(|event| event["kind"] == "specimen.phase" && event["run"] == "r1"), "{first}");
    let next = first["next"].as_u64().unwrap();
    assert_eq!(next, events[999]["id"].as_u64().unwrap());
    let rest = rig.get(&format!("/v1/runs/r1/events?after={next}")).json();
    assert_eq!((rest["events"].as_array().unwrap().len(), &rest["next"]), (3, &Value::Null));
    assert_eq!(rig.get("/v1/runs/r1/events?after=-1").problem(), "bad_query");
}

/// The store reports a run that ended before another run or before a restart.
#[test]
fn a_watcher_hears_of_a_run_that_the_status_has_no_more() {
    let rig = Rig::start();
    let (store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    let mut run = record("r1", "2026-01-01T00:00:00Z", "P-1");
    store.save_run(&run).unwrap();
    let watch = |run| carved(&url(&rig), &["run", "watch", run]);
    let open = watch("r1");
    assert_eq!(open.status.code(), Some(1));
    assert!(text(&open.stderr).contains("no outcome"), "{}", text(&open.stderr));
    run.wells[0].end(SpecimenOutcome::Skipped, Some("empty"));
    run.wells[1].end(SpecimenOutcome::Failed, Some("no light"));
    run.end(RunOutcome::Partial);
    store.save_run(&run).unwrap();
    let ended = watch("r1");
    let said = text(&ended.stdout);
    assert_eq!(ended.status.code(), Some(4), "{said} {}", text(&ended.stderr));
    assert!(said.contains("A01  larva of 3 dpf: skipped, empty\n") && said.contains("run r1 (simulated) has ended: partial"), "{said}");
    let unknown = watch("r9");
    assert_eq!(unknown.status.code(), Some(1));
    assert!(text(&unknown.stderr).contains("unknown_run"), "{}", text(&unknown.stderr));
}

#[test]
fn tables_and_statistics_of_runs_are_read_as_csv_and_json() {
    let rig = Rig::start();
    let (store, _journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    for (id, barcode) in [("r1", "P-1"), ("r2", "P-2")] {
        let mut run = record(id, "2026-01-01T00:00:00Z", barcode);
        recorded(&store, &run, 0);
        run.wells[0].end(SpecimenOutcome::Succeeded, None);
        run.wells[0].flags = vec![Flag::Moved.into()];
        run.wells[1].end(SpecimenOutcome::Skipped, Some("empty"));
        run.end(RunOutcome::Succeeded);
        store.save_run(&run).unwrap();
    }
    let rows = |path: &str| {
        let answer = rig.get(path);
        assert_eq!((answer.status, answer.header("content-type")), (200, Some("text/csv; charset=utf-8")), "{path}");
        let mut reader = csv::Reader::from_reader(answer.body.as_slice());
        let headings = reader.headers().unwrap().clone();
        let of = |row: csv::StringRecord| headings.iter().map(str::to_owned).zip(row.iter().map(str::to_owned)).collect();
        reader.records().map(|row| of(row.unwrap())).collect::<Vec<std::collections::BTreeMap<String, String>>>()
    };
    let one = rows("/v1/runs/r1/table.csv");
    assert_eq!((one.len(), one[0]["compound"].as_str(), one[0]["volume_um3"].as_str()), (2, "DMSO", "250000000.0"));
    assert_eq!((one[1]["outcome"].as_str(), one[1]["volume_um3"].as_str()), ("skipped", ""));
    let spreadsheet = rig.get("/v1/runs/r1/table.csv?spreadsheet=true");
    assert!(spreadsheet.status == 200 && spreadsheet.body.starts_with("\u{feff}run,".as_bytes()));
    let groups = rows("/v1/runs/r1/groups.csv");
    assert!(groups.iter().all(|row| row["n"] == "0" || row["wells"].is_empty() || row["wells"].contains("r1/")), "{groups:?}");
    let several = rig.get("/v1/table.csv?runs=r2,r1&spreadsheet=true");
    assert!(several.status == 200 && several.body.starts_with("\u{feff}run,".as_bytes()));
    let both = rows("/v1/table.csv?runs=r2,r1");
    assert_eq!(both.iter().map(|row| row["plate_barcode"].as_str()).collect::<Vec<_>>(), ["P-2", "P-2", "P-1", "P-1"]);
    assert_eq!(rows("/v1/runs/r1/shape.csv"), [], "the larva of this test has no slices");
    let tag = rig.get("/v1/runs/r1/table.csv").header("etag").unwrap().to_owned();
    assert_eq!(rig.send("GET", "/v1/runs/r1/table.csv", &[("If-None-Match", &tag)], "").status, 304);

    // The only larva has a flag that makes its number doubtful.
    let sound = rig.get("/v1/runs/r1/statistics").json();
    let volume = &sound["quantities"][0];
    assert_eq!((&volume["groups"], &volume["left_out"][0]["well"]), (&json!([]), &json!("A01")));
    assert_eq!((&sound["flagged"], &sound["specimens"]), (&json!("sound"), &json!(1)));
    let statistics = rig.get("/v1/runs/r1/statistics?flagged=included").json();
    let group = &statistics["quantities"][0]["groups"][0];
    assert_eq!((&group["n"], &group["mean"], &group["sd"]), (&json!(1), &json!(2.5e8), &Value::Null));
    assert_eq!((&group["condition"]["compound"], &group["values"][0]["flagged"]), (&json!("DMSO"), &json!(true)));
    assert_eq!((&statistics["runs"], &statistics["specimens_with_flags"]), (&json!(["r1"]), &json!(1)));
    let without = rig.get("/v1/runs/r1/statistics?flagged=excluded").json();
    assert_eq!(&without["quantities"][0]["left_out"], &volume["left_out"]);

    for (path, status, code) in [
        ("/v1/runs/r9/table.csv", 404, "unknown_run"),
        ("/v1/runs/r1/table.csv?spreadsheet=perhaps", 400, "bad_query"),
        ("/v1/runs/r9/statistics", 404, "unknown_run"),
        ("/v1/table.csv?runs=r1,r9", 404, "unknown_run"),
        ("/v1/table.csv?runs=r1,r1", 400, "bad_query"),
        ("/v1/table.csv?runs=", 400, "bad_query"),
        ("/v1/table.csv", 400, "bad_query"),
        ("/v1/runs/r1/statistics?flagged=perhaps", 400, "bad_query"),
    ] {
        let answer = rig.get(path);
        assert_eq!((answer.status, answer.problem().as_str()), (status, code), "{path}");
    }
    std::fs::write(rig.data.path().join("runs/r1/A01/measurement.json"), "{}").unwrap();
    let altered = rows("/v1/runs/r1/table.csv");
    assert!(altered[0]["reason"].contains("the file was altered") && altered[0]["volume_um3"].is_empty(), "{altered:?}");
    assert_eq!((altered.len(), altered[0]["well"].as_str()), (2, "A01"));
    // A pipe that nobody writes into.
    let numbers = rig.data.path().join("runs/r1/A01/measurement.json");
    std::fs::remove_file(&numbers).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&numbers).status().unwrap().success());
    let report = rig.get("/v1/runs/r1/report.html");
    let text = String::from_utf8(report.body.clone()).unwrap();
    assert!(report.status == 200 && text.contains("Left out: r1 A01, because it cannot be read"), "{}", report.status);
    assert!(!rows("/v1/runs/r1/table.csv")[0]["reason"].is_empty());
}
