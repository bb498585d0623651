//! The report of a run, as `carved report` writes it.

use super::{AppState, Problem, read, unknown_run};
use crate::report::html;
use crate::tables::statistics::Flagged;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

/// The report of a run: one HTML file to read and to print. It needs no other file.
#[utoipa::path(get, path = "/v1/runs/{run_id}/report.html", tag = "results", params(("run_id" = String, Path)), responses(
    (status = 200, description = "HTML, to be saved", body = String, content_type = "text/html"),
    (status = 404, description = "No such run", body = Problem, content_type = "application/problem+json"),
    (status = 500, description = "A file of the run is not what was recorded, or cannot be read", body = Problem, content_type = "application/problem+json"),
))]
pub(in crate::http) async fn report_of_run(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
) -> Result<Response, Problem> {
    let Path(id) = path?;
    let name = id.clone();
    let made = read(&app, move |store| {
        let Some(run) = store.stored_run(&name)? else { return Ok(None) };
        let gates = store.gates()?;
        Ok(Some(html::report(&[run], &gates, Flagged::Sound)))
    });
    let text = made.await?.ok_or_else(|| unknown_run(&id))?.map_err(|error| {
        Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "unreadable", format!("the report of run {id} cannot be made: {error}"))
    })?;
    let name = format!("attachment; filename=\"{id}.html\"");
    Ok(([(header::CONTENT_TYPE, "text/html; charset=utf-8".to_owned()), (header::CONTENT_DISPOSITION, name)], text).into_response())
}
