//! A well of a run: its outcome, its numbers and its times.

use crate::{Phase, PlannedWell, ReferenceStatus, SpecimenKind, SpecimenOutcome, WellNote};
use carved_core::flag::{Flag, StoredFlag};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Duration;

/// A well of the run, in its current state.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct WellStatus {
    pub well: String,
    /// The kind of specimen, from the plate map.
    pub specimen: SpecimenKind,
    pub dpf: Option<f64>,
    pub outcome: Option<SpecimenOutcome>,
    /// Why a skipped or failed well has no number.
    pub reason: Option<String>,
    #[serde(default)]
    #[cfg_attr(feature = "schema", schema(value_type = Vec<String>))]
    pub flags: Vec<StoredFlag>,
    /// The estimator of the numbers: `support` (slices of the outlines) or `voxel` (as in the paper).
    #[serde(default)]
    pub estimator: Option<String>,
    pub volume_um3: Option<f64>,
    /// Standard deviation of the volume.
    #[serde(default)]
    pub volume_sd_um3: Option<f64>,
    pub area_um2: Option<f64>,
    #[serde(default)]
    pub area_sd_um2: Option<f64>,
    /// Volume of the field surface, which is the one that the page shows.
    pub field_volume_um3: Option<f64>,
    pub field_area_um2: Option<f64>,
    /// Diameter of the fitted sphere, for beads.
    pub diameter_um: Option<f64>,
    /// Number of views that count. It is below the planned number if views did not fit or the method ended the turn early. For a well that
    /// was aborted or interrupted, it is the number of views that are stored: 0 if none was taken, and `null` in runs of versions that did not count them.
    #[serde(default)]
    pub views: Option<u32>,
    /// Number of views by the method.
    #[serde(default)]
    pub views_planned: Option<u32>,
    /// Residual of the median view: how far its edges lie from those of the calibrated model, px.
    #[serde(default)]
    pub residual_px: Option<f64>,
    /// Fluorescence in the second camera per volume: grey levels times px per nl.
    #[serde(default)]
    pub signal_per_nl: Option<f64>,
    /// Comparison of a larva of known age with reference larvae.
    #[serde(default)]
    pub reference: Option<Box<ReferenceStatus>>,
    /// The newest remark of a person on it.
    #[serde(default)]
    pub note: Option<Box<WellNote>>,
}

impl WellStatus {
    /// A well that was not measured yet.
    pub fn pending(planned: &PlannedWell) -> Self {
        Self::empty(planned.well.clone(), planned.specimen, planned.dpf)
    }

    fn empty(well: String, specimen: SpecimenKind, dpf: Option<f64>) -> Self {
        Self {
            well,
            specimen,
            dpf,
            outcome: None,
            reason: None,
            flags: Vec::new(),
            estimator: None,
            volume_um3: None,
            volume_sd_um3: None,
            area_um2: None,
            area_sd_um2: None,
            field_volume_um3: None,
            field_area_um2: None,
            diameter_um: None,
            views: None,
            views_planned: None,
            residual_px: None,
            signal_per_nl: None,
            reference: None,
            note: None,
        }
    }

    /// Sets a person's remark, and the flag that an exclusion is.
    pub fn set_note(&mut self, note: Option<Box<WellNote>>) {
        let excluded = StoredFlag::from(Flag::Excluded);
        self.flags.retain(|flag| *flag != excluded);
        if note.as_ref().is_some_and(|note| note.excluded) {
            self.flags.push(excluded);
        }
        self.note = note;
    }

    pub fn end(&mut self, outcome: SpecimenOutcome, reason: Option<&str>) {
        self.outcome = Some(outcome);
        self.reason = reason.map(str::to_owned);
    }

