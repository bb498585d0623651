//! `GET /v1/fault-codes`: every code that a fault can have, for the authors of schedulers.

use crate::api::FaultCode;
use axum::Json;
use carved_records::FAULT_CODES;

/// Every code that a fault can have, and what is done about it.
#[utoipa::path(get, path = "/v1/fault-codes", tag = "contract", responses((status = 200, description = "The whole list", body = [FaultCode])))]
pub(super) async fn get() -> Json<Vec<FaultCode>> {
    Json(FAULT_CODES.iter().copied().map(Into::into).collect())
}
