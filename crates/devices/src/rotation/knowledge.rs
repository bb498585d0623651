//! What a driver knows about the position of its axis.
//!
//! ```text
//! Unknown ──reference──► At(epoch) ──any doubt──► Suspect(epoch + 1) ──reference──► At(epoch + 2)
//!    └── a reference that fails ──► Suspect
//! ```

use crate::{Achieved, DeviceError, Position};
use carved_core::units::Steps;
use std::time::Duration;

/// The position with its epoch, or why there is none.
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
    /// The axis was never referenced. `axis` is its name in logs.
    pub fn none_of(axis: &'static str) -> Self {
        Self { axis, epoch: 0, known: Known::Unknown }
    }

    /// The axis stands at its reference, step 0 of a new epoch.
    pub fn begin_epoch(&mut self) -> Achieved {
        self.epoch += 1;
        self.arrived(Steps(0))
    }

    pub fn arrived(&mut self, at: Steps) -> Achieved {
        self.known = Known::At(at);
        Achieved { steps: at, epoch: self.epoch }
    }

    /// Makes a known position suspect, and keeps the reason.
    pub fn doubt(&mut self, error: &DeviceError) {
        if self.is_known() {
            self.epoch += 1;
            tracing::warn!(epoch = self.epoch, why = %error, "the position of the {} is suspect", self.axis);
        }
        if !matches!(self.known, Known::Suspect { .. }) {
            self.known = Known::Suspect { why: error.to_string() };
        }
    }

    /// Drops the position without a fault.
    pub fn forget(&mut self) {
        self.known = Known::Unknown;
    }

    pub fn is_known(&self) -> bool {
        matches!(self.known, Known::At(_))
    }

    pub fn is_suspect(&self) -> bool {
        matches!(self.known, Known::Suspect { .. })
    }

    /// The known position, from which a move begins.
    ///
    /// # Errors
    /// The position is not known, so that the axis must not move.
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

/// The longest time that a healthy controller needs for a move of `steps`: a trapezoid of speed, plus a tenth for rounding.
pub(super) fn travel_time(steps: i64, steps_per_s: f64, steps_per_s2: f64) -> Duration {
    let seconds = steps.unsigned_abs() as f64 / steps_per_s + steps_per_s / steps_per_s2;
    // A day is longer than any turn, and Duration can hold it.
    Duration::from_secs_f64((1.1 * seconds).min(86_400.0))
}
