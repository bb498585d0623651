//! The camera's own clock, which also gives the timestamps of frames.

use aravis::prelude::*;
use aravis::{GvDevice, glib};

// GigE Vision's bootstrap registers: writing `LATCH` to the first copies the running time into the two after it.
const CONTROL: u64 = 0x944;
const LATCHED_HIGH: u64 = 0x948;
const LATCHED_LOW: u64 = 0x94c;
const LATCH: u32 = 2;

/// A clock that runs. Not every camera has one.
#[derive(Debug, Clone, Copy)]
pub(super) struct CameraClock {
    pub ticks_per_s: u64,
}

impl CameraClock {
    /// `None` if the camera reports no frequency, or its time does not advance.
    pub fn of(device: &GvDevice) -> Option<Self> {
        let clock = Self { ticks_per_s: device.timestamp_tick_frequency().ok().filter(|f| *f > 0)? };
        let first = clock.now_ns(device).ok()?;
        let second = clock.now_ns(device).ok()?;
        (second > first).then_some(clock)
    }

    /// The present time, ns. It takes three requests on the control channel.
    pub fn now_ns(self, device: &GvDevice) -> Result<u64, glib::Error> {
        device.write_register(CONTROL, LATCH)?;
        let (_, high) = device.read_register(LATCHED_HIGH)?;
        let (_, low) = device.read_register(LATCHED_LOW)?;
        let ticks = (u128::from(high) << 32) | u128::from(low);
        // As Aravis converts the stamps of frames.
        Ok((ticks * 1_000_000_000 / u128::from(self.ticks_per_s)) as u64)
    }
}
