//! Warning flags of a Zaber controller, and what each means for a turn.

use super::DEVICE;
use crate::DeviceError;
use crate::rotation::Reference;

/// No flag is set.
pub(super) const NONE: &str = "--";
/// The axis did not follow and was stopped.
pub(super) const STALLED: &str = "FS";
/// A movement was interrupted by another one, or by the knob. A stop of this program also sets it.
pub(super) const INTERRUPTED: &str = "NI";
/// The axis is or was turned with the knob.
pub(super) const KNOB: &str = "NC";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// A person must inspect the instrument before the axis turns again.
    Alarm,
    /// The position is not known any more. The next reference finds it.
    Suspect,
    /// The controller was restarted. carved never restarts it, so on a referenced axis this is an intervention. Otherwise as `Suspect`.
    Restarted,
    /// An intervention: a person, or a safety circuit that a person resets, holds the axis. With the way out.
    ByHand(&'static str),
    /// It does not prevent a turn. An effect would show in the counter, which is compared after each move.
    Harmless,
}

const LET_GO: &str = "Let go of the axis, then acknowledge the fault and let the run go on: it begins with a reference";
const WHO_RESET: &str = "Find out who reset it, or why it restarted. When the axis may turn, acknowledge the fault and let the run go on: it begins with a reference";
const RELEASE: &str =
    "Release the emergency stop, then acknowledge the fault and let the run go on: the next reference switches the driver on again";

/// All flags of the protocol, of firmware 6 and 7, in the order of their importance.
#[rustfmt::skip]
const MEANINGS: &[(&str, Kind, &str)] = &[
    ("FF", Kind::Alarm, "critical system error"),
    ("FN", Kind::Alarm, "the peripheral is not supported"),
    ("FZ", Kind::Alarm, "the peripheral is not active"),
    ("FH", Kind::ByHand(RELEASE), "the hardware emergency stop was pressed and the driver is off"),
    ("FV", Kind::Alarm, "the supply voltage was too high or too low and the driver was switched off"),
    ("FO", Kind::ByHand(LET_GO), "the driver was switched off by a command or is off since the start"),
    ("FC", Kind::Alarm, "the current at switching on was too high"),
    ("FM", Kind::Alarm, "the motor is too hot"),
    ("FD", Kind::Alarm, "the driver was switched off"),
    ("FQ", Kind::Alarm, "the encoder failed, or counts what no motor can do"),
    ("FI", Kind::Alarm, "the index mark is not where it should be"),
    ("FA", Kind::Alarm, "the analog encoder is out of step"),
    ("FR", Kind::Alarm, "the motor was driven above its limit for too long"),
    (STALLED, Kind::Alarm, "the axis stalled and was stopped"),
    ("FB", Kind::Alarm, "a streamed motion was not possible"),
    ("FP", Kind::Alarm, "the axis left its path"),
    ("FE", Kind::Alarm, "a limit was met on the way"),
    ("FT", Kind::Alarm, "the two axes of a lockstep group are twisted"),
    ("WL", Kind::Alarm, "a limit was met where none was expected: the axis slipped, or its limits are wrong"),
    ("WV", Kind::Alarm, "the supply voltage is out of its range: the motor may lose steps"),
    ("WT", Kind::Harmless, "the controller is hot; it switches its driver off if it gets hotter"),
    ("WS", Kind::Alarm, "the axis stalled and went on: something holds the shaft"),
    ("WM", Kind::ByHand(LET_GO), "the axis was turned while it stood"),
    ("WP", Kind::Alarm, "the calibration does not fit the peripheral: angles are not corrected"),
    ("WR", Kind::Restarted, "it has no reference any more; it was restarted"),
    ("WH", Kind::Restarted, "it has not been homed since it was started"),
    (KNOB, Kind::ByHand(LET_GO), "the axis was turned with the controller's knob"),
    (INTERRUPTED, Kind::ByHand(LET_GO), "a move was interrupted by hand or by another program"),
    ("ND", Kind::Suspect, "a streamed motion slowed down, and this program streams none"),
    ("NR", Kind::Harmless, "a value was rounded"),
    ("NT", Kind::Harmless, "a value was truncated"),
    ("NU", Kind::Harmless, "a setting is about to change"),
    ("NJ", Kind::ByHand(LET_GO), "a joystick is being calibrated"),
    ("NB", Kind::Alarm, "the controller waits for new firmware"),
];

fn meaning(flag: &str) -> (Kind, &'static str) {
    let known = MEANINGS.iter().find(|(name, ..)| *name == flag).map(|(_, kind, text)| (*kind, *text));
    known.unwrap_or((Kind::Alarm, "a flag that this program does not know"))
}

