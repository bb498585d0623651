//! Driver for Trinamic modules (TMCL): two motors that hold the capillary at both ends and turn it as a pair.
//!
//! ```text
//! reference:  flush ─ settings ─ stop ─ arm the stall stop ─ skew? ─ search (both) | here ─ counters to 0 ─ mark
//! move_to:    both counters where they were left, and the mark? ─ absolute target to both
//!               └─ look, look, ... : skew? off the path? at rest too early? reset? ─► both stopped, position suspect
//!               └─ no look in time ─► both stopped, read at rest, sent on
//!               └─ both counters at the target, both speeds 0, the mark ─► arrived
//! ```
//! A "look" reads the position counters of both motors: the first counter before and after the second, so that the skew of a turning
//! pair follows without a clock. Skew is the difference between the two counters.
//!
//! **Skew limits.** One motor is started before the other. If the module has not acknowledged both in the time in which one motor
//! alone exceeds the allowed skew, the pair is stopped. If no look succeeds for that time during a move, both motors are stopped,
//! read at rest, and sent on, so that a late answer costs only time. A pair with too much skew is reported as an alarm before it is
//! homed again. Parameter 8, "position reached", is not used, because a stop leaves it at 0. A reading that shows a fault must be
//! read twice: bits can flip, and the checksum with them.
//!
//! **The mark.** A module that was reset reports nothing and counts from 0, which may be the expected position. At every reference a
//! number is written into a variable that a reset clears. It is read with every look, at rest and before every reference. carved never
//! resets the module, so a reset counts as a person's.
//!
//! **Stalls.** If the stall stop is armed on a stalled motor, its old move continues. So it is armed only by a reference, after a
//! stop, which ends the move. The module counts the steps that it sends. Steps that are lost without a stall show as skew when the
//! pair is referenced at its switches, or in the pictures.

mod entry;
pub(super) mod frame;
mod settings;
mod travel;
mod wire;

pub(super) use entry::ENTRY;
pub use settings::{ClockDivisors, TmclPin, TmclSettings};

use super::Reference;
use super::knowledge::Knowledge;
use super::link::{Link, Stop};
use crate::cancel::CancelToken;
use crate::outputs::{Bank, OutputStatus, Outputs};
use crate::{Achieved, Begun, Capabilities, DeviceError, Difference, EvenMotion, Position, RotationAxis, StopHandle};
use carved_core::units::Steps;
use frame::{Request, Version, parameter, stop_pieces};
use std::time::Instant;
use travel::Pace;
use wire::Wire;

const DEVICE: &str = "rotation axis (TMCL)";
/// Upper half of every mark. The lower half is the epoch.
const MARK: i32 = 0x0CA7_0000;

/// A rotation axis of two motors on one Trinamic module.
pub struct Tmcl {
    wire: Wire,
    settings: TmclSettings,
    identity: String,
    knowledge: Knowledge,
    mark: i32,
    /// A motion was requested and its end was not seen.
    in_flight: bool,
    /// Too much skew was reported, and no reference was found since.
    skew_reported: bool,
    outputs: Bank<TmclPin>,
}

impl Tmcl {
    /// Opens the port and compares the module's settings with the configured ones. Nothing moves.
    ///
    /// # Errors
    /// A bad setting, a port that cannot be opened, a silent module, or one with other settings.
    pub fn open(settings: TmclSettings) -> Result<Self, DeviceError> {
        settings.check()?;
        let mut wire = Wire::new(Self::link(&settings)?, &settings);
        let version = wire.flush().map_err(|error| wire.first_contact(error))?;
        let version = Version::of(version);
        let identity = format!("TMCM-{} {}", version.module, version.firmware());
        let knowledge = Knowledge::none_of("rotation axis");
        let outputs = Bank::new(&settings.outputs);
        let mut tmcl = Self { wire, settings, identity, knowledge, mark: 0, in_flight: false, skew_reported: false, outputs };
        tmcl.compare_settings()?;
        tracing::info!(identity = tmcl.identity, port = %tmcl.settings.port, "rotation axis opened");
        Ok(tmcl)
    }

    /// Opens the port.
    fn link(settings: &TmclSettings) -> Result<Link, DeviceError> {
        let stop = Stop { pieces: stop_pieces(settings.module_address, settings.motors), gap: settings.exchange_time() };
        Link::serial(DEVICE, &settings.port, settings.baud, stop)
    }

