//! `run.json`: plan, method and outcome of a run, one entry per well.

use super::{Software, StoreError, schema};
use carved_core::frame::RawFrame;
use carved_records::{
    CalibrationStatus, InstrumentIdentity, Method, Mode, RunOutcome, RunPlan, SpecimenOutcome, WellStatus, is_plain_name, is_well,
    sha256_hex,
};
use serde::{Deserialize, Serialize};
use std::path::Path;

const SCHEMA: &str = "carved.run/1";

pub(super) const FILE: &str = "run.json";

/// Content of `run.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    pub schema: String,
    pub id: String,
    pub software: Software,
    pub mode: Mode,
    /// The instrument that made the run. `None` for imported pictures and in files of versions that did not write it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub instrument: Option<InstrumentIdentity>,
    pub plan: RunPlan,
    pub method: Method,
    /// SHA-256 of the empty-capillary picture, as in every `recording.json`.
    #[serde(default)]
    pub empty_capillary_sha256: Option<String>,
    /// The newest calibration of the rig when the run started.
    #[serde(default)]
    pub calibration: Option<CalibrationStatus>,
    /// RFC 3339, UTC.
    pub started: String,
    pub ended: Option<String>,
    /// The clock was set back during the run, so `ended` is not the time that it showed at the end but that of the start.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub clock_set_back: bool,
    pub outcome: Option<RunOutcome>,
    pub wells: Vec<WellStatus>,
}

impl RunRecord {
    pub fn new(id: &str, plan: RunPlan, method: Method, mode: Mode, empty: Option<&RawFrame>) -> Self {
        let wells = plan.plate_map.iter().map(WellStatus::pending).collect();
        Self {
            schema: SCHEMA.into(),
            id: id.into(),
            software: Software::this(),
            mode,
            instrument: None,
            plan,
            method,
            empty_capillary_sha256: empty.map(|frame| sha256_hex(frame.bytes())),
            calibration: None,
            started: jiff::Timestamp::now().to_string(),
            ended: None,
            clock_set_back: false,
            outcome: None,
            wells,
        }
    }

    pub fn end(&mut self, outcome: RunOutcome) {
        self.end_at(outcome, jiff::Timestamp::now());
    }

    /// A run does not end before its start, also if the clock was set back.
    fn end_at(&mut self, outcome: RunOutcome, now: jiff::Timestamp) {
        self.clock_set_back = self.started.parse::<jiff::Timestamp>().is_ok_and(|started| now < started);
        if self.clock_set_back {
            tracing::warn!(run = self.id, started = self.started, %now, "the clock was set back during the run");
        }
        self.ended = Some(if self.clock_set_back { self.started.clone() } else { now.to_string() });
        self.outcome = Some(outcome);
    }

    /// Ends a run that cannot be continued.
    pub fn end_interrupted(&mut self) {
        for well in self.wells.iter_mut().filter(|w| w.outcome.is_none()) {
            well.end(SpecimenOutcome::Interrupted, Some("the daemon ended before this well was done"));
        }
        self.end(RunOutcome::Interrupted);
    }

    /// Reads the `run.json` of a folder. The folder may have another name than the run, as in a copy.
    ///
    /// # Errors
    /// The format is newer, or a name leads out of the folder.
    pub fn of_folder(folder: &Path) -> Result<Self, StoreError> {
        Self::checked(&folder.join(FILE))
    }

    /// Checks the names, because they become paths.
    fn checked(file: &Path) -> Result<Self, StoreError> {
        let run: Self = schema::read(file, SCHEMA)?;
        let wrong = |expected, found: &str| StoreError::Format { path: file.to_owned(), expected, found: format!("{found:?}") };
        if !is_plain_name(&run.id) {
            return Err(wrong("a run's name of letters, digits, '-', '_' and '.' as its id", &run.id));
        }
        let planned = run.plan.plate_map.iter().map(|planned| &planned.well);
        if let Some(well) = planned.chain(run.wells.iter().map(|status| &status.well)).find(|well| !is_well(well)) {
            return Err(wrong("wells A01 to AF48", well));
        }
        Ok(run)
    }

    /// Reads a `run.json`. Its folder must have the run's name.
    pub(super) fn read(file: &Path) -> Result<Self, StoreError> {
        file.symlink_metadata().and_then(|found| carved_files::check(found.file_type())).map_err(StoreError::io("read", file))?;
        let run = Self::checked(file)?;
        let folder = file.parent().and_then(Path::file_name).unwrap_or_default();
        if folder != run.id.as_str() {
            let found = format!("run {:?} in the folder {}", run.id, folder.display());
            return Err(StoreError::Format { path: file.to_owned(), expected: "the run that its folder is named after", found });
        }
        Ok(run)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::power_loss::record;

    #[test]
    fn a_run_does_not_end_before_its_start_and_says_that_the_clock_was_set_back() {
        let started = "2026-01-01T12:00:00Z";
        for (now, ended, set_back) in [
            ("2026-01-01T11:00:00Z", started, true),
            ("2026-01-01T12:00:00Z", started, false),
            ("2026-01-01T13:00:00Z", "2026-01-01T13:00:00Z", false),
        ] {
            let mut run = RunRecord { started: started.into(), ..record("r1") };
            run.end_at(RunOutcome::Succeeded, now.parse().unwrap());
            assert_eq!((run.ended.as_deref(), run.clock_set_back), (Some(ended), set_back), "{now}");
            assert_eq!(serde_json::to_string(&run).unwrap().contains("clock_set_back"), set_back);
        }
    }
}
