//! What the events of this process amount to, for `/metrics`: counters and histograms that begin at 0 with each start of the daemon.

use carved_records::{EventData, FAULT_CODES, HeldBy, RunOutcome, SpecimenDone, SpecimenOutcome};
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::{Registry, Unit};

type Label = [(&'static str, String); 1];
/// A counter per value of one label.
type Counters = Family<Label, Counter>;
/// A histogram per value of one label.
type Histograms = Family<Label, Histogram, fn() -> Histogram>;

/// Bounds of times in s: from the fastest phase to its longest deadline.
const SECONDS: [f64; 12] = [0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0];
/// Bounds of the standard deviation over the volume. Clean larvae have less than 1 %, and 5 % is of no use.
const SD: [f64; 8] = [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2];
/// Bounds of the residual in px. The edges of good frames are found to a tenth of a pixel.
const RESIDUAL_PX: [f64; 8] = [0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0];

/// Counters and histograms of a process.
pub struct Tally {
    specimens: Counters,
    flags: Counters,
    runs: Counters,
    held: Counters,
    faults: Counters,
    phases: Histograms,
    own: Histogram,
    rig: Histogram,
    volume_sd: Histogram,
    residual: Histogram,
    store_refusals: Counter,
    index_failures: Counter,
}

fn seconds() -> Histogram {
    Histogram::new(SECONDS)
}

/// Every value of a label begins at 0, so that `increase` sees the first event.
fn known(label: &'static str, values: impl IntoIterator<Item = String>) -> Counters {
    let counters = Counters::default();
    values.into_iter().for_each(|value| drop(counters.get_or_create(&[(label, value)])));
    counters
}

impl Default for Tally {
    fn default() -> Self {
        use SpecimenOutcome::{Aborted, Failed, Interrupted, Skipped, Succeeded};
        let of_runs = [RunOutcome::Succeeded, RunOutcome::Partial, RunOutcome::Failed, RunOutcome::Aborted, RunOutcome::Interrupted];
        Self {
            specimens: known("outcome", [Succeeded, Failed, Aborted, Interrupted, Skipped].map(word)),
            flags: Counters::default(),
            runs: known("outcome", of_runs.map(word)),
            held: known("by", [HeldBy::Fault, HeldBy::Operator].map(word)),
            faults: known("code", FAULT_CODES.iter().map(|code| code.code.to_owned())),
            phases: Family::new_with_constructor(seconds),
            own: seconds(),
            rig: seconds(),
            volume_sd: Histogram::new(SD),
            residual: Histogram::new(RESIDUAL_PX),
            store_refusals: Counter::default(),
            index_failures: Counter::default(),
        }
    }
}

fn word(value: impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_else(|| "none".into())
}

impl Tally {
    /// Takes an event that is on disk. Every label has few values: outcomes, flags, phases and codes are closed sets.
    pub(super) fn take(&self, event: &EventData) {
        match event {
            EventData::SpecimenDone(done) => self.specimen(done),
            EventData::RunEnded(ended) => count(&self.runs, "outcome", word(ended.outcome)),
            EventData::RunHeld(held) => count(&self.held, "by", word(held.by)),
            EventData::FaultRaised(fault) => count(&self.faults, "code", fault.code.clone()),
            _ => {}
        }
    }

    fn specimen(&self, done: &SpecimenDone) {
        let well = &done.result;
        count(&self.specimens, "outcome", word(well.outcome));
        for flag in &well.flags {
            count(&self.flags, "flag", flag.to_string());
        }
        if let Some(times) = &done.times {
            for (phase, took_s) in &times.phases_s {
                self.phases.get_or_create(&[("phase", phase.clone())]).observe(*took_s);
            }
            self.own.observe(times.own_s);
        }
        if let Some(seconds) = done.seconds {
            self.rig.observe(seconds);
        }
        if let (Some(volume), Some(sd)) = (well.volume_um3, well.volume_sd_um3) {
            self.volume_sd.observe(sd / volume);
        }
        if let Some(residual) = well.residual_px {
            self.residual.observe(residual);
        }
    }

    /// The disk refused a write.
    pub(super) fn store_refused(&self) {
        self.store_refusals.inc();
    }

    /// The index could not follow what is on disk.
    pub(super) fn index_failed(&self) {
        self.index_failures.inc();
    }

    /// Adds everything to the answer of a scrape.
    pub fn register(&self, registry: &mut Registry) {
        let s = Unit::Seconds;
        registry.register("specimens", "Specimens done by outcome", self.specimens.clone());
        registry.register("specimen_flags", "Specimens done with this flag", self.flags.clone());
        registry.register("runs", "Runs ended by outcome", self.runs.clone());
        registry.register("run_holds", "Holds of runs, by a fault or by an operator", self.held.clone());
        registry.register("faults_raised", "Faults raised by code", self.faults.clone());
        registry.register_with_unit("phase_duration", "Time of a phase of a specimen", s.clone(), self.phases.clone());
        registry.register_with_unit("specimen_own", "Time that the program itself used for a specimen", s.clone(), self.own.clone());
        registry.register_with_unit("specimen_rig", "Time that a specimen used the instrument", s, self.rig.clone());
        let (ratio, pixels) = (Unit::Other("ratio".into()), Unit::Other("pixels".into()));
        registry.register_with_unit("specimen_volume_sd", "Standard deviation over volume", ratio, self.volume_sd.clone());
        registry.register_with_unit("specimen_residual", "Residual of the median view", pixels, self.residual.clone());
        registry.register("store_refusals", "Writes that the disk refused", self.store_refusals.clone());
        registry.register("index_failures", "Times that the index fell behind what is on disk", self.index_failures.clone());
    }
}

fn count(counters: &Counters, label: &'static str, value: String) {
    counters.get_or_create(&[(label, value)]).inc();
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::{Fault, RunEnded, WellCounts, fault_table};
    use serde_json::json;

    fn text(tally: &Tally) -> String {
        let mut registry = Registry::default();
        tally.register(&mut registry);
        let mut text = String::new();
        prometheus_client::encoding::text::encode(&mut text, &registry).unwrap();
        text
    }

    #[test]
    fn events_are_counted_by_outcome_flag_and_code() {
        let tally = Tally::default();
        let before = text(&tally);
        for line in ["specimens_total{outcome=\"failed\"} 0", "faults_raised_total{code=\"disk_full\"} 0"] {
            assert!(before.lines().any(|found| found == line), "{line} is not in\n{before}");
        }
        let done = json!({
            "well": "A01", "specimen": "larva", "dpf": 3.0, "outcome": "succeeded", "reason": null, "flags": ["moved", "residual"],
            "volume_um3": 2e8, "volume_sd_um3": 3e6, "area_um2": 3e6, "field_volume_um3": null, "field_area_um2": null,
            "diameter_um": null, "residual_px": 0.25, "seconds": 31.0,
            "times": {"phases_s": {"revolve": 26.5, "measure": 0.3}, "devices_s": 25.0, "own_s": 1.8, "attempts": 1},
        });
        tally.take(&EventData::SpecimenDone(serde_json::from_value(done).unwrap()));
        tally.take(&EventData::RunEnded(RunEnded { outcome: Some(RunOutcome::Partial), wells: WellCounts::default(), loaded_by: None }));
        tally.take(&EventData::FaultRaised(Fault::new(1, &fault_table::DISK_FULL, String::new(), String::new())));
        tally.store_refused();
        let after = text(&tally);
        for line in [
            "specimens_total{outcome=\"succeeded\"} 1",
            "specimen_flags_total{flag=\"moved\"} 1",
            "specimen_flags_total{flag=\"residual\"} 1",
            "runs_total{outcome=\"partial\"} 1",
            "faults_raised_total{code=\"disk_full\"} 1",
            "phase_duration_seconds_bucket{le=\"20.0\",phase=\"revolve\"} 0",
            "phase_duration_seconds_bucket{le=\"40.0\",phase=\"revolve\"} 1",
            "specimen_own_seconds_sum 1.8",
            "specimen_rig_seconds_count 1",
            "specimen_volume_sd_ratio_bucket{le=\"0.01\"} 0",
            "specimen_volume_sd_ratio_bucket{le=\"0.02\"} 1",
            "specimen_residual_pixels_bucket{le=\"0.3\"} 1",
            "store_refusals_total 1",
            "index_failures_total 0",
        ] {
            assert!(after.lines().any(|found| found == line), "{line} is not in\n{after}");
        }
    }
}
