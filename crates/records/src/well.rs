//! One well of a run: what became of it, its numbers and where its time went.

use crate::{Phase, PlannedWell, ReferenceStatus, SpecimenKind, SpecimenOutcome};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::Duration;

/// One well of the run, as far as it has come.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WellStatus {
    pub well: String,
    /// What the plate map says is in it.
    pub specimen: SpecimenKind,
    pub dpf: Option<f64>,
    pub outcome: Option<SpecimenOutcome>,
    /// Why a skipped or failed well has no number.
    pub reason: Option<String>,
    #[serde(default)]
    pub flags: Vec<String>,
    /// What made the numbers to trust: `support` (slices of the outlines) or `voxel` (the paper's).
    #[serde(default)]
    pub estimator: Option<String>,
    pub volume_um3: Option<f64>,
    /// Standard deviation.
    #[serde(default)]
    pub volume_sd_um3: Option<f64>,
    pub area_um2: Option<f64>,
    #[serde(default)]
    pub area_sd_um2: Option<f64>,
    /// Of the surface where the outlines put it, which is the one that is shown.
    pub field_volume_um3: Option<f64>,
    pub field_area_um2: Option<f64>,
    /// Of the fitted sphere, for beads.
    pub diameter_um: Option<f64>,
    /// Views that count; fewer than planned where some did not belong, or the method ended the turn early.
    #[serde(default)]
    pub views: Option<u32>,
    /// By the method: `views` of so many.
    #[serde(default)]
    pub views_planned: Option<u32>,
    /// Fluorescence in the second camera per volume: grey levels times px per nl.
    #[serde(default)]
    pub signal_per_nl: Option<f64>,
    /// Where a larva of known age stands among reference larvae.
    #[serde(default)]
    pub reference: Option<Box<ReferenceStatus>>,
}

impl WellStatus {
    /// A well that is still to come.
    pub fn pending(planned: &PlannedWell) -> Self {
        Self {
            well: planned.well.clone(),
            specimen: planned.specimen,
            dpf: planned.dpf,
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
            signal_per_nl: None,
            reference: None,
        }
    }

    pub fn end(&mut self, outcome: SpecimenOutcome, reason: Option<&str>) {
        self.outcome = Some(outcome);
        self.reason = reason.map(str::to_owned);
    }
}

impl WellCounts {
    /// Counts each well once: a measured one with flags is `flagged`, not `succeeded`.
    pub fn of(wells: &[WellStatus]) -> Self {
        let mut counts = Self { total: wells.len() as u32, ..Self::default() };
        for well in wells {
            *match well.outcome {
                None => &mut counts.pending,
                Some(SpecimenOutcome::Succeeded) if well.flags.is_empty() => &mut counts.succeeded,
                Some(SpecimenOutcome::Succeeded) => &mut counts.flagged,
                Some(SpecimenOutcome::Failed) => &mut counts.failed,
                Some(SpecimenOutcome::Skipped) => &mut counts.skipped,
                Some(SpecimenOutcome::Aborted | SpecimenOutcome::Interrupted) => &mut counts.interrupted,
            } += 1;
        }
        counts
    }
}

/// Disjoint counts of a run's wells.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct WellCounts {
    pub succeeded: u32,
    pub flagged: u32,
    pub failed: u32,
    pub skipped: u32,
    pub interrupted: u32,
    pub pending: u32,
    pub total: u32,
}

/// The volume of a specimen that is being turned, of the views that were taken until now. `None` throughout while it is not known.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct LiveEstimate {
    /// The estimate, um^3.
    pub volume_um3: Option<f64>,
    /// Its standard deviation, um^3.
    pub volume_sd_um3: Option<f64>,
    /// The views that it is made of.
    pub volume_views: Option<u32>,
    /// Whether it has settled within what the method's early end promises.
    pub converged: Option<bool>,
}

/// Where the time of a well went, s. Phases add up to more than the well took where two of them went on side by side.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct WellTimes {
    /// By the phase's name.
    pub phases_s: BTreeMap<String, f64>,
    /// Of that, what motors, rests, exposures and who brings and takes specimens took.
    pub devices_s: f64,
    /// The rest: what the program itself took.
    pub own_s: f64,
    /// Turns that were begun of the specimen.
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

    /// Counts a part of a phase as a device's.
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
