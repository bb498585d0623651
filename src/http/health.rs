//! `/livez` and `/readyz`: probes for supervisors of the daemon.

use super::AppState;
use super::problem::Problem;
use axum::extract::State;
use axum::http::StatusCode;

/// The daemon answers.
#[utoipa::path(get, path = "/livez", tag = "health", responses((status = 200, description = "It does", body = String, content_type = "text/plain")))]
pub(super) async fn live() -> &'static str {
    "ok\n"
}

/// The instrument would start a run now.
#[utoipa::path(get, path = "/readyz", tag = "health", responses(
    (status = 200, description = "It would", body = String, content_type = "text/plain"),
    (status = 503, description = "It would not, and why; Retry-After says when to ask again", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn ready(State(app): State<AppState>) -> Result<&'static str, Problem> {
    let status = app.session.status();
    if status.ready {
        return Ok("ready\n");
    }
    let reason = status.not_ready_reason.unwrap_or_else(|| format!("the instrument is in state {:?}", status.state));
    Err(Problem::new(StatusCode::SERVICE_UNAVAILABLE, "not_ready", reason).come_back())
}
