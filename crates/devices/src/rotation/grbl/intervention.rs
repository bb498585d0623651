//! Who else has the axis: a person at the controller, or a safety circuit.
//!
//! ```text
//!   report ─┬─ Hold, Door, Jog, Home, Check, Sleep, Tool, and carved has not asked for it ─┐
//!           ├─ input E (emergency stop), R (reset) or H (feed hold) is active              ├─ read twice ─► Intervention
//!           └─ input D (door) is active, and the axis is to move or is locked ─────────────┘
//!
//! ```
//! carved's own stop is a feed hold and a reset, and the reset ends the hold. So a hold that stands is somebody else's. Stops that the
//! program decides on write nothing to an axis at rest ([`StopHandle::end_motion`](crate::StopHandle::end_motion)): they would end a
//! hold that nobody has read yet. A stop that a person asks for resets always: what was held in mid-move does not move later.

use super::DEVICE;
use super::report::{State, Status};
use crate::DeviceError;

const CYCLE_START: &str = "Press cycle start at the controller when the axis may move, then acknowledge the fault and let the run go on";
const CLOSE_DOOR: &str = "Close the door and press cycle start at the controller, then acknowledge the fault and let the run go on";
const RELEASE: &str = "Release the stop when the axis may move, then acknowledge the fault and let the run go on";
const FINISH: &str = "Finish what you are doing with the axis, then acknowledge the fault and let the run go on";
const RESET: &str = "Reset the controller, then acknowledge the fault and let the run go on";

/// What a report says of somebody else; `before_motion` where the axis is to move next.
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
        State::Hold => ("the controller is in feed hold, and carved has not put it there", CYCLE_START),
        _ if status.is_active('H') => ("the feed hold input of the controller is active", RELEASE),
        State::Jog => ("the axis is jogged, and not by carved", FINISH),
        State::Home => ("the axis is homed, and not by carved", FINISH),
        State::Tool => ("the controller waits for a change of tool", FINISH),
        State::Check => ("the controller is in check mode, in which nothing moves", RESET),
        State::Sleep => ("the controller sleeps, and its motors are off", RESET),
        State::Idle | State::Run | State::Alarm => return None,
    };
    Some(intervention(&format!("{what} (it reports {status})"), way_out))
}

/// An axis that goes on turning without having been sent anywhere.
pub(super) fn still_turning(status: &Status) -> DeviceError {
    intervention(&format!("the axis turns, and carved has not sent it (it reports {status})"), FINISH)
}

/// grblHAL's alarm of that name.
const EMERGENCY_STOP: u16 = 10;
/// The door was opened in a homing cycle.
const DOOR_IN_HOMING: u16 = 7;

/// Of an alarm by its number, where it is somebody's doing.
pub(super) fn of_alarm(number: u16) -> Option<DeviceError> {
    match number {
        EMERGENCY_STOP => Some(intervention("ALARM:10, the emergency stop at the controller is pressed", RELEASE)),
        DOOR_IN_HOMING => Some(intervention("ALARM:7, the safety door was opened while the axis was homed", CLOSE_DOOR)),
        _ => None,
    }
}

/// A command is refused while the door is open.
const DOOR_IS_OPEN: u16 = 13;

/// Of an error by its number, where it is somebody's doing.
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
    fn what_is_nobodys_doing_is_let_pass() {
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
