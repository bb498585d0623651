//! Status reports. As in the real firmware, some reports have optional fields.

use super::overrides::Overrides;
use std::fmt::Write;

/// Number of reports from one with the work offset, or the overrides, to the next. It is larger while the machine is busy.
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

/// The contents of one report. Positions are in units, the feed is in units/min.
pub(super) struct Snapshot<'a> {
    pub state: &'a str,
    pub busy: bool,
    pub machine: [f32; 3],
    pub offset: [f32; 3],
    pub feed: f32,
    pub at_limit: bool,
    pub at_probe: bool,
    /// Letters of the outputs that are on.
    pub accessories: String,
    /// Letters of the active control inputs.
    pub control: String,
    /// Free planner blocks and receive bytes.
    pub free: (usize, usize),
    /// `$10`. Bit 0: the machine position instead of the work position. Bit 1: the buffer state.
    pub mask: u8,
    pub overrides: Overrides,
    /// Whether the machine is homed. Only grblHAL reports it.
    pub homed: Option<bool>,
}

/// Decides which report has which optional field.
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
            // A report never has both the offset and the overrides.
            self.overrides = self.overrides.max(1);
            let _ = write!(text, "|WCO:{}", triple(s.offset));
        }
        if self.overrides > 0 {
            self.overrides -= 1;
        } else {
            self.overrides = OVERRIDES_EVERY.reload(s.busy);
            let _ = write!(text, "|Ov:{},100,{}", s.overrides.feed, s.overrides.spindle);
            // grblHAL has the field without a letter too.
            if s.homed.is_some() || !s.accessories.is_empty() {
                let _ = write!(text, "|A:{}", s.accessories);
            }
        }
        if let Some(homed) = s.homed {
            let _ = write!(text, "|H:{}", u8::from(homed));
        }
        text.push_str(">\r\n");
        text
    }

    /// The offset has changed. The next report contains it.
    pub fn offset_changed(&mut self) {
        self.wco = 0;
    }

    /// An override has changed. The next report without the offset contains it.
    pub fn override_changed(&mut self) {
        self.overrides = 0;
    }
}

pub(super) fn triple(v: [f32; 3]) -> String {
    format!("{:.3},{:.3},{:.3}", v[0], v[1], v[2])
}
