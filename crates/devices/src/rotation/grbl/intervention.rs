//! Detection of an intervention: a person at the controller, or a safety circuit, holds the axis.
//!
//! ```text
//!   report ─┬─ Hold, Door, Jog, Home, Check, Sleep, Tool, and carved did not request it ───┐
//!           ├─ input E (emergency stop), R (reset) or H (feed hold) is active              ├─ read twice ─► Intervention
//!           └─ input D (door) is active, and the axis is to move or is locked ─────────────┘
//!   a greeting or ALARM:3 that no reset of carved explains ─────────────────────────────────────────────► Intervention
//!   at rest, at another place than where carved left it ──────────────────────────────────── read twice ─► Intervention
//! ```
//! A Grbl counts the steps that it sends. Its count changes at rest only if somebody else moves the axis, or if it restarts and counts from 0.
//!
//! The stop of this program is a feed hold and a reset, and the reset ends the hold. So a hold that persists comes from a person. Stops
//! that the program decides on write nothing to an axis at rest ([`StopHandle::end_motion`](crate::StopHandle::end_motion)), because
//! they would end a hold that was not read yet. A stop that a person requests always resets, so that a motion that is held does not
//! continue later.

use super::DEVICE;
use super::report::{State, Status};
use crate::DeviceError;

const CYCLE_START: &str = "Press cycle start at the controller when the axis may move, then acknowledge the fault and let the run go on";
const CLOSE_DOOR: &str = "Close the door and press cycle start at the controller, then acknowledge the fault and let the run go on";
const RELEASE: &str = "Release the stop when the axis may move, then acknowledge the fault and let the run go on";
const FINISH: &str = "Finish what you are doing with the axis, then acknowledge the fault and let the run go on";
const RESET: &str = "Reset the controller, then acknowledge the fault and let the run go on";
const WHO_RESET: &str = "Find out who reset it, or why it restarted. When the axis may turn, acknowledge the fault and let the run go on: it begins with a reference";

/// The intervention that a report shows, if any. `before_motion`: the axis is about to move.
pub(super) fn of(status: &Status, before_motion: bool) -> Option<DeviceError> {
    let door_counts = before_motion || status.state != State::Idle;
    let (what, way_out) = match status.state {
        _ if status.is_active('E') || (status.state == State::Alarm && status.detail == Some(EMERGENCY_STOP)) => {
            ("the emergency stop at the controller is pressed", RELEASE)
        }
        State::Door if status.detail == Some(0) => ("the safety door was open; the controller waits for cycle start", CLOSE_DOOR),
        State::Door => ("the safety door is open", CLOSE_DOOR),
        _ if status.is_active('D') && door_counts => ("the safety door is open", CLOSE_DOOR),
        _ if status.is_active('R') => ("the reset input of the controller is active", RELEASE),
        State::Hold => ("the controller is in feed hold, and carved did not request it", CYCLE_START),
        _ if status.is_active('H') => ("the feed hold input of the controller is active", RELEASE),
        State::Jog => ("the axis is jogged, but not by carved", FINISH),
        State::Home => ("the axis is homed, but not by carved", FINISH),
        State::Tool => ("the controller waits for a tool change", FINISH),
        State::Check => ("the controller is in check mode, in which nothing moves", RESET),
        State::Sleep => ("the controller sleeps, and its motors are off", RESET),
        State::Idle | State::Run | State::Alarm => return None,
    };
    Some(intervention(&format!("{what} (it reports {status})"), way_out))
}

/// The error of an axis that keeps turning without a command.
pub(super) fn still_turning(status: &Status) -> DeviceError {
    intervention(&format!("the axis turns without a command of carved (it reports {status})"), FINISH)
}

/// The error of a reset that carved did not request. `sign`: what the controller said.
pub(super) fn reset(sign: &str) -> DeviceError {
    intervention(&format!("the controller was reset, but not by carved (it says {sign})"), WHO_RESET)
}

