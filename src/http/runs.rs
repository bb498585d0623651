//! Commands: each is answered after the driver has written it to the journal or refused it. All may be repeated.

use super::AppState;
use super::body::{self, Body};
use super::problem::Problem;
use crate::api::RunPlan;
use crate::session::{Accepted, Refusal, Towards};
use axum::Json;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use carved_records::is_plain_name;
use carved_records::plate_map::Mistake;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// The command was taken; the status from this revision on shows what became of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct Acknowledged {
    run: String,
    revision: u64,
}

/// Body of `PUT /v1/runs/{run_id}/wells/{well}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct WellLoaded {
    /// `true`: the specimen of this well is in the capillary; `false`: it has been taken out.
    loaded: bool,
}

pub(super) fn refused(app: &AppState, refusal: Refusal) -> Problem {
    Problem::refused(refusal, &app.session.status())
}

fn acknowledged(app: &AppState, run: String) -> Json<Acknowledged> {
    Json(Acknowledged { run, revision: app.session.status().revision })
}

/// Registers a run under the client's own name for it, and starts it.
///
/// The answer comes after the plan is on disk. The same plan again answers 200 and changes nothing.
#[utoipa::path(
    put, path = "/v1/runs/{run_id}", tag = "commands", request_body = RunPlan,
    params(("run_id" = String, Path, description = "1 to 64 letters, digits, '-', '_' or '.', the first not a '.'")),
    responses(
        (status = 201, description = "The run is on disk and will start", body = Acknowledged, headers(("Location" = String))),
        (status = 200, description = "This very run had been taken before", body = Acknowledged),
        (status = 409, description = "Another plan has this name, or the state does not accept it", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The store, a device or the daemon cannot take it now", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "The disk is full, or the plate will not fit on it", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn put(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    Body(plan): Body<RunPlan, { body::PLATE_MAP }>,
) -> Result<Response, Problem> {
    let Path(id) = path?;
    if !is_plain_name(&id) {
        let detail = format!("{id:?} is not a run id: use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'");
        return Err(Problem { detail, ..Problem::unprocessable("invalid_run_id", Vec::<Mistake>::new()) });
    }
    let accepted = app.session.put_run(id.clone(), plan).await.map_err(|refusal| refused(&app, refusal))?;
    let location = format!("/v1/runs/{id}");
    let body = acknowledged(&app, id);
    Ok(match accepted {
        Accepted::Created => (StatusCode::CREATED, [("location", location)], body).into_response(),
        Accepted::Same => body.into_response(),
    })
}

/// The command is in the path. A body is not read, so that an abort does not wait for a slow client.
async fn steer(
    app: &AppState,
    path: Result<Path<String>, PathRejection>,
    headers: &HeaderMap,
    towards: Towards,
) -> Result<Json<Acknowledged>, Problem> {
    body::within(headers, body::SMALL)?;
    let Path(id) = path?;
    app.session.steer(id.clone(), towards).await.map_err(|refusal| refused(app, refusal))?;
    Ok(acknowledged(app, id))
}

/// Holds a run once the specimen under way is done.
///
/// Answered at once; the state goes by Holding to Held. A repeat answers 200.
#[utoipa::path(
    post, path = "/v1/runs/{run_id}/hold", tag = "commands", params(("run_id" = String, Path)),
    responses(
        (status = 200, description = "The run is held, or will be", body = Acknowledged),
    )
)]
pub(super) async fn hold(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    steer(&app, path, &headers, Towards::Hold).await
}

/// Lets a held run go on at the well where it is.
///
/// Refused while the fault that held it stands. A repeat answers 200.
#[utoipa::path(
    post, path = "/v1/runs/{run_id}/unhold", tag = "commands", params(("run_id" = String, Path)),
    responses(
        (status = 200, description = "The run continues, or had continued", body = Acknowledged),
    )
)]
pub(super) async fn unhold(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    steer(&app, path, &headers, Towards::Unhold).await
}

/// Ends a run once the specimen under way is done.
///
/// Answered at once; the wells that are left end as aborted. A repeat answers 200.
#[utoipa::path(
    post, path = "/v1/runs/{run_id}/stop", tag = "commands", params(("run_id" = String, Path)),
    responses(
        (status = 200, description = "The run ends, or had been stopped", body = Acknowledged),
    )
)]
pub(super) async fn stop(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    steer(&app, path, &headers, Towards::Stop).await
}

/// Ends a run; motors stop before anything else happens.
///
/// Acknowledged at once; the run ends when its record is closed: at most 60 s later, and the method's `deadlines_s.measure` for each
/// specimen that was let go and has no numbers yet. A repeat answers 200.
#[utoipa::path(
    post, path = "/v1/runs/{run_id}/abort", tag = "commands", params(("run_id" = String, Path)),
    responses(
        (status = 200, description = "The run ends, or had ended", body = Acknowledged),
    )
)]
pub(super) async fn abort(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    steer(&app, path, &headers, Towards::Abort).await
}

/// The loader says that the specimen of this well is in the capillary, or has been taken out.
///
/// What it was asked for is taken whatever has become of the run since: held, it stays inside and is used when the run continues; ended, it
/// is known to be inside until it is said to be out. A repeat answers 200.
#[utoipa::path(
    put, path = "/v1/runs/{run_id}/wells/{well}", tag = "commands", request_body = WellLoaded,
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`")),
    responses(
        (status = 200, description = "The word is taken, or was before", body = Acknowledged),
        (status = 404, description = "No such run", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "Nobody asked for this well, or another is inside: `detail` has the word that is waited for", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn loaded(
    State(app): State<AppState>,
    path: Result<Path<(String, String)>, PathRejection>,
    Body(said): Body<WellLoaded, { body::SMALL }>,
) -> Result<Json<Acknowledged>, Problem> {
    let Path((run, well)) = path?;
    app.session.loaded(run.clone(), well, said.loaded).await.map_err(|refusal| refused(&app, refusal))?;
    Ok(acknowledged(&app, run))
}
