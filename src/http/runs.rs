//! Commands: each is answered after the driver has written it to the journal or refused it. All may be repeated.

use super::AppState;
use super::body::{self, Body};
use super::lease;
use super::pace::Peer;
use super::problem::Problem;
use crate::api::RunPlan;
use crate::session::{Accepted, Refusal, Said, Towards};
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{FromRequestParts, Path, Query, State};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use carved_records::plate_map::Mistake;
use carved_records::{Asked, SaidBy, WellNote, is_plain_name};
use serde::{Deserialize, Serialize};
use std::convert::Infallible;
use utoipa::{IntoParams, ToSchema};

/// The command was accepted. The status shows its effect from this revision on.
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

/// Body of `PUT /v1/runs/{run_id}/wells/{well}/note`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct NoteOnWell {
    /// Name of the person.
    #[schema(max_length = 64, pattern = r"\S")]
    by: String,
    /// Whether statistics leave the well out. Its numbers stay.
    #[serde(default)]
    excluded: bool,
    /// The reason of an exclusion, which needs one, or any remark.
    #[serde(default)]
    #[schema(max_length = 1000)]
    comment: String,
    /// Words to find wells by.
    #[serde(default)]
    #[schema(max_items = 16)]
    tags: Vec<String>,
}

/// Who sends a command.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub(super) struct By {
    /// Name of the person, for the events of the run; its first 64 characters count. Without it nobody is named.
    by: Option<String>,
}

impl By {
    /// The first 64 characters of the name, without control characters and white space around it. No command is refused for its label: an
    /// empty name, and a query that cannot be read, name nobody.
    fn name(by: Result<Query<Self>, QueryRejection>) -> Option<String> {
        let name: String = by.ok()?.0.by?.chars().filter(|c| !c.is_control()).take(64).collect();
        Some(name.trim().to_owned()).filter(|name| !name.is_empty())
    }
}

/// Who asks, and from where: for the events of the run.
pub(super) struct Asking(pub Asked);

impl FromRequestParts<AppState> for Asking {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Self, Infallible> {
        let by = By::name(Query::try_from_uri(&parts.uri));
        let address = parts.extensions.get::<Peer>().map(|peer| match peer.0 {
            own if own.is_loopback() => "the instrument's computer".to_owned(),
            other => other.to_string(),
        });
        let from = address.map(|address| match lease::holder(app, &parts.headers) {
            Some(holder) => format!("{address}, with the lease of {holder}"),
            None => address,
        });
        Ok(Self(Asked { by, from }))
    }
}

pub(super) fn refused(app: &AppState, refusal: Refusal) -> Problem {
    Problem::refused(refusal, &app.session.status())
}

pub(super) fn acknowledged(app: &AppState, run: String) -> Json<Acknowledged> {
    Json(Acknowledged { run, revision: app.session.status().revision })
}

/// The answer to a request that creates something at `location`, or finds it there.
pub(super) fn accepted(app: &AppState, accepted: Accepted, location: String, run: String) -> Response {
    let body = acknowledged(app, run);
    match accepted {
        Accepted::Created => (StatusCode::CREATED, [("location", location)], body).into_response(),
        Accepted::Same => body.into_response(),
    }
}

/// Registers a run under a name that the client chooses, and starts it.
///
/// The answer is sent once the plan is on disk. A repeated request with the same plan is answered with 200 and changes nothing.
#[utoipa::path(
    put, path = "/v1/runs/{run_id}", tag = "commands", request_body = RunPlan,
    params(("run_id" = String, Path, description = "1 to 64 letters, digits, '-', '_' or '.', the first not a '.'")),
    responses(
        (status = 201, description = "The run is on disk and will start", body = Acknowledged, headers(("Location" = String))),
        (status = 200, description = "The run was accepted before with the same plan", body = Acknowledged),
        (status = 409, description = "A run with another plan has this name, or no run can start in the present state", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The disk, a device or the daemon cannot start a run now", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "The disk is full, or has no room for this plate", body = Problem, content_type = "application/problem+json"),
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
    let done = app.session.put_run(id.clone(), plan).await.map_err(|refusal| refused(&app, refusal))?;
    Ok(accepted(&app, done, format!("/v1/runs/{id}"), id))
}

/// The command is in the path. A body is not read, so that an abort does not wait for a slow client.
async fn steer(
    app: &AppState,
    path: Result<Path<String>, PathRejection>,
    Asking(asked): Asking,
    headers: &HeaderMap,
    towards: Towards,
) -> Result<Json<Acknowledged>, Problem> {
    body::within(headers, body::SMALL)?;
    let Path(id) = path?;
    app.session.steer(id.clone(), towards, asked).await.map_err(|refusal| refused(app, refusal))?;
    Ok(acknowledged(app, id))
}

/// Holds a run after the current specimen.
///
/// The answer is sent at once. The state is Holding until the specimen is done, and then Held. A repeated request is answered with 200.
#[utoipa::path(
    post, path = "/v1/runs/{run_id}/hold", tag = "commands", params(("run_id" = String, Path), By),
    responses(
        (status = 200, description = "The run is held, or will be", body = Acknowledged),
    )
)]
pub(super) async fn hold(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    asking: Asking,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    steer(&app, path, asking, &headers, Towards::Hold).await
}

/// Continues a held run at its current well.
///
/// The request is refused while the fault that held the run is open. A repeated request is answered with 200.
#[utoipa::path(
    post, path = "/v1/runs/{run_id}/unhold", tag = "commands", params(("run_id" = String, Path), By),
    responses(
        (status = 200, description = "The run continues, or continued already", body = Acknowledged),
    )
)]
pub(super) async fn unhold(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    asking: Asking,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    steer(&app, path, asking, &headers, Towards::Unhold).await
}