/// The error of an axis at rest that is not where it was left, units. A controller that counts from 0 again has restarted.
pub(super) fn elsewhere(left: f64, found: f64) -> DeviceError {
    if found == 0.0 {
        return reset(&format!("position 0 where it was left at {left:.3}"));
    }
    intervention(&format!("the axis was moved, but not by carved (it stands at {found:.3} and was left at {left:.3})"), FINISH)
}

/// Number of the alarm for a reset of a moving axis.
pub(super) const RESET_IN_MOTION: u16 = 3;
/// Number of grblHAL's alarm for the emergency stop.
const EMERGENCY_STOP: u16 = 10;
/// Number of the alarm for a door that was opened in a homing cycle.
const DOOR_IN_HOMING: u16 = 7;

/// The intervention that an alarm shows, if any.
pub(super) fn of_alarm(number: u16) -> Option<DeviceError> {
    match number {
        EMERGENCY_STOP => Some(intervention("ALARM:10, the emergency stop at the controller is pressed", RELEASE)),
        DOOR_IN_HOMING => Some(intervention("ALARM:7, the safety door was opened while the axis was homed", CLOSE_DOOR)),
        _ => None,
    }
}

/// Number of the error of a command that is refused while the door is open.
const DOOR_IS_OPEN: u16 = 13;

/// The intervention that an error shows, if any.
pub(super) fn of_error(number: u16) -> Option<DeviceError> {
    (number == DOOR_IS_OPEN).then(|| intervention("error:13, the safety door is open", CLOSE_DOOR))
}

fn intervention(what: &str, way_out: &'static str) -> DeviceError {
    DeviceError::Intervention { device: DEVICE, what: what.into(), way_out }
}

#[cfg(test)]
mod tests {
    use super::super::report::Line;
    use super::*;

    fn said(report: &str, before_motion: bool) -> Option<String> {
        let Line::Status(status) = Line::parse(report) else { panic!("{report}") };
        of(&status, before_motion).map(|error| error.to_string())
    }

    #[test]
    fn a_report_without_an_intervention_passes() {
        for report in ["<Idle|MPos:0,0,0>", "<Run|MPos:0,0,0>", "<Alarm|MPos:0,0,0>", "<Idle|MPos:0,0,0|Pn:PX>"] {
            assert_eq!(said(report, true), None, "{report}");
        }
        assert_eq!(said("<Idle|MPos:0,0,0|Pn:D>", false), None, "grblHAL may be set to ignore the door at rest");
    }

    #[test]
    fn each_state_and_input_is_named_with_what_was_read_and_a_way_out() {
        for (report, names, way_out) in [
            ("<Hold:0|MPos:1.500,0,0>", "feed hold", "cycle start"),
            ("<Idle|MPos:1.500,0,0|Pn:H>", "feed hold input", "Release"),
            ("<Door:1|MPos:1.500,0,0|Pn:D>", "door is open", "Close the door"),
            ("<Door:0|MPos:1.500,0,0>", "door was open", "cycle start"),
            ("<Idle|MPos:1.500,0,0|Pn:D>", "door is open", "Close the door"),
            ("<Alarm|MPos:1.500,0,0|Pn:E>", "emergency stop", "Release"),
            ("<Alarm:10|MPos:1.500,0,0>", "emergency stop", "Release"),
            ("<Alarm|MPos:1.500,0,0|Pn:R>", "reset input", "Release"),
            ("<Jog|MPos:1.500,0,0>", "jogged", "Finish"),
            ("<Home|MPos:1.500,0,0>", "homed", "Finish"),
            ("<Check|MPos:1.500,0,0>", "check mode", "Reset"),
            ("<Sleep|MPos:1.500,0,0>", "sleeps", "Reset"),
        ] {
            let said = said(report, true).unwrap();
            assert!(said.contains(names) && said.contains(way_out) && said.contains("1.500"), "{report}: {said}");
        }
    }
}
