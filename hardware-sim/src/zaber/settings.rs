//! Properties and settings of the controller.

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Address of the device in its chain.
    pub device: u8,
    /// Microsteps per full step.
    pub resolution: u32,
    /// Speed, in the protocol's unit: microsteps/s times 1.6384.
    pub maxspeed: u32,
    /// Acceleration, in the protocol's unit: microsteps/s^2 times 1.6384 / 10000.
    pub accel: u32,
    /// Whether the axis has an encoder. Only then stalls are detected.
    pub encoder: bool,
    pub serial_number: u32,
    /// Whether a command is accepted only if its slash is the first byte of the line.
    pub slash_first: bool,
}

impl Default for Settings {
    /// 200 full steps per revolution, 32 microsteps per full step, half a revolution per second.
    fn default() -> Self {
        Self { device: 1, resolution: 32, maxspeed: 5243, accel: 5, encoder: true, serial_number: 51_234, slash_first: false }
    }
}

impl Settings {
    pub(super) fn steps_per_s(&self) -> f64 {
        f64::from(self.maxspeed) / 1.6384
    }

    pub(super) fn steps_per_s2(&self) -> f64 {
        f64::from(self.accel) * 10_000.0 / 1.6384
    }
}
