//! A fake camera.

use crate::{Camera, ClockReading, DeviceError, FrameSink, Grabbed, Link, StreamCounters, StreamEnd, StreamPlan, StreamedFrame};
use carved_core::frame::{PixelFormat, RawFrame};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

type Arm = Box<dyn FnMut(u32) -> Result<(), DeviceError> + Send>;
type Expose = Box<dyn FnMut(u32) -> Result<RawFrame, DeviceError> + Send>;
type Script = Box<dyn FnMut(u32, &StreamPlan) -> Result<Vec<Scripted>, DeviceError> + Send>;

/// A frame of a scripted stream.
#[derive(Debug, Clone, PartialEq)]
pub struct Scripted {
    /// Number in the stream.
    pub frame_id: u64,
    /// The camera's clock, ns.
    pub camera_ns: u64,
    /// The pixels. `None`: the frame comes incomplete.
    pub frame: Option<RawFrame>,
}

/// A camera whose frames a test makes. It may also be lost and come back.
pub struct FakeCamera {
    arm: Arm,
    expose: Expose,
    /// The highest rate, Hz, and the frames of each stream.
    streams: Option<(f64, Script)>,
    /// The error of a stream whose sink has enough.
    end: Option<Box<dyn Fn() -> DeviceError + Send>>,
    /// Calls of `stream` while the camera was there.
    streamed: u32,
    /// Calls of `arm`.
    armed: u32,
    /// Calls of `grab` while the camera was there.
    triggers: u32,
    is_lost: Arc<AtomicBool>,
}

impl Default for FakeCamera {
    /// A camera whose frames have one black pixel.
    fn default() -> Self {
        Self::new(|_| RawFrame::new(1, 1, PixelFormat::Mono8, vec![0]).map_err(|e| refused(e.to_string())))
    }
}

fn refused(why: String) -> DeviceError {
    DeviceError::Camera { what: "fake frame".into(), why }
}

impl FakeCamera {
    /// The clock of a camera that can run free, at each reading, ns.
    pub const CLOCK_NS: u64 = 1_000_000_000_000;

    /// A camera that takes its frames from `expose`, which is given the number of the trigger, from 1.
    pub fn new(expose: impl FnMut(u32) -> Result<RawFrame, DeviceError> + Send + 'static) -> Self {
        Self {
            arm: Box::new(|_| Ok(())),
            expose: Box::new(expose),
            streams: None,
            end: None,
            streamed: 0,
            armed: 0,
            triggers: 0,
            is_lost: Arc::default(),
        }
    }

    /// The camera asks `arm` at each start of an acquisition, with the number of the call, from 1. An error makes the camera lost if
    /// it is [`DeviceError::ControlLost`]. A success brings a lost camera back.
    #[must_use]
    pub fn arming(mut self, arm: impl FnMut(u32) -> Result<(), DeviceError> + Send + 'static) -> Self {
        self.arm = Box::new(arm);
        self
    }

    /// The camera can run free, up to a rate in Hz. At each start of a stream it asks `script` for the frames, with the number of the
    /// stream, from 1. A stream whose frames are used up is silent.
    #[must_use]
    pub fn streaming(
        mut self,
        highest_rate_hz: f64,
        script: impl FnMut(u32, &StreamPlan) -> Result<Vec<Scripted>, DeviceError> + Send + 'static,
    ) -> Self {
        self.streams = Some((highest_rate_hz, Box::new(script)));
        self
    }

    /// Each stream ends with this error, although its sink has enough.
    #[must_use]
    pub fn ending_with(mut self, end: impl Fn() -> DeviceError + Send + 'static) -> Self {
        self.end = Some(Box::new(end));
        self
    }

    /// The camera is lost at first. While it is lost each `grab` fails.
    #[must_use]
    pub fn lost(self) -> Self {
        self.is_lost.store(true, Ordering::SeqCst);
        self
    }

    /// How often an acquisition was started, or tried to.
    pub fn times_armed(&self) -> u32 {
        self.armed
    }
}

