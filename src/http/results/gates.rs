//! The bead gates that the rig has had: what a control chart shows.

use super::{json, read};
use crate::http::AppState;
use crate::http::problem::Problem;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use carved_core::quality::gate::{Chart, GateVerdict};
use carved_core::statistics::Spread;
use carved_store::gates::GateFile;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A quantity of a gate, with the limits that its earlier gates gave it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct GateQuantity {
    /// `diameter_um`, `aspect_ratio`, `sphere_rms_um`, `residual_px`, `uy_px` or `gamma_deg`.
    name: String,
    /// Mean of the beads.
    mean: f64,
    /// Standard deviation between the beads; `null` of a single one.
    sd: Option<f64>,
    /// Mean of the earlier gates; `null` while they are too few for a chart.
    history_mean: Option<f64>,
    /// Lower limit of the chart; `null` while the earlier gates are too few.
    lower_limit: Option<f64>,
    /// Upper limit of the chart; `null` while the earlier gates are too few.
    upper_limit: Option<f64>,
    /// Whether the value is outside of the limits.
    jumped: bool,
    /// Whether a cumulative sum is over its limit.
    drifted: bool,
}

/// A bead gate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct GateRow {
    id: String,
    rig: String,
    /// `hardware`, `simulated` or `imported`.
    mode: String,
    /// When the last of the beads was begun, RFC 3339, UTC.
    measured: String,
    /// `passed`, `no_history`, `too_few_beads` or `failed`.
    verdict: String,
    /// Whether specimens may be measured by it.
    passes: bool,
    beads: usize,
    /// Nominal mean diameter, um.
    nominal_um: f64,
    /// Whether the history begins anew with it.
    begins_history: bool,
    quantities: Vec<GateQuantity>,
}

/// The bead gates of the instrument.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct Gates {
    /// Oldest first.
    gates: Vec<GateRow>,
}

fn quantity(name: &str, found: Option<Spread>, charts: &[Chart]) -> Option<GateQuantity> {
    let Spread { mean, sd, .. } = found?;
    let chart = charts.iter().find(|chart| chart.name == name);
    Some(GateQuantity {
        name: name.into(),
        mean,
        sd,
        history_mean: chart.map(|chart| chart.history.mean),
        lower_limit: chart.map(|chart| chart.limits[0]),
        upper_limit: chart.map(|chart| chart.limits[1]),
        jumped: chart.is_some_and(|chart| chart.jumped),
        drifted: chart.is_some_and(|chart| chart.drifted),
    })
}

impl From<GateFile> for GateRow {
    fn from(file: GateFile) -> Self {
        let word = |value: serde_json::Value| value.as_str().unwrap_or_default().to_owned();
        let found = file.found;
        let (numbers, charts) = (&found.gate.numbers, &found.gate.charts);
        let all = [
            ("diameter_um", Some(numbers.diameter_um)),
            ("aspect_ratio", Some(numbers.aspect_ratio)),
            ("sphere_rms_um", Some(numbers.sphere_rms_um)),
            ("residual_px", numbers.residual_px),
            ("uy_px", numbers.uy_px),
            ("gamma_deg", numbers.gamma_deg),
        ];
        let verdict: GateVerdict = found.gate.verdict;
        Self {
            id: file.id,
            mode: word(serde_json::to_value(found.mode).unwrap_or_default()),
            measured: found.measured.to_string(),
            verdict: word(serde_json::to_value(verdict).unwrap_or_default()),
            passes: verdict.passes(),
            beads: numbers.beads,
            nominal_um: found.settings.nominal_um,
            begins_history: found.begins_history,
            quantities: all.into_iter().filter_map(|(name, spread)| quantity(name, spread, charts)).collect(),
            rig: found.rig,
        }
    }
}

/// The bead gates that are kept, with the charts on which each was judged.
#[utoipa::path(get, path = "/v1/bead-gates", tag = "results", responses(
    (status = 200, description = "All of them, oldest first", body = Gates),
    (status = 304, description = "The client has it"),
    (status = 500, description = "The folder of the calibrations cannot be read", body = Problem, content_type = "application/problem+json"),
))]
pub(in crate::http) async fn bead_gates(State(app): State<AppState>, headers: HeaderMap) -> Result<Response, Problem> {
    let gates = read(&app, carved_store::StoreReader::gates).await?;
    Ok(json(&headers, &Gates { gates: gates.into_iter().map(Into::into).collect() }))
}