    /// Fails a well that may have numbers. They are not those of its specimen, and are removed.
    pub fn fail_measured(&mut self, reason: &str) {
        let (flags, views, views_planned) = (std::mem::take(&mut self.flags), self.views, self.views_planned);
        *self = Self { flags, views, views_planned, ..Self::empty(std::mem::take(&mut self.well), self.specimen, self.dpf) };
        self.end(SpecimenOutcome::Failed, Some(reason));
    }

    /// Ends a well without a number before its turn was complete. `views`: how many of its views are stored.
    pub fn end_early(&mut self, outcome: SpecimenOutcome, reason: &str, views: u32) {
        self.end(outcome, Some(reason));
        self.views = Some(views);
    }
}

impl WellCounts {
    /// Counts each well once. A measured well with flags counts as `flagged`, not as `succeeded`.
    pub fn of(wells: &[WellStatus]) -> Self {
        let mut counts = Self::default();
        for well in wells {
            counts.add(well.outcome, !well.flags.is_empty(), 1);
        }
        counts
    }

    /// Counts `number` more wells with this outcome. `is_flagged`: they have flags.
    pub fn add(&mut self, outcome: Option<SpecimenOutcome>, is_flagged: bool, number: u32) {
        self.total += number;
        *match outcome {
            None => &mut self.pending,
            Some(SpecimenOutcome::Succeeded) if is_flagged => &mut self.flagged,
            Some(SpecimenOutcome::Succeeded) => &mut self.succeeded,
            Some(SpecimenOutcome::Failed) => &mut self.failed,
            Some(SpecimenOutcome::Skipped) => &mut self.skipped,
            Some(SpecimenOutcome::Aborted | SpecimenOutcome::Interrupted) => &mut self.interrupted,
        } += number;
    }
}

/// Disjoint counts of a run's wells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(utoipa::ToSchema))]
pub struct WellCounts {
    pub succeeded: u32,
    pub flagged: u32,
    pub failed: u32,
    pub skipped: u32,
    pub interrupted: u32,
    pub pending: u32,
    pub total: u32,
}

/// The live estimate of a specimen's volume, from the views so far. All fields are `None` while it is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LiveEstimate {
    /// The estimate, um^3.
    pub volume_um3: Option<f64>,
    /// Its standard deviation, um^3.
    pub volume_sd_um3: Option<f64>,
    /// Number of views in the estimate.
    pub volume_views: Option<u32>,
    /// Whether the estimate has converged by the rule of the method's early end.
    pub converged: Option<bool>,
}

/// Times of a well, s. The sum of the phases exceeds the duration of the well if two phases ran in parallel.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WellTimes {
    /// Time of each phase, by its name.
    pub phases_s: BTreeMap<String, f64>,
    /// The part for motors, settling, exposures, and for loading and ejecting specimens.
    pub devices_s: f64,
    /// The rest, which the program itself used.
    pub own_s: f64,
    /// Number of attempts at the specimen.
    pub attempts: u32,
}

impl WellTimes {
    /// Adds the time of a phase.
    pub fn phase(&mut self, phase: Phase, took: Duration) {
        *self.phases_s.entry(phase.name().into()).or_default() += took.as_secs_f64();
        if matches!(phase, Phase::Load | Phase::Eject | Phase::Wash) {
            self.devices_s += took.as_secs_f64();
        }
        self.own_s = self.phases_s.values().sum::<f64>() - self.devices_s;
    }

    /// Counts a part of a phase as time of a device.
    pub fn device(&mut self, took: Duration) {
        self.devices_s += took.as_secs_f64();
        self.own_s -= took.as_secs_f64();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_time_is_what_devices_leave() {
        let mut times = WellTimes::default();
        let s = Duration::from_secs;
        times.phase(Phase::Load, s(30));
        times.device(s(3));
        times.phase(Phase::Revolve, s(4));
        times.phase(Phase::Measure, s(2));
        times.phase(Phase::Eject, s(5));
        assert!((times.own_s - 3.0).abs() < 1e-9 && (times.devices_s - 38.0).abs() < 1e-9, "{times:?}");
    }
}
