//! Every error of the server: `application/problem+json` (RFC 9457) with the scheduler's reaction.

use crate::api::{Mistake, SchedulerAction, State, Status};
use crate::session::{QueueRefusal, Refusal};
use axum::Json;
use axum::extract::rejection::{PathRejection, QueryRejection};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use carved_records::plate_map;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub(super) const CONTENT_TYPE: &str = "application/problem+json";

/// Who commands now. Both `null`: nobody does, every client may.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub(super) struct LeaseStatus {
    pub holder: Option<String>,
    pub expires_in_s: Option<f64>,
}

/// What went wrong, for a program (`code`, `scheduler_action`) and for a person (`title`, `detail`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Problem {
    /// `urn:carved:problem:` and the code.
    #[serde(rename = "type")]
    pub kind: String,
    pub title: String,
    pub status: u16,
    pub detail: String,
    /// Stable word to branch on.
    pub code: String,
    pub scheduler_action: SchedulerAction,
    /// Number of the fault behind it, as listed in the status; `null` where there is none.
    pub fault_seq: Option<u64>,
    /// Everything that is wrong with the body, with a 422.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<Mistake>,
    /// States that accept the command, with a 409 for a wrong state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub accepted_in: Vec<State>,
    /// The run under way, with a 409 for a wrong state.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Who has the lease and for how long, with a 423.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) lease: Option<LeaseStatus>,
    #[serde(skip)]
    pub(super) retry_after_s: Option<u32>,
}

/// Number of mistakes that `detail` describes.
const DETAILED: usize = 20;

/// Value of `Retry-After` for a client that should repeat the request, s.
const RETRY_AFTER_S: u32 = 5;

impl Problem {
    /// A problem that a person has to look at.
    pub fn new(status: StatusCode, code: &str, detail: impl Into<String>) -> Self {
        Self {
            kind: format!("urn:carved:problem:{code}"),
            title: status.canonical_reason().unwrap_or("Error").to_owned(),
            status: status.as_u16(),
            detail: detail.into(),
            code: code.to_owned(),
            scheduler_action: SchedulerAction::EscalateOperator,
            fault_seq: None,
            errors: Vec::new(),
            accepted_in: Vec::new(),
            run: None,
            lease: None,
            retry_after_s: None,
        }
    }

    pub(super) fn action(mut self, action: SchedulerAction) -> Self {
        self.scheduler_action = action;
        self
    }

    pub(super) fn come_back(self) -> Self {
        self.come_back_after(RETRY_AFTER_S)
    }

    pub(super) fn come_back_after(mut self, seconds: u32) -> Self {
        self.retry_after_s = Some(seconds);
        self.action(SchedulerAction::Retry)
    }

