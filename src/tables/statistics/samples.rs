//! The numbers of the measured wells.

use super::{QUANTITIES, WellCondition};
use carved_store::{StoreError, StoredRun};

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
            let number = |(_, _, pointer): (&str, &str, &str)| measurement.pointer(pointer).and_then(serde_json::Value::as_f64);
            samples.push(Sample {
                run: run.record().id.clone(),
                well: planned.well.clone(),
                condition: WellCondition::of(planned),
                flagged: well.status.is_some_and(|status| !status.flags.is_empty()),
                numbers: QUANTITIES.map(number),
            });
        }
    }
    Ok(samples)
}
