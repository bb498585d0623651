//! Driver for Zaber controllers by their ASCII protocol.
//!
//! ```text
//! reference:  checksums on ─ settings ─ stop ─ warnings clear ─ home | here: counter to 0 ─ encoder's offset
//! move_to:    flags? ─ counter and encoder where they were left? ─ move abs ─ state, state, ... IDLE
//!               └─ flags? ─ counter at the target? ─ encoder there too? ─► arrived
//! ```
//! Every reply carries a flag, so that a restart (no reference), a stall, a limit and a hand at the axis show in whatever is
//! asked next; [`flags`] has what each means. The encoder tells where the shaft stands: steps that were lost are a miss.

mod flags;
mod packet;
mod settings;
mod wire;

pub use settings::ZaberSettings;

use super::Reference;
use super::knowledge::Knowledge;
use super::link::{Link, Stop};
use crate::cancel::CancelToken;
use crate::device::{Achieved, Capabilities, DeviceError, Difference, Position, RotationAxis, StopHandle};
use crate::units::Steps;
use std::time::{Duration, Instant};
use wire::Wire;

const DEVICE: &str = "rotation axis (Zaber)";
/// Pause between two looks at an axis that turns.
const LOOK_AGAIN: Duration = Duration::from_millis(1);

/// A rotation axis on a Zaber controller.
pub struct Zaber {
    wire: Wire,
    settings: ZaberSettings,
    identity: String,
    knowledge: Knowledge,
    /// What the encoder said where the counter was 0.
    encoder_origin: i64,
    /// A motion has been asked for and its end has not been seen.
    in_flight: bool,
}

impl Zaber {
    /// Opens the port and holds the controller's settings against the configured ones. Nothing moves.
    ///
    /// # Errors
    /// A bad setting, a port that cannot be opened, a silent controller, or one with other settings.
    pub fn open(settings: ZaberSettings) -> Result<Self, DeviceError> {
        settings.check()?;
        let stop = packet::stop(settings.device, settings.axis);
        let link = Link::serial(DEVICE, &settings.port, settings.baud, Stop::of(stop.as_bytes()))?;
        let wire = Wire::new(link, &settings);
        let mut zaber = Self {
            wire,
            settings,
            identity: String::new(),
            knowledge: Knowledge::none_of("rotation axis"),
            encoder_origin: 0,
            in_flight: false,
        };
        zaber.compare_settings()?;
        let serial = zaber.wire.ask_device("get system.serial")?.data;
        let version = zaber.wire.ask_device("get version")?.data;
        zaber.identity = format!("Zaber {serial}, firmware {version}");
        tracing::info!(identity = zaber.identity, port = %zaber.settings.port, "rotation axis opened");
        Ok(zaber)
    }

    fn compare_settings(&mut self) -> Result<(), DeviceError> {
        // A controller that restarted has forgotten it; its answer may come without.
        self.wire.ask_device("set comm.checksum 1")?;
        let expected = [("resolution", self.settings.resolution), ("maxspeed", self.settings.maxspeed), ("accel", self.settings.accel)];
        let mut differences = Vec::new();
        for (name, expected) in expected {
            let mut found = self.wire.get(name)?;
            if found != i64::from(expected) {
                found = self.wire.get(name)?;
            }
            if found != i64::from(expected) {
                differences.push(Difference::new(name, expected.to_string(), found.to_string()));
            }
        }
        if self.settings.encoder_tolerance_steps.is_some() {
            self.wire.get("encoder.pos")?;
        }
        if differences.is_empty() { Ok(()) } else { Err(DeviceError::Mismatch { device: DEVICE, differences }) }
    }

