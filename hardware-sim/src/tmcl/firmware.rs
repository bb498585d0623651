//! The firmware: nine bytes in, nine bytes out. It has no file descriptor and no clock of its own.
//!
//! ```text
//!  bytes ── any 9 bytes are a frame ──► command ──► two motors ──► the two ends of the shaft
//! ```
//! The start of a frame is not marked, so that one stray byte shifts all later frames. A frame for another module is ignored. Nine
//! zeros are such a frame.

use super::frame::{BYTES, Request, Status, reply};
use super::motor::Motor;
use super::settings::Settings;
use crate::motor_faults::MotorFaults;
use crate::outputs::{OutputPin, Outputs};
use crate::serial;
use crate::shaft::Shaft;
use std::sync::Arc;

/// The bank of the user's variables.
const USER_BANK: u8 = 2;
const USER_VARIABLES: usize = 56;
/// The bank of the digital outputs, and how many there are.
const OUTPUT_BANK: u8 = 2;
const OUTPUTS: u8 = 8;
/// Value of command 255 that resets the module.
const RESET: i32 = 1234;

pub(crate) struct Firmware {
    settings: Settings,
    motors: [Motor; 2],
    outputs: Arc<Outputs>,
    user: [i32; USER_VARIABLES],
    received: Vec<u8>,
    out: Vec<u8>,
}

impl serial::Firmware for Firmware {
    fn restarts_when_opened(&self) -> bool {
        false
    }

    fn lose_power(&mut self, now_s: f64) {
        for motor in &mut self.motors {
            motor.lose_power(self.settings.parameters(), now_s);
        }
        self.outputs.all_off();
        self.user = [0; USER_VARIABLES];
        self.received.clear();
    }

    /// A module sends nothing when it starts.
    fn boot(&mut self) {}

    fn next_event_s(&self) -> Option<f64> {
        self.motors.iter().filter_map(Motor::next_event_s).reduce(f64::min)
    }

    fn advance(&mut self, now_s: f64) {
        self.motors.iter_mut().for_each(|motor| motor.advance(now_s));
    }

    fn receive(&mut self, bytes: &[u8], now_s: f64) {
        self.received.extend_from_slice(bytes);
        while let Some(frame) = self.received.first_chunk::<BYTES>().copied() {
            self.received.drain(..BYTES);
            self.answer(Request::read(frame), now_s);
            if self.settings.half_duplex && !self.out.is_empty() {
                self.received.clear();
            }
        }
    }

    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }
}

impl Firmware {
    pub fn new(shaft: &Arc<Shaft>, faults: &Arc<MotorFaults>, outputs: Arc<Outputs>, settings: Settings) -> Self {
        let motors = [0, 1].map(|number| Motor::new(number, Arc::clone(shaft), Arc::clone(faults), settings.parameters()));
        Self { settings, motors, outputs, user: [0; USER_VARIABLES], received: Vec::new(), out: Vec::new() }
    }

    fn answer(&mut self, request: Request, now_s: f64) {
        let (status, value) = if !request.intact {
            (Status::WrongChecksum, 0)
        } else if request.address != self.settings.module_address {
            return;
        } else if (request.command, request.value) == (255, RESET) {
            return serial::Firmware::lose_power(self, now_s);
        } else {
            match self.carry_out(request, now_s) {
                Ok(value) => (Status::Ok, value),
                Err(status) => (status, 0),
            }
        };
        let Settings { host_address, module_address, .. } = self.settings;
        self.out.extend(reply(host_address, module_address, status, request.command, value));
    }

    /// `SIO` and `GIO` of the digital outputs.
    fn output(&self, request: Request) -> Result<i32, Status> {
        let pin = OutputPin::Number(request.kind);
        if request.motor != OUTPUT_BANK || request.kind >= OUTPUTS {
            return Err(Status::WrongType);
        }
        if request.command == 14 {
            if !(0..=1).contains(&request.value) || self.outputs.is_refused(pin) {
                return Err(Status::InvalidValue);
            }
            self.outputs.set(pin, request.value == 1);
        }
        Ok(self.outputs.is_on(pin).into())
    }

    fn carry_out(&mut self, request: Request, now_s: f64) -> Result<i32, Status> {
        let Request { command, kind, value, .. } = request;
        match command {
            9 | 10 => {
                let variable = Some(&mut self.user).filter(|_| request.motor == USER_BANK).and_then(|user| user.get_mut(usize::from(kind)));
                let variable = variable.ok_or(Status::WrongType)?;
                if command == 9 {
                    *variable = value;
                }
                return Ok(*variable);
            }
            14 | 15 => return self.output(request),
            136 if kind == 1 => return Ok(self.settings.version),
            136 => return Err(Status::WrongType),
            _ => {}
        }
        let motor = self.motors.get_mut(usize::from(request.motor)).ok_or(Status::InvalidValue)?;
        match (command, kind) {
            (3, _) | (13, 1) => motor.stop(now_s),
            (4, 0) => motor.go(value.into(), now_s),
            (4, 1) => {
                let from = motor.get(super::motor::ACTUAL, now_s).unwrap_or_default();
                motor.go(i64::from(from) + i64::from(value), now_s);
            }
            (5, _) => {
                if !motor.set(kind, value, now_s) {
                    return Err(Status::WrongType);
                }
            }
            (6, _) => return motor.get(kind, now_s).ok_or(Status::WrongType),
            (13, 0) => motor.search(now_s),
            (13, 2) => return Ok(i32::from(motor.is_searching())),
            (4 | 13, _) => return Err(Status::WrongType),
            _ => return Err(Status::InvalidCommand),
        }
        Ok(value)
    }
}
