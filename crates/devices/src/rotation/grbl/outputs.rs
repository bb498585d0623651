//! The outputs of a Grbl controller: M7 and M8, which M9 switches off together, and M3 with M5.
//!
//! ```text
//!   held? ──► $G: what is on? ──► M7 | M8 | M3 S.. | M5 | M9, then M7 or M8 for the other one ──► $G: as wanted?
//! ```
//! `ok` is no proof: one flipped bit makes an `M8` an `M9`, which is also answered with `ok`. So the parser's state is read after each
//! switching. Every reset switches everything off. While a person holds the controller nothing is switched, because the command would be
//! executed at the end of the hold. In laser mode (`$32=1`) the spindle output is off unless a G1 is executed, so that mode is refused.

use super::agree::FULL_SPEED;
use super::report::{Line, State};
use super::{DEVICE, FULL_SPINDLE, Grbl, GrblPin};
use crate::DeviceError;
use crate::outputs::{OutputStatus, Outputs};

/// How often the state is read after a stop: the greeting of the reset, and its alarm, may come before the answer.
const ATTEMPTS: u32 = 4;

/// What the parser says of the outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Modes {
    mist: bool,
    flood: bool,
    spindle: bool,
}

impl Modes {
    /// Of the answer to `$G`: `[GC:G0 G54 ... M5 M7 M8 T0 F0 S0]`.
    fn parse(answer: &str) -> Option<Self> {
        let words: Vec<&str> = answer.strip_prefix("[GC:")?.strip_suffix(']')?.split(' ').collect();
        let has = |word| words.contains(&word);
        // A report always has one word of each group.
        let is_whole = (has("M3") || has("M4") || has("M5")) && (has("M7") || has("M8") || has("M9"));
        is_whole.then(|| Self { mist: has("M7"), flood: has("M8"), spindle: !has("M5") })
    }

    fn get(&mut self, pin: GrblPin) -> &mut bool {
        match pin {
            GrblPin::MistCoolant => &mut self.mist,
            GrblPin::FloodCoolant => &mut self.flood,
            GrblPin::Spindle => &mut self.spindle,
        }
    }
}

impl std::fmt::Display for Modes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let word = |on: bool| if on { "on" } else { "off" };
        write!(f, "mist {}, flood {}, spindle {}", word(self.mist), word(self.flood), word(self.spindle))
    }
}

impl Outputs for Grbl {
    fn statuses(&self) -> Vec<OutputStatus> {
        self.outputs.statuses()
    }

    fn switch(&mut self, name: &str, on: bool) -> Result<(), DeviceError> {
        let pin = self.outputs.pin(DEVICE, name)?;
        self.link.pass_latch(true);
        let switched = self.switch_after_stop(pin, on);
        self.link.pass_latch(false);
        if let Err(error) = &switched
            && !matches!(error, DeviceError::Unexpected { .. })
        {
            let unreported = self.unreported_reset.clone();
            self.doubt(error);
            if !on {
                // The error of an output that is switched off holds no run, so the next check reports the reset.
                self.unreported_reset = unreported;
            }
        }
        self.outputs.note(DEVICE, name, on, switched)
    }
}

impl Grbl {
    /// Reads on after the traces of a stop, which are no failure here.
    fn switch_after_stop(&mut self, pin: GrblPin, on: bool) -> Result<(), DeviceError> {
        let mut attempts = ATTEMPTS;
        loop {
            attempts -= 1;
            let switched = if on { self.switch_on(pin) } else { self.check_free().and_then(|()| self.set_pin(pin, false)) };
            match switched {
                Err(error @ (DeviceError::Suspect { .. } | DeviceError::Alarm { .. })) if attempts > 0 => self.doubt(&error),
                ended => return ended,
            }
        }
    }

    fn switch_on(&mut self, pin: GrblPin) -> Result<(), DeviceError> {
        self.identify()?;
        if self.free_status()?.state == State::Alarm {
            // Nothing moves: without a reference the axis refuses to.
            self.doubt(&DeviceError::Alarm { device: DEVICE, what: "the alarm state".into() });
            self.command("$X", self.settings.answer_timeout(), |_| {})?;
        }
        self.set_pin(pin, true)
    }

    fn set_pin(&mut self, pin: GrblPin, on: bool) -> Result<(), DeviceError> {
        let mut wanted = self.modes()?;
        let was = std::mem::replace(wanted.get(pin), on);
        if was != on {
            match (pin, on) {
                (GrblPin::MistCoolant, true) => self.code("M7")?,
                (GrblPin::FloodCoolant, true) => self.code("M8")?,
                (GrblPin::Spindle, true) => {
                    self.link.send(FULL_SPINDLE)?;
                    self.code(&format!("M3S{:.0}", self.full_speed()))?;
                }
                (GrblPin::Spindle, false) => self.code("M5")?,
                (GrblPin::MistCoolant | GrblPin::FloodCoolant, false) => self.code("M9")?,
            }
            // One of them at most is on after M9.
            if pin != GrblPin::Spindle && !on && wanted.flood {
                self.code("M8")?;
            }
            if pin != GrblPin::Spindle && !on && wanted.mist {
                self.code("M7")?;
            }
        }
        let found = self.modes()?;
        if found == wanted {
            return Ok(());
        }
        Err(DeviceError::Unexpected { device: DEVICE, expected: wanted.to_string(), found: found.to_string() })
    }

    /// The spindle speed at which the output is fully on.
    fn full_speed(&self) -> f64 {
        self.controller_settings.get(&FULL_SPEED).copied().unwrap_or(1000.0)
    }

    fn modes(&mut self) -> Result<Modes, DeviceError> {
        let mut found = None;
        self.command("$G", self.settings.answer_timeout(), |line| {
            if let Line::Message(text) = line {
                found = Modes::parse(&text).or(found);
            }
        })?;
        let expected = || "the modes of the parser in the answer to $G".to_owned();
        found.ok_or_else(|| DeviceError::Unexpected { device: DEVICE, expected: expected(), found: "none that can be read".into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outputs_are_read_from_the_modes_of_the_parser() {
        let modes = |text| Modes::parse(text).map(|m| (m.mist, m.flood, m.spindle));
        assert_eq!(modes("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"), Some((false, false, false)));
        assert_eq!(modes("[GC:G0 G54 G17 G21 G90 G94 M3 M7 M8 T0 F0 S1000]"), Some((true, true, true)));
        for other in ["[GC:G0 G54 M5 M", "[MSG:M5 M9]", "[GC:G0 G54 T0]"] {
            assert_eq!(modes(other), None, "{other}");
        }
    }
}
