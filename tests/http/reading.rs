//! Snapshots, long polls, live pictures, events, probes and metrics.

use crate::rig::{BOOT, Rig, event, settings};
use crate::wire::{PATIENCE, connect, read_answer, read_until};
use carved::api::{CalibrationStatus, Eta, Fault, Mode, RunOutcome, RunStatus, State, WellCounts};
use carved::session::{Refusal, Shown};
use carved_store::{Claim, Store};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[test]
fn the_status_is_the_snapshot_and_its_tag_changes_with_the_state_alone() {
    let rig = Rig::start();
    let first = rig.get("/v1/status");
    assert_eq!(first.status, 200);
    let status = first.json();
    assert_eq!((&status["boot_id"], &status["revision"], &status["state"]), (&BOOT.into(), &41.into(), &"Idle".into()));
    assert_eq!(status["mode"], serde_json::to_value(Mode::Simulated).unwrap());
    assert!(status["server_time"].as_str().unwrap().ends_with('Z'), "{status}");
    let tag = first.header("etag").unwrap().to_owned();
    assert_eq!(tag, format!("\"{BOOT}-41\""));

    let again = rig.send("GET", "/v1/status", &[("If-None-Match", &tag)], "");
    assert_eq!((again.status, again.body.len(), again.header("etag")), (304, 0, Some(&*tag)));
    rig.driver.publish(|s| s.state = State::Starting);
    let newer = rig.send("GET", "/v1/status", &[("If-None-Match", &tag)], "");
    assert_eq!((newer.status, &newer.json()["state"]), (200, &"Starting".into()));
    assert_ne!(newer.header("etag"), Some(&*tag));
}

#[test]
fn the_methods_that_a_plan_may_name_are_served() {
    let answer = Rig::start().get("/v1/methods");
    assert_eq!(answer.status, 200);
    let expected = serde_json::json!({"methods": [
        {"name": "standard", "version": null, "asd": 21, "order": "coarse_to_fine", "epsilon": 0.05, "voxel_um": 6.93}]});
    assert_eq!(answer.json(), expected);
}

fn ask(rig: &Rig, path: &str, headers: &str) -> TcpStream {
    let mut stream = connect(rig.address);
    write!(stream, "GET {path} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n").unwrap();
    stream
}

#[test]
fn a_long_poll_answers_when_the_revision_rises() {
    let rig = Rig::start();
    let mut waiting = ask(&rig, "/v1/status?wait=25&after=41", "");
    waiting.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    assert!(waiting.read(&mut [0]).is_err(), "answered although nothing is new");
    waiting.set_read_timeout(Some(PATIENCE)).unwrap();
    rig.driver.publish(|s| s.state = State::Execute);
    let woken = read_answer(&mut waiting).json();
    assert_eq!((&woken["revision"], &woken["state"]), (&42.into(), &"Execute".into()));
    // A newer revision exists, or the client counts further than this daemon after a restart: both are answered at once.
    assert_eq!(rig.get("/v1/status?wait=30&after=41").json()["revision"], 42);
    assert_eq!(rig.get("/v1/status?wait=30&after=5000").json()["revision"], 42);
    // Without a change the answer comes at the end of the wait: the same snapshot, or 304 to a client that has it.
    assert_eq!(rig.get("/v1/status?wait=0.01&after=42").json()["revision"], 42);
    let tag = format!("\"{BOOT}-42\"");
    assert_eq!(rig.send("GET", "/v1/status?wait=0.01&after=42", &[("If-None-Match", &tag)], "").status, 304);
}

#[test]
fn json_is_compressed_for_a_client_that_takes_it_and_a_stream_is_not() {
    let rig = Rig::start();
    let zipped = rig.send("GET", "/v1/status", &[("Accept-Encoding", "gzip")], "");
    assert_eq!((zipped.header("content-encoding"), zipped.header("vary")), (Some("gzip"), Some("accept-encoding")));
    let mut text = String::new();
    flate2::read::GzDecoder::new(&zipped.body[..]).read_to_string(&mut text).unwrap();
    assert_eq!(serde_json::from_str::<serde_json::Value>(&text).unwrap()["revision"], 41);
    assert_eq!(rig.get("/v1/status").header("content-encoding"), None, "it was not asked for");
    let mut stream = ask(&rig, "/v1/events", "Accept-Encoding: gzip\r\n");
    let head = String::from_utf8(read_until(&mut stream, b"\r\n\r\n")).unwrap();
    assert!(head.starts_with("HTTP/1.1 200") && !head.contains("content-encoding"), "{head}");
}