    /// Waits until the axis stands; the flag that it then carries.
    fn rest(&mut self, wait: Duration) -> Result<String, DeviceError> {
        let until = Instant::now() + wait;
        loop {
            let reply = self.wire.ask("")?;
            if !reply.moving {
                return Ok(reply.flag);
            }
            if Instant::now() > until {
                let (expected, found) = (format!("the axis to stand within {} ms", wait.as_millis()), "BUSY".into());
                return Err(DeviceError::Unexpected { device: DEVICE, expected, found });
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    /// Sure that the axis stands at `place` within `wait`, unflagged, by its counter and by its encoder? What says otherwise
    /// is asked for once more before it is believed.
    fn confirm(&mut self, place: i64, wait: Duration) -> Result<(), DeviceError> {
        if self.stands_at(place, wait)?.is_ok() {
            return Ok(());
        }
        self.stands_at(place, wait)?
    }

    fn stands_at(&mut self, place: i64, wait: Duration) -> Result<Result<(), DeviceError>, DeviceError> {
        let flag = self.rest(wait)?;
        let missed = |achieved| Ok(Err(DeviceError::Missed { target: Steps(place), achieved: Steps(achieved) }));
        let counter = self.wire.get("pos")?;
        if let Err(error) = flags::judge(&flag, self.settings.reference) {
            return Ok(Err(if flag == flags::STALLED { self.stalled(counter, place) } else { error }));
        }
        if counter != place {
            return missed(counter);
        }
        let Some(tolerance) = self.settings.encoder_tolerance_steps else { return Ok(Ok(())) };
        let measured = self.wire.get("encoder.pos")? - self.encoder_origin;
        if measured.abs_diff(place) > u64::from(tolerance) { missed(measured) } else { Ok(Ok(())) }
    }

    fn stalled(&self, at: i64, target: i64) -> DeviceError {
        let motor = format!("axis {}", self.settings.axis);
        DeviceError::Stalled { device: DEVICE, motor, at: Steps(at), target: Steps(target), evidence: flags::STALLED.into() }
    }

    fn travel(&mut self, from: i64, to: i64) -> Result<(), DeviceError> {
        self.confirm(from, Duration::ZERO)?;
        if from == to {
            return Ok(());
        }
        self.in_flight = true;
        self.wire.ask(&format!("move abs {to}"))?;
        self.confirm(to, self.settings.travel_time(to - from))?;
        self.in_flight = false;
        Ok(())
    }

    fn find_origin(&mut self) -> Result<(), DeviceError> {
        self.compare_settings()?;
        self.wire.ask("stop")?;
        self.rest(self.settings.travel_time(0))?;
        self.wire.ask("warnings clear")?;
        match self.settings.reference {
            Reference::Home => {
                self.in_flight = true;
                self.wire.ask("home")?;
                self.rest(self.settings.homing_timeout())?;
                self.in_flight = false;
            }
            Reference::Here => {
                self.wire.ask("set pos 0")?;
            }
        }
        if self.settings.encoder_tolerance_steps.is_some() {
            self.encoder_origin = self.wire.get("encoder.pos")?;
        }
        // Every later angle hangs on these.
        self.confirm(0, Duration::ZERO)
    }

    /// Brings the axis to rest and no longer believes its position.
    fn doubt(&mut self, error: &DeviceError) {
        if self.in_flight {
            self.wire.halt();
            self.in_flight = false;
        }
        self.knowledge.doubt(error);
    }
}

impl RotationAxis for Zaber {
    fn identity(&self) -> &str {
        &self.identity
    }

    fn capabilities(&self) -> Capabilities {
        let has_encoder = self.settings.encoder_tolerance_steps.is_some();
        // A stall is told by the encoder.
        Capabilities { has_position: true, has_encoder, has_stall: has_encoder, can_stop: true, absolute: true, trigger_only: false }
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
        let from = self.knowledge.whence()?;
        match self.travel(from.0, target.0) {
            Ok(()) => Ok(self.knowledge.arrived(target)),
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn position(&self) -> Position {
        self.knowledge.position()
    }

    fn stop_handle(&self) -> StopHandle {
        let stopper = self.wire.stopper();
        StopHandle::new(move || stopper.stop())
    }
}

impl Drop for Zaber {
    fn drop(&mut self) {
        if self.in_flight {
            self.wire.halt();
        }
    }
}

#[cfg(test)]
mod dialogues;
