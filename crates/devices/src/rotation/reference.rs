//! How an axis finds its reference position, step 0.

use serde::{Deserialize, Serialize};

/// The kind of reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// Runs the controller's homing cycle to a switch.
    Home,
    /// Takes the present position. This is enough if only angles within one revolution matter.
    Here,
}