pub(super) fn is_by_hand(flag: &str) -> bool {
    matches!(meaning(flag).0, Kind::ByHand(_))
}

/// The motor driver is off until a person, or a reference after an acknowledgement, switches it on.
pub(super) fn switches_off(flag: &str) -> bool {
    matches!(flag, "FH" | "FO")
}

/// A reference clears this flag, or the flag was reported before it.
pub(super) fn ends_with_a_reference(flag: &str) -> bool {
    matches!(flag, "WR" | "WH" | "WM") || matches!(flag, KNOB | INTERRUPTED)
}

/// Whether the flag shows that the controller was restarted.
pub(super) fn is_of_a_restart(flag: &str) -> bool {
    meaning(flag).0 == Kind::Restarted
}

/// The error of a restart that carved did not request. `sign`: how it shows.
pub(super) fn restarted(sign: &str) -> DeviceError {
    DeviceError::Intervention { device: DEVICE, what: format!("the controller was reset, but not by carved ({sign})"), way_out: WHO_RESET }
}

/// The error that flags show on an axis with this kind of reference. An intervention comes before anything else.
pub(super) fn judge(flags: &[String], reference: Reference, is_referenced: bool) -> Result<(), DeviceError> {
    let mut worst = Ok(());
    for flag in flags {
        let (kind, text) = meaning(flag);
        let error = match kind {
            Kind::ByHand(way_out) => {
                return Err(DeviceError::Intervention { device: DEVICE, what: format!("the controller reports {flag}: {text}"), way_out });
            }
            Kind::Alarm => DeviceError::Alarm { device: DEVICE, what: format!("{flag} ({text})") },
            // With this reference the axis is not homed, and need not be.
            Kind::Restarted if flag == "WH" && reference == Reference::Here => continue,
            Kind::Restarted if is_referenced => return Err(restarted(&format!("it reports {flag}: {text}"))),
            Kind::Suspect | Kind::Restarted => DeviceError::Suspect { why: format!("the controller reports {flag}: {text}") },
            Kind::Harmless => {
                tracing::warn!(device = DEVICE, flag, "{text}");
                continue;
            }
        };
        worst = worst.and(Err(error));
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(flags: &[&str], reference: Reference) -> Result<(), DeviceError> {
        judge(&flags.iter().map(|flag| (*flag).to_owned()).collect::<Vec<_>>(), reference, false)
    }

    #[test]
    fn a_restart_of_a_referenced_axis_is_a_persons() {
        for flag in ["WR", "WH"] {
            let error = judge(&[flag.to_owned()], Reference::Home, true).unwrap_err();
            assert!(
                matches!(&error, DeviceError::Intervention { what, .. } if what.contains("not by carved") && what.contains(flag)),
                "{error}"
            );
        }
        judge(&["WH".to_owned()], Reference::Here, true).unwrap();
        assert!(matches!(judge(&["ND".to_owned()], Reference::Home, true), Err(DeviceError::Suspect { .. })));
    }

    #[test]
    fn every_flag_has_its_meaning() {
        for flag in "FF FN FZ FV FC FM FD FQ FI FA FR FS FB FP FE FT WL WV WS WP NB XY".split(' ') {
            let error = judged(&[flag], Reference::Home).unwrap_err();
            assert!(matches!(&error, DeviceError::Alarm { what, .. } if what.starts_with(flag)), "{error}");
        }
        for flag in ["WR", "WH", "ND"] {
            let error = judged(&[flag], Reference::Home).unwrap_err();
            assert!(matches!(&error, DeviceError::Suspect { why } if why.contains(flag)), "{error}");
        }
        for flag in ["FH", "FO", "WM", "NC", "NI", "NJ"] {
            let error = judged(&[flag], Reference::Home).unwrap_err();
            assert!(matches!(&error, DeviceError::Intervention { what, .. } if what.contains(flag)), "{error}");
        }
        judged(&["WT", "NR", "NT", "NU"], Reference::Home).unwrap();
        judged(&["WH"], Reference::Here).unwrap();
        judged(&[], Reference::Home).unwrap();
    }

    #[test]
    fn what_a_person_did_comes_before_what_it_led_to() {
        assert!(matches!(judged(&["FQ", "WH", "NC"], Reference::Here), Err(DeviceError::Intervention { .. })));
        assert!(matches!(judged(&["FQ", "WR"], Reference::Here), Err(DeviceError::Alarm { .. })));
    }
}
