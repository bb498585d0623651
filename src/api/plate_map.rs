//! A plate map, as it was read.

use carved_records as records;
use carved_records::PlannedWell;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A plate map that holds no mistake.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct PlateMap {
    /// The `plate_format` of a run's plan, where the file names it.
    pub plate_format: Option<u32>,
    /// The `plate_map` of a run's plan: the wells in the order of the file.
    pub plate_map: Vec<PlannedWell>,
    /// The `metadata` of a run's plan: MIHCSME as it came, or `columns` with the cells of a CSV that carved does not read.
    #[schema(value_type = Object)]
    pub metadata: records::Metadata,
    /// What was read otherwise than it stands there, each with its place.
    pub notes: Vec<String>,
    /// What a person confirms before a run, with its place: a single well makes the plate larger, and may be a misprint. The choice of the plate
    /// (`plate_format`) confirms it. `null` where nothing is to be confirmed.
    #[serde(default)]
    pub confirm: Option<String>,
}

impl From<records::plate_map::PlateMap> for PlateMap {
    fn from(from: records::plate_map::PlateMap) -> Self {
        let records::plate_map::PlateMap { plate_format, plate_map, metadata, notes, confirm } = from;
        Self { plate_format, plate_map, metadata, notes, confirm }
    }
}
