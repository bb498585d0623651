//! `POST /v1/plate-maps/check`: converts the file of a plate map to the wells of a plan, or lists every mistake with its line.

use super::body::PlateMapFile;
use super::problem::Problem;
use crate::api::PlateMap;
use axum::Json;
use axum::extract::Query;
use axum::extract::rejection::QueryRejection;
use carved_records::plate_map;
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
    plate_map::read(&file.bytes, file.format, which.plate.as_deref(), which.plate_format)
        .map(|map| Json(map.into()))
        .map_err(|mistakes| Problem::unprocessable("invalid_plate_map", mistakes).of_a_plate())
}