/// Ends a run after the current specimen.
///
/// The answer is sent at once. The remaining wells end with the outcome `aborted`. A repeated request is answered with 200.
#[utoipa::path(
    post, path = "/v1/runs/{run_id}/stop", tag = "commands", params(("run_id" = String, Path), By),
    responses(
        (status = 200, description = "The run will end, or was stopped already", body = Acknowledged),
    )
)]
pub(super) async fn stop(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    asking: Asking,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    steer(&app, path, asking, &headers, Towards::Stop).await
}

/// Aborts a run. The motors are stopped first.
///
/// The answer is sent at once. The run ends when its record is closed. This takes at most 60 s, and in addition the method's
/// `deadlines_s.measure` for each specimen that was released and has no numbers yet. A repeated request is answered with 200.
#[utoipa::path(
    post, path = "/v1/runs/{run_id}/abort", tag = "commands", params(("run_id" = String, Path), By),
    responses(
        (status = 200, description = "The run will end, or has ended", body = Acknowledged),
    )
)]
pub(super) async fn abort(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    asking: Asking,
    headers: HeaderMap,
) -> Result<Json<Acknowledged>, Problem> {
    steer(&app, path, asking, &headers, Towards::Abort).await
}

/// The loader reports that the specimen of this well is in the capillary, or that it was taken out.
///
/// The report of a specimen that carved requested is accepted also if the run was held or has ended since the request. In a held run the
/// specimen stays in the capillary and is measured when the run continues. After the end of the run, carved treats it as inside until the
/// loader reports that it is out. A repeated request is answered with 200.
#[utoipa::path(
    put, path = "/v1/runs/{run_id}/wells/{well}", tag = "commands", request_body = WellLoaded,
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`")),
    responses(
        (status = 200, description = "The report is accepted, or was accepted before", body = Acknowledged),
        (status = 404, description = "No such run", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "carved did not request this well, or another specimen is inside: `detail` states the report that carved expects", body = Problem, content_type = "application/problem+json"),
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

/// Answers a message about a well once it is on disk.
async fn about_well(
    app: &AppState,
    path: Result<Path<(String, String)>, PathRejection>,
    said: Said,
) -> Result<Json<Acknowledged>, Problem> {
    let Path((run, well)) = path?;
    app.session.said(run.clone(), well, said).await.map_err(|refusal| refused(app, refusal))?;
    Ok(acknowledged(app, run))
}

/// Leaves a well out of a held run.
///
/// The well ends with the outcome `skipped` and the name and reason of the person. A specimen of it that is inside must leave before the run
/// continues. A repeated request is answered with 200.
#[utoipa::path(
    put, path = "/v1/runs/{run_id}/wells/{well}/skip", tag = "commands", request_body = SaidBy,
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`")),
    responses(
        (status = 200, description = "The well is skipped, or was before", body = Acknowledged),
        (status = 404, description = "No such run", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The run is not held, or the well has an outcome", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn skip(
    State(app): State<AppState>,
    path: Result<Path<(String, String)>, PathRejection>,
    Body(says): Body<SaidBy, { body::SMALL }>,
) -> Result<Json<Acknowledged>, Problem> {
    about_well(&app, path, Said::Skip(says)).await
}

/// Has a well of a held run measured again when the run continues.
///
/// Its files stay as those of an earlier attempt, and its numbers are taken out of the record. A well without an outcome is answered with 200.
#[utoipa::path(
    put, path = "/v1/runs/{run_id}/wells/{well}/redo", tag = "commands", request_body = SaidBy,
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`")),
    responses(
        (status = 200, description = "The well will be measured", body = Acknowledged),
        (status = 404, description = "No such run", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The run is not held, or the sampler cannot bring the specimen again", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn redo(
    State(app): State<AppState>,
    path: Result<Path<(String, String)>, PathRejection>,
    Body(says): Body<SaidBy, { body::SMALL }>,
) -> Result<Json<Acknowledged>, Problem> {
    about_well(&app, path, Said::Redo(says)).await
}

/// Writes a person's remark on a well, also of a run that has ended.
///
/// It replaces the remark before it; the events of the run keep all. `excluded` gives the well the flag `excluded`, with which statistics leave
/// it out. The numbers stay. A repeated request changes nothing.
#[utoipa::path(
    put, path = "/v1/runs/{run_id}/wells/{well}/note", tag = "commands", request_body = NoteOnWell,
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`")),
    responses(
        (status = 200, description = "The remark is on disk", body = Acknowledged),
        (status = 404, description = "No such run", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The run has no such well", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn note(
    State(app): State<AppState>,
    path: Result<Path<(String, String)>, PathRejection>,
    Body(NoteOnWell { by, excluded, comment, tags }): Body<NoteOnWell, { body::SMALL }>,
) -> Result<Json<Acknowledged>, Problem> {
    let time = jiff::Timestamp::now().to_string();
    about_well(&app, path, Said::Note(WellNote { by, time, excluded, comment, tags })).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_command_is_refused_for_the_name_of_who_sends_it() {
        let name = |query: &str| By::name(Query::try_from_uri(&format!("/v1/runs/r/abort{query}").parse().unwrap()));
        assert_eq!(name("?by=%20kim%0A"), Some("kim".into()));
        assert_eq!(name(&format!("?by={}", "n".repeat(70))), Some("n".repeat(64)));
        for nobody in ["", "?by=", "?by=a&by=b", "?by=%0A"] {
            assert_eq!(name(nobody), None, "{nobody}");
        }
    }
}
