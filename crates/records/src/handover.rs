//! Handing a plate over: announced, then completed or called off.
//!
//! ```text
//! loader: PUT handoff {load, P-1} ──► what is needed first ──► moves the plate ──► PUT handoff/completed (or aborted)
//! ```
//! The instrument does not see plates: it believes the loader, and holds it to what it said.

use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HandoffIntent {
    /// The plate is to be put in.
    Load,
    /// The plate is to be taken away.
    Unload,
}

/// Body of `PUT /v1/plate/handoff`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
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
