//! The daily beads as a run asks for them: kept after a run that had some, and asked for before numbers are taken for sound.

use crate::config::Config;
use carved_records::{BeadGate, Method};
use carved_records::{CalibrationStatus, FieldError, GateStatus, Mode, RunPlan, SpecimenKind, SpecimenOutcome, WellStatus};
use carved_store::calibrations;
use carved_store::gates::{self, GateFile};
use std::path::Path;

fn status_of(file: &GateFile, now: jiff::Timestamp) -> GateStatus {
    let verdict = serde_json::to_value(file.found.gate.verdict).ok();
    GateStatus {
        id: file.id.clone(),
        verdict: verdict.and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default(),
        measured: file.found.measured.to_string(),
        max_age_s: file.found.settings.max_age_h * 3600.0,
        stands: file.stands(now),
        words: file.found.gate.words.clone(),
    }
}

/// The rig's newest gate, from disk; one that cannot be read is told in the log, and is none.
fn newest(config: &Config, mode: Mode) -> Option<GateStatus> {
    let found = gates::newest(&config.calibrations(), &config.rig_name, mode).unwrap_or_else(|error| {
        tracing::warn!(%error, "the rig's bead gates are not read");
        None
    })?;
    Some(status_of(&found, jiff::Timestamp::now()))
}

/// The rig's newest calibration with its gate, from disk; one that cannot be read is told in the log, and is none.
pub fn calibration(config: &Config, mode: Mode) -> Option<CalibrationStatus> {
    let found = calibrations::newest(&config.calibrations(), &config.rig_name, mode).unwrap_or_else(|error| {
        tracing::warn!(%error, "the rig's calibrations are not read");
        None
    });
    let size = found.map(|found| found.status(config.calibration.max_age_days, jiff::Timestamp::now()));
    beside(size, newest(config, mode))
}

/// The rig's calibration with its gate; a gate alone where no calibration of the rig's size is kept.
fn beside(calibration: Option<CalibrationStatus>, gate: Option<GateStatus>) -> Option<CalibrationStatus> {
    let alone = |gate: &GateStatus| CalibrationStatus {
        id: gate.id.clone(),
        kind: "gate".into(),
        measured: gate.measured.clone(),
        age_s: 0.0,
        max_age_s: gate.max_age_s,
        bead_bias_percent: None,
        valid: gate.stands,
        gate: None,
    };
    let mut told = calibration.or_else(|| gate.as_ref().map(alone))?;
    told.gate = gate;
    Some(told)
}

/// Why this method's numbers lack a gate, if its policy asks for one. On an emulated rig only where one was ever kept: a flag on every
/// well of every demo is one that nobody reads.
pub fn lacking(newest: Option<&GateStatus>, method: &Method, mode: Mode) -> Option<String> {
    const WAY_OUT: &str = "measure three to five beads";
    match newest {
        _ if method.policy.bead_gate == BeadGate::Off => None,
        Some(gate) if gate.stands => None,
        Some(gate) if gate.verdict == "passed" || gate.verdict == "no_history" => {
            let hours = gate.max_age_s / 3600.0;
            Some(format!("the newest bead gate is of {}, and stands for {hours:.0} h: {WAY_OUT}", gate.measured))
        }
        Some(gate) => Some(format!("the newest bead gate, of {}, {}; {WAY_OUT}", gate.measured, gate.words.join("; "))),
        None if mode == Mode::Simulated => None,
        None => Some(format!("this rig has no bead gate: {WAY_OUT}")),
    }
}

/// The mistake of a plan with larvae whose method refuses to measure without a gate.
pub fn refuses(config: &Config, mode: Mode, plan: &RunPlan) -> Option<FieldError> {
    let method = config.methods.get(&plan.method).filter(|m| m.policy.bead_gate == BeadGate::Refuse)?;
    let larvae = plan.plate_map.iter().any(|w| w.specimen == SpecimenKind::Larva);
    let why = larvae.then(|| lacking(newest(config, mode).as_ref(), method, mode)).flatten()?;
    Some(FieldError { pointer: "/method".into(), detail: format!("{why}. The method's policy is bead_gate = \"refuse\"") })
}

/// Raises `bead_gate` for a larva that was measured without a gate; beads are what makes one.
pub fn flag(well: &mut WellStatus, lacks_gate: bool) {
    if lacks_gate && well.specimen == SpecimenKind::Larva && well.outcome == Some(SpecimenOutcome::Succeeded) {
        well.flags.push("bead_gate".into());
    }
}

/// Makes and keeps the gate of a run's beads, where it had enough of them.
pub fn keep(config: &Config, run_folder: &Path) {
    match gates::after_run(run_folder, &config.calibrations()) {
        Ok(Some(file)) => tracing::info!(id = %file.id, verdict = ?file.found.gate.verdict, "the run's beads are kept as a gate"),
        Ok(None) => {}
        Err(error) => tracing::warn!(%error, "the run's beads are not kept as a gate"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::PlannedWell;

    fn method(gate: BeadGate) -> Method {
        let config = Config::parse(include_str!("../../config/simulated.toml"), Path::new("simulated.toml")).unwrap();
        let mut method = config.methods["standard"].clone();
        method.policy.bead_gate = gate;
        method
    }

    #[test]
    fn a_gate_is_lacking_where_it_is_asked_for_and_does_not_stand() {
        let gate = |verdict: &str, stands| GateStatus {
            id: "g".into(),
            verdict: verdict.into(),
            measured: "2026-11-20T09:00:00Z".into(),
            max_age_s: 86400.0,
            stands,
            words: vec!["failed: 3 beads".into()],
        };
        let (good, old, bad) = (gate("passed", true), gate("no_history", false), gate("failed", false));
        for asked in [BeadGate::Flag, BeadGate::Refuse] {
            let why = |newest, mode| lacking(newest, &method(asked), mode);
            assert_eq!((why(Some(&good), Mode::Hardware), why(None, Mode::Simulated)), (None, None));
            assert!(why(None, Mode::Hardware).unwrap().contains("no bead gate"));
            assert!(why(Some(&old), Mode::Simulated).unwrap().contains("stands for 24 h"));
            assert!(why(Some(&bad), Mode::Hardware).unwrap().contains("failed: 3 beads"));
        }
        assert_eq!(lacking(Some(&bad), &method(BeadGate::Off), Mode::Hardware), None);
    }

    #[test]
    fn larvae_that_were_measured_without_a_gate_are_flagged_and_beads_are_not() {
        let flags = |kind, outcome, lacks| {
            let mut well = WellStatus::pending(&PlannedWell::new("A01", kind, None));
            well.outcome = outcome;
            flag(&mut well, lacks);
            well.flags
        };
        assert_eq!(flags(SpecimenKind::Larva, Some(SpecimenOutcome::Succeeded), true), ["bead_gate"]);
        assert!(flags(SpecimenKind::Larva, Some(SpecimenOutcome::Succeeded), false).is_empty());
        assert!(flags(SpecimenKind::Larva, Some(SpecimenOutcome::Skipped), true).is_empty());
        assert!(flags(SpecimenKind::Bead, Some(SpecimenOutcome::Succeeded), true).is_empty());
    }
}
