//! The numbers of the measured wells.

use super::{GroupReference, QUANTITIES, WellCondition};
use carved_store::{StoreError, StoredRun, place_among_references};
use serde_json::Value;

/// A measured well.
#[derive(Debug, Clone)]
pub struct Sample {
    pub run: String,
    pub well: String,
    pub condition: WellCondition,
    /// Whether the specimen has flags.
    pub flagged: bool,
    /// By the place in [`QUANTITIES`].
    pub numbers: [Option<f64>; QUANTITIES.len()],
    /// Reference larvae of the same age, by the place in [`QUANTITIES`].
    pub references: [Option<GroupReference>; QUANTITIES.len()],
}

/// The reference larvae of a quantity of larvae. Volume and area have some.
fn reference(measurement: &Value, column: &str) -> Option<GroupReference> {
    let quantity = match column {
        "volume_um3" => "volume",
        "area_um2" => "area",
        _ => return None,
    };
    let (_, place) = place_among_references(measurement, quantity)?;
    let end = |i: usize| place["interval_95"][i].as_f64();
    Some(GroupReference { group: place["group"].as_str()?.to_owned(), n: place["n"].as_u64()?, interval_95: [end(0)?, end(1)?].into() })
}

/// The measured wells of runs, in the order of their plans.
///
/// # Errors
/// A file that is there and cannot be read, or was altered.
pub fn of(runs: &[StoredRun]) -> Result<Vec<Sample>, StoreError> {
    let mut samples = Vec::new();
    for run in runs {
        for planned in &run.record().plan.plate_map {
            let well = run.well(planned)?;
            let Some(measurement) = well.measurement else { continue };
            let number = |(_, _, pointer): (&str, &str, &str)| measurement.pointer(pointer).and_then(Value::as_f64);
            samples.push(Sample {
                run: run.record().id.clone(),
                well: planned.well.clone(),
                condition: WellCondition::of(planned),
                flagged: well.status.is_some_and(|status| !status.flags.is_empty()),
                numbers: QUANTITIES.map(number),
                references: QUANTITIES.map(|(column, ..)| reference(&measurement, column)),
            });
        }
    }
    Ok(samples)
}