#[test]
fn a_picture_at_rest_is_asked_of_the_driver() {
    let rig = Rig::start();
    let taken = rig.send("POST", "/v1/live/picture", &[], "");
    assert_eq!((taken.status, taken.header("content-type"), &taken.body[..]), (200, Some("image/jpeg"), &[0xff, 0xd8][..]));
    assert_eq!(*rig.commands.lock().unwrap(), ["picture"]);
    rig.refuse(Refusal::NoPicture { why: "the camera is dark".into() });
    let none = rig.send("POST", "/v1/live/picture", &[], "");
    assert_eq!((none.status, none.problem().as_str()), (503, "no_picture"));
}

#[test]
fn a_query_that_makes_no_sense_is_refused() {
    let rig = Rig::start();
    for query in ["wait=abc", "wait=-1&after=3", "wait=NaN&after=3", "wait=1e300&after=3", "wait=5", "after=-3", "wait=5&after=x"] {
        let answer = rig.get(&format!("/v1/status?{query}"));
        assert_eq!((answer.status, answer.problem().as_str()), (400, "bad_query"), "{query}");
    }
}

#[test]
fn live_pictures_come_when_there_are_any() {
    let rig = Rig::start();
    let routes = [
        ("/v1/live/frame.jpg", "image/jpeg", "jpeg bytes"),
        ("/v1/live/profile.png", "image/png", "png bytes"),
        ("/v1/live/mesh.glb", "model/gltf-binary", "glb bytes"),
    ];
    for (path, ..) in routes {
        let none = rig.get(path);
        assert_eq!((none.status, &*none.text(), none.header("carved-well")), (204, "", None), "{path}");
    }
    rig.driver.set_live(|live| {
        live.shown = Some(Shown { run: "r1".into(), well: "A02".into(), views: 9 });
        live.frame_jpg = Some(Arc::new(b"jpeg bytes".to_vec()));
        live.profile_png = Some(Arc::new(b"png bytes".to_vec()));
        live.mesh_glb = Some(Arc::new(b"glb bytes".to_vec()));
    });
    for (path, content_type, content) in routes {
        let found = rig.get(path);
        assert_eq!((found.status, found.header("content-type"), &*found.text()), (200, Some(content_type), content));
        assert_eq!(found.header("cache-control"), Some("no-store"));
        let tag = found.header("etag").unwrap();
        let same = rig.send("GET", path, &[("If-None-Match", tag)], "");
        assert_eq!(same.status, 304);
        for answer in [&found, &same] {
            let whose = ["carved-run", "carved-well", "carved-views"].map(|name| answer.header(name));
            assert_eq!(whose, [Some("r1"), Some("A02"), Some("9")], "{path}");
        }
    }
    let old = rig.get("/v1/live/frame.jpg").header("etag").unwrap().to_owned();
    rig.driver.set_live(|live| live.frame_jpg = Some(Arc::new(b"newer bytes".to_vec())));
    assert_eq!(rig.send("GET", "/v1/live/frame.jpg", &[("If-None-Match", &old)], "").text(), "newer bytes");
}

/// The fields of the next event of a stream, without comments and chunk sizes.
fn next_event(stream: &mut TcpStream) -> Vec<String> {
    let began = Instant::now();
    loop {
        // Comments keep a silent stream open without limit.
        assert!(began.elapsed() < PATIENCE, "no event comes");
        let block = String::from_utf8(read_until(stream, b"\n\n")).unwrap();
        let fields: Vec<String> = ["event: ", "id: ", "data: "]
            .iter()
            .flat_map(|name| block.lines().filter(move |line| line.starts_with(name)).map(str::to_owned))
            .collect();
        if !fields.is_empty() {
            return fields;
        }
    }
}

fn id_of(fields: &[String]) -> u64 {
    fields.iter().find_map(|f| f.strip_prefix("id: ")).unwrap().parse().unwrap()
}

#[test]
fn events_are_replayed_from_the_id_on_and_go_on_live() {
    let rig = Rig::with(settings(), (5..8).map(event).collect());
    let mut stream = ask(&rig, "/v1/events", "Last-Event-ID: 5\r\n");
    let head = String::from_utf8(read_until(&mut stream, b"\r\n\r\n")).unwrap();
    assert!(head.starts_with("HTTP/1.1 200") && head.to_lowercase().contains("content-type: text/event-stream"), "{head}");
    let replayed = next_event(&mut stream);
    assert_eq!(id_of(&replayed), 6);
    let data = replayed.iter().find_map(|f| f.strip_prefix("data: ")).unwrap();
    assert_eq!(serde_json::from_str::<carved_records::Event>(data).unwrap(), event(6));
    assert_eq!(id_of(&next_event(&mut stream)), 7);
    rig.driver.log().push(event(8));
    assert_eq!(id_of(&next_event(&mut stream)), 8);
}