    pub(super) fn bad_request(code: &str, detail: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, code, detail)
    }

    pub(super) fn unprocessable(code: &str, errors: impl IntoIterator<Item: Into<plate_map::Mistake>>) -> Self {
        let errors: Vec<plate_map::Mistake> = errors.into_iter().map(Into::into).collect();
        let detail = errors.iter().take(DETAILED).map(ToString::to_string).collect::<Vec<_>>().join("; ");
        let more = errors.len().saturating_sub(DETAILED);
        let detail = if more > 0 { format!("{detail}; {more} more stand in errors") } else { detail };
        let errors = errors.into_iter().collect();
        // The cause is the program or the barcode reader, not the plate: the same body is refused with any plate.
        Self { errors, ..Self::new(StatusCode::UNPROCESSABLE_ENTITY, code, detail) }
    }

    /// If all mistakes concern the plate's map or barcode, another plate can be run. A wrong method or an unknown field would also affect
    /// the next plate.
    pub(super) fn of_a_plate(self) -> Self {
        let is_the_plates = |mistake: &Mistake| mistake.pointer.as_ref().is_none_or(|at| at.starts_with("/plate"));
        if self.errors.is_empty() || !self.errors.iter().all(is_the_plates) {
            return self;
        }
        self.action(SchedulerAction::RejectPlate)
    }

    /// If the refusal comes from the instrument's condition: names the newest fault and its scheduler action.
    fn behind(mut self, status: &Status) -> Self {
        if let Some(fault) = status.faults.last() {
            self.fault_seq = Some(fault.seq);
            self.scheduler_action = fault.scheduler_action;
        }
        self
    }

    /// The HTTP answer for a refusal by the session.
    pub(super) fn refused(refusal: Refusal, status: &Status) -> Self {
        let detail = refusal.to_string();
        let conflict = |code| Self::new(StatusCode::CONFLICT, code, detail.clone());
        let unavailable = |code| Self::new(StatusCode::SERVICE_UNAVAILABLE, code, detail.clone()).come_back();
        match refusal {
            Refusal::InvalidPlan(errors) => Self::unprocessable("invalid_plan", errors).of_a_plate(),
            // The only mistake is the barcode.
            Refusal::InvalidHandoff(errors) => Self::unprocessable("invalid_body", errors).action(SchedulerAction::RejectPlate),
            Refusal::InvalidSaying(errors) => Self::unprocessable("invalid_body", errors),
            Refusal::WellNotNow { .. } => conflict("well_not_now"),
            Refusal::OtherPlan { .. } => conflict("other_plan"),
            Refusal::Pruned { .. } => conflict("pruned"),
            Refusal::WrongState { state, accepted_in } => {
                let run = status.run.as_ref().filter(|run| run.outcome.is_none());
                let whose = run.map_or_else(String::new, |run| format!(" Run {} of {} is under way.", run.id, run.operator));
                let detail = format!("{detail}.{whose} {}", status.doing);
                // A run that ends does not come back to a state that accepts a command to it.
                let is_too_late = state.is_ending() && !accepted_in.contains(&State::Idle);
                let action = if is_too_late { SchedulerAction::PauseInstrument } else { SchedulerAction::Retry };
                Self { detail, accepted_in, run: run.map(|run| run.id.clone()), ..conflict("wrong_state").action(action) }.behind(status)
            }
            Refusal::UnknownRun { .. } => Self::new(StatusCode::NOT_FOUND, "unknown_run", detail),
            Refusal::UnexpectedWell { .. } => conflict("unexpected_well"),
            Refusal::RunEnded { .. } => conflict("run_ended"),
            // A repeat alone does not help: first the loader does what `detail` says, or the run ends.
            Refusal::CapillaryFull { .. } | Refusal::MayStillCome { .. } => {
                conflict("capillary_full").action(SchedulerAction::PauseInstrument)
            }
            Refusal::HandoffOpen { .. } => conflict("handoff_open").action(SchedulerAction::PauseInstrument),
            Refusal::PlateNeeded { .. } => conflict("plate_needed").action(SchedulerAction::PauseInstrument),
            Refusal::PlateInside { .. } => conflict("other_barcode").action(SchedulerAction::PauseInstrument),
            Refusal::Store { full: true, .. } => {
                Self::new(StatusCode::INSUFFICIENT_STORAGE, "disk_full", detail).action(SchedulerAction::PauseInstrument).behind(status)
            }
            Refusal::Store { full: false, .. } => unavailable("store").behind(status),
            Refusal::DeviceLost { .. } => unavailable("device_lost").behind(status),
            Refusal::FaultStands { seq, .. } => Self { fault_seq: Some(seq), ..conflict("fault_stands") },
            Refusal::UnknownFault { .. } => Self::new(StatusCode::NOT_FOUND, "unknown_fault", detail),
            Refusal::OtherBarcode { .. } => conflict("other_barcode").action(SchedulerAction::RejectPlate),
            Refusal::NoPicture { .. } => unavailable("no_picture"),
            Refusal::NoHandoff => conflict("no_handoff"),
            Refusal::WillNotFit { .. } | Refusal::OverBudget { .. } => {
                Self::new(StatusCode::INSUFFICIENT_STORAGE, "will_not_fit", detail).action(SchedulerAction::PauseInstrument)
            }
            Refusal::Queued { .. } => conflict("queued"),
            Refusal::Queue { kind: QueueRefusal::Unknown, .. } => Self::new(StatusCode::NOT_FOUND, "not_queued", detail),
            Refusal::Queue { kind: QueueRefusal::OtherPlate, .. } => conflict("other_plate_next").action(SchedulerAction::PauseInstrument),
            Refusal::Queue { kind: QueueRefusal::Empty, .. } => conflict("queue_empty").action(SchedulerAction::PauseInstrument),
            Refusal::Queue { kind: QueueRefusal::Conflict, .. } => conflict("queue_conflict"),
            Refusal::Busy => conflict("busy").action(SchedulerAction::Retry),
            Refusal::ShuttingDown => unavailable("shutting_down"),
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let status = StatusCode::from_u16(self.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let retry_after = self.retry_after_s;
        let mut response = (status, Json(self)).into_response();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(CONTENT_TYPE));
        if let Some(seconds) = retry_after {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

impl From<PathRejection> for Problem {
    fn from(rejection: PathRejection) -> Self {
        Self::bad_request("bad_path", rejection.body_text())
    }
}

impl From<QueryRejection> for Problem {
    fn from(rejection: QueryRejection) -> Self {
        Self::bad_request("bad_query", rejection.body_text())
    }
}
