//! `GET /v1/runs...`: the results of past runs, read from the index and the run folders.
//!
//! ```text
//! handler ─> a slot (few at a time) ─> blocking thread ─> StoreReader ─> disk
//! ```
//! These requests read the disk, so clients should poll the status instead. A slow disk delays only other readers of results.

mod download;
mod files;
mod gates;
mod replays;
mod report;
mod rest;
pub(super) mod statistics;
pub(super) mod tables;

pub(super) use download::{__path_events, __path_run_files, DOWNLOADS, events, run_files};
use files::DETECTION;
pub(super) use files::{
    __path_coloured, __path_mesh, __path_model, __path_profile, __path_standard, __path_view, coloured, mesh, model, profile, standard,
    view,
};
pub(super) use gates::{__path_bead_gates, bead_gates};
pub(super) use replays::{__path_replay, __path_replays, replay, replays};
pub(super) use report::{__path_report_of_run, report_of_run};
pub(super) use rest::{__path_rest, rest};

use super::conditional;
use super::problem::Problem;
use super::stored;
use super::{App, AppState};
use crate::api::{RunOutcome, RunPlan, VolumeEstimate, WellCounts, WellStatus};
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use carved_core::pipeline::standard::Aspect;
use carved_store::{Cursor, RunsQuery, SpecimenFile, StoreError, StoreReader};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

/// Number of simultaneous reads: as many as a disk can serve without a longer wait for each.
pub(super) const AT_A_TIME: usize = 4;

/// Maximum number of runs per page.
const MOST: usize = 200;

fn fifty() -> usize {
    50
}

#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct ListParameters {
    /// Runs per page, 1 to 200.
    #[serde(default = "fifty")]
    #[param(required = false, default = 50, minimum = 1, maximum = 200)]
    limit: usize,
    /// `next` of the page before.
    cursor: Option<String>,
    plate_barcode: Option<String>,
    method: Option<String>,
    operator: Option<String>,
    external_id: Option<String>,
    /// A part of the name of a compound: runs with a well of it. Upper and lower case of A to Z are alike.
    compound: Option<String>,
    /// `hardware`, `simulated` or `imported`.
    mode: Option<String>,
    /// `succeeded`, `partial`, `failed`, `aborted`, `interrupted`, or `open` for those without one.
    outcome: Option<String>,
}

/// A run in a list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct RunRow {
    id: String,
    external_id: Option<String>,
    mode: String,
    software_version: String,
    plate_barcode: String,
    method: String,
    operator: String,
    /// RFC 3339, UTC.
    started: String,
    ended: Option<String>,
    outcome: Option<String>,
    wells: WellCounts,
}

impl From<carved_store::RunRow> for RunRow {
    fn from(row: carved_store::RunRow) -> Self {
        // `place_us` is only needed for the `next` of a page.
        let carved_store::RunRow {
            id,
            external_id,
            mode,
            software_version,
            plate_barcode,
            method,
            operator,
            started,
            ended,
            outcome,
            wells,
            place_us: _,
        } = row;
        Self { id, external_id, mode, software_version, plate_barcode, method, operator, started, ended, outcome, wells }
    }
}

/// A page of runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct Runs {
    /// Newest first.
    runs: Vec<RunRow>,
    /// The `cursor` of the next page; `null` at the end.
    next: Option<String>,
}

/// A run with the results of its wells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct RunDetail {
    id: String,
    external_id: Option<String>,
    /// `hardware`, `simulated` or `imported`.
    mode: String,
    software_version: String,
    plate_barcode: String,
    method: String,
    /// The method whole.
    method_settings: Value,
    operator: String,
    /// RFC 3339, UTC.
    started: String,
    ended: Option<String>,
    outcome: Option<RunOutcome>,
    wells: WellCounts,
    /// Copies that `carved archive` made, newest first.
    copies: Vec<RunCopy>,
    /// What was asked for, the plate map with its conditions and the lab's metadata in it.
    plan: RunPlan,
    /// In the order of the plan's plate map.
    results: Vec<WellStatus>,
    /// Of the wells in the order of `results`, whether or not anything was recorded of them.
    specimens: Vec<String>,
}

/// A copy of a run, every file of which was read again when it was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct RunCopy {
    /// RFC 3339, UTC.
    archived: String,
    /// The folder of the copy.
    destination: String,
    bytes: u64,
    files: usize,
}

impl From<carved_store::Receipt> for RunCopy {
    fn from(receipt: carved_store::Receipt) -> Self {
        let carved_store::Receipt { schema: _, software: _, run: _, archived, destination, bytes, files, packed: _ } = receipt;
        Self { archived, destination: destination.display().to_string(), bytes, files: files.len() }
    }
}

/// Events of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct RunEvents {
    /// Oldest first.
    events: Vec<crate::api::Event>,
    /// The `after` of the next answer; `null` at the end.
    next: Option<u64>,
}

#[derive(Debug, Default, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct Attempt {
    /// An earlier attempt at the well, by its number; 0 or left out, the newest.
    #[serde(default)]
    #[param(required = false)]
    attempt: u32,
}

