//! The overrides: percentages by which the speed of a feed move and that of the spindle are changed, without a line of G-code. Grbl has one
//! for rapid moves too, which is not emulated.
//!
//! ```text
//!           100 %   +10 %   -10 %   +1 %   -1 %
//!   feed    0x90    0x91    0x92    0x93   0x94
//!   spindle 0x99    0x9A    0x9B    0x9C   0x9D
//! ```
//! A reset sets them to 100 %.

use std::ops::RangeInclusive;

const FEED: u8 = 0x90;
const SPINDLE: u8 = 0x99;
const RANGE: RangeInclusive<i16> = 10..=200;

/// Percentages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Overrides {
    pub feed: i16,
    pub spindle: i16,
}

impl Default for Overrides {
    fn default() -> Self {
        Self { feed: 100, spindle: 100 }
    }
}

impl Overrides {
    /// Takes a byte. Returns `false` if it is none of these.
    pub fn take(&mut self, byte: u8) -> bool {
        let (value, command) = match byte {
            SPINDLE.. => (&mut self.spindle, byte - SPINDLE),
            FEED.. => (&mut self.feed, byte - FEED),
            _ => return false,
        };
        let changed = match command {
            0 => 100,
            1 => *value + 10,
            2 => *value - 10,
            3 => *value + 1,
            4 => *value - 1,
            _ => return false,
        };
        *value = changed.clamp(*RANGE.start(), *RANGE.end());
        true
    }
}