    fn compare_settings(&mut self) -> Result<(), DeviceError> {
        self.end_slowing()?;
        let settings = &self.settings;
        let mut expected = vec![
            (parameter::MICROSTEP_RESOLUTION, "microstep resolution", i64::from(settings.microstep_resolution)),
            (parameter::MAX_SPEED, "maximum speed", settings.max_speed.into()),
            (parameter::MAX_ACCELERATION, "maximum acceleration", settings.max_acceleration.into()),
        ];
        if let Some(divisors) = settings.clock_divisors {
            expected.push((parameter::PULSE_DIVISOR, "pulse divisor", divisors.pulse.into()));
            expected.push((parameter::RAMP_DIVISOR, "ramp divisor", divisors.ramp.into()));
        }
        let mut differences = Vec::new();
        for motor in self.settings.motors {
            for (number, name, expected) in &expected {
                let request = Request::get(*number, motor);
                let mut found = self.wire.ask(request)?;
                if i64::from(found) != *expected {
                    found = self.wire.ask(request)?;
                }
                if i64::from(found) != *expected {
                    let name = format!("motor {motor}, parameter {number} ({name})");
                    differences.push(Difference::new(name, expected.to_string(), found.to_string()));
                }
            }
        }
        if differences.is_empty() { Ok(()) } else { Err(DeviceError::Mismatch { device: DEVICE, differences }) }
    }

    /// Lowers the maximum speed of both motors for a sweep. The module remembers that, so that a program that takes over can end it.
    fn slow(&mut self, speed: u32) -> Result<(), DeviceError> {
        self.wire.ask(Request::set_slowed(true))?;
        self.set_speed(speed)
    }

    /// Sets the configured speed again after a sweep, also after one that another process did not finish.
    fn end_slowing(&mut self) -> Result<(), DeviceError> {
        if self.wire.ask(Request::slowed())? == 0 {
            return Ok(());
        }
        self.set_speed(self.settings.max_speed)?;
        self.wire.ask(Request::set_slowed(false)).map(drop)
    }

    fn set_speed(&mut self, speed: u32) -> Result<(), DeviceError> {
        self.wire.ask_all(self.settings.motors.map(|motor| Request::set(parameter::MAX_SPEED, motor, speed as i32))).map(drop)
    }

