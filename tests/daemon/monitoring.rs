//! The files in `monitoring/`: Prometheus' own tool accepts rules and metrics, and each metric that they name exists. `monitoring/evaluate`
//! evaluates every query on a Prometheus.

use crate::common::Daemon;
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Metrics that only some instruments have at some times. `tests/http/reading.rs` has them.
const SOMETIMES: [&str; 4] = [
    "carved_calibration_measured_timestamp_seconds",
    "carved_calibration_max_age_seconds",
    "carved_faults",
    "carved_run_remaining_seconds",
];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("monitoring")
}

fn metrics(daemon: &Daemon) -> String {
    ureq::get(format!("{}/metrics", daemon.url)).call().unwrap().body_mut().read_to_string().unwrap()
}

/// Names of metrics in a text.
fn named(text: &str) -> BTreeSet<String> {
    let words = text.split(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
    words.filter(|word| word.starts_with("carved_")).map(str::to_owned).collect()
}

/// Each metric that the rules and the dashboard name is in the answer of this daemon, and promtool finds nothing wrong with the answer.
pub fn is_covered_by(daemon: &Daemon) {
    let text = metrics(daemon);
    let there: BTreeSet<String> =
        text.lines().filter(|line| !line.starts_with('#')).filter_map(|line| named(line).into_iter().next()).collect();
    let files = ["carved.rules.yml", "grafana-carved.json"].map(|file| std::fs::read_to_string(folder().join(file)).unwrap());
    let wanted: BTreeSet<String> = files.iter().flat_map(|file| named(file)).collect();
    assert!(wanted.len() > 20, "{wanted:?}");
    let missing: Vec<&String> = wanted.iter().filter(|name| !there.contains(*name) && !SOMETIMES.contains(&name.as_str())).collect();
    assert!(missing.is_empty(), "{missing:?} are not in\n{text}");
    if cfg!(has_promtool) {
        let mut lint = promtool(&["check", "metrics"]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        lint.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
        accepts(&lint.wait_with_output().unwrap());
    }
}

fn promtool(args: &[&str]) -> Command {
    let mut command = Command::new("promtool");
    command.args(args).current_dir(folder());
    command
}

fn accepts(output: &Output) {
    let said = [&output.stdout, &output.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(output.status.success(), "{}", said.join("\n"));
}

#[test]
#[cfg_attr(not(has_promtool), ignore = "no promtool: apt-get install prometheus")]
fn the_rules_are_sound_and_raise_their_alerts() {
    accepts(&promtool(&["check", "rules", "carved.rules.yml"]).output().unwrap());
    accepts(&promtool(&["test", "rules", "carved.rules.test.yml"]).output().unwrap());
    accepts(&promtool(&["check", "config", "prometheus.yml"]).output().unwrap());
    // Every alert has a case that raises it.
    let [rules, cases] = ["carved.rules.yml", "carved.rules.test.yml"].map(|file| std::fs::read_to_string(folder().join(file)).unwrap());
    for alert in rules.lines().filter_map(|line| line.trim().strip_prefix("- alert: ")) {
        assert!(cases.contains(&format!("alertname: {alert}\n")), "{alert} has no case");
    }
}

#[test]
fn names_of_metrics_are_found_in_queries() {
    let query = "sum by (instrument) (rate(carved_specimens_total{outcome=\"failed\"}[5m])) > carved_x";
    assert_eq!(named(query), ["carved_specimens_total", "carved_x"].map(str::to_owned).into());
}
