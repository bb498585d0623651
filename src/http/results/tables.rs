//! Tables of runs as CSV, as `carved export table` writes them.

use super::{read, unknown_run};
use crate::http::conditional;
use crate::http::problem::Problem;
use crate::http::{App, AppState};
use crate::tables::statistics::{Flagged, Statistics, groups_table};
use crate::tables::{self, Table, csv};
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use carved_store::StoredRun;
use serde::Deserialize;
use utoipa::IntoParams;

/// Maximum number of runs of one table.
const MOST: usize = 100;

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct Named {
    /// Names of runs, 1 to 100, separated by commas. Each is named once.
    #[param(pattern = r"[^\s,]")]
    runs: String,
    /// As of the table of one run.
    #[serde(default)]
    spreadsheet: bool,
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct Opened {
    /// `true`: for a spreadsheet, with a byte order mark, and with an apostrophe before text that it would take for a formula.
    #[serde(default)]
    spreadsheet: bool,
}

/// A table of runs as CSV. A run that is not stored is refused by name.
async fn table(
    app: &App,
    names: Vec<String>,
    make: fn(&[StoredRun]) -> Table,
    write: fn(&Table) -> String,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let made = read(app, move |store| {
        let mut runs = Vec::new();
        for name in names {
            match store.stored_run(&name)? {
                Some(run) => runs.push(run),
                None => return Ok(Err(name)),
            }
        }
        Ok(Ok(write(&make(&runs))))
    });
    let text = made.await?.map_err(|name| unknown_run(&name))?;
    let tag = conditional::tag_of(text.as_bytes());
    Ok(conditional::answer(headers, &tag, || {
        ([(header::CONTENT_TYPE, "text/csv; charset=utf-8"), (header::CACHE_CONTROL, "no-cache")], text).into_response()
    }))
}

/// The table of a run: one row per planned well, with plate map, numbers, flags, quality and provenance. The row of a well with a file that was
/// altered or cannot be read has `reason` in place of its numbers.
#[utoipa::path(get, path = "/v1/runs/{run_id}/table.csv", tag = "results", params(("run_id" = String, Path), Opened), responses(
    (status = 200, description = "CSV", body = String, content_type = "text/csv"),
    (status = 304, description = "The client has it"),
    (status = 400, description = "A query that makes no sense", body = Problem, content_type = "application/problem+json"),
))]
pub(in crate::http) async fn of_run(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    asked: Result<Query<Opened>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    opened(&app, path, asked, tables::specimens, &headers).await
}

/// A table of one run as CSV.
async fn opened(
    app: &App,
    path: Result<Path<String>, PathRejection>,
    asked: Result<Query<Opened>, QueryRejection>,
    make: fn(&[StoredRun]) -> Table,
    headers: &HeaderMap,
) -> Result<Response, Problem> {
    let (Path(id), Query(Opened { spreadsheet })) = (path?, asked?);
    table(app, vec![id], make, written(spreadsheet), headers).await
}

fn written(spreadsheet: bool) -> fn(&Table) -> String {
    if spreadsheet { csv::for_spreadsheet } else { csv::text }
}

/// The shape table of a run: one row per slice along the body of each specimen.
#[utoipa::path(get, path = "/v1/runs/{run_id}/shape.csv", tag = "results", params(("run_id" = String, Path)), responses(
    (status = 200, description = "CSV", body = String, content_type = "text/csv"),
    (status = 304, description = "The client has it"),
))]
pub(in crate::http) async fn shape_of_run(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path(id) = path?;
    table(&app, vec![id], tables::stations, csv::text, &headers).await
}

/// The statistics of a run as a table: one row per quantity and group or compound, as `carved export statistics` writes it. Numbers that are
/// bounds or doubtful are left out, and counted.
#[utoipa::path(get, path = "/v1/runs/{run_id}/groups.csv", tag = "results", params(("run_id" = String, Path), Opened), responses(
    (status = 200, description = "CSV", body = String, content_type = "text/csv"),
    (status = 304, description = "The client has it"),
    (status = 400, description = "A query that makes no sense", body = Problem, content_type = "application/problem+json"),
))]
pub(in crate::http) async fn groups_of_run(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    asked: Result<Query<Opened>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let groups = |runs: &[StoredRun]| groups_table(&Statistics::of(runs, Flagged::Sound));
    opened(&app, path, asked, groups, &headers).await
}

/// One table of several runs.
#[utoipa::path(get, path = "/v1/table.csv", tag = "results", params(Named), responses(
    (status = 200, description = "CSV", body = String, content_type = "text/csv"),
    (status = 304, description = "The client has it"),
    (status = 400, description = "A query that makes no sense", body = Problem, content_type = "application/problem+json"),
    (status = 404, description = "A run is not stored", body = Problem, content_type = "application/problem+json"),
    (status = 500, description = "It is not what was recorded, or cannot be read", body = Problem, content_type = "application/problem+json"),
))]
pub(in crate::http) async fn of_runs(
    State(app): State<AppState>,
    asked: Result<Query<Named>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Query(Named { runs, spreadsheet }) = asked?;
    let names = names(&runs)?;
    table(&app, names, tables::specimens, written(spreadsheet), &headers).await
}

/// The names of a list. A row of a run that stands in it twice could not be told from the other.
fn names(list: &str) -> Result<Vec<String>, Problem> {
    let names: Vec<String> = list.split(',').map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect();
    let twice = names.iter().enumerate().find(|(i, name)| names[..*i].contains(name));
    if let Some((_, name)) = twice {
        return Err(Problem::bad_request("bad_query", format!("the run {name} is named twice; a table has each run once")));
    }
    if !(1..=MOST).contains(&names.len()) {
        return Err(Problem::bad_request("bad_query", format!("runs names {} runs; use 1 to {MOST}", names.len())));
    }
    Ok(names)
}
