//! `carved run` against a server: its requests, its output and its exit code.

use crate::rig::Rig;
use crate::wire::PATIENCE;
use carved::api::{Fault, Hold, NextCommand, RunOutcome, RunStatus, SchedulerAction, State};
use carved_records::{PlannedWell, SpecimenKind, SpecimenOutcome, WellCounts, WellStatus};
use std::io::{Read, Write};
use std::net::TcpListener;
use std::process::{Command, Output};
use std::time::Instant;

const MAP: &str = "well,dpf\nA1,3\nA02,4\n";

pub fn carved(url: &str, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_carved"));
    // The developer may be behind a proxy. The client must ignore it.
    command.env("http_proxy", "http://127.0.0.1:1").env("HTTP_PROXY", "http://127.0.0.1:1").env("ALL_PROXY", "http://127.0.0.1:1");
    command.args(args).args(["--url", url]).output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

pub fn url(rig: &Rig) -> String {
    format!("http://{}", rig.address)
}

fn map_file(text: &str) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::with_suffix(".csv").unwrap();
    file.write_all(text.as_bytes()).unwrap();
    file
}

fn start(url: &str, map: &tempfile::NamedTempFile, more: &[&str]) -> Output {
    let path = map.path().to_str().unwrap();
    let base = ["run", "start", "--plate-map", path, "--barcode", "P-1", "--operator", "kim"];
    carved(url, &[&base[..], more].concat())
}

fn well(name: &str, outcome: Option<SpecimenOutcome>, reason: Option<&str>) -> WellStatus {
    let mut well = WellStatus::pending(&PlannedWell::new(name, SpecimenKind::Larva, Some(3.0)));
    if let Some(outcome) = outcome {
        well.end(outcome, reason);
    }
    well
}

fn run_of(results: Vec<WellStatus>, outcome: Option<RunOutcome>) -> RunStatus {
    RunStatus {
        id: "r1".into(),
        external_id: None,
        method: "standard".into(),
        operator: "kim".into(),
        wells: WellCounts::of(&results),
        results: results.into_iter().collect(),
        started: "2026-01-01T00:00:00Z".into(),
        ended: None,
        eta_s: None,
        held_by_operator: false,
        goes_on_by_itself: false,
        hold: None,
        outcome,
    }
}

