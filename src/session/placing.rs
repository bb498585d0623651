//! Brings the specimen into view along the capillary, if the instrument has an axis for this.
//!
//! ```text
//!   |        ======>|      the specimen extends beyond the right border, the space on the left is free
//!   |  <======      |      it is moved into the free space, up to the margin
//! ```

use carved_core::profile::Profile;
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::{DeviceError, LinearAxis, Position, Rig};

/// Share of the picture's width that stays free beside the visible end of the specimen.
const MARGIN: f64 = 0.05;

/// References the axis if necessary, and moves the capillary to the position where a specimen should be in view.
pub fn place(rig: &mut Rig, position_um: f64, cancel: &CancelToken) -> Result<(), DeviceError> {
    let Some(axis) = rig.rotation.linear() else { return Ok(()) };
    axis.reference(cancel)?;
    let target = axis.steps_of(position_um);
    axis.move_to(target)?;
    Ok(())
}

/// Moves the capillary along its axis, as far as the limits allow. Returns `false` if it cannot move.
pub fn shift(rig: &mut Rig, by_um: f64) -> Result<bool, DeviceError> {
    let Some(axis) = rig.rotation.linear() else { return Ok(false) };
    let Position::Referenced { steps: from, .. } = axis.position() else { return Ok(false) };
    let target = within(axis, Steps(from.0 + axis.steps_of(by_um).0));
    if target == from {
        return Ok(false);
    }
    axis.move_to(target)?;
    Ok(true)
}

fn within(axis: &dyn LinearAxis, target: Steps) -> Steps {
    let [low, high] = axis.limits();
    target.clamp(low, high)
}

/// Shift to the right, in px, that brings more of the specimen into the picture. `None` if all of it is in view, or if it extends beyond
/// both sides.
pub fn shift_px(profile: &Profile) -> Option<f64> {
    let (left, right) = (profile.detection.is_clipped_left(), profile.detection.is_clipped_right());
    if left == right {
        return None;
    }
    let mask = &profile.mask;
    let covered = |u: &usize| (0..mask.height()).any(|v| mask.get(*u, v));
    let (first, last) = ((0..mask.width()).find(covered)?, (0..mask.width()).rev().find(covered)?);
    let free = if left { mask.width() - 1 - last } else { first } as f64 - MARGIN * mask.width() as f64;
    (free >= 1.0).then_some(if left { free } else { -free })
}
