//! `GET /v1/status`: the newest snapshot, at once or as soon as it has changed.

use super::problem::Problem;
use super::{AppState, closed, conditional};
use crate::api::Status;
use axum::Json;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use std::time::Duration;
use utoipa::IntoParams;

/// Longest wait of a long poll. Longer requests are shortened to this.
const LONGEST_WAIT: Duration = Duration::from_secs(30);

#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub(super) struct Wait {
    /// Seconds to wait for a revision above `after`, at most 30.
    wait: Option<f64>,
    /// Revision that the client has seen.
    #[param(format = "uint64")]
    after: Option<u64>,
}

impl Wait {
    /// The revision that must be exceeded and the time to wait, if the client wants to wait.
    fn checked(&self) -> Result<Option<(Duration, u64)>, Problem> {
        let wrong = |detail: &str| Problem::bad_request("bad_query", detail);
        let Some(wait) = self.wait else { return Ok(None) };
        let wait = Duration::try_from_secs_f64(wait).map_err(|_| wrong("wait is a number of seconds, 0 or more"))?;
        let after = self.after.ok_or_else(|| wrong("wait needs after=REVISION, the revision that the client has seen"))?;
        Ok(Some((wait.min(LONGEST_WAIT), after)))
    }
}

/// The state of the instrument, its run, specimen, hardware and faults.
///
/// From memory only; without `wait` 200 whenever the daemon listens, faulted too. The `ETag` changes with the state, not with the clocks.
#[utoipa::path(
    get, path = "/v1/status", tag = "status", params(Wait, ("If-None-Match" = Option<String>, Header, description = "ETag of the status that the client has")),
    responses(
        (status = 200, description = "The newest snapshot", body = Status, headers(("ETag" = String, description = "boot id and revision"))),
        (status = 304, description = "The client has the newest snapshot"),
        (status = 400, description = "The query makes no sense", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "With `wait`: too many clients wait for events or for a change of the status", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn get(
    State(app): State<AppState>,
    headers: HeaderMap,
    query: Result<Query<Wait>, QueryRejection>,
) -> Result<Response, Problem> {
    let waiting = query?.checked()?;
    let mut status = app.session.status();
    // A revision above ours comes from before a restart: the client gets the status at once.
    if let Some((wait, after)) = waiting.filter(|(_, after)| *after == status.revision) {
        let _slot = app.staying.take()?;
        tokio::select! {
            newer = app.session.status_after(after) => status = newer,
            () = tokio::time::sleep(wait) => status = app.session.status(),
            () = closed(app.closing.clone()) => status = app.session.status(),
        }
    }
    let tag = format!("\"{}-{}\"", status.boot_id, status.revision);
    Ok(conditional::answer(&headers, &tag, || ([(header::CACHE_CONTROL, "no-cache")], Json(status)).into_response()))
}
