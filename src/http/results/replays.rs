//! Stored wells measured again by another method, beside their first numbers.

use super::{AppState, Problem, json, read, unknown_run};
use crate::api::WellStatus;
use crate::http::body::{self, Body};
use crate::session::numbers;
use crate::session::replays::{self, NotNow, Progress, Replay};
use axum::Json;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use carved_records::{FieldError, PlannedWell, is_plain_name};
use carved_store::{MeasurementFile, Replayed, StoreError, StoreReader};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::collections::VecDeque;
use std::path::PathBuf;
use utoipa::ToSchema;

/// Body of `PUT /v1/runs/{run_id}/replays/{name}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(in crate::http) struct ReplayRequest {
    /// The wells; none: all that have numbers.
    #[serde(default)]
    wells: Vec<String>,
    /// A method as the text of a TOML file with the keys of a `[methods.NAME]` table. `null`: the method of the configuration that has the
    /// name of the results.
    #[serde(default)]
    settings: Option<String>,
}

/// The numbers of a well by another method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::http) struct ReplayedWell {
    /// Name of the method.
    name: String,
    /// RFC 3339, UTC.
    replayed: String,
    software_version: String,
    /// The method whole.
    method_settings: Value,
    /// As a run has it.
    result: WellStatus,
}

/// How far measuring again has come.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::http) struct ReplayProgress {
    /// Name of the method.
    name: String,
    /// Number of wells that were asked for.
    wells: usize,
    /// Number of them that are done, also of those that failed.
    done: usize,
    failed: Vec<ReplayFailed>,
    /// It rests, because a run is under way.
    waits: bool,
}

/// A well that could not be measured again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::http) struct ReplayFailed {
    well: String,
    reason: String,
}

/// What other methods gave for the wells of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::http) struct RunReplays {
    /// The wells of this run that are being measured again, or were last since the daemon started.
    progress: Option<ReplayProgress>,
    /// In the order of the plate map, then of the names.
    results: Vec<ReplayedWell>,
}

impl From<Progress> for ReplayProgress {
    fn from(Progress { run: _, name, wells, done, failed, waits }: Progress) -> Self {
        let failed = failed.into_iter().map(|(well, reason)| ReplayFailed { well, reason }).collect();
        Self { name, wells, done, failed, waits }
    }
}

/// Results without readable numbers are left out.
fn replayed(planned: &PlannedWell, found: Replayed) -> Option<ReplayedWell> {
    let Replayed { software, replayed, method_name, method, measurement } = found;
    let file: MeasurementFile = serde_json::from_slice(&measurement)
        .inspect_err(|error| tracing::warn!(%error, well = planned.well, "the numbers of another method are not read"))
        .ok()?;
    let mut result = carved_records::WellStatus::pending(planned);
    numbers::end_well(&mut result, &file, method.asd);
    Some(ReplayedWell {
        name: method_name?,
        replayed: replayed?,
        software_version: software.version,
        method_settings: serde_json::to_value(&method).unwrap_or_default(),
        result,
    })
}

async fn found(app: &AppState, id: String) -> Result<RunReplays, Problem> {
    let name = id.clone();
    let results = read(app, move |store| {
        let Some(record) = store.run(&name)? else { return Ok(None) };
        let mut results = Vec::new();
        for planned in &record.plan.plate_map {
            results.extend(store.replays(&name, &planned.well).into_iter().filter_map(|found| replayed(planned, found)));
        }
        Ok(Some(results))
    });
    let results = results.await?.ok_or_else(|| unknown_run(&id))?;
    let progress = app.replays.progress().filter(|progress| progress.run == id).map(Into::into);
    Ok(RunReplays { progress, results })
}

/// What other methods gave for the wells of a run.
#[utoipa::path(get, path = "/v1/runs/{run_id}/replays", tag = "results", params(("run_id" = String, Path)), responses(
    (status = 200, description = "The results, and how far measuring again has come", body = RunReplays),
    (status = 304, description = "The client has it"),
))]
pub(in crate::http) async fn replays(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path(id) = path?;
    Ok(json(&headers, &found(&app, id).await?))
}

