//! `POST /v1/plate-maps/check`: converts the file of a plate map to the wells of a plan, or lists every mistake with its line.

use super::body::PlateMapFile;
use super::problem::Problem;
use crate::api::PlateMap;
use axum::Json;
use axum::extract::Query;
use axum::extract::rejection::QueryRejection;
use carved_records::plate_map::{self, ColumnProposal, MappedColumn};
use serde::Deserialize;
use utoipa::IntoParams;

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Which {
    /// One of several plates of a MIHCSME file.
    plate: Option<String>,
    /// Number of wells of the plate: 6, 12, 24, 48, 96, 384 or 1536. It counts before the one that the file names. A well that is not on this
    /// plate is a mistake.
    plate_format: Option<u32>,
    /// What the columns of a CSV are, as JSON: a list of `MappedColumn`. Columns that it does not name are kept as they are. Without it the
    /// headings say what the columns are.
    columns: Option<String>,
}

/// Reads a plate map without starting anything.
///
/// Its answer's `plate_map` and `metadata` are those of `PUT /v1/runs/{run_id}`.
#[utoipa::path(
    post, path = "/v1/plate-maps/check", tag = "contract", params(Which),
    request_body(description = "CSV, or JSON: a list of wells, or MIHCSME metadata", content(
        (String = "text/csv"),
        (serde_json::Value = "application/json"),
    )),
    responses((status = 200, description = "Nothing is wrong with it", body = PlateMap))
)]
pub(super) async fn check(query: Result<Query<Which>, QueryRejection>, file: PlateMapFile) -> Result<Json<PlateMap>, Problem> {
    let Query(which) = query?;
    let read = match &which.columns {
        None => plate_map::read(&file.bytes, file.format, which.plate.as_deref(), which.plate_format),
        Some(columns) => {
            file.must_be_csv()?;
            let columns: Vec<MappedColumn> = serde_json::from_str(columns)
                .map_err(|e| Problem::bad_request("bad_query", format!("columns is no list of MappedColumn: {e}")))?;
            plate_map::read_mapped(&file.bytes, which.plate_format, &columns)
        }
    };
    read.map(|map| Json(map.into())).map_err(wrong)
}

/// Says what the columns of a foreign table seem to be. Nothing is read or stored.
///
/// A person corrects the answer. Then it is the `columns` of `POST /v1/plate-maps/check`.
#[utoipa::path(
    post, path = "/v1/plate-maps/columns", tag = "contract",
    request_body(description = "CSV with a heading", content((String = "text/csv"))),
    responses((status = 200, description = "What each column seems to be", body = ColumnProposal))
)]
pub(super) async fn columns(file: PlateMapFile) -> Result<Json<ColumnProposal>, Problem> {
    file.must_be_csv()?;
    plate_map::propose(&file.bytes).map(Json).map_err(wrong)
}

fn wrong(mistakes: Vec<plate_map::Mistake>) -> Problem {
    Problem::unprocessable("invalid_plate_map", mistakes).of_a_plate()
}
