//! A fake camera.

use crate::{Camera, DeviceError, Grabbed, Link, StreamCounters};
use carved_core::frame::{PixelFormat, RawFrame};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

type Arm = Box<dyn FnMut(u32) -> Result<(), DeviceError> + Send>;
type Expose = Box<dyn FnMut(u32) -> Result<RawFrame, DeviceError> + Send>;

/// A camera whose frames a test makes. It may also be lost and come back.
pub struct FakeCamera {
    arm: Arm,
    expose: Expose,
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
    /// A camera that takes its frames from `expose`, which is given the number of the trigger, from 1.
    pub fn new(expose: impl FnMut(u32) -> Result<RawFrame, DeviceError> + Send + 'static) -> Self {
        Self { arm: Box::new(|_| Ok(())), expose: Box::new(expose), armed: 0, triggers: 0, is_lost: Arc::default() }
    }

    /// The camera asks `arm` at each start of an acquisition, with the number of the call, from 1. An error makes the camera lost if
    /// it is [`DeviceError::ControlLost`]. A success brings a lost camera back.
    #[must_use]
    pub fn arming(mut self, arm: impl FnMut(u32) -> Result<(), DeviceError> + Send + 'static) -> Self {
        self.arm = Box::new(arm);
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