/// Measures wells of a run that has ended again, from their stored frames, by another method.
///
/// The first numbers stay as they are. `name` names the method and its results. The work goes on in the background, well by well, and rests
/// while a run is under way. What is there already by the same method stays as it is.
#[utoipa::path(
    put, path = "/v1/runs/{run_id}/replays/{name}", tag = "commands", request_body = ReplayRequest,
    params(
        ("run_id" = String, Path),
        ("name" = String, Path, description = "1 to 64 letters, digits, '-', '_' or '.', the first not a '.'"),
    ),
    responses(
        (status = 202, description = "It has begun", body = RunReplays),
        (status = 404, description = "No such run", body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "A run is under way, or other wells are being measured again", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The daemon cannot begin it now", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::http) async fn replay(
    State(app): State<AppState>,
    path: Result<Path<(String, String)>, PathRejection>,
    Body(asked): Body<ReplayRequest, { body::SMALL }>,
) -> Result<(StatusCode, Json<RunReplays>), Problem> {
    let Path((id, name)) = path?;
    let invalid =
        |pointer: &str, detail: String| Problem::unprocessable("invalid_replay", [FieldError { pointer: pointer.into(), detail }]);
    if !is_plain_name(&name) {
        let detail = format!("{name:?} is no name for results: use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'");
        return Err(invalid("", detail));
    }
    let method = match &asked.settings {
        Some(text) => replays::method(text).map_err(|error| {
            let why = std::error::Error::source(&error).map(|source| format!(": {source}")).unwrap_or_default();
            invalid("/settings", format!("{error}{why}"))
        })?,
        None => app.session.methods().get(&name).cloned().ok_or_else(|| {
            let known = app.session.methods().keys().cloned().collect::<Vec<_>>().join(", ");
            invalid("", format!("there is no method {name:?}; there are: {known}. For another one, send its `settings`"))
        })?,
    };
    let run = id.clone();
    let wells = read(&app, move |store| wells(store, &run, &asked.wells)).await?;
    let wells = match wells {
        Wells::NoRun => return Err(unknown_run(&id)),
        Wells::Open => {
            return Err(Problem::new(StatusCode::CONFLICT, "run_open", format!("run {id} has not ended; measure again when it is over")));
        }
        Wells::Not(well) => return Err(invalid("/wells", format!("nothing is recorded of well {well:?} of run {id}"))),
        Wells::These(wells) if wells.is_empty() => return Err(invalid("/wells", format!("no well of run {id} has numbers"))),
        Wells::These(wells) => wells,
    };
    let replay = Replay { run: id.clone(), name, method, wells };
    app.replays.begin(replay).map_err(|why| {
        let detail = why.to_string();
        match why {
            NotNow::UnderWay { .. } => Problem::new(StatusCode::CONFLICT, "run_under_way", detail),
            NotNow::Busy { .. } => Problem::new(StatusCode::CONFLICT, "measuring_again", detail),
            NotNow::NoThread { .. } => Problem::new(StatusCode::SERVICE_UNAVAILABLE, "no_thread", detail).come_back(),
            NotNow::ShuttingDown => Problem::new(StatusCode::SERVICE_UNAVAILABLE, "shutting_down", detail).come_back(),
        }
    })?;
    Ok((StatusCode::ACCEPTED, Json(found(&app, id).await?)))
}

enum Wells {
    NoRun,
    Open,
    /// A well without recording.
    Not(String),
    These(VecDeque<(String, PathBuf)>),
}

/// The wells that are meant, with the folders of their recordings.
fn wells(store: &StoreReader, run: &str, asked: &[String]) -> Result<Wells, StoreError> {
    let Some(record) = store.run(run)? else { return Ok(Wells::NoRun) };
    if record.outcome.is_none() {
        return Ok(Wells::Open);
    }
    let mut these = VecDeque::new();
    for planned in &record.plan.plate_map {
        let well = &planned.well;
        if asked.is_empty() || asked.contains(well) {
            match store.recording(run, well)? {
                Some(reader) if !asked.is_empty() || reader.closed_numbers().is_some() => {
                    these.push_back((well.clone(), reader.folder().to_owned()));
                }
                None if !asked.is_empty() => return Ok(Wells::Not(well.clone())),
                _ => {}
            }
        }
    }
    let unknown = asked.iter().find(|well| !record.plan.plate_map.iter().any(|planned| planned.well == **well));
    Ok(unknown.map_or(Wells::These(these), |well| Wells::Not(well.clone())))
}
