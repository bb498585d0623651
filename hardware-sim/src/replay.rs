//! A recording as the image source of the camera: at each angle the camera sends the frame that was recorded there.
//!
//! ```text
//!   recorded   |0 deg      |17.28      |34.56  ...        |360 deg: the closure view, not the first view
//!   shaft      ──────────────▲ the nearest frame, if it is within half a motor step. Otherwise a black frame, which is counted
//! ```

use crate::scene::Exposure;
use crate::sight::{PixelFormat, Pixels, Sight};
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicU64, Ordering};

#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ReplayError {
    #[error("a replay needs at least one recorded frame, found none")]
    Empty,
    #[error("recorded frame {index} stands at {angle_rad} rad, which is no angle")]
    Angle { index: usize, angle_rad: f64 },
    #[error("recorded frame {index} has {found} bytes, a {width} x {height} {} frame has {expected}", format.name())]
    Cut { index: usize, width: u32, height: u32, format: PixelFormat, expected: usize, found: usize },
    #[error("recorded frame {index} is {found:?}, the first is {expected:?}; one replay shows frames of one kind")]
    Unlike { index: usize, expected: (u32, u32, PixelFormat), found: (u32, u32, PixelFormat) },
}

/// Recorded frames, found by their unwrapped angle.
#[derive(Debug)]
pub struct Replay {
    /// Angle, rad, and frame, in the order of the angles.
    frames: Vec<(f64, Pixels)>,
    half_step_rad: f64,
    misses: AtomicU64,
}

impl Replay {
    /// Takes frames with their unwrapped angles, rad, counted from the index, and the steps of the motor per number of revolutions.
    ///
    /// # Errors
    /// The recording is empty, a frame is incomplete or has no angle, or the frames differ in size or format.
    pub fn new(mut frames: Vec<(f64, Pixels)>, steps_per_revolution: (u32, u32)) -> Result<Self, ReplayError> {
        let kind = |p: &Pixels| (p.width, p.height, p.format);
        let expected = frames.first().map(|(_, p)| kind(p)).ok_or(ReplayError::Empty)?;
        for (index, (angle_rad, pixels)) in frames.iter().enumerate() {
            let (width, height, format) = kind(pixels);
            if !angle_rad.is_finite() {
                return Err(ReplayError::Angle { index, angle_rad: *angle_rad });
            }
            if kind(pixels) != expected {
                return Err(ReplayError::Unlike { index, expected, found: kind(pixels) });
            }
            if !pixels.is_whole() {
                let expected = width as usize * height as usize * format.bytes_per_pixel();
                return Err(ReplayError::Cut { index, width, height, format, expected, found: pixels.bytes.len() });
            }
        }
        frames.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (steps, revolutions) = steps_per_revolution;
        let half_step_rad = 0.5 * TAU * f64::from(revolutions) / f64::from(steps.max(1));
        Ok(Self { frames, half_step_rad, misses: AtomicU64::new(0) })
    }

    /// The format of the recorded frames. The camera must be set to it.
    pub fn format(&self) -> PixelFormat {
        self.frames[0].1.format
    }

    /// Number of exposures without a recorded frame. For each of them a black frame was sent.
    pub fn misses(&self) -> u64 {
        self.misses.load(Ordering::Relaxed)
    }

    fn nearest(&self, angle_rad: f64) -> &(f64, Pixels) {
        let after = self.frames.partition_point(|(a, _)| *a < angle_rad);
        let candidates = &self.frames[after.saturating_sub(1)..(after + 1).min(self.frames.len())];
        match candidates {
            [a, b] if (b.0 - angle_rad).abs() < (angle_rad - a.0).abs() => b,
            [a, ..] => a,
            // Unreachable: there is at least one frame, so the range is not empty.
            [] => &self.frames[0],
        }
    }
}

impl Sight for Replay {
    fn size(&self) -> (u32, u32) {
        (self.frames[0].1.width, self.frames[0].1.height)
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        let (angle_rad, pixels) = self.nearest(exposure.angle_rad);
        if (angle_rad - exposure.angle_rad).abs() <= self.half_step_rad && format == pixels.format {
            return pixels.clone();
        }
        self.misses.fetch_add(1, Ordering::Relaxed);
        tracing::warn!(
            at_deg = exposure.angle_rad.to_degrees(),
            nearest_deg = angle_rad.to_degrees(),
            wanted = format.name(),
            recorded = pixels.format.name(),
            "no recorded frame for this exposure; a black one is sent"
        );
        Pixels::filled(pixels.width, pixels.height, format, 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(value: u8) -> Pixels {
        Pixels::filled(4, 4, PixelFormat::Mono8, value)
    }

    fn replay() -> Replay {
        let step = TAU / 500.0;
        let frames = vec![(0.0, frame(1)), (24.0 * step, frame(2)), (TAU, frame(3))];
        Replay::new(frames, (500, 1)).unwrap()
    }

    fn seen(replay: &Replay, steps: f64) -> u8 {
        replay.look(&Exposure { angle_rad: steps / 500.0 * TAU, number: 0 }, PixelFormat::Mono8).bytes[0]
    }

    #[test]
    fn the_closure_view_is_not_the_first_view() {
        let r = replay();
        assert_eq!([seen(&r, 0.0), seen(&r, 24.0), seen(&r, 500.0)], [1, 2, 3]);
        assert_eq!(r.misses(), 0);
    }

    #[test]
    fn a_frame_further_than_half_a_step_away_is_not_used() {
        let r = replay();
        assert_eq!([seen(&r, 0.49), seen(&r, 23.51), seen(&r, -0.49), seen(&r, 500.49)], [1, 2, 1, 3]);
        assert_eq!([seen(&r, 0.51), seen(&r, 12.0), seen(&r, 1000.0), seen(&r, -500.0)], [0; 4]);
        assert_eq!(r.misses(), 4);
    }

    #[test]
    fn another_format_than_the_recorded_one_gives_a_black_frame() {
        let r = replay();
        let black = r.look(&Exposure { angle_rad: 0.0, number: 0 }, PixelFormat::RGB8Packed);
        assert_eq!((black.bytes.len(), black.bytes[0], r.misses()), (48, 0, 1));
    }

    #[test]
    fn incomplete_or_mixed_recordings_are_refused() {
        assert_eq!(Replay::new(vec![], (500, 1)).unwrap_err(), ReplayError::Empty);
        let mut cut = frame(0);
        cut.bytes.pop();
        assert!(matches!(Replay::new(vec![(0.0, cut)], (500, 1)), Err(ReplayError::Cut { expected: 16, found: 15, .. })));
        let other = Pixels::filled(4, 4, PixelFormat::BayerRG8, 0);
        assert!(matches!(Replay::new(vec![(0.0, frame(0)), (1.0, other)], (500, 1)), Err(ReplayError::Unlike { index: 1, .. })));
        assert!(matches!(Replay::new(vec![(f64::NAN, frame(0))], (500, 1)), Err(ReplayError::Angle { .. })));
    }
}
