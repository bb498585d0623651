//! One line of the event journal.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Something that happened. Ids rise by one and last across restarts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Event {
    pub id: u64,
    /// RFC 3339, UTC.
    pub time: String,
    /// As `run.started`, `view.taken`, `specimen.measured`, `fault.raised`.
    pub kind: String,
    pub run: Option<String>,
    pub well: Option<String>,
    pub data: serde_json::Value,
}
