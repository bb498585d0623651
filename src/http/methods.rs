//! The methods that a plan may name.

use super::AppState;
use crate::api::MethodOffer;
use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct Methods {
    /// Sorted by name.
    methods: Vec<MethodOffer>,
}

/// The methods of this instrument's configuration. They do not change while the daemon lives.
#[utoipa::path(get, path = "/v1/methods", tag = "status", responses((status = 200, description = "All of them", body = Methods)))]
pub(super) async fn get(State(app): State<AppState>) -> Json<Methods> {
    Json(Methods { methods: app.session.methods().iter().map(|(name, method)| MethodOffer::new(name, method)).collect() })
}
