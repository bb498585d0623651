//! What a driver knows of its axis' position.
//!
//! ```text
//! Unknown ──reference──► At(epoch) ──any doubt──► Suspect(epoch + 1) ──reference──► At(epoch + 2)
//!    └── a reference that fails ──► Suspect
//! ```

use crate::{Achieved, DeviceError, Position};
use carved_core::units::Steps;
use std::time::Duration;

#[derive(Debug)]
pub(super) struct Knowledge {
    axis: &'static str,
    epoch: u32,
    known: Known,
}

#[derive(Debug)]
enum Known {
    Unknown,
    At(Steps),
    Suspect { why: String },
}

impl Knowledge {
    /// Nothing is known of `axis`.
    pub fn none_of(axis: &'static str) -> Self {
        Self { axis, epoch: 0, known: Known::Unknown }
    }

    /// The axis stands at its reference: step 0 of a new epoch.
    pub fn begin_epoch(&mut self) -> Achieved {
        self.epoch += 1;
        self.arrived(Steps(0))
    }

    pub fn arrived(&mut self, at: Steps) -> Achieved {
        self.known = Known::At(at);
        Achieved { steps: at, epoch: self.epoch }
    }

    /// No longer believes the position, if there was one to believe, and remembers why.
    pub fn doubt(&mut self, error: &DeviceError) {
        if self.is_known() {
            self.epoch += 1;
            tracing::warn!(epoch = self.epoch, why = %error, "the position of the {} is suspect", self.axis);
        }
        if !matches!(self.known, Known::Suspect { .. }) {
            self.known = Known::Suspect { why: error.to_string() };
        }
    }

    /// What was known is of no meaning any more, and nothing is wrong.
    pub fn forget(&mut self) {
        self.known = Known::Unknown;
    }

    pub fn is_known(&self) -> bool {
        matches!(self.known, Known::At(_))
    }

    pub fn is_suspect(&self) -> bool {
        matches!(self.known, Known::Suspect { .. })
    }

    /// Where a move begins.
    ///
    /// # Errors
    /// An axis whose position is not known does not move.
    pub fn known_steps(&self) -> Result<Steps, DeviceError> {
        match &self.known {
            Known::Unknown => Err(DeviceError::NotReferenced),
            Known::Suspect { why } => Err(DeviceError::Suspect { why: why.clone() }),
            Known::At(steps) => Ok(*steps),
        }
    }

    pub fn position(&self) -> Position {
        let epoch = self.epoch;
        match self.known {
            Known::Unknown => Position::Unknown,
            Known::At(steps) => Position::Referenced { steps, epoch },
            Known::Suspect { .. } => Position::Suspect { epoch },
        }
    }

    /// The epoch that the next reference begins.
    pub fn next_epoch(&self) -> u32 {
        self.epoch + 1
    }
}

/// Longest time a healthy controller needs for a move of `steps`: trapezoid, and a tenth for rounding.
pub(super) fn travel_time(steps: i64, steps_per_s: f64, steps_per_s2: f64) -> Duration {
    let seconds = steps.unsigned_abs() as f64 / steps_per_s + steps_per_s / steps_per_s2;
    // A day is longer than any turn and within what Duration holds.
    Duration::from_secs_f64((1.1 * seconds).min(86_400.0))
}
