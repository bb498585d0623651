//! Two schedulers on one instrument, and a client that sends too many commands.

use crate::rig::{PLAN, Rig, settings};
use crate::wire::Answer;
use carved::config::HttpSettings;

const JSON: (&str, &str) = ("Content-Type", "application/json");

fn take(rig: &Rig, holder: &str) -> Answer {
    rig.put("/v1/lease", &format!(r#"{{"holder": "{holder}", "ttl_s": 600}}"#))
}

#[test]
fn who_has_the_lease_commands_and_the_others_learn_who_it_is() {
    let rig = Rig::start();
    assert_eq!(rig.put("/v1/runs/before", PLAN).status, 201, "nobody has it: everyone may");
    let lease = take(&rig, "loader");
    assert_eq!(lease.status, 201);
    let token = lease.json()["token"].as_str().unwrap().to_owned();
    for (method, path, body) in
        [("PUT", "/v1/runs/r", PLAN), ("PUT", "/v1/runs/r/wells/A01", r#"{"loaded": true}"#), ("DELETE", "/v1/lease", "")]
    {
        let answer = rig.send(method, path, &[JSON], body);
        assert_eq!((answer.status, answer.problem().as_str()), (423, "locked"), "{method} {path}");
        let problem = answer.json();
        assert_eq!((&problem["lease"]["holder"], &problem["scheduler_action"]), (&"loader".into(), &"retry".into()));
        let left = problem["lease"]["expires_in_s"].as_f64().unwrap();
        let retry_after: f64 = answer.header("retry-after").unwrap().parse().unwrap();
        assert!(left > 0.0 && left <= 600.0 && retry_after >= left, "{left} {retry_after}");
    }
    assert_eq!(take(&rig, "loader").status, 423, "a name is no token");
    let mine = [JSON, ("Carved-Lease", token.as_str())];
    assert_eq!(rig.send("PUT", "/v1/runs/r", &mine, PLAN).status, 201);
    assert_eq!(rig.get("/v1/status").status, 200, "reading is free");
    let shown = rig.get("/v1/lease").json();
    assert_eq!((&shown["holder"], shown.get("token")), (&"loader".into(), None));
    let renewed = rig.send("PUT", "/v1/lease", &mine, r#"{"holder": "loader", "ttl_s": 9}"#);
    assert_eq!((renewed.status, &renewed.json()["token"]), (200, &token.as_str().into()));
    assert_eq!(rig.send("DELETE", "/v1/lease", &mine, "").status, 204);
    assert_eq!(rig.get("/v1/lease").json()["holder"], serde_json::Value::Null);
    let over = rig.send("PUT", "/v1/runs/r2", &mine, PLAN);
    assert_eq!((over.status, over.problem().as_str()), (412, "lease_over"), "who believes to have it is told");
    assert_eq!(rig.put("/v1/runs/r2", PLAN).status, 201);
}

#[test]
fn a_lease_may_be_asked_for_again_under_a_token_of_ones_own() {
    let rig = Rig::start();
    let asked = r#"{"holder": "loader", "ttl_s": 600, "token": "a-word-of-my-own_1"}"#;
    assert_eq!(rig.put("/v1/lease", asked).status, 201);
    let again = rig.put("/v1/lease", asked);
    assert_eq!((again.status, &again.json()["token"]), (200, &"a-word-of-my-own_1".into()), "its answer may have been lost");
    assert_eq!(rig.put("/v1/lease", &asked.replace("my-own", "another")).status, 423);
    let mine = [JSON, ("Carved-Lease", "a-word-of-my-own_1")];
    assert_eq!(rig.send("PUT", "/v1/runs/r", &mine, PLAN).status, 201);
    assert_eq!(rig.send("DELETE", "/v1/lease", &mine, "").status, 204);
}

#[test]
fn no_lease_keeps_anyone_from_an_abort() {
    let rig = Rig::start();
    rig.put("/v1/runs/r", PLAN);
    take(&rig, "loader");
    assert_eq!(rig.send("POST", "/v1/runs/r/abort", &[], "").status, 200);
    assert_eq!(rig.send("POST", "/v1/runs/r/abort", &[("Carved-Lease", "of last week")], "").status, 200);
}

#[test]
fn a_lease_has_a_holder_and_an_end() {
    let rig = Rig::start();
    let pointers = |body: &str| {
        let answer = rig.put("/v1/lease", body);
        assert_eq!(answer.status, 422, "{body}");
        answer.json()["errors"].as_array().unwrap().iter().map(|e| e["pointer"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(pointers(r#"{"holder": " ", "ttl_s": 0}"#), ["/holder", "/ttl_s"]);
    assert_eq!(pointers(r#"{"holder": "x", "ttl_s": 3601}"#), ["/ttl_s"]);
    assert_eq!(pointers(r#"{"holder": "x", "ttl_s": 60, "token": "easily guessed"}"#), ["/token"]);
    assert_eq!(rig.get("/v1/lease").json()["holder"], serde_json::Value::Null);
}

#[test]
fn a_client_that_commands_without_end_is_reported_to_wait_and_may_still_read_and_abort() {
    // One command per minute, so that the limit does not recover during the test.
    let rig = Rig::with(HttpSettings { commands_per_minute: 1, command_burst: 3, ..settings() }, Vec::new());
    for _burst in 0..3 {
        assert!(rig.put("/v1/runs/r", PLAN).status < 300);
    }
    let answer = rig.put("/v1/runs/r", PLAN);
    assert_eq!((answer.status, answer.problem().as_str()), (429, "too_many_commands"));
    let wait: u32 = answer.header("retry-after").unwrap().parse().unwrap();
    assert!((1..=60).contains(&wait), "{wait}");
    assert_eq!(answer.json()["scheduler_action"], "retry");
    assert_eq!(rig.get("/v1/status").status, 200);
    assert_eq!(rig.send("POST", "/v1/runs/r/abort", &[], "").status, 200);
}
