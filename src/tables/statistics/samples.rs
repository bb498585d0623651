//! The numbers of the measured wells.

use super::{Flagged, GroupReference, QUANTITIES, SIGNAL, WellCondition};
use carved_core::flag::{Effect, Flag, StoredFlag};
use carved_records::SpecimenOutcome;
use carved_store::{Computation, StoredRun, StoredWell, place_among_references};
use serde_json::Value;

/// A measured well.
#[derive(Debug, Clone)]
pub struct Sample {
    pub run: String,
    pub well: String,
    pub condition: WellCondition,
    /// The well did not succeed: its number never counts.
    pub is_refused: bool,
    /// The flags of the specimen.
    pub flags: Vec<StoredFlag>,
    /// Whether the second camera was saturated.
    pub saturated: bool,
    /// By the place in [`QUANTITIES`].
    pub numbers: [Option<f64>; QUANTITIES.len()],
    /// Reference larvae of the same age, by the place in [`QUANTITIES`].
    pub references: [Option<GroupReference>; QUANTITIES.len()],
}

impl Sample {
    /// Whether the number at this place in [`QUANTITIES`] counts.
    pub fn counts(&self, q: usize, flagged: Flagged) -> bool {
        !self.is_refused && self.left_out(q, flagged).is_empty()
    }

    /// The flags for which the number at this place in [`QUANTITIES`] does not count.
    pub fn left_out(&self, q: usize, flagged: Flagged) -> Vec<StoredFlag> {
        let is_signal = QUANTITIES[q].0 == SIGNAL;
        let own = self.flags.iter().filter(|flag| match flagged {
            Flagged::Included => flag.effect() == Effect::Excluded,
            Flagged::Sound => flag.effect() != Effect::Holds,
            Flagged::Excluded => true,
        });
        let saturated = (self.saturated && is_signal && flagged != Flagged::Included).then_some(Flag::Saturated.into());
        own.cloned().chain(saturated).collect()
    }
}

/// The reference larvae of a quantity of larvae. Those of the eyes only where the references have eyes.
fn reference(measurement: &Value, column: &str) -> Option<GroupReference> {
    let quantity = match column {
        "volume_um3" => "volume",
        "area_um2" => "area",
        "eye_volume_um3" => "eye_volume",
        "eye_distance_um" => "eye_distance",
        _ => return None,
    };
    let (_, place) = place_among_references(measurement, quantity)?;
    let end = |i: usize| place["interval_95"][i].as_f64();
    Some(GroupReference { group: place["group"].as_str()?.to_owned(), n: place["n"].as_u64()?, interval_95: [end(0)?, end(1)?].into() })
}

/// Whether the second camera was saturated, by its flags.
fn saturated(flags: &Value) -> bool {
    flags.as_array().is_some_and(|flags| flags.iter().any(|flag| flag == Flag::Saturated.code()))
}

/// Whether the number of this well is not reported: the well did not succeed. A later computation judges its number anew.
fn is_refused(well: &StoredWell, measurement: &Value) -> bool {
    let outcome = well.status.as_ref().and_then(|status| status.outcome);
    let has_findings = measurement["turn_findings"].as_array().is_some_and(|findings| !findings.is_empty());
    has_findings || well.computation == Computation::OfRun && outcome.is_some_and(|outcome| outcome != SpecimenOutcome::Succeeded)
}

/// The measured wells of runs, in the order of their plans. A well with a file that cannot be read, or was altered, is left out.
pub fn of(runs: &[StoredRun]) -> Vec<Sample> {
    let mut samples = Vec::new();
    for run in runs {
        for mut well in run.wells() {
            let Some(measurement) = well.measurement.take() else { continue };
            let number = |(_, _, pointer): (&str, &str, &str)| measurement.pointer(pointer).and_then(Value::as_f64);
            samples.push(Sample {
                run: run.record().id.clone(),
                well: well.planned.well.clone(),
                is_refused: is_refused(&well, &measurement),
                condition: WellCondition::of(&well.planned),
                flags: well.status.map(|status| status.flags).unwrap_or_default(),
                saturated: measurement.pointer("/fluorescence/flags").is_some_and(saturated),
                numbers: QUANTITIES.map(number),
                references: QUANTITIES.map(|(column, ..)| reference(&measurement, column)),
            });
        }
    }
    samples
}