#[test]
fn a_reader_without_an_id_sees_only_what_happens_from_now_on() {
    let rig = Rig::with(settings(), (5..8).map(event).collect());
    let mut stream = ask(&rig, "/v1/events", "");
    // The server sends the retry line after it has subscribed the reader, so event 8 reaches it.
    read_until(&mut stream, b"retry: 2000");
    rig.driver.log().push(event(8));
    assert_eq!(id_of(&next_event(&mut stream)), 8);
}

#[test]
fn a_gap_that_cannot_be_filled_is_said() {
    let rig = Rig::with(settings(), (5..8).map(event).collect());
    for id in ["3", "99", "not-a-number", "18446744073709551615", "-1"] {
        let mut stream = ask(&rig, "/v1/events", &format!("Last-Event-ID: {id}\r\n"));
        let told = next_event(&mut stream);
        assert_eq!(told[0], "event: resync", "{id}: {told:?}");
        assert!(told[1].contains("\"revision\":41"), "{told:?}");
    }
    let mut stream = ask(&rig, "/v1/events", "Last-Event-ID: 3\r\n");
    next_event(&mut stream);
    rig.driver.log().push(event(8));
    assert_eq!(id_of(&next_event(&mut stream)), 8, "the stream goes on live after a resync");
}

/// Here the memory holds events 1101 and 1102, and the index all of them, in pages of 500.
#[test]
fn a_reader_that_was_long_away_gets_every_event_once() {
    let rig = Rig::with(settings(), (1101..=1102).map(event).collect());
    let (_store, mut journal, _) = Claim::on(rig.data.path()).and_then(Store::open).unwrap();
    for _ in 0..1102 {
        journal.append(None, None, event(1).body.data).unwrap();
    }
    let mut stream = ask(&rig, "/v1/events", "Last-Event-ID: 5\r\n");
    for id in 6..=1102 {
        assert_eq!(id_of(&next_event(&mut stream)), id);
    }
    rig.driver.log().push(event(1103));
    assert_eq!(id_of(&next_event(&mut stream)), 1103);
    assert_eq!(next_event(&mut ask(&rig, "/v1/events", "Last-Event-ID: 9000\r\n"))[0], "event: resync", "an id that was never given");
}

#[test]
fn a_reader_that_falls_behind_misses_nothing() {
    let rig = Rig::with(settings(), vec![event(1)]);
    let mut stream = ask(&rig, "/v1/events", "Last-Event-ID: 1\r\n");
    read_until(&mut stream, b"retry: 2000");
    // More events than the live channel holds (256), and fewer than the journal in memory (2000).
    for id in 2..=1500 {
        rig.driver.log().push(event(id));
    }
    for id in 2..=1500 {
        assert_eq!(id_of(&next_event(&mut stream)), id);
    }
}

#[test]
fn the_probes_tell_living_from_ready() {
    let rig = Rig::start();
    assert_eq!((rig.get("/livez").status, rig.get("/readyz").status), (200, 200));
    rig.driver.publish(|s| {
        s.ready = false;
        s.not_ready_reason = Some("the axis is not referenced".into());
    });
    let unready = rig.get("/readyz");
    assert_eq!((unready.status, unready.problem().as_str()), (503, "not_ready"));
    assert!(unready.header("retry-after").unwrap().parse::<u32>().unwrap() > 0);
    assert_eq!(unready.json()["detail"], "the axis is not referenced");
    assert_eq!(rig.get("/livez").status, 200);
}

fn calibration() -> CalibrationStatus {
    CalibrationStatus {
        id: "0123456789ab".into(),
        kind: "beads".into(),
        measured: "2026-01-01T00:00:00Z".into(),
        age_s: 0.0,
        max_age_s: 1.0,
        bead_bias_percent: Some(-0.22),
        valid: true,
        gate: None,
    }
}

