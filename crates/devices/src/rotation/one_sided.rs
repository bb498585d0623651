//! Backlash compensation: every stop is approached from the same side.
//!
//! ```text
//!   target ahead:    ────────────────►│
//!   target behind:            ┌──────►│       one backlash beyond it, and back
//!                             └───────────────
//! ```
//! This wraps any driver. The play of the gear is then always on the same side, and the angles between views are right.

use crate::cancel::CancelToken;
use crate::{Achieved, DeviceError, Position, RotationAxis};
use carved_core::units::Steps;

/// An axis that always arrives in the forward direction.
pub struct OneSided {
    axis: Box<dyn RotationAxis>,
    backlash_steps: i64,
}

/// Wraps `axis`, or returns it unchanged if `backlash_steps` is 0.
///
/// # Errors
/// An axis that steps through a list cannot go back.
pub fn one_sided(axis: Box<dyn RotationAxis>, backlash_steps: u32) -> Result<Box<dyn RotationAxis>, DeviceError> {
    if backlash_steps == 0 {
        return Ok(axis);
    }
    if axis.capabilities().trigger_only {
        let (name, found) = ("rig.backlash_steps".into(), backlash_steps.to_string());
        let rule = "an axis that steps through a list cannot go back: it must be 0".into();
        return Err(DeviceError::Setting { device: "rotation axis", name, found, rule });
    }
    Ok(Box::new(OneSided { axis, backlash_steps: backlash_steps.into() }))
}

impl OneSided {
    fn approach(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        self.axis.move_to(target + Steps(-self.backlash_steps))?;
        self.axis.move_to(target)
    }
}

impl RotationAxis for OneSided {
    forward_axis!(axis: identity, capabilities, begin_run, announce, even_motion, move_evenly, let_go, linear, specimen_input, outputs, check, position, stop_handle);

    /// A reference may have been reached in either direction, so it is also approached from behind.
    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        let origin = self.axis.reference(cancel)?;
        self.approach(origin.steps)
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        match self.axis.position() {
            Position::Referenced { steps, .. } if target < steps => self.approach(target),
            _ => self.axis.move_to(target),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::FakeAxis;

    #[test]
    fn every_stop_is_reached_turning_forward() {
        let axis = FakeAxis::new();
        let log = axis.log();
        let mut axis = one_sided(Box::new(axis), 7).unwrap();
        assert_eq!(axis.reference(&CancelToken::new()).unwrap().steps, Steps(0));
        for target in [250, 125, 375, 375, 62] {
            assert_eq!(axis.move_to(Steps(target)).unwrap().steps, Steps(target));
        }
        assert_eq!(log.targets(), [-7, 0, 250, 118, 125, 375, 375, 55, 62].map(Steps));
    }

    #[test]
    fn an_axis_that_cannot_go_back_is_refused_and_no_backlash_adds_no_move() {
        assert!(matches!(one_sided(Box::new(FakeAxis::new().trigger_only()), 7), Err(DeviceError::Setting { .. })));
        let axis = FakeAxis::new().trigger_only();
        let log = axis.log();
        one_sided(Box::new(axis), 0).unwrap().reference(&CancelToken::new()).unwrap();
        assert!(log.targets().is_empty());
    }
}
