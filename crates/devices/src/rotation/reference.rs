//! How an axis finds its step 0.

use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// Runs the controller's homing cycle to a switch.
    Home,
    /// Takes the place where the axis stands; enough where only angles within one revolution matter.
    Here,
}
