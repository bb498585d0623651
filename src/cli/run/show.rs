//! The status as text.

use crate::api::{Fault, InstrumentIdentity, Mode, NextCommand, RunStatus, SpecimenKind, Status, WellStatus};
use carved_core::flag::StoredFlag;
use serde::Serialize;

/// The name of a value in the API.
pub fn word(value: impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

/// The mark of simulated numbers, for lines that are copied elsewhere.
fn made(mode: Mode) -> &'static str {
    if mode == Mode::Hardware { "" } else { " (simulated)" }
}

/// One well that has ended.
pub fn well(well: &WellStatus, mode: Mode) -> String {
    let kind = match (well.specimen, well.dpf) {
        (SpecimenKind::Bead, _) => "bead".to_owned(),
        (SpecimenKind::Larva, Some(dpf)) => format!("larva of {dpf} dpf"),
        (SpecimenKind::Larva, None) => "larva".to_owned(),
    };
    let mut line = format!("{}  {kind}: {}", well.well, well.outcome.map(word).unwrap_or_default());
    if let Some(reason) = &well.reason {
        line += &format!(", {reason}");
    }
    if let Some(volume) = well.volume_um3 {
        // An interval around a bound would not contain the true volume.
        let is_bound = StoredFlag::is_bound(&well.flags);
        let sd = well.volume_sd_um3.filter(|_| !is_bound).map_or_else(String::new, |sd| format!(" ± {:.2} (1 SD)", sd / 1e6));
        let at_least = if is_bound { "at least " } else { "" };
        line += &format!(", {at_least}{:.2}{sd} nl{}", volume / 1e6, made(mode));
    }
    if !well.flags.is_empty() {
        line += &format!(" ({})", StoredFlag::joined(&well.flags, ", "));
    }
    line
}

pub fn fault(fault: &Fault) -> String {
    format!("fault {} {}: {}. What to do: {}", fault.seq, fault.code, fault.message.trim_end_matches('.'), fault.what_to_do)
}

pub fn counts(run: &RunStatus) -> String {
    let w = &run.wells;
    let parts = [
        (w.succeeded, "succeeded"),
        (w.flagged, "flagged"),
        (w.failed, "failed"),
        (w.skipped, "skipped"),
        // Aborted ones too.
        (w.interrupted, "not finished"),
        (w.pending, "to come"),
    ];
    let said: Vec<String> = parts.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
    format!("{} wells: {}", w.total, said.join(", "))
}

/// How a run ended.
pub fn end(run: &RunStatus, mode: Mode) -> String {
    format!("run {}{} has ended: {}; {}", run.id, made(mode), run.outcome.map(word).unwrap_or_default(), counts(run))
}

/// The name of the instrument, with its serial number and place if they are known.
fn instrument(instrument: &InstrumentIdentity) -> String {
    let serial = instrument.serial.as_ref().map(|serial| format!(", serial number {serial}"));
    let location = instrument.location.as_ref().map(|location| format!(", {location}"));
    format!("{}{}{}", instrument.name, serial.unwrap_or_default(), location.unwrap_or_default())
}

pub fn status(status: &Status) -> String {
    let mut text = format!("{}: {} ({}){}\n", instrument(&status.instrument), status.doing, word(status.state), made(status.mode));
    if let (false, Some(why)) = (status.ready, &status.not_ready_reason) {
        text += &format!("not ready: {why}\n");
    }
    match &status.run {
        Some(run) if run.outcome.is_some() => text += &format!("{}\n", end(run, status.mode)),
        Some(run) => {
            let left = run.eta_s.map_or_else(String::new, |eta| format!(", some {:.0} min to go", (eta.p50 / 60.0).ceil()));
            text += &format!("run {} by {}, method {}: {}{left}\n", run.id, run.operator, run.method, counts(run));
        }
        None => {}
    }
    let hold = status.run.as_ref().and_then(|run| run.hold.as_ref());
    match hold.and_then(|hold| Some((hold.next_command?, hold.fault_seq))) {
        Some((NextCommand::Unhold, _)) => text += "next: `carved run unhold`\n",
        Some((NextCommand::Acknowledge, Some(seq))) => text += &format!("next: `carved run acknowledge {seq}`\n"),
        Some((NextCommand::Acknowledge, None)) | None => {}
    }
    for one in &status.faults {
        text += &format!("{}\n", fault(one));
    }
    text
}
