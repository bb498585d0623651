//! The queue of plates: each waits for its turn, and begins when the loader reports it as the next one.

use super::AppState;
use super::body::{self, Body};
use super::problem::Problem;
use super::runs::{Acknowledged, accepted, acknowledged, refused};
use super::safety::{Noted, noted};
use crate::api::RunPlan;
use crate::session::QueueChange;
use axum::Json;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::Response;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Body of `PUT /v1/queue`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct QueueOrder {
    /// The names of all queued runs, the next one first.
    runs: Vec<String>,
}

/// Body of `PUT /v1/plate/next`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct NextPlate {
    /// As it was read from the plate that is in its place now.
    barcode: String,
}

/// Queues a plate, or changes the plan of a queued one.
///
/// A new plate comes last. A changed one keeps its place. The queue is kept on disk, also over a restart. A repeated request with the same plan
/// is answered with 200 and changes nothing.
#[utoipa::path(
    put, path = "/v1/queue/{run_id}", tag = "commands", request_body = RunPlan,
    params(("run_id" = String, Path, description = "Name of the run: 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'")),
    responses(
        (status = 201, description = "The plate is queued", body = Acknowledged, headers(("Location" = String))),
        (status = 200, description = "The plan of the queued plate is this one now", body = Acknowledged),
        (status = 409, description = "The run is on disk already, its barcode is queued for another run, or the queue is full", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn put(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    Body(plan): Body<RunPlan, { body::PLATE_MAP }>,
) -> Result<Response, Problem> {
    let Path(run) = path?;
    let change = QueueChange::Put { run: run.clone(), plan };
    let done = app.session.change_queue(change).await.map_err(|refusal| refused(&app, refusal))?;
    Ok(accepted(&app, done, format!("/v1/queue/{run}"), run))
}

/// The plan of a queued plate.
#[utoipa::path(
    get, path = "/v1/queue/{run_id}", tag = "status", params(("run_id" = String, Path)),
    responses(
        (status = 200, description = "Its plan", body = RunPlan),
        (status = 400, description = "The path is malformed", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "No plate is queued for this run", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The daemon is about to end", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn get(State(app): State<AppState>, path: Result<Path<String>, PathRejection>) -> Result<Json<RunPlan>, Problem> {
    let Path(run) = path?;
    app.session.queued(run).await.map(Json).map_err(|refusal| refused(&app, refusal))
}

/// Takes a plate out of the queue.
///
/// A plate that has begun is not in the queue any more: 404.
#[utoipa::path(
    delete, path = "/v1/queue/{run_id}", tag = "commands", params(("run_id" = String, Path)),
    responses(
        (status = 200, description = "The plate is out of the queue", body = Acknowledged),
        (status = 404, description = "No plate is queued for this run", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn delete(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    body::within(&headers, body::SMALL)?;
    let Path(run) = path?;
    app.session.change_queue(QueueChange::Remove { run: run.clone() }).await.map_err(|refusal| refused(&app, refusal))?;
    Ok(acknowledged(&app, run))
}

/// Changes the order of the queue.
///
/// The body names every queued run once. If the queue has changed meanwhile, the request is refused and the order stays.
#[utoipa::path(
    put, path = "/v1/queue", tag = "commands", request_body = QueueOrder,
    responses(
        (status = 200, description = "The queue has this order", body = Noted),
        (status = 409, description = "These are not the queued runs", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn order(State(app): State<AppState>, Body(order): Body<QueueOrder, { body::SMALL }>) -> Result<Json<Noted>, Problem> {
    app.session.change_queue(QueueChange::Order { runs: order.runs }).await.map_err(|refusal| refused(&app, refusal))?;
    Ok(noted(&app))
}

/// The loader reports that the next plate is in its place, by the barcode that it has read.
///
/// If this is the next plate of the queue, its run begins as by `PUT /v1/runs/{run_id}`, and its entry leaves the queue. Another barcode is
/// refused with both names, and nothing changes. Any other refusal of the start leaves the plate in the queue too. A repeat while the run of
/// this plate is under way is answered with 200.
#[utoipa::path(
    put, path = "/v1/plate/next", tag = "commands", request_body = NextPlate,
    responses(
        (status = 201, description = "The run of the plate is on disk and will start", body = Acknowledged, headers(("Location" = String))),
        (status = 200, description = "The run of this plate is under way", body = Acknowledged),
        (status = 409, description = "Another plate is next, none is queued, or no run can start in the present state", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn next(State(app): State<AppState>, Body(plate): Body<NextPlate, { body::SMALL }>) -> Result<Response, Problem> {
    let (run, done) = app.session.next_plate(plate.barcode).await.map_err(|refusal| refused(&app, refusal))?;
    Ok(accepted(&app, done, format!("/v1/runs/{run}"), run))
}