/// A specimen: results, quality, and where its files are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct SpecimenDetail {
    run: String,
    well: String,
    attempt: u32,
    /// Numbers of the attempts before the newest.
    earlier_attempts: Vec<u32>,
    /// As in the run; `null` of an earlier attempt.
    result: Option<WellStatus>,
    #[schema(schema_with = stored::recording)]
    recording: Value,
    #[schema(schema_with = stored::measurement)]
    measurement: Option<Value>,
    /// Volume of the live hull after each view of the newest attempt, oldest first, as the journal has it; none of an earlier one.
    hull_volumes_um3: Vec<f64>,
    /// The estimates while its views came in, oldest first; none of an earlier attempt.
    estimates: Vec<VolumeEstimate>,
    links: Links,
}

/// Addresses of a specimen's files, of those that there are.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub(super) struct Links {
    mesh_ply: Option<String>,
    mesh_glb: Option<String>,
    /// The model with the colours of the frames; `null` where surface, numbers or frames are missing.
    coloured_glb: Option<String>,
    /// The standard pictures of a larva: its left side, head to the left, with a scale bar; `null` where head or back are not decided, and
    /// of runs of earlier versions.
    lateral_png: Option<String>,
    /// The same without a bar.
    lateral_tif: Option<String>,
    /// Its back, head to the left, with a scale bar.
    dorsal_png: Option<String>,
    /// The same without a bar.
    dorsal_tif: Option<String>,
    /// The frame on which the well was judged.
    detection: Option<String>,
    views: Vec<String>,
    profiles: Vec<String>,
}

/// Reads the store outside the threads that serve requests, with few reads at a time.
async fn read<T: Send + 'static>(
    app: &App,
    work: impl FnOnce(&StoreReader) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, Problem> {
    let ended = || Problem::new(StatusCode::SERVICE_UNAVAILABLE, "shutting_down", "the instrument is shutting down").come_back();
    let _slot = app.reading.acquire().await.map_err(|_| ended())?;
    let reader = app.reader.clone();
    tokio::task::spawn_blocking(move || work(&reader)).await.map_err(|_| ended())?.map_err(|e| unread(&e))
}

fn unread(error: &StoreError) -> Problem {
    let detail = error.to_string();
    match error {
        StoreError::Index { .. } => Problem::new(StatusCode::SERVICE_UNAVAILABLE, "index", detail).come_back(),
        StoreError::Newer { .. } => Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "newer_format", detail),
        StoreError::Unended { .. } => Problem::new(StatusCode::CONFLICT, "run_open", "the run has not ended; its files are still written"),
        StoreError::Altered { .. } => Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "altered", detail),
        _ => Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "store", detail),
    }
}

fn json<T: Serialize>(headers: &HeaderMap, value: &T) -> Response {
    let text = serde_json::to_vec(value).unwrap_or_default();
    let tag = conditional::tag_of(&text);
    conditional::answer(headers, &tag, || {
        ([(header::CONTENT_TYPE, "application/json"), (header::CACHE_CONTROL, "no-cache")], text).into_response()
    })
}

fn cursor(text: &str) -> Option<Cursor> {
    let (place_us, id) = text.split_once('-')?;
    Some(Cursor { place_us: place_us.parse().ok()?, id: id.to_owned() })
}

/// Runs that are stored, newest first.
#[utoipa::path(get, path = "/v1/runs", tag = "results", params(ListParameters), responses(
    (status = 200, description = "A page of them", body = Runs),
    (status = 304, description = "The client has it"),
    (status = 400, description = "A query that makes no sense", body = Problem, content_type = "application/problem+json"),
    (status = 503, description = "The index cannot be read", body = Problem, content_type = "application/problem+json"),
))]
pub(super) async fn list(
    State(app): State<AppState>,
    asked: Result<Query<ListParameters>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Query(a) = asked?;
    if !(1..=MOST).contains(&a.limit) {
        return Err(Problem::bad_request("bad_query", format!("limit is {}; use 1 to {MOST}", a.limit)));
    }
    let after = match a.cursor.as_deref().map(|text| cursor(text).ok_or(text)) {
        None => None,
        Some(Ok(place)) => Some(place),
        Some(Err(text)) => return Err(Problem::bad_request("bad_query", format!("{text:?} is no cursor; use `next` of a page as it is"))),
    };
    let limit = a.limit;
    let query = RunsQuery {
        // One more run shows whether there is another page.
        limit: limit + 1,
        after,
        plate_barcode: a.plate_barcode,
        method: a.method,
        operator: a.operator,
        external_id: a.external_id,
        compound: a.compound,
        mode: a.mode,
        outcome: a.outcome,
    };
    let mut runs = read(&app, move |store| store.runs(&query)).await?;
    let more = runs.len() > limit;
    runs.truncate(limit);
    let next = runs.last().filter(|_| more).map(carved_store::RunRow::cursor).map(|c| format!("{}-{}", c.place_us, c.id));
    Ok(json(&headers, &Runs { runs: runs.into_iter().map(Into::into).collect(), next }))
}

