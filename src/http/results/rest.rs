//! The plan of the wells that a run has left without numbers, to be sent as the plan of another run.

use super::{AppState, Problem, json, read, unknown_run};
use crate::api::RunPlan;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::extract::{Path, Query, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use carved_records::{SpecimenOutcome, WellStatus};
use carved_store::RunRecord;
use serde::Deserialize;
use std::collections::BTreeSet;
use utoipa::IntoParams;

/// Which wells.
#[derive(Debug, Default, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
pub(in crate::http) struct RestParameters {
    /// Names of wells, separated by commas, such as `A01,B07`. Without it: the wells that were left out by a stop or an abort, or were
    /// interrupted.
    wells: Option<String>,
}

/// The rest of a run, as the plan of another one.
///
/// Plate, method, operator, treatments and metadata are those of the run. Send it by `PUT /v1/runs/{run_id}` under another name.
#[utoipa::path(get, path = "/v1/runs/{run_id}/rest", tag = "results", params(("run_id" = String, Path), RestParameters), responses(
    (status = 200, description = "The plan", body = RunPlan),
    (status = 304, description = "The client has it"),
    (status = 404, description = "No such run", body = Problem, content_type = "application/problem+json"),
    (status = 409, description = "The run is under way, or no well is left", body = Problem, content_type = "application/problem+json"),
    (status = 422, description = "The run does not have these wells", body = Problem, content_type = "application/problem+json"),
))]
pub(in crate::http) async fn rest(
    State(app): State<AppState>,
    path: Result<Path<String>, PathRejection>,
    query: Result<Query<RestParameters>, QueryRejection>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let Path(id) = path?;
    let Query(RestParameters { wells }) = query?;
    let name = id.clone();
    let record = read(&app, move |store| store.run(&name)).await?.ok_or_else(|| unknown_run(&id))?;
    Ok(json(&headers, &rest_of(record, wells.as_deref())?))
}

/// Whether a well was planned and never finished.
fn is_left(well: &WellStatus) -> bool {
    matches!(well.outcome, None | Some(SpecimenOutcome::Aborted | SpecimenOutcome::Interrupted))
}

fn rest_of(record: RunRecord, asked: Option<&str>) -> Result<RunPlan, Problem> {
    let conflict = |code, detail: String| Err(Problem::new(StatusCode::CONFLICT, code, detail));
    if record.outcome.is_none() {
        return conflict("wrong_state", format!("run {} is under way: its wells are still measured", record.id));
    }
    let chosen: BTreeSet<String> = match asked {
        Some(asked) if asked.split(',').any(|well| !well.trim().is_empty()) => {
            asked.split(',').map(|well| well.trim().to_ascii_uppercase()).filter(|well| !well.is_empty()).collect()
        }
        _ => record.wells.iter().filter(|well| is_left(well)).map(|well| well.well.clone()).collect(),
    };
    if let Some(unknown) = chosen.iter().find(|well| record.wells.iter().all(|planned| planned.well != **well)) {
        return Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "unknown_well", format!("run {} has no well {unknown}", record.id)));
    }
    let mut plan = record.plan;
    plan.plate_map.retain(|planned| chosen.contains(&planned.well));
    if plan.plate_map.is_empty() {
        return conflict("nothing_left", format!("every well of run {} was finished", record.id));
    }
    Ok(plan)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::{Method, Mode, PlannedWell, RunOutcome, SpecimenKind};

    #[test]
    fn the_rest_of_a_run_is_what_was_never_finished_or_what_is_asked_for() {
        let wells = ["A01", "A02", "A03", "A04"].map(|well| PlannedWell::new(well, SpecimenKind::Larva, Some(3.0)));
        let plan = RunPlan::new("P-1", "standard", "kim", wells.to_vec());
        let method: Method =
            serde_json::from_value(serde_json::json!({"asd": 21, "order": "sequential", "epsilon": 0.05, "voxel_um": 6.93})).unwrap();
        let mut record = RunRecord::new("r1", plan, method, Mode::Simulated, None);
        let names = |plan: RunPlan| plan.plate_map.into_iter().map(|planned| planned.well).collect::<Vec<_>>();
        let refused = |record: &RunRecord, asked| rest_of(record.clone(), asked).unwrap_err().status;
        assert_eq!(refused(&record, None), 409, "it is under way");
        let outcomes = [SpecimenOutcome::Succeeded, SpecimenOutcome::Interrupted, SpecimenOutcome::Failed, SpecimenOutcome::Aborted];
        for (well, outcome) in record.wells.iter_mut().zip(outcomes) {
            well.end(outcome, None);
        }
        record.end(RunOutcome::Aborted);
        assert_eq!(names(rest_of(record.clone(), None).unwrap()), ["A02", "A04"]);
        assert_eq!(names(rest_of(record.clone(), Some("a03, A01")).unwrap()), ["A01", "A03"], "in the order of the plan");
        assert_eq!(refused(&record, Some("A01,H12")), 422);
        record.wells.iter_mut().for_each(|well| well.end(SpecimenOutcome::Succeeded, None));
        assert_eq!(refused(&record, None), 409);
    }
}
