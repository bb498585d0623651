//! The place of a larva in plain words.

use super::group::Quantity;
use super::matching::{Known, Mismatch, Missing, MissingReason, asd_is_matched};
use super::predictive::Place;
use super::standing::Answer;
use std::fmt;

impl Answer<Place> {
    /// The sentence for an operator: `area 0.8 SD below the mean of 24 larvae of 4 dpf`, `volume: no reference larvae with as many views`.
    /// `dpf` is the specimen's age.
    pub fn words(&self, quantity: Quantity, dpf: f64) -> String {
        match self {
            Self::Known(place) if asd_is_matched(&place.mismatches) => format!("{quantity} {}", place.words(dpf)),
            Self::Known(place) => {
                format!("{quantity}: no reference larvae with as many views; {} whose number of views is not stated", place.words(dpf))
            }
            Self::Missing(missing) => format!("{quantity}: {}", missing.words(dpf)),
        }
    }
}

impl Place {
    fn words(&self, dpf: f64) -> String {
        let side = if self.z < 0.0 { "below" } else { "above" };
        format!("{:.1} SD {side} the mean of {} larvae of {dpf} dpf", self.z.abs(), self.n)
    }
}

impl Missing {
    /// Why there is no reference, and what there is instead.
    fn words(&self, dpf: f64) -> String {
        let list = self.there_are.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        match self.reason {
            MissingReason::Age if list.is_empty() => "no reference".to_owned(),
            MissingReason::Age => format!("no reference of {dpf} dpf (there are: {list})"),
            MissingReason::Estimator if matches!(self.quantity, Quantity::EyeVolume | Quantity::EyeDistance) => {
                format!("no reference of the eyes of {dpf} dpf")
            }
            MissingReason::Estimator => "no reference by this estimator".to_owned(),
            MissingReason::Quantity => format!("no reference of {dpf} dpf"),
            MissingReason::Asd => format!("no reference larvae with as many views (there are: {list} views)"),
        }
    }
}

impl fmt::Display for Known {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(x) => write!(f, "{x}"),
            Self::Word(word) => f.write_str(word),
        }
    }
}

/// `voxel edge: 6.93 um, the reference's not stated`, `treatment: not known, the reference's fixed`.
impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, unit) = match self.key.as_str() {
            "asd" => ("planned views", ""),
            "voxel_um" => ("voxel edge", " um"),
            "views" => ("views that carved", ""),
            other => (other, ""),
        };
        let said = |known: &Option<Known>, nothing: &str| known.as_ref().map_or_else(|| nothing.to_owned(), |k| format!("{k}{unit}"));
        write!(f, "{name}: {}, the reference's {}", said(&self.specimen, "not known"), said(&self.reference, "not stated"))
    }
}
