//! The emergency stop, and the operator's acknowledgement of a fault.

use super::AppState;
use super::body;
use super::problem::Problem;
use super::runs::{Asking, By, refused};
use axum::Json;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use serde::{Deserialize, Serialize};
use std::time::Duration;
use utoipa::ToSchema;

/// How long the answer to an emergency stop waits for the disk. The motors stand already, and the driver takes the stop in any case.
const LATCHED: Duration = Duration::from_secs(1);

/// Taken; the status from this revision on shows what became of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct Noted {
    pub revision: u64,
}

pub(super) fn noted(app: &AppState) -> Json<Noted> {
    Json(Noted { revision: app.session.status().revision })
}

/// Stops the motors, then everything else.
///
/// The stop is on the wire before anything is waited for, and is answered within a second; the run ends as aborted. It latches as the fault `emergency_stop`: nothing
/// runs until that is acknowledged. A repeat stops again and answers 200.
#[utoipa::path(
    post, path = "/v1/emergency-stop", tag = "commands", params(By),
    responses(
        (status = 200, description = "The motors are stopped, and that is journalled", body = Noted),
        (status = 202, description = "The motors are stopped; the disk is slow, and it is journalled as soon as the disk takes it", body = Noted),
        (status = 409, description = "The state does not accept it; the motors were stopped all the same", body = Problem, content_type = "application/problem+json"),
        (status = 413, description = "A body larger than the command can need; the motors were stopped all the same", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "It could not be journalled; the motors were stopped all the same", body = Problem, content_type = "application/problem+json"),
        (status = 507, description = "The disk is full; the motors were stopped all the same", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn emergency_stop(
    State(app): State<AppState>,
    Asking(asked): Asking,
    headers: HeaderMap,
) -> Result<(StatusCode, Json<Noted>), Problem> {
    app.session.emergency_stop(asked).await;
    let stopped = tokio::time::timeout(LATCHED, app.session.latch_emergency_stop()).await;
    body::within(&headers, body::SMALL)?;
    let Ok(latched) = stopped else { return Ok((StatusCode::ACCEPTED, noted(&app))) };
    latched.map_err(|refusal| refused(&app, refusal))?;
    Ok((StatusCode::OK, noted(&app)))
}

/// The operator has seen to a fault.
///
/// One that ends by itself (a lost device, a full disk) stays listed until its cause is gone. A repeat answers 200.
#[utoipa::path(
    post, path = "/v1/faults/{seq}/acknowledge", tag = "commands",
    params(("seq" = u64, Path, description = "`seq` of the fault in the status"), By),
    responses(
        (status = 200, description = "The fault is acknowledged, or was over", body = Noted),
        (status = 400, description = "That is no number", body = Problem, content_type = "application/problem+json"),
        (status = 404, description = "There has been no such fault", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn acknowledge(
    State(app): State<AppState>,
    path: Result<Path<u64>, PathRejection>,
    Asking(asked): Asking,
    headers: HeaderMap,
) -> Result<Json<Noted>, Problem> {
    body::within(&headers, body::SMALL)?;
    let Path(seq) = path?;
    app.session.acknowledge(seq, asked).await.map_err(|refusal| refused(&app, refusal))?;
    Ok(noted(&app))
}