    /// The position after a move, or its error.
    fn ended(&mut self, target: Steps, moved: Result<(), DeviceError>) -> Result<Achieved, DeviceError> {
        match moved {
            Ok(()) => Ok(self.knowledge.arrived(target)),
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    /// A move at this speed, in the module's unit. Both motors begin within `Begun`.
    fn sweep(&mut self, from: i64, to: i64, speed: u32, begun: &mut dyn FnMut(Begun)) -> Result<(), DeviceError> {
        self.slow(speed)?;
        let (steps_per_s, acceleration_steps_per_s2) = self.settings.rates_at(speed);
        let pace = Pace { wait: self.settings.travel_time_at(to - from, speed), is_even: true };
        self.travel(from, to, pace, |sent| {
            begun(Begun { sent, taken: Instant::now(), steps_per_s, acceleration_steps_per_s2 });
        })?;
        self.end_slowing()
    }

    fn find_origin(&mut self) -> Result<(), DeviceError> {
        // Until the pair is seen at rest at its origin, one motor may turn: started by an earlier owner, or by a search whose end was
        // misread.
        self.in_flight = true;
        self.wire.flush()?;
        if let Ok(Steps(place)) = self.knowledge.known_steps() {
            self.check_as_left(place)?;
        }
        self.compare_settings()?;
        self.stop_and_rest()?;
        if let Some(speed) = self.settings.stop_on_stall {
            self.wire.ask_all(self.settings.motors.map(|motor| Request::set(parameter::STOP_ON_STALL, motor, speed as i32)))?;
        }
        match self.settings.reference {
            Reference::Home => self.search()?,
            Reference::Here => self.take_here()?,
        }
        self.mark = MARK | (self.knowledge.next_epoch() & 0xffff) as i32;
        self.wire.ask(Request::set_mark(self.mark))?;
        // Every later angle depends on these counters.
        self.confirm(0)?;
        (self.in_flight, self.skew_reported) = (false, false);
        Ok(())
    }

    /// Stops the axis and makes its position suspect.
    fn doubt(&mut self, error: &DeviceError) {
        if self.in_flight {
            self.wire.halt();
            self.in_flight = false;
        }
        self.outputs.forget();
        self.skew_reported |= matches!(error, DeviceError::Skew { .. });
        self.knowledge.doubt(error);
    }
}

impl RotationAxis for Tmcl {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn capabilities(&self) -> Capabilities {
        let has_stall = self.settings.stop_on_stall.is_some();
        Capabilities {
            has_position: true,
            has_encoder: false,
            has_stall,
            can_stop: true,
            absolute: true,
            trigger_only: false,
            outside: false,
        }
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        self.wire.release(cancel)?;
        match self.find_origin() {
            Ok(()) => Ok(self.knowledge.begin_epoch()),
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let from = self.knowledge.known_steps()?;
        let pace = Pace { wait: self.settings.travel_time(target.0 - from.0), is_even: false };
        let moved = self.travel(from.0, target.0, pace, |_sent| ());
        self.ended(target, moved)
    }

    fn even_motion(&self) -> Option<EvenMotion> {
        let (fastest_steps_per_s, acceleration_steps_per_s2) = self.settings.rates();
        Some(EvenMotion { fastest_steps_per_s, acceleration_steps_per_s2 })
    }

    /// A pair that had to be stopped and sent on has not kept its speed, which is an error.
    fn move_evenly(&mut self, target: Steps, steps_per_s: f64, begun: &mut dyn FnMut(Begun)) -> Result<Achieved, DeviceError> {
        let from = self.knowledge.known_steps()?;
        let fastest = Some(self.settings.rates().0);
        let speed = self.settings.speed(steps_per_s).ok_or(DeviceError::Uneven { steps_per_s, fastest })?;
        let moved = self.sweep(from.0, target.0, speed, begun);
        let ended = self.ended(target, moved);
        if ended.is_err() {
            // The pair is stopped. Without an answer the next reference restores the speed.
            self.wire.pass_latch(true);
            if let Err(error) = self.end_slowing() {
                tracing::debug!(%error, "the speed of the sweep stays until the next reference");
            }
            self.wire.pass_latch(false);
        }
        ended
    }

    fn check(&mut self) -> Result<(), DeviceError> {
        self.wire.still_there()?;
        if self.wire.is_stopped() {
            return self.wire.sign_of_life();
        }
        match self.knowledge.known_steps() {
            Ok(Steps(place)) => {
                let found = self.check_as_left(place);
                if let Err(error @ DeviceError::Intervention { .. }) = &found {
                    self.doubt(error);
                }
                found?;
            }
            Err(_) => {
                self.wire.ask(Request::get(parameter::ACTUAL_POSITION, self.settings.motors[0]))?;
            }
        }
        // A module that was reset says nothing, and has switched its outputs off.
        for TmclPin(port) in self.outputs.pins_on() {
            if self.wire.ask(Request::output(port))? != 1 {
                self.outputs.forget();
            }
        }
        Ok(())
    }

    fn outputs(&mut self) -> Option<&mut dyn Outputs> {
        if self.outputs.is_empty() { None } else { Some(self) }
    }

    fn position(&self) -> Position {
        self.knowledge.position()
    }

    fn stop_handle(&self) -> StopHandle {
        let stopper = self.wire.stopper();
        let link = stopper.link();
        StopHandle::new(move || stopper.stop()).with_link(link)
    }
}

impl Outputs for Tmcl {
    fn statuses(&self) -> Vec<OutputStatus> {
        self.outputs.statuses()
    }

    /// `SIO`, and `GIO` for proof. A module that was reset has switched all outputs off; the reference finds that out by the mark.
    fn switch(&mut self, name: &str, on: bool) -> Result<(), DeviceError> {
        let TmclPin(port) = self.outputs.pin(DEVICE, name)?;
        self.wire.pass_latch(true);
        let answers = self.wire.ask_all([Request::set_output(port, on), Request::output(port)]);
        self.wire.pass_latch(false);
        let switched = match answers.map(|answers| answers.values[1]) {
            Ok(found) if found == i32::from(on) => Ok(()),
            Ok(found) => {
                let expected = format!("output {port} to read {}", u8::from(on));
                Err(DeviceError::Unexpected { device: DEVICE, expected, found: found.to_string() })
            }
            Err(error) => Err(error),
        };
        self.outputs.note(DEVICE, name, on, switched)
    }
}

impl Drop for Tmcl {
    fn drop(&mut self) {
        if self.in_flight {
            self.wire.halt();
        }
        for name in self.outputs.left_on() {
            let _switched = self.switch(&name, false);
        }
    }
}

#[cfg(test)]
mod dialogues;