/// A run that is stored, with the results of its wells.
#[utoipa::path(get, path = "/v1/runs/{run_id}", tag = "results", params(("run_id" = String, Path)), responses(
    (status = 200, description = "The run", body = RunDetail),
    (status = 304, description = "The client has it"),
))]
pub(super) async fn run(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path(id) = path?;
    let name = id.clone();
    let found = read(&app, move |store| Ok(store.run(&name)?.map(|record| (record, store.copies(&name)))));
    let (record, copies) = found.await?.ok_or_else(|| unknown_run(&id))?;
    let word = |value: Value| value.as_str().unwrap_or_default().to_owned();
    let detail = RunDetail {
        specimens: record.wells.iter().map(|w| format!("/v1/runs/{id}/specimens/{}", w.well)).collect(),
        mode: word(serde_json::to_value(record.mode).unwrap_or_default()),
        method_settings: serde_json::to_value(&record.method).unwrap_or_default(),
        wells: carved_records::WellCounts::of(&record.wells),
        id,
        external_id: record.plan.external_id.clone(),
        software_version: record.software.version,
        plate_barcode: record.plan.plate_barcode.clone(),
        copies: copies.into_iter().map(Into::into).collect(),
        method: record.plan.method.clone(),
        operator: record.plan.operator.clone(),
        plan: record.plan,
        started: record.started,
        ended: record.ended,
        outcome: record.outcome,
        results: record.wells.into_iter().collect(),
    };
    Ok(json(&headers, &detail))
}

fn unknown_run(id: &str) -> Problem {
    Problem::new(StatusCode::NOT_FOUND, "unknown_run", format!("no run {id:?} is stored; GET /v1/runs lists those that are"))
}

fn unknown_specimen(run: &str, well: &str) -> Problem {
    let detail = format!("nothing is recorded of well {well:?} of run {run:?}; GET /v1/runs/{{run_id}} lists its wells");
    Problem::new(StatusCode::NOT_FOUND, "unknown_specimen", detail)
}

/// A specimen of a run: its results and quality, and links to its files.
#[utoipa::path(
    get, path = "/v1/runs/{run_id}/specimens/{well}", tag = "results",
    params(("run_id" = String, Path), ("well" = String, Path, description = "`A01` to `AF48`"), Attempt),
    responses(
        (status = 200, description = "What is recorded of it", body = SpecimenDetail),
        (status = 304, description = "The client has it"),
    )
)]
pub(super) async fn specimen(
    State(app): State<AppState>,
    path: Result<Path<(String, String)>, PathRejection>,
    query: Result<Query<Attempt>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path((run, well)) = path?;
    let Query(Attempt { attempt }) = query?;
    let (r, w) = (run.clone(), well.clone());
    let stored = read(&app, move |store| store.specimen(&r, &w, attempt)).await?.ok_or_else(|| unknown_specimen(&run, &well))?;
    let base = format!("/v1/runs/{run}/specimens/{well}");
    let which = if attempt == 0 { String::new() } else { format!("?attempt={attempt}") };
    let mut links = Links::default();
    for file in stored.files {
        match file {
            SpecimenFile::Mesh => links.mesh_ply = Some(format!("{base}/mesh.ply{which}")),
            SpecimenFile::Model => links.mesh_glb = Some(format!("{base}/mesh.glb{which}")),
            SpecimenFile::Detection => links.detection = Some(format!("{base}/views/{DETECTION}{which}")),
            SpecimenFile::View(i) => links.views.push(format!("{base}/views/{i}.png{which}")),
            SpecimenFile::Profile(i) => links.profiles.push(format!("{base}/profiles/{i}.png{which}")),
            SpecimenFile::Standard { aspect, is_tiff } => {
                let link = match (aspect, is_tiff) {
                    (Aspect::Lateral, false) => &mut links.lateral_png,
                    (Aspect::Lateral, true) => &mut links.lateral_tif,
                    (Aspect::Dorsal, false) => &mut links.dorsal_png,
                    (Aspect::Dorsal, true) => &mut links.dorsal_tif,
                };
                *link = Some(format!("{base}/{}{which}", SpecimenFile::standard_name(aspect, is_tiff)));
            }
        }
    }
    if attempt == 0 && links.mesh_ply.is_some() && stored.measurement.is_some() && !links.views.is_empty() {
        links.coloured_glb = Some(format!("{base}/coloured.glb"));
    }
    let detail = SpecimenDetail {
        run,
        well,
        attempt,
        earlier_attempts: stored.earlier,
        result: stored.status,
        recording: stored.recording,
        measurement: stored.measurement,
        // The closure view and retakes have no hull volume.
        hull_volumes_um3: stored.views.iter().filter_map(|view| view.hull_volume_um3).collect(),
        estimates: VolumeEstimate::each(stored.views.iter().map(|view| view.estimate)),
        links,
    };
    Ok(json(&headers, &detail))
}
