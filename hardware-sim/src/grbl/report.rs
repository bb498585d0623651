//! Status reports, whose optional fields come and go as in the firmware.

use std::fmt::Write;

/// Reports until the work offset and the overrides are told again; busy machines tell them less often.
const WCO_EVERY: Refresh = Refresh { busy: 30, idle: 10 };
const OVERRIDES_EVERY: Refresh = Refresh { busy: 20, idle: 10 };

struct Refresh {
    busy: u8,
    idle: u8,
}

impl Refresh {
    fn reload(&self, busy: bool) -> u8 {
        (if busy { self.busy } else { self.idle }) - 1
    }
}

/// What one report tells.
pub(super) struct Snapshot<'a> {
    pub state: &'a str,
    pub busy: bool,
    pub machine: [f32; 3],
    pub offset: [f32; 3],
    pub feed: f32,
    pub at_limit: bool,
    pub at_probe: bool,
    /// Letters of the control inputs that are active.
    pub control: String,
    /// Free planner blocks and receive bytes.
    pub free: (usize, usize),
    /// `$10`: bit 0 machine position instead of work position, bit 1 buffer state.
    pub mask: u8,
    /// grblHAL tells whether it is homed.
    pub homed: Option<bool>,
}

/// Counts which report carries which optional field.
#[derive(Debug, Default)]
pub(super) struct Reporter {
    wco: u8,
    overrides: u8,
}

impl Reporter {
    pub fn status(&mut self, s: &Snapshot) -> String {
        let mut text = format!("<{}", s.state);
        if s.mask & 1 != 0 {
            let _ = write!(text, "|MPos:{}", triple(s.machine));
        } else {
            let _ = write!(text, "|WPos:{}", triple(std::array::from_fn(|i| s.machine[i] - s.offset[i])));
        }
        if s.mask & 2 != 0 {
            let _ = write!(text, "|Bf:{},{}", s.free.0, s.free.1);
        }
        let _ = write!(text, "|FS:{:.0},0", s.feed);
        let pins = [(s.at_probe, "P"), (s.at_limit, "X"), (true, &s.control)].map(|(active, pin)| if active { pin } else { "" }).concat();
        if !pins.is_empty() {
            let _ = write!(text, "|Pn:{pins}");
        }
        if self.wco > 0 {
            self.wco -= 1;
        } else {
            self.wco = WCO_EVERY.reload(s.busy);
            // The overrides never share a report with the offset.
            self.overrides = self.overrides.max(1);
            let _ = write!(text, "|WCO:{}", triple(s.offset));
        }
        if self.overrides > 0 {
            self.overrides -= 1;
        } else {
            self.overrides = OVERRIDES_EVERY.reload(s.busy);
            text.push_str("|Ov:100,100,100");
            if s.homed.is_some() {
                text.push_str("|A:");
            }
        }
        if let Some(homed) = s.homed {
            let _ = write!(text, "|H:{}", u8::from(homed));
        }
        text.push_str(">\r\n");
        text
    }

    /// The offset changed: the next report tells it.
    pub fn offset_changed(&mut self) {
        self.wco = 0;
    }
}

pub(super) fn triple(v: [f32; 3]) -> String {
    format!("{:.3},{:.3},{:.3}", v[0], v[1], v[2])
}