impl Camera for FakeCamera {
    fn identity(&self) -> &'static str {
        "fake camera"
    }

    fn highest_rate_hz(&mut self) -> Result<Option<f64>, DeviceError> {
        Ok(self.streams.as_ref().map(|(rate_hz, _)| *rate_hz))
    }

    fn clock(&mut self) -> Result<Option<ClockReading>, DeviceError> {
        Ok(self.streams.as_ref().map(|_| ClockReading { camera_ns: Self::CLOCK_NS, host: Instant::now(), scale: 1.0 }))
    }

    fn stream(&mut self, plan: &StreamPlan, sink: FrameSink<'_>) -> Result<StreamEnd, DeviceError> {
        if self.is_lost() {
            return Err(DeviceError::ControlLost);
        }
        let Some((_, script)) = &mut self.streams else { return Err(refused("it is not scripted".into())) };
        self.streamed += 1;
        let mut end = StreamEnd { rate_hz: plan.rate_hz, incomplete: Vec::new() };
        let mut frames = 0;
        for Scripted { frame_id, camera_ns, frame } in script(self.streamed, plan)? {
            let Some(frame) = frame else {
                end.incomplete.push(frame_id);
                continue;
            };
            frames += 1;
            if sink(StreamedFrame { frame, frame_id, camera_ns, received: Instant::now() }).is_break() {
                return self.end.as_ref().map_or(Ok(end), |error| Err(error()));
            }
        }
        Err(DeviceError::StreamSilent { waited_ms: plan.silence.as_millis(), frames, last: "the script is at its end".into() })
    }

    fn arm(&mut self) -> Result<(), DeviceError> {
        self.armed += 1;
        let result = (self.arm)(self.armed);
        match result {
            Ok(()) => self.is_lost.store(false, Ordering::SeqCst),
            Err(DeviceError::ControlLost) => self.is_lost.store(true, Ordering::SeqCst),
            Err(_) => {}
        }
        result
    }

    fn grab(&mut self, _deadline: Duration) -> Result<Grabbed, DeviceError> {
        if self.is_lost() {
            return Err(DeviceError::CameraSilent { request: "the trigger".into(), why: "unplugged".into() });
        }
        self.triggers += 1;
        let frame = (self.expose)(self.triggers)?;
        Ok(Grabbed { frame, frame_id: self.triggers.into(), attempts: 1, trigger_ms: 0.0 })
    }

    fn link(&self) -> Link {
        let is_lost = Arc::clone(&self.is_lost);
        Link::new(move || is_lost.load(Ordering::SeqCst))
    }

    fn reopen(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }

    fn counters(&self) -> StreamCounters {
        StreamCounters::default()
    }

    fn disarm(&mut self) -> Result<(), DeviceError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::ControlFlow;

    #[test]
    fn a_scripted_stream_gives_its_frames_until_the_sink_breaks_and_is_silent_at_its_end() {
        let black = || RawFrame::new(1, 1, PixelFormat::Mono8, vec![0]).unwrap();
        let script = move |_: u32, _: &StreamPlan| {
            let frames = [Some(black()), None, Some(black())].into_iter().zip(1..);
            Ok(frames.map(|(frame, frame_id)| Scripted { frame_id, camera_ns: 100 * frame_id, frame }).collect())
        };
        let mut camera = FakeCamera::default().streaming(59.0, script);
        assert_eq!(camera.highest_rate_hz().unwrap(), Some(59.0));
        let plan = StreamPlan { rate_hz: 30.0, buffers: 4, silence: Duration::from_millis(300) };
        let mut seen = Vec::new();
        let mut until = |last: u64, seen: &mut Vec<u64>| {
            camera.stream(&plan, &mut |frame| {
                seen.push(frame.frame_id);
                if frame.frame_id == last { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })
        };
        assert_eq!(until(3, &mut seen).unwrap(), StreamEnd { rate_hz: 30.0, incomplete: vec![2] });
        assert!(matches!(until(4, &mut seen), Err(DeviceError::StreamSilent { waited_ms: 300, frames: 2, .. })));
        assert_eq!(seen, [1, 3, 1, 3]);
        let refusal = FakeCamera::default().stream(&plan, &mut |_| ControlFlow::Break(())).unwrap_err();
        assert!(matches!(refusal, DeviceError::Camera { .. }), "{refusal}");
    }
}
