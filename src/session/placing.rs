//! Brings the specimen into view along the capillary, where the instrument has an axis for that.
//!
//! ```text
//!   |        ======>|      goes on beyond the right border: the room on the left is free
//!   |  <======      |      carried into it, up to the margin
//! ```

use carved_core::profile::Profile;
use carved_core::units::Steps;
use carved_devices::cancel::CancelToken;
use carved_devices::{DeviceError, LinearAxis, Position, Rig};

/// Share of the picture's width that is left free beside the end of a specimen that can be seen.
const MARGIN: f64 = 0.05;

/// References the axis where it is not, and moves the capillary to where a specimen should be in view.
pub fn place(rig: &mut Rig, position_um: f64, cancel: &CancelToken) -> Result<(), DeviceError> {
    let Some(axis) = rig.rotation.linear() else { return Ok(()) };
    axis.reference(cancel)?;
    let target = axis.steps_of(position_um);
    axis.move_to(target)?;
    Ok(())
}

/// Carries the capillary along, as far as the limits allow; false where there is no way to go.
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

/// How far to the right, in px, brings more of a specimen into the picture that goes on beyond one of its sides; nothing
/// where all of it is in view, or where both sides cut it.
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
