//! Statistics of a run, which the page draws.

use super::{json, read, unknown_run};
use crate::http::AppState;
use crate::http::problem::Problem;
use crate::tables::statistics::{Flagged, Statistics};
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::Deserialize;
use utoipa::IntoParams;

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct Counted {
    /// Which specimens with flags count: `sound` (no bound, nothing doubtful), `included` (all) or `excluded` (none).
    #[serde(default)]
    #[param(required = false, inline)]
    flagged: Flagged,
}

/// Statistics of a run: groups of wells that were treated alike, compounds, Z' of the controls, and dose-response curves.
#[utoipa::path(get, path = "/v1/runs/{run_id}/statistics", tag = "results", params(("run_id" = String, Path), Counted), responses(
    (status = 200, description = "By quantity", body = Statistics),
    (status = 304, description = "The client has it"),
))]
pub(in crate::http) async fn of_run(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    query: Result<Query<Counted>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let (Path(id), Query(Counted { flagged })) = (path?, query?);
    let name = id.clone();
    let made = read(&app, move |store| Ok(store.stored_run(&name)?.map(|run| Statistics::of(&[run], flagged))));
    let statistics = made.await?.ok_or_else(|| unknown_run(&id))?;
    Ok(json(&headers, &statistics))
}