#[test]
fn metrics_are_the_snapshots_numbers() {
    let rig = Rig::start();
    rig.driver.publish(|s| {
        s.state = State::Execute;
        s.hardware.camera.completed_frames = 1234;
        s.hardware.disk_free_bytes = Some(5_000_000_000);
        let wells = WellCounts { succeeded: 3, skipped: 1, pending: 2, total: 6, ..WellCounts::default() };
        s.run = Some(RunStatus {
            id: "r".into(),
            external_id: None,
            method: "standard".into(),
            operator: "kim".into(),
            wells,
            results: Vec::new(),
            started: "2026-01-01T00:00:00Z".into(),
            ended: None,
            eta_s: Some(Eta { p50: 600.0, p90: 700.0 }),
            held_by_operator: false,
            goes_on_by_itself: false,
            hold: None,
            outcome: None::<RunOutcome>,
        });
        s.calibration = Some(calibration());
        let fault = carved_records::Fault::new(3, &carved_records::fault_table::EMERGENCY_STOP, String::new(), String::new());
        s.faults = vec![Fault::of(&fault, carved_records::RunUnderFault::None)];
    });
    for n in 0..3 {
        rig.get(&format!("/nowhere/{n}"));
    }
    let answer = rig.get("/metrics");
    assert!(answer.header("content-type").unwrap().starts_with("text/plain; version=0.0.4"));
    let text = answer.text();
    for line in [
        "# TYPE carved_build_info gauge",
        "carved_build_info{INSTRUMENT,version=\"1.2.3\",mode=\"simulated\"} 1",
        "carved_instrument_info{INSTRUMENT,serial=\"\",location=\"\",uuid=\"0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11\"} 1",
        "carved_state{INSTRUMENT,state=\"Execute\"} 1",
        "carved_state{INSTRUMENT,state=\"Held\"} 0",
        "carved_ready{INSTRUMENT} 1",
        "carved_needs_person{INSTRUMENT} 1",
        "carved_faults{INSTRUMENT,code=\"emergency_stop\"} 1",
        "carved_run_remaining_seconds{INSTRUMENT} 600.0",
        "carved_calibration_valid{INSTRUMENT} 1",
        "carved_calibration_measured_timestamp_seconds{INSTRUMENT} 1767225600.0",
        "carved_calibration_max_age_seconds{INSTRUMENT} 1.0",
        "carved_status_revision{INSTRUMENT} 42",
        "carved_run_open{INSTRUMENT} 1",
        "carved_run_wells{INSTRUMENT,outcome=\"succeeded\"} 3",
        "carved_run_wells{INSTRUMENT,outcome=\"pending\"} 2",
        "carved_bead_gate_valid{INSTRUMENT} 0",
        "carved_index_behind{INSTRUMENT} 0",
        "# TYPE carved_camera_frames_completed_total counter",
        "carved_camera_frames_completed_total{INSTRUMENT} 1234",
        "carved_disk_free_bytes{INSTRUMENT} 5000000000",
        "carved_http_requests_total{INSTRUMENT,method=\"GET\",route=\"unmatched\",status=\"404\"} 3",
    ] {
        let line = line.replace("INSTRUMENT", "instrument=\"vast-1\"");
        assert!(text.lines().any(|l| l == line), "{line} is not in\n{text}");
    }
    assert!(!text.contains("# UNIT") && !text.contains("# EOF"), "that is OpenMetrics:\n{text}");
}

#[test]
fn metrics_come_as_openmetrics_where_the_client_accepts_it() {
    let rig = Rig::start();
    let answer = rig.send("GET", "/metrics", &[("Accept", "application/openmetrics-text;version=1.0.0,text/plain;q=0.5")], "");
    assert!(answer.header("content-type").unwrap().starts_with("application/openmetrics-text"));
    let text = answer.text();
    assert!(text.ends_with("# EOF\n") && text.contains("# TYPE carved_http_requests counter\n"), "{text}");
}

#[test]
fn the_calibration_s_age_is_a_clock_and_its_validity_is_not() {
    let rig = Rig::start();
    rig.driver.publish(|s| s.calibration = Some(calibration()));
    let answer = rig.get("/v1/status");
    let told = &answer.json()["calibration"];
    // The time of the calibration lies more than a day in the past, and the calibration stays valid until the driver changes it.
    assert!(told["age_s"].as_f64().unwrap() > 86400.0, "{told}");
    assert_eq!((&told["valid"], &told["bead_bias_percent"]), (&true.into(), &(-0.22).into()), "{told}");
    let tag = answer.header("etag").unwrap().to_owned();
    assert_eq!(rig.send("GET", "/v1/status", &[("If-None-Match", &tag)], "").status, 304);
}
