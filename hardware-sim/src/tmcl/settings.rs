//! The EEPROM of the module: axis parameters, the same for both motors.

use std::collections::BTreeMap;

/// The module and the axis parameters that it starts with.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    pub module_address: u8,
    pub host_address: u8,
    /// Type of the module in the upper 16 bits, version of its firmware in the lower 16 bits.
    pub version: i32,
    /// One pair of wires for both directions (RS485). The module ignores what arrives while it has an answer to send.
    pub half_duplex: bool,
    pub(super) parameters: BTreeMap<u8, i32>,
}

impl Default for Settings {
    /// A TMCM-6212 with firmware 1.00, whose units are steps/s and steps/s^2. A revolution of 6400 microsteps takes two seconds.
    fn default() -> Self {
        let parameters = [(0, 0), (1, 0), (2, 0), (3, 0), (4, 3200), (5, 32_000), (8, 1), (10, 0), (11, 0), (140, 5), (181, 0), (206, 512)];
        Self { module_address: 1, host_address: 2, version: 0x1844_0100, half_duplex: false, parameters: parameters.into() }
    }
}

impl Settings {
    /// Sets an axis parameter of both motors in the EEPROM.
    #[must_use]
    pub fn with(mut self, parameter: u8, value: i32) -> Self {
        self.parameters.insert(parameter, value);
        self
    }

    pub(super) fn parameters(&self) -> BTreeMap<u8, i32> {
        self.parameters.clone()
    }
}
