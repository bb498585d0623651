//! The daily bead gate in a run: it is stored after a run with beads, and checked before the numbers of larvae are trusted.

use crate::config::Config;
use carved_core::flag::Flag;
use carved_core::quality::Check;
use carved_core::quality::gate::{BeadGate as CheckedBeads, GateNumbers, GateSettings, GateVerdict};
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
        summary: summary(&file.found.gate, &file.found.settings),
        words: file.found.gate.words.clone(),
    }
}

/// The gate as a text for the operator: verdict, measured size, next action.
fn summary(gate: &CheckedBeads, settings: &GateSettings) -> String {
    let GateNumbers { beads, diameter_um, repeat_um, .. } = &gate.numbers;
    let off_um = diameter_um.mean - settings.expected_um();
    let side = if off_um < 0.0 { "small" } else { "large" };
    let size = format!("{beads} beads, mean diameter {:.1} µm ({:.1} µm too {side})", diameter_um.mean, off_um.abs());
    match gate.verdict {
        GateVerdict::TooFewBeads => {
            format!("Not decided: {beads} of the {} beads that are needed. Next: measure the others.", settings.beads_least)
        }
        GateVerdict::Failed => {
            let limit = gate.checks.iter().find(|check| check.over).map(|check| over(check));
            let changed = || gate.charts.iter().find(|chart| chart.jumped || chart.drifted).map(|chart| changed(&chart.name));
            let (what, next) = limit.or_else(changed).unwrap_or(("a limit is exceeded".into(), "look at the frames of the beads"));
            format!("Failed: {what}. Measure no specimens. Next: {next}.")
        }
        GateVerdict::Passed | GateVerdict::NoHistory => {
            let next = if repeat_um.is_none() {
                "measure one of the beads twice".to_owned()
            } else if gate.verdict == GateVerdict::NoHistory {
                let days = settings.history_least.saturating_sub(gate.history);
                format!("measure beads daily. After {days} more such sets, a change is noticed")
            } else {
                format!("measure specimens. Measure beads again within {:.0} h", settings.max_age_h)
            };
            format!("Passed: {size}. Next: {next}.")
        }
    }
}

/// What this check says is wrong with the beads, and what to do.
fn over(check: &Check) -> (String, &'static str) {
    let found = check.found.unwrap_or_default();
    match check.name.as_str() {
        "aspect_off" => (
            format!("the beads look {:.1} % too {}", 100.0 * found.abs(), if found < 0.0 { "short" } else { "long" }),
            "look for air around the capillary, then calibrate the scale with beads",
        ),
        "roundness_um" => (
            format!("a bead is {found:.1} µm off a sphere, {:.1} µm is allowed", check.limit),
            "clean the capillary and measure the bead again",
        ),
        "residual_px" => ("the views of a bead do not agree".into(), "check focus, light and vibration"),
        "repeat_um" => (
            format!("one bead measured twice differs by {found:.1} µm, {:.1} µm is allowed", check.limit),
            "check focus, light and the seat of the capillary, then measure it again",
        ),
        _ => (
            "the mean diameter is not that of the beads".into(),
            "check the batch of the beads, then calibrate the scale with a micrometer",
        ),
    }
}

/// What has changed since earlier sets, and what to do.
fn changed(chart: &str) -> (String, &'static str) {
    match chart {
        "uy_px" | "gamma_deg" => ("the capillary or the camera has moved since earlier sets".into(), "check their mounts"),
        "aspect_ratio" | "diameter_um" => {
            ("the beads measure differently from earlier sets".into(), "check the lens, its distance and the water around the capillary")
        }
        _ => ("edges are worse than in earlier sets".into(), "check focus, light and the glass"),
    }
}

/// The rig's newest gate, from disk. `None` if there is none, or if it cannot be read, which is logged.
fn newest(config: &Config, mode: Mode) -> Option<GateStatus> {
    let found = gates::newest(&config.calibrations(), &config.rig_name, mode).unwrap_or_else(|error| {
        tracing::warn!(%error, "the rig's bead gates are not read");
        None
    })?;
    Some(status_of(&found, jiff::Timestamp::now()))
}

/// The rig's newest calibration with its gate, from disk. `None` if there is none, or if it cannot be read, which is logged.
pub fn calibration(config: &Config, mode: Mode) -> Option<CalibrationStatus> {
    let found = calibrations::newest(&config.calibrations(), &config.rig_name, mode).unwrap_or_else(|error| {
        tracing::warn!(%error, "the rig's calibrations are not read");
        None
    });
    let size = found.map(|found| found.status(config.calibration.max_age_days, jiff::Timestamp::now()));
    beside(size, newest(config, mode))
}

/// The rig's calibration with its gate, or the gate alone if the rig has no stored calibration.
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

