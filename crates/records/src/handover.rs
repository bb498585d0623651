//! Plate handovers: announced, then completed or cancelled.
//!
//! ```text
//! loader: PUT handoff {load, P-1} ──► what must happen first ──► moves the plate ──► PUT handoff/completed (or aborted)
//! ```
//! The instrument does not see plates. It checks that the loader does what it announced.

use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(rename_all = "snake_case")]
pub enum HandoffIntent {
    /// The plate will be put in.
    Load,
    /// The plate will be taken away.
    Unload,
}

/// Body of `PUT /v1/plate/handoff`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
#[serde(deny_unknown_fields)]
pub struct Handoff {
    pub intent: HandoffIntent,
    pub barcode: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HandoffEnd {
    Completed,
    Aborted,
}
