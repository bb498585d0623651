//! The handover of plates by the loader, and the preflight.

use super::AppState;
use super::body::{self, Body};
use super::problem::Problem;
use super::runs::refused;
use super::safety::{Noted, noted};
use crate::api::{Check, Handoff, HandoffNeeds, RunPlan};
use axum::Json;
use axum::extract::State;
use axum::http::HeaderMap;
use carved_records::HandoffEnd;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Announces that a plate is to be put in or taken away.
///
/// `needs` says what has to happen first; ask again until it is `null`, move the plate, then say so. A repeat answers 200.
#[utoipa::path(
    put, path = "/v1/plate/handoff", tag = "commands", request_body = Handoff,
    responses(
        (status = 200, description = "What the handover waits for", body = HandoffNeeds),
        (status = 409, description = "Another plate is inside, or a run is under way", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn handoff(
    State(app): State<AppState>,
    Body(plate): Body<Handoff, { body::SMALL }>,
) -> Result<Json<HandoffNeeds>, Problem> {
    app.session.handoff(plate).await.map(Json).map_err(|refusal| refused(&app, refusal))
}

async fn end(app: &AppState, headers: &HeaderMap, end: HandoffEnd) -> Result<Json<Noted>, Problem> {
    body::within(headers, body::SMALL)?;
    app.session.end_handoff(end).await.map_err(|refusal| refused(app, refusal))?;
    Ok(noted(app))
}

/// The announced plate has been moved.
#[utoipa::path(
    put, path = "/v1/plate/handoff/completed", tag = "commands",
    responses(
        (status = 200, description = "The plate is in, or out; or that was known", body = Noted),
        (status = 409, description = "No handover was announced, or it still waits for something", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn completed(State(app): State<AppState>, headers: HeaderMap) -> Result<Json<Noted>, Problem> {
    end(&app, &headers, HandoffEnd::Completed).await
}

/// The announced plate is not moved after all.
#[utoipa::path(
    put, path = "/v1/plate/handoff/aborted", tag = "commands",
    responses(
        (status = 200, description = "The handover is called off, or that was known", body = Noted),
        (status = 409, description = "No handover was announced", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn aborted(State(app): State<AppState>, headers: HeaderMap) -> Result<Json<Noted>, Problem> {
    end(&app, &headers, HandoffEnd::Aborted).await
}

/// What a plan would meet now.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct Preflight {
    /// Whether nothing that blocks has failed.
    passed: bool,
    checks: Vec<Check>,
}

/// Looks at everything that a run of this plan needs, and says all that fails.
///
/// The axis is asked, the camera sends a frame; nothing moves. Not while a run is under way.
#[utoipa::path(
    post, path = "/v1/preflight", tag = "commands", request_body = RunPlan,
    responses(
        (status = 200, description = "Every check, passed or not", body = Preflight),
        (status = 409, description = "A run or another check is under way", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn preflight(
    State(app): State<AppState>,
    Body(plan): Body<RunPlan, { body::PLATE_MAP }>,
) -> Result<Json<Preflight>, Problem> {
    let checks = app.session.preflight(plan).await.map_err(|refusal| refused(&app, refusal))?;
    Ok(Json(Preflight { passed: checks.iter().all(|c| c.passed || !c.blocks), checks }))
}
