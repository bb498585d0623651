//! One frame from the camera, also if the camera must be opened again for it.

use crate::cancel::CancelToken;
use crate::{Camera, DeviceError, Grabbed};
use carved_core::frame::RawFrame;
use carved_records::sha256_hex;
use carved_records::{Light, SecondEntry};
use std::time::{Duration, Instant};

/// How long a lost camera is searched before its view fails. Meanwhile the axis is at rest and the specimen waits.
const PATIENCE: Duration = Duration::from_secs(10);
/// Pause between two attempts.
const PAUSE: Duration = Duration::from_millis(200);

/// Takes one frame. If the camera is lost meanwhile and comes back within ten seconds, it is opened again, and the frame is taken
/// again. Nothing has moved.
///
/// # Errors
/// The camera's error; of a lost camera, that of the last attempt.
pub fn grab(camera: &mut dyn Camera, deadline: Duration, cancel: &CancelToken) -> Result<Grabbed, DeviceError> {
    let mut failed = match camera.grab(deadline) {
        Err(e) if camera.is_lost() => e,
        done => return done,
    };
    tracing::warn!(error = %failed, "the camera is lost; it is opened again when it answers");
    let until = Instant::now() + PATIENCE;
    while Instant::now() < until && !cancel.rest(PAUSE) {
        match camera.arm().and_then(|()| camera.grab(deadline)) {
            Err(e) if camera.is_lost() => failed = e,
            done => return done,
        }
    }
    Err(failed)
}

/// Takes the second camera's frame of a view, after that of the first camera.
///
/// # Errors
/// As [`grab`].
pub fn grab_second(camera: &mut dyn Camera, deadline: Duration, cancel: &CancelToken) -> Result<(SecondEntry, RawFrame), DeviceError> {
    let began = Instant::now();
    let Grabbed { frame, frame_id, attempts, .. } = grab(camera, deadline, cancel)?;
    let grab_ms = began.elapsed().as_secs_f64() * 1e3;
    let entry = SecondEntry { grab_ms, frame_id, attempts, light: Light::of(&frame), sha256: sha256_hex(frame.bytes()) };
    Ok((entry, frame))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::FakeCamera;
    use carved_core::frame::PixelFormat;

    /// A camera that is lost, and comes back at the third attempt to start it.
    fn back_at_third_attempt() -> FakeCamera {
        FakeCamera::new(|_| Ok(RawFrame::new(1, 1, PixelFormat::Mono8, vec![7]).unwrap()))
            .arming(|attempt| if attempt < 3 { Err(DeviceError::ControlLost) } else { Ok(()) })
            .lost()
    }

    #[test]
    fn a_camera_that_comes_back_gives_its_view_and_a_cancelled_run_does_not_wait() {
        let cancel = CancelToken::new();
        let mut camera = back_at_third_attempt();
        assert_eq!(grab(&mut camera, PAUSE, &cancel).unwrap().frame.bytes(), [7]);
        assert_eq!(camera.times_armed(), 3);
        cancel.cancel();
        let mut camera = back_at_third_attempt();
        assert!(matches!(grab(&mut camera, PAUSE, &cancel), Err(DeviceError::CameraSilent { .. })));
        assert_eq!(camera.times_armed(), 0);
    }
}
