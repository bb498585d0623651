//! Takes frames with a camera and computes their mean, whose noise falls with the square root of their number.

use anyhow::Context;
use carved_core::frame::RawFrame;
use carved_devices::DeviceError;
use carved_devices::acquisition::grab;
use carved_devices::camera::{self, AravisSettings};
use carved_devices::cancel::CancelToken;
use std::time::Duration;

/// Time for one frame besides its exposure, including repeated triggers.
const PATIENCE: Duration = Duration::from_secs(3);
/// Number of triggers for which there is time at least. On a busy computer a frame may be lost.
const TRIGGERS: u32 = 3;

/// Takes `count` frames, unless `cancel` is cancelled before. Returns the camera's identity and the frames.
pub fn take(settings: &AravisSettings, count: u32, cancel: &CancelToken) -> anyhow::Result<(String, Vec<RawFrame>)> {
    let deadline = PATIENCE.max(settings.frame_timeout() * TRIGGERS)
        + Duration::try_from_secs_f64(settings.exposure_us * 1e-6).context("exposure_us")?;
    let mut camera = camera::open(settings.clone())?;
    camera.arm()?;
    let next = |_| if cancel.is_cancelled() { Err(DeviceError::Stopped) } else { Ok(grab(camera.as_mut(), deadline, cancel)?.frame) };
    let frames = (0..count).map(next).collect::<Result<Vec<_>, _>>()?;
    camera.disarm()?;
    Ok((camera.identity().to_owned(), frames))
}

/// Mean of frames of one size and format, rounded.
pub fn mean(frames: &[RawFrame]) -> anyhow::Result<RawFrame> {
    let first = frames.first().context("no frame to take the mean of")?;
    let mut sums = vec![0u32; first.bytes().len()];
    for frame in frames {
        anyhow::ensure!(frame.bytes().len() == sums.len(), "frames of two sizes have no mean");
        sums.iter_mut().zip(frame.bytes()).for_each(|(sum, byte)| *sum += u32::from(*byte));
    }
    let n = frames.len() as u32;
    // The mean of bytes fits in a byte.
    let bytes = sums.into_iter().map(|sum| ((sum + n / 2) / n) as u8).collect();
    Ok(RawFrame::new(first.width(), first.height(), first.format(), bytes)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::frame::PixelFormat;

    #[test]
    fn the_mean_is_rounded_and_of_one_size() {
        let frame = |bytes: &[u8]| RawFrame::new(bytes.len() as u32, 1, PixelFormat::Mono8, bytes.to_vec()).unwrap();
        assert_eq!(mean(&[frame(&[1, 255]), frame(&[2, 255]), frame(&[2, 254])]).unwrap().bytes(), [2, 255]);
        assert!(mean(&[]).is_err() && mean(&[frame(&[1]), frame(&[1, 2])]).is_err());
    }
}