#[test]
fn a_plate_map_becomes_a_run_and_the_same_again_starts_nothing() {
    let (rig, map) = (Rig::start(), map_file(MAP));
    for says in ["is on the instrument's disk", "no second run was started"] {
        let output = start(&url(&rig), &map, &["--method", "standard", "--id", "r1"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let said = text(&output.stdout);
        assert!(said.contains("line 2: A1 is read as A01") && said.contains("run r1 of 2 well(s)") && said.contains(says), "{said}");
        rig.driver.publish(|s| s.run = Some(run_of(vec![well("A01", None, None)], None)));
    }
    rig.driver.publish(|s| s.run = Some(run_of(vec![well("A01", Some(SpecimenOutcome::Failed), None)], Some(RunOutcome::Failed))));
    for more in [&["--watch"][..], &[]] {
        let output = start(&url(&rig), &map, &[&["--method", "standard", "--id", "r1"], more].concat());
        let said = text(&output.stderr);
        assert_eq!((output.status.code(), text(&output.stdout)), (Some(1), String::new()), "{said}");
        assert!(said.contains("has ended already: failed. Nothing was started") && said.contains("--id"), "{said}");
    }
    assert_eq!(*rig.commands.lock().unwrap(), ["put r1"; 4]);
    let named = start(&url(&rig), &map, &["--method", "standard"]);
    assert!(text(&named.stdout).contains("run P-1-20"), "{}", text(&named.stdout));
}

#[test]
fn mistakes_are_printed_with_their_lines_and_have_a_code_of_their_own() {
    let rig = Rig::start();
    let broken = map_file("well,dpf\nA01,3\nAG9,99\n");
    let output = start(&url(&rig), &broken, &["--method", "standard"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("line 3, well: ") && said.contains("line 3, dpf: ") && said.contains("2 mistake(s)"), "{said}");
    let output = start(&url(&rig), &map_file(MAP), &["--method", "fast", "--id", "r1"]);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("/method: \"fast\" is not a method"), "{said}");
    assert_eq!(*rig.commands.lock().unwrap(), ["put r1"], "a broken plate map is not sent");
    let checked = Command::new(env!("CARGO_BIN_EXE_carved")).args(["plate", "check"]).arg(broken.path()).output().unwrap();
    assert_eq!(checked.status.code(), Some(3));
    assert!(text(&checked.stderr).contains("line 3, dpf: "));
}

#[test]
fn a_run_is_aborted_by_its_name_or_as_the_one_under_way() {
    let (rig, map) = (Rig::start(), map_file(MAP));
    let nothing = carved(&url(&rig), &["run", "abort"]);
    assert_eq!(nothing.status.code(), Some(1));
    assert!(text(&nothing.stderr).contains("no run yet"));
    start(&url(&rig), &map, &["--method", "standard", "--id", "r1"]);
    rig.driver.publish(|s| s.run = Some(run_of(vec![well("A01", None, None)], None)));
    for args in [&["run", "abort", "r1"][..], &["run", "abort"]] {
        assert_eq!(carved(&url(&rig), args).status.code(), Some(0));
    }
    assert_eq!(rig.commands.lock().unwrap()[1..], ["abort r1", "abort r1"]);
    let unknown = carved(&url(&rig), &["run", "abort", "r2"]);
    assert_eq!(unknown.status.code(), Some(1));
    assert!(text(&unknown.stderr).contains("unknown_run"), "{}", text(&unknown.stderr));
}

#[test]
fn a_fault_is_acknowledged_by_its_number_on_the_command_line() {
    let rig = Rig::start();
    let done = carved(&url(&rig), &["run", "acknowledge", "17"]);
    assert_eq!(done.status.code(), Some(0), "{}", text(&done.stderr));
    assert!(text(&done.stdout).starts_with("fault 17 is acknowledged. "), "{}", text(&done.stdout));
    let unknown = carved(&url(&rig), &["run", "acknowledge", "18"]);
    assert_eq!(unknown.status.code(), Some(1));
    assert!(text(&unknown.stderr).contains("unknown_fault"), "{}", text(&unknown.stderr));
    assert_eq!(rig.commands.lock().unwrap().iter().filter(|command| command.starts_with("acknowledge")).count(), 2);
}

/// Waits until the status was answered this many times.
fn answered(rig: &Rig, times: u32) {
    let began = Instant::now();
    let counted = "carved_http_requests_total{instrument=\"vast-1\",method=\"GET\",route=\"/v1/status\",status=\"200\"} ";
    let count = || rig.get("/metrics").text().lines().find_map(|line| line.strip_prefix(counted)?.parse().ok()).unwrap_or(0);
    while count() < times {
        assert!(began.elapsed() < PATIENCE, "the status was not asked for {times} times");
    }
}

#[test]
fn a_watcher_tells_each_well_and_fault_and_ends_as_the_run_does() {
    let ended = [
        (RunOutcome::Succeeded, 0),
        (RunOutcome::Partial, 4),
        (RunOutcome::Failed, 5),
        (RunOutcome::Interrupted, 5),
        (RunOutcome::Aborted, 6),
    ];
    for (outcome, code) in ended {
        let rig = Rig::start();
        rig.driver.publish(|s| {
            s.state = State::Execute;
            s.run = Some(run_of(vec![well("A01", Some(SpecimenOutcome::Skipped), Some("empty")), well("A02", None, None)], None));
        });
        let address = url(&rig);
        let watching = std::thread::spawn(move || carved(&address, &["run", "watch"]));
        // It has read the current run, and that run's status; the next request meets the fault.
        answered(&rig, 2);
        rig.driver.publish(|s| {
            s.faults.push(Fault {
                seq: 17,
                code: "camera_lost".into(),
                category: "camera".into(),
                message: "no answer".into(),
                recoverable: true,
                scheduler_action: SchedulerAction::PauseInstrument,
                operator_required: true,
                ends_by_itself: true,
                meaning: String::new(),
                what_to_do: "Check the cable.".into(),
                since: "2026-01-01T00:00:00Z".into(),
            });
        });
        answered(&rig, 3);
        rig.driver.publish(|s| {
            let results = vec![
                well("A01", Some(SpecimenOutcome::Skipped), Some("empty")),
                WellStatus { volume_um3: Some(2.5e8), volume_sd_um3: Some(1e6), ..well("A02", Some(SpecimenOutcome::Succeeded), None) },
            ];
            s.run = Some(run_of(results, Some(outcome)));
        });
        let output = watching.join().unwrap();
        let said = text(&output.stdout);
        assert_eq!(output.status.code(), Some(code), "{said} {}", text(&output.stderr));
        assert_eq!(said.matches("A01  larva of 3 dpf: skipped, empty\n").count(), 1, "{said}");
        assert_eq!(said.matches("A02  larva of 3 dpf: succeeded, 250.00 ± 1.00 (1 SD) nl (simulated)\n").count(), 1, "{said}");
        assert_eq!(said.matches("fault 17 camera_lost: no answer. What to do: Check the cable.\n").count(), 1, "{said}");
        assert!(said.contains("run r1 (simulated) has ended: "), "{said}");
    }
    let aborted = run_of(vec![well("A01", Some(SpecimenOutcome::Aborted), None)], Some(RunOutcome::Aborted));
    let rig = Rig::start();
    rig.driver.publish(|s| s.run = Some(aborted));
    let said = text(&carved(&url(&rig), &["run", "watch"]).stdout);
    assert!(said.contains("A01  larva of 3 dpf: aborted\n") && said.contains("1 wells: 1 not finished"), "{said}");
}

#[test]
fn the_status_is_said_in_words_or_as_it_is_served() {
    let rig = Rig::start();
    rig.driver.publish(|s| {
        (s.ready, s.not_ready_reason) = (false, Some("the camera is lost".into()));
        s.run = Some(run_of(vec![well("A01", None, None)], None));
    });
    let said = text(&carved(&url(&rig), &["run", "status"]).stdout);
    for line in ["Waiting for a run. (Idle)", "not ready: the camera is lost", "run r1 by kim, method standard: 1 wells: 1 to come"] {
        assert!(said.contains(line), "{said}");
    }
    rig.driver.publish(|s| {
        s.state = State::Held;
        let next_command = Some(NextCommand::Unhold);
        let hold = Hold {
            code: "operator".into(),
            cause: "it".into(),
            times: 1,
            next_action: None,
            next_command,
            fault_seq: None,
            next_try: None,
        };
        s.run = s.run.take().map(|run| RunStatus { hold: Some(hold), ..run });
    });
    let said = text(&carved(&url(&rig), &["run", "status"]).stdout);
    assert!(said.contains("next: `carved run unhold`\n"), "{said}");
    rig.driver.publish(|s| {
        let run = s.run.as_mut().and_then(|run| run.hold.as_mut()).unwrap();
        (run.next_command, run.fault_seq) = (Some(NextCommand::Acknowledge), Some(17));
    });
    let said = text(&carved(&url(&rig), &["run", "status"]).stdout);
    assert!(said.contains("next: `carved run acknowledge 17`\n"), "{said}");
    let served: serde_json::Value = serde_json::from_slice(&carved(&url(&rig), &["run", "status", "--json"]).stdout).unwrap();
    assert_eq!(served["schema"], "carved/status/1");
}

#[test]
fn the_lease_of_another_is_reported() {
    let (rig, map) = (Rig::start(), map_file(MAP));
    let lease = rig.put("/v1/lease", r#"{"holder": "the loader", "ttl_s": 600}"#).json();
    let locked = start(&url(&rig), &map, &["--method", "standard"]);
    assert_eq!(locked.status.code(), Some(1));
    assert!(text(&locked.stderr).contains("the loader"), "{}", text(&locked.stderr));
    let token = lease["token"].as_str().unwrap();
    assert_eq!(start(&url(&rig), &map, &["--method", "standard", "--lease", token]).status.code(), Some(0));
}

/// A server that gives one answer per connection; at `None` it closes the connection. The thread returns the requests.
fn scripted(answers: Vec<Option<String>>) -> (String, std::thread::JoinHandle<Vec<String>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let serving = std::thread::spawn(move || {
        let asked = answers.into_iter().map(|answer| {
            let (mut stream, _) = listener.accept().unwrap();
            let (mut request, mut piece) = (Vec::new(), [0; 4096]);
            let whole = |request: &[u8]| {
                let text = String::from_utf8_lossy(request).to_ascii_lowercase();
                let (head, body) = text.split_once("\r\n\r\n")?;
                let length = head.lines().find_map(|l| l.strip_prefix("content-length: ")).map_or(0, |n| n.parse().unwrap());
                (body.len() >= length).then_some(())
            };
            while whole(&request).is_none() {
                let read = stream.read(&mut piece).unwrap();
                assert!(read > 0, "the client hung up");
                request.extend_from_slice(&piece[..read]);
            }
            if let Some(answer) = answer {
                stream.write_all(answer.as_bytes()).unwrap();
            }
            text(&request)
        });
        asked.collect()
    });
    (url, serving)
}

fn answer(status: &str, headers: &str, body: &str) -> String {
    format!("HTTP/1.1 {status}\r\nConnection: close\r\n{headers}Content-Length: {}\r\n\r\n{body}", body.len())
}

const PROBLEM: &str = r#"{"type": "urn:carved:problem:x", "title": "t", "status": 503, "detail": "not now", "code": "x", "scheduler_action": "retry", "fault_seq": null}"#;

#[test]
fn what_can_be_asked_again_is_asked_again_as_it_was() {
    let taken = r#"{"run": "r1", "revision": 1}"#;
    let script = vec![None, Some(answer("503 Service Unavailable", "Retry-After: 0\r\n", PROBLEM)), Some(answer("201 Created", "", taken))];
    let (url, serving) = scripted(script);
    let output = start(&url, &map_file(MAP), &["--method", "standard", "--id", "r1"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let asked = serving.join().unwrap();
    assert!(asked[0].starts_with("PUT /v1/runs/r1 HTTP/1.1\r\n"), "{}", asked[0]);
    assert!(asked.iter().all(|one| *one == asked[0]), "{asked:?}");
}

#[test]
fn who_says_to_come_back_later_than_patience_lasts_is_not_pestered() {
    let (url, serving) = scripted(vec![Some(answer("503 Service Unavailable", "Retry-After: 3600\r\n", PROBLEM))]);
    let output = start(&url, &map_file(MAP), &["--method", "standard"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("not now"), "{}", text(&output.stderr));
    assert_eq!(serving.join().unwrap().len(), 1);
}

#[test]
fn another_program_at_the_address_and_none_are_distinguished() {
    let (url, serving) = scripted(vec![Some(answer("404 Not Found", "", "<html>"))]);
    let strange = carved(&url, &["run", "status"]);
    assert_eq!(strange.status.code(), Some(1));
    assert!(text(&strange.stderr).contains("another program"), "{}", text(&strange.stderr));
    serving.join().unwrap();
    let gone = carved(&url, &["run", "status", "--patience-s", "0"]);
    assert_eq!(gone.status.code(), Some(1));
    assert!(text(&gone.stderr).contains("does not answer"), "{}", text(&gone.stderr));
    let wrong = carved("https://127.0.0.1", &["run", "status"]);
    assert!(text(&wrong.stderr).contains("plain HTTP"), "{}", text(&wrong.stderr));
}
