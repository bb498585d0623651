//! `GET /metrics`: the snapshot, the counts of events and the number of answered requests in Prometheus' format.
//!
//! Each scrape makes a new registry from one snapshot, so that its numbers are consistent.

use super::AppState;
use super::problem::Problem;
use crate::api::{CalibrationStatus, InstrumentIdentity, State, Status};
use crate::notify::{Counts, Notices, needs_somebody};
use axum::extract::{self, MatchedPath, Request};
use axum::http::{HeaderMap, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use carved_records::BeadGate;
use prometheus_client::metrics::counter::{ConstCounter, Counter};
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::{ConstGauge, Gauge};
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::{Registry, Unit};
use std::collections::BTreeMap;

type Label = [(&'static str, String); 1];

/// Number of answered requests, by method, route and status.
pub(super) type Requests = Family<[(&'static str, String); 3], Counter>;

/// Counts a request under the pattern of its route, not its path, so that clients cannot make the table grow.
pub(super) async fn count(extract::State(app): extract::State<AppState>, request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>().map_or("unmatched", MatchedPath::as_str).to_owned();
    let method = match *request.method() {
        Method::GET | Method::HEAD | Method::PUT | Method::POST | Method::DELETE => request.method().to_string(),
        _ => "other".into(),
    };
    let response = next.run(request).await;
    let labels = [("method", method), ("route", route), ("status", response.status().as_u16().to_string())];
    app.requests.get_or_create(&labels).inc();
    response
}

const OPEN_METRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
const PROMETHEUS: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Counters, gauges and histograms of the instrument and of this server, in the form that the client accepts: that of OpenMetrics, or the
/// older one of Prometheus.
#[utoipa::path(
    get, path = "/metrics", tag = "health",
    responses((status = 200, description = "Metrics of Prometheus, or OpenMetrics where the client accepts it", content(
        (String = "text/plain"), (String = "application/openmetrics-text"),
    )))
)]
pub(super) async fn get(extract::State(app): extract::State<AppState>, headers: HeaderMap) -> Result<Response, Problem> {
    let status = app.session.status();
    // Also on each series and not only in an info metric: tables and graphs then have the name that is in the records, whatever the label
    // of the target is in Prometheus.
    let instrument = ("instrument".into(), status.instrument.name.clone().into());
    let mut registry = Registry::with_prefix_and_labels("carved", std::iter::once(instrument));
    describe(&mut registry, &status);
    describe_calibration(&mut registry, status.calibration.as_ref(), is_gated(app.session.methods()));
    app.session.events().tally().register(&mut registry);
    describe_notices(&mut registry, &app.session.notices().map(Notices::counts).unwrap_or_default());
    registry.register("http_requests", "Requests answered", app.requests.clone());
    let mut text = String::new();
    prometheus_client::encoding::text::encode(&mut text, &registry)
        .map_err(|why| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "metrics", why.to_string()))?;
    let accepts = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    if accepts.into_iter().any(|accepted| accepted.contains("application/openmetrics-text")) {
        return Ok(([(header::CONTENT_TYPE, OPEN_METRICS)], text).into_response());
    }
    Ok(([(header::CONTENT_TYPE, PROMETHEUS)], older(&text)).into_response())
}

/// OpenMetrics text in the older form of Prometheus: a counter and an info have the suffix of their samples in their descriptions, too.
fn older(text: &str) -> String {
    let kinds: BTreeMap<&str, &str> = text.lines().filter_map(|line| line.strip_prefix("# TYPE ")?.split_once(' ')).collect();
    let mut lines = String::new();
    for line in text.lines().filter(|line| !line.starts_with("# UNIT ") && *line != "# EOF") {
        let described = ["# HELP ", "# TYPE "].iter().find_map(|what| Some((what, line.strip_prefix(what)?.split_once(' ')?)));
        let Some((what, (name, rest))) = described else {
            lines += line;
            lines.push('\n');
            continue;
        };
        let (suffix, kind) = match kinds.get(name) {
            Some(&"counter") => ("_total", "counter"),
            Some(&"info") => ("_info", "gauge"),
            Some(kind) => ("", *kind),
            None => ("", "untyped"),
        };
        let rest = if *what == "# TYPE " { kind } else { rest };
        lines += &format!("{what}{name}{suffix} {rest}\n");
    }
    lines
}

/// The JSON name of a value, so that both interfaces use the same names.
fn word(value: impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

fn describe(registry: &mut Registry, status: &Status) {
    registry.register("build", "Version of the daemon", Info::new([("version", status.version.clone()), ("mode", word(status.mode))]));
    let InstrumentIdentity { name: _, serial, location, uuid } = status.instrument.clone();
    let of_instrument = [("serial", serial.unwrap_or_default()), ("location", location.unwrap_or_default()), ("uuid", uuid)];
    registry.register("instrument", "Identity of the instrument", Info::new(of_instrument));
    let states: Family<Label, Gauge> = Family::default();
    for state in State::ALL {
        states.get_or_create(&[("state", word(state))]).set(i64::from(state == status.state));
    }
    registry.register("state", "1 for the state that the instrument is in, 0 for the others", states);
    gauge(registry, "needs_person", "Whether a person has to do something", i64::from(needs_somebody(status)));
    gauge(registry, "ready", "Whether a run would start now", i64::from(status.ready));
    gauge(registry, "status_revision", "Revision of the status", status.revision as i64);
    let faults: Family<Label, Gauge> = Family::default();
    for fault in &status.faults {
        faults.get_or_create(&[("code", fault.code.clone())]).inc();
    }
    registry.register("faults", "Faults that stand, by code", faults);
    let uptime = ConstGauge::new(status.uptime_s);
    registry.register_with_unit("uptime", "Time since the daemon started", Unit::Seconds, uptime);
    describe_run(registry, status);
    describe_hardware(registry, status);
}

/// Whether a method asks for a bead gate.
fn is_gated(methods: &BTreeMap<String, carved_records::Method>) -> bool {
    methods.values().any(|method| method.policy.bead_gate != BeadGate::Off)
}

fn gauge(registry: &mut Registry, name: &str, help: &str, value: i64) {
    registry.register(name, help, ConstGauge::new(value));
}

fn describe_run(registry: &mut Registry, status: &Status) {
    let wells: Family<Label, Gauge> = Family::default();
    let w = status.run.as_ref().map(|run| run.wells).unwrap_or_default();
    for (outcome, count) in [
        ("succeeded", w.succeeded),
        ("flagged", w.flagged),
        ("failed", w.failed),
        ("skipped", w.skipped),
        ("interrupted", w.interrupted),
        ("pending", w.pending),
    ] {
        wells.get_or_create(&[("outcome", outcome.into())]).set(i64::from(count));
    }
    registry.register("run_wells", "Wells of the run by outcome", wells);
    let is_open = status.run.as_ref().is_some_and(|run| run.outcome.is_none());
    gauge(registry, "run_open", "Whether a run has no outcome yet", i64::from(is_open));
    let remaining = status.run.as_ref().and_then(|run| run.eta_s).map(|eta| eta.p50);
    seconds(registry, "run_remaining", "Estimate of the time until the run is done", remaining);
    if let Some(specimen) = &status.specimen {
        gauge(registry, "specimen_views", "Views taken of the specimen in the capillary", i64::from(specimen.view));
        gauge(registry, "specimen_views_planned", "Views that its revolution has", i64::from(specimen.views_planned));
        if let Some(volume) = specimen.volume_um3 {
            let unit = Unit::Other("um3".into());
            registry.register_with_unit("specimen_volume", "Best estimate of the volume so far", unit, ConstGauge::new(volume));
        }
    }
}

/// Times are those of the measurement, and not ages: Prometheus computes the age with `time()` at any later moment. A bead gate that no method
/// asks for is left out, because nobody measures it again when it is too old.
fn describe_calibration(registry: &mut Registry, calibration: Option<&CalibrationStatus>, is_gated: bool) {
    // A gate without a calibration is told as a calibration of the kind `gate`.
    let size = calibration.filter(|c| c.kind != "gate");
    gauge(registry, "calibration_valid", "Whether the rig has a calibration that is not too old", i64::from(size.is_some_and(|c| c.valid)));
    if let Some(c) = size {
        seconds(registry, "calibration_measured_timestamp", "When the calibration was measured", timestamp(&c.measured));
        seconds(registry, "calibration_max_age", "Age at which the calibration expires", Some(c.max_age_s));
    }
    if !is_gated {
        return;
    }
    let gate = calibration.and_then(|c| c.gate.as_ref());
    gauge(
        registry,
        "bead_gate_valid",
        "Whether the newest bead gate was passed and is not too old",
        i64::from(gate.is_some_and(|g| g.stands)),
    );
    if let Some(gate) = gate {
        seconds(registry, "bead_gate_measured_timestamp", "When the newest bead gate was measured", timestamp(&gate.measured));
        seconds(registry, "bead_gate_max_age", "Age at which the bead gate expires", Some(gate.max_age_s));
    }
}

/// A gauge in seconds. Not there without a value.
fn seconds(registry: &mut Registry, name: &str, help: &str, value: Option<f64>) {
    if let Some(value) = value {
        registry.register_with_unit(name, help, Unit::Seconds, ConstGauge::new(value));
    }
}

/// Seconds since 1970 of a time in RFC 3339.
fn timestamp(time: &str) -> Option<f64> {
    time.parse::<jiff::Timestamp>().ok().map(|time| time.as_millisecond() as f64 / 1e3)
}

fn describe_notices(registry: &mut Registry, counts: &Counts) {
    for (name, help, value) in [
        ("notices_delivered", "Notices that the receiver took", counts.delivered),
        ("notices_dropped", "Notices that are lost", counts.dropped),
        ("notice_failures", "Attempts to deliver a notice that failed", counts.failed_attempts),
    ] {
        registry.register(name, help, ConstCounter::new(value));
    }
    gauge(registry, "notices_waiting", "Notices that are not delivered yet", counts.waiting as i64);
    gauge(registry, "notices_failing", "Whether notices do not reach their receiver", i64::from(counts.is_failing));
}

fn describe_hardware(registry: &mut Registry, status: &Status) {
    let camera = &status.hardware.camera;
    gauge(registry, "camera_connected", "Whether the camera is there", i64::from(camera.connected));
    gauge(registry, "rotation_connected", "Whether the rotation axis is there", i64::from(status.hardware.rotation.connected));
    gauge(registry, "rotation_referenced", "Whether its position is known", i64::from(status.hardware.rotation.referenced));
    let counters = [
        ("camera_frames_completed", "Whole frames received", camera.completed_frames),
        ("camera_frames_failed", "Frames lost", camera.failed_frames),
        ("camera_packets_missing", "Packets that never came", camera.missing_packets),
        ("camera_packets_resent", "Packets that were sent again", camera.resent_packets),
        ("camera_packets_ignored", "Packets that were of no use", camera.ignored_packets),
    ];
    for (name, help, value) in counters {
        registry.register(name, help, ConstCounter::new(value));
    }
    if let Some(light) = &camera.light {
        registry.register("camera_background", "Median of the newest frame, 0 to 255", ConstGauge::new(light.background));
        registry.register_with_unit(
            "camera_saturated",
            "Share of the saturated pixels, which are at the maximum of 255",
            Unit::Other("ratio".into()),
            ConstGauge::new(light.saturated),
        );
        registry.register("camera_focus", "Sharpness of the newest frame", ConstGauge::new(light.focus));
    }
    gauge(
        registry,
        "index_behind",
        "Whether the index lacks something that is on disk",
        i64::from(status.hardware.index_trouble.is_some()),
    );
    if let Some(free) = status.hardware.disk_free_bytes {
        registry.register_with_unit("disk_free", "Space left for recordings", Unit::Bytes, ConstGauge::new(free as i64));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bead_gate_that_no_method_asks_for_is_no_metric() {
        let text = |policies: [BeadGate; 2]| {
            let methods = policies.map(|bead_gate| {
                let mut method: carved_records::Method =
                    serde_json::from_str(r#"{"asd": 21, "order": "coarse_to_fine", "epsilon": 0.05, "voxel_um": 6.93}"#).unwrap();
                method.policy.bead_gate = bead_gate;
                (format!("{bead_gate:?}"), method)
            });
            let mut registry = Registry::default();
            describe_calibration(&mut registry, None, is_gated(&methods.into()));
            let mut text = String::new();
            prometheus_client::encoding::text::encode(&mut text, &registry).unwrap();
            text
        };
        let asked = text([BeadGate::Off, BeadGate::Flag]);
        assert!(asked.lines().any(|line| line == "bead_gate_valid 0"), "{asked}");
        let off = text([BeadGate::Off, BeadGate::Off]);
        assert!(off.contains("calibration_valid 0") && !off.contains("bead_gate"), "{off}");
    }
}
