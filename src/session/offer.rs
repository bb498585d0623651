//! What a run may be asked for by name: the methods of the configuration, in short.

use carved_records::{Method, Versioned, ViewOrder};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A method of this instrument; `run.json` records it whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MethodOffer {
    pub name: String,
    /// What the lab calls this state of it; `null` where the configuration does not say.
    pub version: Option<String>,
    /// ASD: axial views in one revolution.
    pub asd: u32,
    /// `sequential` or `coarse_to_fine`.
    #[schema(value_type = String)]
    pub order: ViewOrder,
    /// Share of the views that may miss a voxel that still counts.
    pub epsilon: f64,
    /// SD: edge of a voxel, um.
    pub voxel_um: f64,
}

impl MethodOffer {
    pub fn new(name: &str, method: &Method) -> Self {
        Self {
            name: name.to_owned(),
            version: method.version.clone(),
            asd: method.asd,
            order: method.order,
            epsilon: method.epsilon,
            voxel_um: method.voxel_um,
        }
    }
}

impl Versioned for MethodOffer {
    fn version(&self) -> Option<&str> {
        self.version.as_deref()
    }
}
