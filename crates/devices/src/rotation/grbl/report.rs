//! Lines that Grbl and grblHAL send.
//!
//! ```text
//! ok  error:9  ALARM:1           answers and alarms
//! <Idle|MPos:0.000,...|Pn:P>     a status report: state, machine position, active inputs
//! Grbl 1.1h ['$' for help]       the greeting at a start
//! $100=17.778  [VER:...]         settings, messages
//! ```

use std::fmt::{self, Display};

/// One line from the controller.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::rotation) enum Line {
    /// The line was understood and queued. A motion is not finished yet.
    Ok,
    /// The line was refused.
    Error(u16),
    /// The controller is locked.
    Alarm(u16),
    /// A status report.
    Status(Status),
    /// A line that begins like a status report and cannot be read.
    BrokenStatus(String),
    /// `Grbl 1.1h ['$' for help]`: the controller has just (re)started.
    Greeting(String),
    /// A line of `$$`.
    Setting { number: u16, value: f64 },
    /// `[...]`: messages, version, parser state.
    Message(String),
    /// Empty lines and noise.
    Other(String),
}

/// A status report.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::rotation) struct Status {
    pub state: State,
    /// The number after the state: `Hold:1`, `Door:0`, grblHAL's `Alarm:10`.
    pub detail: Option<u16>,
    /// Machine position by axis, in units; `None` if the controller reports work positions.
    pub machine: Option<Vec<f64>>,
    /// Whether the axes are homed. grblHAL reports it now and then, and in its full report.
    pub homed: Option<bool>,
    /// Letters of the active inputs; empty if none is.
    pub inputs: String,
}

/// The state of the controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::rotation) enum State {
    Idle,
    Run,
    Jog,
    Home,
    Hold,
    Door,
    Check,
    Sleep,
    /// grblHAL: a change of tool.
    Tool,
    Alarm,
}

impl Line {
    pub fn parse(text: &str) -> Self {
        let text = text.trim();
        let number = |rest: &str| rest.parse::<u16>().ok();
        if text == "ok" {
            Self::Ok
        } else if let Some(n) = text.strip_prefix("error:").and_then(number) {
            Self::Error(n)
        } else if let Some(n) = text.strip_prefix("ALARM:").and_then(number) {
            Self::Alarm(n)
        } else if text.starts_with('<') {
            Status::parse(text).map_or_else(|| Self::BrokenStatus(text.into()), Self::Status)
        } else if text.get(..4).is_some_and(|head| head.eq_ignore_ascii_case("grbl")) || text.ends_with("for help]") {
            // Also by its end, because a character of its beginning may be disturbed.
            Self::Greeting(text.into())
        } else if let Some((number, value)) = setting(text) {
            Self::Setting { number, value }
        } else if text.starts_with('[') && text.ends_with(']') {
            Self::Message(text.into())
        } else {
            Self::Other(text.into())
        }
    }
}

impl Status {
    /// Whether an input is active, by its letter.
    pub fn is_active(&self, input: char) -> bool {
        self.inputs.contains(input)
    }

    /// Whether the probe input is active, which is the sampler's wire.
    pub fn probe(&self) -> bool {
        self.is_active('P')
    }

    fn parse(text: &str) -> Option<Self> {
        let mut fields = text.strip_prefix('<')?.strip_suffix('>')?.split('|');
        let mut state = fields.next()?.split(':');
        let (name, detail) = (state.next()?, state.next().and_then(|number| number.parse().ok()));
        let state = match name {
            "Idle" => State::Idle,
            "Run" => State::Run,
            "Jog" => State::Jog,
            "Home" => State::Home,
            "Hold" => State::Hold,
            "Door" => State::Door,
            "Check" => State::Check,
            "Sleep" => State::Sleep,
            "Tool" => State::Tool,
            "Alarm" => State::Alarm,
            _ => return None,
        };
        let mut machine = None;
        let mut homed = None;
        let mut inputs = String::new();
        // Not every report has every field. Only these are used.
        for field in fields {
            if let Some(list) = field.strip_prefix("MPos:") {
                machine = Some(list.split(',').map(finite).collect::<Option<Vec<f64>>>()?);
            } else if let Some(list) = field.strip_prefix("H:") {
                homed = Some(list.starts_with('1'));
            } else if let Some(pins) = field.strip_prefix("Pn:") {
                pins.clone_into(&mut inputs);
            }
        }
        Some(Self { state, detail, machine, homed, inputs })
    }
}

/// For people: `Hold:0, machine position 0.720, 0.000, -1.500, active inputs H`.
impl Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.state)?;
        if let Some(detail) = self.detail {
            write!(f, ":{detail}")?;
        }
        match &self.machine {
            Some(units) => {
                let units: Vec<String> = units.iter().map(|u| format!("{u:.3}")).collect();
                write!(f, ", machine position {}", units.join(", "))?;
            }
            None => write!(f, ", no machine position")?,
        }
        if !self.inputs.is_empty() {
            write!(f, ", active inputs {}", self.inputs)?;
        }
        Ok(())
    }
}