/// Why the numbers of this method lack a gate. `None` if its policy asks for none. On an emulated rig without any gate also `None`:
/// operators would ignore a flag that every well of every demo has.
pub fn lacking(newest: Option<&GateStatus>, method: &Method, mode: Mode) -> Option<String> {
    const WAY_OUT: &str = "measure three to five beads";
    match newest {
        _ if method.policy.bead_gate == BeadGate::Off => None,
        Some(gate) if gate.stands => None,
        Some(gate) if gate.is_of_the_future(jiff::Timestamp::now()) => Some(format!(
            "the newest bead gate is of {}, which is later than the computer's clock: set the clock, or take the file of gate {} out of the \
             folder of calibrations and {WAY_OUT}",
            gate.measured, gate.id
        )),
        Some(gate) if gate.verdict == "passed" || gate.verdict == "no_history" => {
            let hours = gate.max_age_s / 3600.0;
            Some(format!("the newest bead gate is of {}, and stands for {hours:.0} h: {WAY_OUT}", gate.measured))
        }
        Some(gate) => {
            let found = if gate.summary.is_empty() { gate.words.join("; ") } else { gate.summary.trim_end_matches('.').to_owned() };
            Some(format!("the newest bead gate, of {}: {found}; {WAY_OUT}", gate.measured))
        }
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

/// Flags a larva that was measured without a gate with `bead_gate`. Beads are not flagged: they make the gate.
pub fn flag(well: &mut WellStatus, lacks_gate: bool) {
    if lacks_gate && well.specimen == SpecimenKind::Larva && well.outcome == Some(SpecimenOutcome::Succeeded) {
        well.flags.push(Flag::BeadGate.into());
    }
}

/// Computes and stores the gate of a run's beads, if there are enough of them.
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
    use carved_core::quality::gate::BeadMeasured;

    /// Beads that are `off_um` too large. The first of them is measured again if `twice`.
    fn beads(n: usize, off_um: f64, twice: bool) -> Vec<BeadMeasured> {
        let bead = |i: usize, more_um: f64| BeadMeasured {
            bead: format!("A{i:02}"),
            diameter_um: 500.0 + off_um + [0.0, 0.4, -0.4][i % 3] + more_um,
            aspect_ratio: 1.0,
            sphere_rms_um: 0.5,
            residual_px: Some(0.2),
            uy_px: Some(511.5),
            gamma_deg: Some(0.2),
        };
        (0..n).map(|i| bead(i, 0.0)).chain(twice.then(|| bead(0, 0.0))).collect()
    }

    fn said(beads: &[BeadMeasured], earlier: usize) -> String {
        let settings = GateSettings::default();
        let history = vec![GateNumbers::of(&self::beads(3, 0.0, true)).unwrap(); earlier];
        summary(&CheckedBeads::of(beads, &history, &settings).unwrap(), &settings)
    }

    #[test]
    fn a_technician_reads_the_verdict_the_size_and_one_next_step() {
        assert_eq!(
            said(&beads(3, -1.1, false), 0),
            "Passed: 3 beads, mean diameter 498.9 µm (1.1 µm too small). Next: measure one of the beads twice."
        );
        let few = said(&beads(3, 1.1, true), 1);
        assert!(
            few.starts_with("Passed: 3 beads, mean diameter 501.1 µm (1.1 µm too large). Next: measure beads daily. After 4 more"),
            "{few}"
        );
        assert_eq!(said(&beads(2, 0.0, true), 0), "Not decided: 2 of the 3 beads that are needed. Next: measure the others.");
        let off = said(&beads(3, 20.0, true), 0);
        assert!(
            off.starts_with("Failed: the mean diameter is not that of the beads. Measure no specimens. Next: check the batch"),
            "{off}"
        );
        let mut dented = beads(3, 0.0, true);
        dented[0].sphere_rms_um = 4.2;
        assert!(
            said(&dented, 0).starts_with("Failed: a bead is 4.2 µm off a sphere, 3.0 µm is allowed. Measure no"),
            "{}",
            said(&dented, 0)
        );
        for said in [few, off] {
            assert!(!said.contains("score") && !said.contains("repeat_um"), "{said}");
        }
    }

    #[test]
    fn a_capillary_that_has_moved_is_named() {
        let mut moved = beads(3, 0.0, true);
        for bead in &mut moved {
            bead.uy_px = Some(540.0);
        }
        assert!(said(&moved, 6).contains("Failed: the capillary or the camera has moved since earlier sets"), "{}", said(&moved, 6));
        assert!(said(&beads(3, 0.0, true), 6).contains("Next: measure specimens. Measure beads again within 24 h"));
    }
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
            summary: String::new(),
            words: vec!["failed: 3 beads".into()],
        };
        let (good, old, bad) = (gate("passed", true), gate("no_history", false), gate("failed", false));
        for asked in [BeadGate::Flag, BeadGate::Refuse] {
            let why = |newest, mode| lacking(newest, &method(asked), mode);
            assert_eq!((why(Some(&good), Mode::Hardware), why(None, Mode::Simulated)), (None, None));
            assert!(why(None, Mode::Hardware).unwrap().contains("no bead gate"));
            assert!(why(Some(&old), Mode::Simulated).unwrap().contains("stands for 24 h"));
            let ahead = GateStatus { measured: "2999-01-01T00:00:00Z".into(), ..old.clone() };
            assert!(why(Some(&ahead), Mode::Hardware).unwrap().contains("later than the computer's clock"));
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
        assert_eq!(flags(SpecimenKind::Larva, Some(SpecimenOutcome::Succeeded), true), [Flag::BeadGate]);
        assert!(flags(SpecimenKind::Larva, Some(SpecimenOutcome::Succeeded), false).is_empty());
        assert!(flags(SpecimenKind::Larva, Some(SpecimenOutcome::Skipped), true).is_empty());
        assert!(flags(SpecimenKind::Bead, Some(SpecimenOutcome::Succeeded), true).is_empty());
    }
}
