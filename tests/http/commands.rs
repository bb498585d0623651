//! Commands, and every way in which they are refused.

use crate::rig::{PLAN, Rig, settings};
use crate::wire::{connect, read_answer};
use carved::api::{Fault, SchedulerAction, State};
use carved::config::HttpSettings;
use carved::session::{QueueRefusal, Refusal};
use carved_devices::StopHandle;
use carved_devices::cancel::CancelToken;
use carved_records::{Asked, FieldError, HandoffIntent, RunPlan};
use serde_json::Value;
use std::io::Write;
use std::net::{IpAddr, Ipv4Addr};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

fn pointers(answer: &crate::wire::Answer) -> Vec<String> {
    let mut found: Vec<_> = answer.json()["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap().to_owned()).collect();
    found.sort();
    found
}

#[test]
fn a_run_is_created_once_and_known_again() {
    let rig = Rig::start();
    let created = rig.put("/v1/runs/plate-1.a", PLAN);
    assert_eq!((created.status, created.header("location")), (201, Some("/v1/runs/plate-1.a")));
    assert_eq!((&created.json()["run"], &created.json()["revision"]), (&"plate-1.a".into(), &41.into()));
    assert_eq!(rig.put("/v1/runs/plate-1.a", PLAN).status, 200);
    let other = rig.put("/v1/runs/plate-1.a", &PLAN.replace("kim", "lee"));
    assert_eq!((other.status, other.problem().as_str()), (409, "other_plan"));
    assert_eq!(rig.put("/v1/runs/plate-2", PLAN).status, 201);
}

#[test]
fn every_wrong_field_of_a_plan_is_named() {
    let rig = Rig::start();
    let shape = r#"{"plate_barcode": 7, "methud": "x", "operator": "kim", "plate_map": [{"well": "A01"}, {"wel": "A02"}]}"#;
    let answer = rig.put("/v1/runs/r", shape);
    assert_eq!((answer.status, answer.problem().as_str()), (422, "invalid_body"));
    assert_eq!(pointers(&answer), ["/method", "/methud", "/plate_barcode", "/plate_map/1/wel", "/plate_map/1/well"]);
    assert_eq!(answer.json()["scheduler_action"], "escalate_operator", "the next plate would be sent in the same way");
    let meaning = PLAN.replace("standard", "fast").replace("A02", "Z99");
    let answer = rig.put("/v1/runs/r", &meaning);
    assert_eq!((answer.status, answer.problem().as_str()), (422, "invalid_plan"));
    assert_eq!(pointers(&answer), ["/method", "/plate_map/1/well"]);
    assert_eq!(answer.json()["scheduler_action"], "escalate_operator", "no plate can be measured by a method that is not there");
    let of_the_plate = rig.put("/v1/runs/r", &PLAN.replace("A02", "Z99"));
    assert_eq!(
        (pointers(&of_the_plate), of_the_plate.json()["scheduler_action"].as_str()),
        (vec!["/plate_map/1/well".into()], Some("reject_plate"))
    );
    let cut = rig.put("/v1/runs/r", &PLAN[..PLAN.len() / 2]);
    assert_eq!((cut.status, cut.json()["scheduler_action"].as_str()), (400, Some("escalate_operator")), "nothing is known of the plate");
    assert_eq!(*rig.commands.lock().unwrap(), ["put r", "put r"], "a body of the wrong shape never reaches the driver");
}

#[test]
fn a_condition_that_cannot_be_held_is_refused_and_not_passed_over() {
    let rig = Rig::start();
    let json = ("Content-Type", "application/json");
    for condition in [("If-Match", "\"boot-7f-41\""), ("If-Match", "*"), ("If-Unmodified-Since", "Sat, 29 Oct 1994 19:43:31 GMT")] {
        let answer = rig.send("PUT", "/v1/runs/r", &[json, condition], PLAN);
        assert_eq!((answer.status, answer.problem().as_str()), (412, "no_condition"), "{condition:?}");
    }
    assert!(rig.commands.lock().unwrap().is_empty());
    assert_eq!(rig.put("/v1/runs/r", PLAN).status, 201);
    assert_eq!(rig.send("POST", "/v1/runs/r/abort", &[("If-Match", "*")], "").status, 200, "nothing keeps an abort");
    let version = rig.put("/v1/runs/r2", &PLAN.replace("\"operator\"", "\"method_version\": \"3\", \"operator\""));
    assert_eq!((version.status, pointers(&version)), (422, vec!["/method_version".to_owned()]));
}

#[test]
fn names_that_could_leave_their_folder_are_refused() {
    let rig = Rig::start();
    for id in ["..", "%2e%2e", "a%2fb", ".hidden", "a%20b", "%00", &"x".repeat(65)] {
        let answer = rig.put(&format!("/v1/runs/{id}"), PLAN);
        assert_eq!((answer.status, answer.problem().as_str()), (422, "invalid_run_id"), "{id}");
    }
    let answer = rig.put("/v1/runs/%ff", PLAN);
    assert_eq!((answer.status, answer.problem().as_str()), (400, "bad_path"));
    assert!(rig.commands.lock().unwrap().is_empty());
}

#[test]
fn bodies_that_are_no_json_are_refused() {
    let rig = Rig::start();
    for path in ["/v1/runs/r", "/v1/runs/r/wells/A01"] {
        for body in ["", "{", "nonsense", "{} {}", "\u{7f}"] {
            let answer = rig.put(path, body);
            assert_eq!((answer.status, answer.problem().as_str()), (400, "malformed_json"), "{path} {body:?}");
        }
        for kind in [&[][..], &[("Content-Type", "text/plain")], &[("Content-Type", "application/x-www-form-urlencoded")]] {
            let answer = rig.send("PUT", path, kind, PLAN);
            assert_eq!((answer.status, answer.problem().as_str()), (415, "not_json"), "{path} {kind:?}");
        }
    }
    // Anything after a correct body is an error.
    for (path, body) in [("/v1/runs/r", PLAN), ("/v1/runs/r/wells/A01", r#"{"loaded": true}"#)] {
        for tail in ["{}", "x"] {
            let answer = rig.put(path, &format!("{body} {tail}"));
            assert_eq!((answer.status, answer.problem().as_str()), (400, "malformed_json"), "{path} {tail:?}");
        }
    }
    assert!(rig.commands.lock().unwrap().is_empty());
    let charset = [("Content-Type", "application/json; charset=utf-8")];
    assert_eq!(rig.send("PUT", "/v1/runs/r", &charset, PLAN).status, 201);
}

#[test]
fn a_run_is_aborted_by_its_name() {
    let rig = Rig::start();
    let unknown = rig.send("POST", "/v1/runs/r/abort", &[], "");
    assert_eq!((unknown.status, unknown.problem().as_str()), (404, "unknown_run"));
    rig.put("/v1/runs/r", PLAN);
    for _again in 0..2 {
        let aborted = rig.send("POST", "/v1/runs/r/abort", &[], "");
        assert_eq!((aborted.status, &aborted.json()["run"]), (200, &"r".into()));
    }
}

#[test]
fn a_run_is_held_let_go_on_and_stopped_by_its_name() {
    let rig = Rig::start();
    rig.put("/v1/runs/r", PLAN);
    for command in ["hold", "unhold", "stop"] {
        assert_eq!(rig.send("POST", &format!("/v1/runs/r/{command}"), &[], "").status, 200, "{command}");
        assert_eq!(rig.send("POST", &format!("/v1/runs/x/{command}"), &[], "").problem(), "unknown_run", "{command}");
    }
    assert_eq!(*rig.commands.lock().unwrap(), ["put r", "hold r", "hold x", "unhold r", "unhold x", "stop r", "stop x"]);
    for message in ["the limit switch stands open", "the limit switch stands open."] {
        rig.refuse(Refusal::FaultStands { seq: 3, code: "rotation_alarm".into(), message: message.into() });
        let stands = rig.send("POST", "/v1/runs/r/unhold", &[], "");
        assert_eq!((stands.status, stands.problem().as_str()), (409, "fault_stands"));
        assert_eq!(stands.json()["fault_seq"], 3);
        let detail = stands.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.contains("/v1/faults/3/acknowledge") && detail.contains("open. "), "{detail}");
        assert_eq!(detail.matches("stands").count(), 1, "{detail}");
    }
}

#[test]
fn a_command_says_from_where_it_came_also_without_a_name() {
    let rig = Rig::start();
    rig.put("/v1/runs/r", PLAN);
    rig.send("POST", "/v1/runs/r/hold", &[], "");
    rig.send("POST", "/v1/runs/r/hold?by=kim", &[], "");
    let lease = rig.put("/v1/lease", r#"{"holder": "loader 1", "ttl_s": 60, "token": "0123456789abcdef"}"#);
    assert_eq!(lease.status, 201);
    rig.send("POST", "/v1/runs/r/hold", &[("Carved-Lease", "0123456789abcdef")], "");
    // An abort passes the lease of another client, which it does not have.
    rig.send("POST", "/v1/runs/r/abort", &[("Carved-Lease", "another-token-of-16")], "");
    let own = "the instrument's computer";
    let of = |by: Option<&str>, from: &str| Asked { by: by.map(str::to_owned), from: Some(from.to_owned()) };
    let wanted = [of(None, own), of(Some("kim"), own), of(None, &format!("{own}, with the lease of loader 1")), of(None, own)];
    assert_eq!(*rig.asked.lock().unwrap(), wanted);
}

#[test]
fn a_command_through_a_trusted_proxy_says_the_address_of_its_client() {
    let from = |trusted: Vec<IpAddr>| {
        let rig = Rig::with(HttpSettings { trusted_proxies: trusted, ..settings() }, Vec::new());
        rig.put("/v1/runs/r", PLAN);
        rig.send("POST", "/v1/runs/r/hold", &[("X-Forwarded-For", "6.6.6.6, 10.0.0.9")], "");
        let asked = rig.asked.lock().unwrap();
        asked[0].from.clone()
    };
    assert_eq!(from(vec![Ipv4Addr::LOCALHOST.into()]).as_deref(), Some("10.0.0.9"));
    assert_eq!(from(Vec::new()).as_deref(), Some("the instrument's computer"), "a header that any client can write");
}

#[test]
fn plates_are_queued_ordered_removed_and_begun() {
    let rig = Rig::start();
    let plan = |barcode: &str, operator: &str| {
        let mut plan: Value = serde_json::from_str(PLAN).unwrap();
        (plan["plate_barcode"], plan["operator"]) = (barcode.into(), operator.into());
        plan
    };
    let (first, second, changed) = (plan("P-1", "kim"), plan("P-2", "kim"), plan("P-1", "lee"));
    let waits = |run: &str| rig.get(&format!("/v1/queue/{run}"));
    for (run, plan, status) in [("n-1", &first, 201), ("n-1", &first, 200), ("n-2", &second, 201), ("n-1", &changed, 200)] {
        let queued = rig.put(&format!("/v1/queue/{run}"), &plan.to_string());
        assert_eq!((queued.status, &queued.json()["run"]), (status, &run.into()));
        assert_eq!(queued.header("location").is_some_and(|at| at == format!("/v1/queue/{run}")), status == 201);
        let kept: RunPlan = serde_json::from_value(waits(run).json()).unwrap();
        assert_eq!(kept, serde_json::from_value::<RunPlan>(plan.clone()).unwrap(), "what was sent comes back");
    }
    assert_eq!(waits("n-9").problem(), "not_queued");
    // The order shows in which plate begins: the rig begins the first one, and only by its barcode.
    assert_eq!(rig.put("/v1/queue", r#"{"runs": ["n-2", "n-1"]}"#).status, 200);
    let begun = rig.put("/v1/plate/next", r#"{"barcode": "P-2"}"#);
    assert_eq!((begun.status, begun.header("location"), &begun.json()["run"]), (201, Some("/v1/runs/n-2"), &"n-2".into()));
    assert_eq!((waits("n-2").problem(), waits("n-1").status), ("not_queued".into(), 200));
    let removed = rig.send("DELETE", "/v1/queue/n-1", &[], "");
    assert_eq!((removed.status, &removed.json()["run"], waits("n-1").status), (200, &"n-1".into(), 404));
    for (path, body) in [("/v1/queue", r#"{"order": []}"#), ("/v1/plate/next", r#"{"barcode": 7}"#), ("/v1/plate/next", "{}")] {
        assert_eq!(rig.put(path, body).status, 422, "{path} {body}");
    }
    for (kind, code, action) in [
        (QueueRefusal::OtherPlate, "other_plate_next", "pause_instrument"),
        (QueueRefusal::Empty, "queue_empty", "pause_instrument"),
        (QueueRefusal::Conflict, "queue_conflict", "escalate_operator"),
    ] {
        rig.refuse(Refusal::Queue { why: "plate P-1 is next".into(), kind });
        let refused = rig.put("/v1/plate/next", r#"{"barcode": "P-2"}"#);
        assert_eq!((refused.status, refused.problem().as_str()), (409, code));
        assert_eq!((&refused.json()["scheduler_action"], &refused.json()["detail"]), (&action.into(), &"plate P-1 is next".into()));
    }
}

/// A stop of the motors bypasses the queue of commands and every check of the request.
#[test]
fn an_emergency_stop_is_on_the_wire_whatever_else_happens() {
    let rig = Rig::start();
    let stops = Arc::new(AtomicU32::new(0));
    let counted = stops.clone();
    let work = CancelToken::default();
    rig.driver.halt().aim(
        StopHandle::new(move || {
            counted.fetch_add(1, Ordering::SeqCst);
        }),
        work.clone(),
    );
    assert_eq!(rig.send("POST", "/v1/emergency-stop", &[], "").status, 200);
    assert!(work.is_cancelled(), "no move follows the stop");
    rig.refuse(Refusal::Store { why: "no space".into(), full: true });
    assert_eq!(rig.send("POST", "/v1/emergency-stop", &[], "").status, 507);
    let large = "x".repeat(1 << 20);
    assert_eq!(rig.send("POST", "/v1/emergency-stop", &[], &large).status, 413);
    assert_eq!(stops.load(Ordering::SeqCst), 3);
}

#[test]
fn a_fault_is_acknowledged_by_its_number() {
    let rig = Rig::start();
    assert_eq!(rig.send("POST", "/v1/faults/17/acknowledge", &[], "").status, 200);
    assert_eq!(rig.send("POST", "/v1/faults/18/acknowledge", &[], "").problem(), "unknown_fault");
    assert_eq!(rig.send("POST", "/v1/faults/first/acknowledge", &[], "").problem(), "bad_path");
}

#[test]
fn a_plate_is_announced_and_moved() {
    let rig = Rig::start();
    let announced = rig.put("/v1/plate/handoff", r#"{"intent": "unload", "barcode": "P-1"}"#);
    assert_eq!((announced.status, &announced.json()["needs"]), (200, &"the run to end".into()));
    for (body, pointer) in [(r#"{"intent": "turn", "barcode": "P"}"#, "/intent"), (r#"{"intent": "load"}"#, "/barcode")] {
        let answer = rig.put("/v1/plate/handoff", body);
        assert_eq!(pointers(&answer), [pointer], "{body}");
        assert_eq!(answer.json()["scheduler_action"], "escalate_operator", "no plate is at fault");
    }
    let field = FieldError { pointer: "/barcode".into(), detail: "no barcode".into() };
    rig.refuse(Refusal::InvalidHandoff(vec![field]));
    let answer = rig.put("/v1/plate/handoff", r#"{"intent": "load", "barcode": "P 1"}"#);
    assert_eq!((answer.status, answer.problem().as_str(), pointers(&answer)), (422, "invalid_body", vec!["/barcode".to_owned()]));
    assert_eq!(answer.json()["scheduler_action"], "reject_plate");
    rig.refusal.lock().unwrap().take();
    for end in ["completed", "aborted"] {
        assert_eq!(rig.send("PUT", &format!("/v1/plate/handoff/{end}"), &[], "").status, 200);
    }
    assert_eq!(*rig.commands.lock().unwrap(), ["Unload P-1", "Load P 1", "Completed", "Aborted"]);
    rig.refuse(Refusal::PlateInside { intent: HandoffIntent::Load, inside: "P-1".into(), found: "P-2".into() });
    let other = rig.put("/v1/plate/handoff", r#"{"intent": "load", "barcode": "P-2"}"#);
    assert_eq!((other.status, other.problem().as_str()), (409, "other_barcode"));
    assert_eq!(other.json()["scheduler_action"], "pause_instrument", "nothing is wrong with P-2");
    assert!(other.json()["detail"].as_str().unwrap().ends_with("then load P-2"), "{other:?}");
    rig.refuse(Refusal::OtherBarcode { expected: "P-1".into(), found: "P-2".into() });
    assert_eq!(rig.put("/v1/runs/r", PLAN).json()["scheduler_action"], "reject_plate");
}

#[test]
fn a_preflight_says_everything_and_what_only_flags_does_not_fail_it() {
    let rig = Rig::start();
    let found = rig.send("POST", "/v1/preflight", &[("Content-Type", "application/json")], PLAN);
    assert_eq!((found.status, &found.json()["passed"]), (200, &true.into()));
    assert_eq!(found.json()["checks"].as_array().unwrap().len(), 3);
    let full = rig.send("POST", "/v1/preflight", &[("Content-Type", "application/json")], &PLAN.replace("kim", "full"));
    assert_eq!((full.status, &full.json()["passed"]), (200, &false.into()));
    rig.refuse(Refusal::WillNotFit { needed_bytes: 2, free_bytes: 1 });
    assert_eq!(rig.put("/v1/runs/r", PLAN).problem(), "will_not_fit");
}

#[test]
fn an_abort_does_not_wait_for_a_slow_body() {
    let rig = Rig::start();
    rig.put("/v1/runs/r", PLAN);
    let mut stream = connect(rig.address);
    write!(stream, "POST /v1/runs/r/abort HTTP/1.1\r\nHost: localhost\r\nContent-Length: 10\r\n\r\n{{").unwrap();
    assert_eq!(read_answer(&mut stream).status, 200);
}

#[test]
fn the_loader_says_what_is_in_the_capillary() {
    let rig = Rig::start();
    let say = |path: &str, body: &str| rig.put(path, body);
    let loaded = r#"{"loaded": true}"#;
    assert_eq!(say("/v1/runs/r/wells/A01", loaded).problem(), "unknown_run");
    rig.put("/v1/runs/r", PLAN);
    assert_eq!(say("/v1/runs/r/wells/A01", loaded).status, 200);
    assert_eq!(say("/v1/runs/r/wells/A01", r#"{"loaded": false}"#).status, 200);
    assert_eq!(rig.commands.lock().unwrap()[1..], ["put r", "loaded r A01", "unloaded r A01"]);
    let unexpected = say("/v1/runs/r/wells/H12", loaded);
    assert_eq!((unexpected.status, unexpected.problem().as_str()), (409, "unexpected_well"));
    for (body, pointer) in [(r#"{"loaded": 1}"#, "/loaded"), ("{}", "/loaded"), (r#"{"loaded": true, "x": 1}"#, "/x")] {
        let answer = say("/v1/runs/r/wells/A01", body);
        assert_eq!((answer.status, pointers(&answer)), (422, vec![pointer.to_owned()]), "{body}");
    }
}

#[test]
fn a_refusal_names_the_states_and_the_fault_behind_it() {
    let rig = Rig::start();
    rig.refuse(Refusal::WrongState { state: State::Execute, accepted_in: vec![State::Idle, State::Complete] });
    let busy = rig.put("/v1/runs/r", PLAN);
    assert_eq!((busy.status, busy.problem().as_str()), (409, "wrong_state"));
    let problem = busy.json();
    assert_eq!(problem["accepted_in"], serde_json::json!(["Idle", "Complete"]));
    assert_eq!((&problem["scheduler_action"], &problem["fault_seq"]), (&"retry".into(), &serde_json::Value::Null));

    rig.refuse(Refusal::WrongState { state: State::Stopping, accepted_in: vec![State::Execute, State::Suspended] });
    let late = rig.send("POST", "/v1/runs/r/hold", &[], "");
    assert_eq!((late.status, &late.json()["scheduler_action"]), (409, &"pause_instrument".into()), "it is never held any more");

    rig.driver.publish(|s| {
        s.faults.push(Fault {
            seq: 17,
            code: "disk_full".into(),
            category: "store".into(),
            message: "no space".into(),
            recoverable: true,
            scheduler_action: SchedulerAction::PauseInstrument,
            operator_required: true,
            ends_by_itself: true,
            meaning: String::new(),
            what_to_do: String::new(),
            since: "2026-01-01T00:00:00Z".into(),
        });
    });
    rig.refuse(Refusal::Store { why: "read-only".into(), full: false });
    for answer in
        [rig.put("/v1/runs/r", PLAN), rig.send("POST", "/v1/runs/r/abort", &[], ""), rig.put("/v1/runs/r/wells/A01", r#"{"loaded": true}"#)]
    {
        assert_eq!((answer.status, answer.problem().as_str()), (503, "store"));
        assert!(answer.header("retry-after").is_some());
        assert_eq!((&answer.json()["scheduler_action"], &answer.json()["fault_seq"]), (&"pause_instrument".into(), &17.into()));
    }
}

#[test]
fn a_body_that_does_not_come_is_not_waited_for_for_ever() {
    let rig = Rig::with(HttpSettings { body_timeout_ms: 50, ..settings() }, Vec::new());
    let mut stream = connect(rig.address);
    let head = "PUT /v1/runs/r HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n{";
    stream.write_all(head.as_bytes()).unwrap();
    let answer = read_answer(&mut stream);
    assert_eq!((answer.status, answer.problem().as_str()), (408, "slow_body"));
}

/// The loader can resolve this refusal itself, so nobody is called. A repeat alone does not help.
#[test]
fn a_capillary_that_is_full_is_the_loaders_to_empty() {
    let rig = Rig::start();
    rig.refuse(Refusal::CapillaryFull { run: "r".into(), well: "A01".into() });
    for answer in [rig.put("/v1/runs/r2", PLAN), rig.put("/v1/runs/r/wells/A02", r#"{"loaded": true}"#)] {
        assert_eq!((answer.status, answer.problem().as_str()), (409, "capillary_full"));
        assert_eq!(answer.json()["scheduler_action"], "pause_instrument");
        let detail = answer.json()["detail"].as_str().unwrap().to_owned();
        assert!(detail.contains("PUT /v1/runs/r/wells/A01 {\"loaded\": false}"), "{detail}");
    }
}