fn setting(text: &str) -> Option<(u16, f64)> {
    let (number, value) = text.strip_prefix('$')?.split_once('=')?;
    Some((number.parse().ok()?, finite(value)?))
}

fn finite(text: &str) -> Option<f64> {
    text.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

/// The meaning of the `error:` numbers that an operator can meet.
pub(super) fn error_text(number: u16) -> String {
    let meaning = match number {
        5 => "homing is switched off in the controller, $22=0",
        7 => "the controller's settings memory was erased; write its settings again",
        8 => "not idle",
        9 => "locked by an alarm",
        11 => "the line was too long",
        15 => "the target is beyond the soft limits",
        20 => "this build of the firmware does not have the command; Grbl has M7 only if it was built with ENABLE_M7",
        _ => "see Grbl's list of errors",
    };
    format!("error:{number} ({meaning})")
}

/// The meaning of an `ALARM:` number.
pub(super) fn alarm_text(number: u16) -> String {
    let meaning = match number {
        1 => "hard limit",
        2 => "soft limit",
        3 => "reset in motion",
        6..=9 => "homing failed",
        _ => "see Grbl's list of alarms",
    };
    format!("ALARM:{number} ({meaning})")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lines_of_a_session_are_distinguished() {
        assert_eq!(Line::parse("ok"), Line::Ok);
        assert_eq!(Line::parse("error:9"), Line::Error(9));
        assert_eq!(Line::parse("ALARM:1"), Line::Alarm(1));
        assert_eq!(Line::parse("$100=17.778"), Line::Setting { number: 100, value: 17.778 });
        assert!(matches!(Line::parse("Grbl 1.1h ['$' for help]"), Line::Greeting(_)));
        assert!(matches!(Line::parse("GrblHAL 1.1f ['$' or '$HELP' for help]"), Line::Greeting(_)));
        for disturbed in ["Grjl 1.1h ['$' for help]", "Grbl 1.1h ['$' for hulp]", "JGrbl 1.1h ['$' for help]"] {
            assert!(matches!(Line::parse(disturbed), Line::Greeting(_)), "{disturbed}");
        }
        assert!(matches!(Line::parse("[GC:G0 G54 G17]"), Line::Message(_)));
        for noise in ["", "o", "okk", "error:", "ALARM:x", "$100=nan", "\u{fffd}ok", "[MSG:"] {
            assert!(matches!(Line::parse(noise), Line::Other(_)), "{noise}");
        }
    }

    #[test]
    fn a_status_is_read_whatever_optional_fields_it_carries() {
        let plain = Status { state: State::Idle, detail: None, machine: Some(vec![0.72, 0.0, -1.5]), homed: None, inputs: String::new() };
        for text in [
            "<Idle|MPos:0.720,0.000,-1.500|FS:0,0>",
            "<Idle|MPos:0.720,0.000,-1.500|Bf:15,128|FS:0,0|WCO:0.000,0.000,0.000|Ov:100,100,100|A:S>",
        ] {
            assert_eq!(Line::parse(text), Line::Status(plain.clone()));
        }
        let probed = Status { inputs: "PX".into(), ..plain.clone() };
        assert!(probed.probe() && !plain.probe());
        assert_eq!(Line::parse("<Idle|MPos:0.720,0.000,-1.500|FS:0,0|Pn:PX>"), Line::Status(probed));
        let homed = Status { homed: Some(true), ..plain };
        assert_eq!(Line::parse("<Idle|MPos:0.720,0.000,-1.500|Bf:100,1023|FS:0,0|H:1,1|A:>"), Line::Status(homed));
        let held = Status { state: State::Hold, detail: Some(0), machine: None, homed: None, inputs: String::new() };
        assert_eq!(held.to_string(), "Hold:0, no machine position");
        assert_eq!(Line::parse("<Hold:0|WPos:1.0,2.0,3.0>"), Line::Status(held));
        let door = Line::parse("<Door:1|MPos:0.720,0.000,-1.500|Pn:D>");
        assert!(matches!(door, Line::Status(s) if s.to_string() == "Door:1, machine position 0.720, 0.000, -1.500, active inputs D"));
        for broken in ["<Idle|MPos:0.7x0,0,0>", "<Idl", "<|MPos:1>", "<Idle|MPos:1.000,2.0", "<Idle|MPos:inf,0,0>", "<>"] {
            assert!(matches!(Line::parse(broken), Line::BrokenStatus(_)), "{broken}");
        }
    }

    proptest! {
        #[test]
        fn no_line_whatever_panics(text in "\\PC*", printable in "[<$\\[eAGo][ -~]{0,40}") {
            Line::parse(&text);
            Line::parse(&printable);
        }
    }
}
