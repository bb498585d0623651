//! `GET /metrics`: the snapshot in Prometheus' format, and the number of answered requests.
//!
//! Each scrape makes a new registry from one snapshot, so that its numbers are consistent.

use super::AppState;
use super::problem::Problem;
use crate::api::Status;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use prometheus_client::metrics::counter::{ConstCounter, Counter};
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::{ConstGauge, Gauge};
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::{Registry, Unit};

type Label = [(&'static str, String); 1];

/// Number of answered requests, by method, route and status.
pub(super) type Requests = Family<[(&'static str, String); 3], Counter>;

/// Counts a request under the pattern of its route, not its path, so that clients cannot make the table grow.
pub(super) async fn count(State(app): State<AppState>, request: Request, next: Next) -> Response {
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

/// Counters and gauges of the instrument and of this server.
#[utoipa::path(get, path = "/metrics", tag = "health", responses((status = 200, description = "OpenMetrics text", body = String, content_type = "application/openmetrics-text")))]
pub(super) async fn get(State(app): State<AppState>) -> Result<Response, Problem> {
    let mut registry = Registry::with_prefix("carved");
    describe(&mut registry, &app.session.status());
    registry.register("http_requests", "Requests answered", app.requests.clone());
    let mut text = String::new();
    prometheus_client::encoding::text::encode(&mut text, &registry)
        .map_err(|why| Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "metrics", why.to_string()))?;
    Ok(([(header::CONTENT_TYPE, "application/openmetrics-text; version=1.0.0; charset=utf-8")], text).into_response())
}

/// The JSON name of a value, so that both interfaces use the same names.
fn word(value: impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

fn describe(registry: &mut Registry, status: &Status) {
    registry.register("build", "Version of the daemon", Info::new([("version", status.version.clone()), ("mode", word(status.mode))]));
    let state: Family<Label, Gauge> = Family::default();
    state.get_or_create(&[("state", word(status.state))]).set(1);
    registry.register("state", "1 for the state that the instrument is in", state);
    gauge(registry, "ready", "Whether a run would start now", i64::from(status.ready));
    gauge(registry, "status_revision", "Revision of the status", status.revision as i64);
    gauge(registry, "faults", "Faults that stand", status.faults.len() as i64);
    let uptime = ConstGauge::new(status.uptime_s);
    registry.register_with_unit("uptime", "Time since the daemon started", Unit::Seconds, uptime);
    describe_run(registry, status);
    describe_hardware(registry, status);
}

fn gauge(registry: &mut Registry, name: &str, help: &str, value: i64) {
    registry.register(name, help, ConstGauge::new(value));
}

fn describe_run(registry: &mut Registry, status: &Status) {
    let wells: Family<Label, Gauge> = Family::default();
    if let Some(run) = &status.run {
        let w = run.wells;
        let counts = [
            ("succeeded", w.succeeded),
            ("flagged", w.flagged),
            ("failed", w.failed),
            ("skipped", w.skipped),
            ("interrupted", w.interrupted),
            ("pending", w.pending),
        ];
        for (outcome, count) in counts {
            wells.get_or_create(&[("outcome", outcome.into())]).set(i64::from(count));
        }
    }
    registry.register("run_wells", "Wells of the run by outcome", wells);
    if let Some(specimen) = &status.specimen {
        gauge(registry, "specimen_views", "Views taken of the specimen in the capillary", i64::from(specimen.view));
        gauge(registry, "specimen_views_planned", "Views that its revolution has", i64::from(specimen.views_planned));
        if let Some(volume) = specimen.volume_um3 {
            let unit = Unit::Other("um3".into());
            registry.register_with_unit("specimen_volume", "Best estimate of the volume so far", unit, ConstGauge::new(volume));
        }
    }
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
        let percent = Unit::Other("percent".into());
        registry.register("camera_background", "Median of the newest frame, 0 to 255", ConstGauge::new(light.background));
        registry.register_with_unit("camera_saturated", "Pixels at the top", percent, ConstGauge::new(light.saturated * 100.0));
        registry.register("camera_focus", "Sharpness of the newest frame", ConstGauge::new(light.focus));
    }
    if let Some(free) = status.hardware.disk_free_bytes {
        registry.register_with_unit("disk_free", "Space left for recordings", Unit::Bytes, ConstGauge::new(free as i64));
    }
}
