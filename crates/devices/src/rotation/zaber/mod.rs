//! Driver for Zaber controllers by their ASCII protocol.
//!
//! ```text
//! reference:  checksums on ─ settings ─ a person at the axis? ─ stop ─ warnings clear ─ home | here: counter to 0 ─ encoder's offset
//! move_to:    flags? ─ counter and encoder where they were left? ─ move abs ─ state, state, ... IDLE
//!               │                                                    └─ no reply: state, flags, counter ─ not heard: move abs
//!               └─ flags? ─ counter at the target? ─ encoder there too? ─► arrived
//! ```
//! Every reply carries the most important flag, so that a restart (no reference), a stall, a limit and a hand at the axis show in
//! whatever is asked next; one flag hides those below it, so all are asked for where there is one. [`flags`] has what each
//! means. The encoder tells where the shaft stands: steps that were lost are a miss.
//!
//! **By hand.** A knob that was turned, a shaft that was pushed and a hardware stop are told as an intervention, once, and nothing
//! that turns the axis is sent until the next reference. Their flags stay set until the axis moves, so the driver remembers
//! which it has told. A stop of its own leaves the same flag as a hand in the middle of a move; that one counts as told.

mod flags;
mod packet;
mod settings;
mod wire;

pub use settings::ZaberSettings;

use super::Reference;
use super::knowledge::Knowledge;
use super::link::{Link, Stop};
use crate::cancel::CancelToken;
use crate::{Achieved, Capabilities, DeviceError, Difference, Position, RotationAxis, StopHandle};
use carved_core::units::Steps;
use packet::Reply;
use std::time::{Duration, Instant};
use wire::Wire;

const DEVICE: &str = "rotation axis (Zaber)";
/// Pause between two looks at an axis that turns.
const LOOK_AGAIN: Duration = Duration::from_millis(1);
/// How often a motion is sent that the axis has not heard.
const MOTION_ATTEMPTS: u32 = 3;

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
    /// All flags, as they were read last.
    flags: Vec<String>,
    /// Flags of a person's doing that were told, or are this program's own.
    reported: Vec<String>,
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
            flags: Vec::new(),
            reported: Vec::new(),
        };
        zaber.compare_settings()?;
        // A stop of who drove the axis before.
        let state = zaber.wire.ask("")?;
        zaber.read_flags(&state)?;
        zaber.reported.extend(zaber.flags.iter().filter(|flag| *flag == flags::INTERRUPTED).cloned());
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

    /// All flags, where a reply says that there are any: it carries one, which hides those below it.
    fn read_flags(&mut self, reply: &Reply) -> Result<(), DeviceError> {
        let list = if reply.flag == flags::NONE { String::new() } else { self.wire.ask("warnings")?.data };
        self.take_flags(&list);
        Ok(())
    }

    /// Takes a list of flags: their number, then each.
    fn take_flags(&mut self, list: &str) {
        self.flags = list.split_whitespace().skip(1).map(str::to_owned).collect();
        self.reported.retain(|flag| self.flags.contains(flag));
    }

    /// What the flags that were read last say, but for those that were told.
    fn judge(&self) -> Result<(), DeviceError> {
        let is_new = |flag: &&String| flags::switches_off(flag) || !self.reported.contains(flag);
        let new: Vec<String> = self.flags.iter().filter(is_new).cloned().collect();
        flags::judge(&new, self.settings.reference)
    }

    /// Waits until the axis stands, or somebody else is seen to have it, and reads the flags that are then set.
    fn rest(&mut self, wait: Duration) -> Result<(), DeviceError> {
        let until = Instant::now() + wait;
        loop {
            let reply = self.wire.ask("")?;
            let is_taken = flags::is_by_hand(&reply.flag) && !self.reported.contains(&reply.flag);
            if !reply.moving || is_taken {
                return self.read_flags(&reply);
            }
            if Instant::now() > until {
                self.read_flags(&reply)?;
                if self.flags.iter().any(|flag| flags::is_by_hand(flag)) {
                    self.judge()?;
                }
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
        self.rest(wait)?;
        let missed = |achieved| Ok(Err(DeviceError::Missed { target: Steps(place), achieved: Steps(achieved) }));
        let counter = self.wire.get("pos")?;
        if let Err(error) = self.judge() {
            let is_stall = matches!(error, DeviceError::Alarm { .. }) && self.flags.iter().any(|flag| flag == flags::STALLED);
            return Ok(Err(if is_stall { self.stalled(counter, place) } else { error }));
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
        self.set_going(&format!("move abs {to}"), Some(from))?;
        self.confirm(to, self.settings.travel_time(to - from))?;
        self.in_flight = false;
        Ok(())
    }

    /// Sends a motion to an axis that stands at `from`, where that is known. A motion ends what the flags say of a person.
    ///
    /// Where no reply comes the motion may have been heard. It is sent again only if it was not: a motion that is sent to an axis in
    /// motion interrupts it, and the controller then reports NI as if a person had done it.
    fn set_going(&mut self, words: &str, from: Option<i64>) -> Result<(), DeviceError> {
        self.in_flight = true;
        for _ in 0..MOTION_ATTEMPTS {
            if self.wire.begin(words)? || self.was_heard(from)? {
                self.reported.clear();
                return Ok(());
            }
            tracing::info!(words, "no reply, and the axis stands where it stood: the motion is sent again");
        }
        Err(self.wire.silent(words, MOTION_ATTEMPTS))
    }

    /// Whether a motion without a reply was heard: the axis moves, stands elsewhere, or a person has it now. In the last case the
    /// motion may have been heard and interrupted at once; who waits for its end reads the flags.
    fn was_heard(&mut self, from: Option<i64>) -> Result<bool, DeviceError> {
        let state = self.wire.ask("")?;
        if state.moving {
            return Ok(true);
        }
        self.read_flags(&state)?;
        if self.flags.iter().any(|flag| flags::is_by_hand(flag) && !self.reported.contains(flag)) {
            return Ok(true);
        }
        match from {
            Some(from) => Ok(self.wire.get("pos")? != from),
            None => Ok(false),
        }
    }

    /// Refuses an axis that a person or a safety circuit has and nobody was told of. Nothing is sent that could turn it. A driver
    /// that was switched off, and was told so, is switched on again; a stop that is still pressed refuses that.
    fn is_free(&mut self) -> Result<(), DeviceError> {
        let reply = self.wire.ask("")?;
        self.read_flags(&reply)?;
        let by_hand: Vec<String> = self.flags.iter().filter(|flag| flags::is_by_hand(flag)).cloned().collect();
        let is_new = |flag: &String| !self.reported.contains(flag) || (reply.moving && flag == flags::KNOB);
        if by_hand.iter().any(is_new) {
            return flags::judge(&by_hand, self.settings.reference);
        }
        if by_hand.iter().any(|flag| flags::switches_off(flag)) {
            if !self.wire.is_accepted("driver enable")? {
                return flags::judge(&by_hand, self.settings.reference);
            }
            let reply = self.wire.ask("")?;
            self.read_flags(&reply)?;
            self.judge_before_a_reference()?;
        }
        Ok(())
    }

    /// What is set although it was cleared is not of the past, but for what the reference itself puts right.
    fn judge_before_a_reference(&self) -> Result<(), DeviceError> {
        let left: Vec<String> = self.flags.iter().filter(|flag| !flags::ends_with_a_reference(flag)).cloned().collect();
        flags::judge(&left, self.settings.reference)
    }

    fn find_origin(&mut self) -> Result<(), DeviceError> {
        self.compare_settings()?;
        self.is_free()?;
        self.wire.ask("stop")?;
        self.rest(self.settings.travel_time(0))?;
        self.wire.ask("warnings clear")?;
        let reply = self.wire.ask("")?;
        self.read_flags(&reply)?;
        self.judge_before_a_reference()?;
        match self.settings.reference {
            Reference::Home => {
                self.set_going("home", None)?;
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
        if matches!(error, DeviceError::Intervention { .. }) {
            self.mark_reported();
        }
        if self.in_flight {
            self.wire.halt();
            self.in_flight = false;
            self.reported.push(flags::INTERRUPTED.into());
        }
        self.knowledge.doubt(error);
    }

    /// Somebody is told of what a person did.
    fn mark_reported(&mut self) {
        self.reported = self.flags.iter().filter(|flag| flags::is_by_hand(flag)).cloned().collect();
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
        let from = self.knowledge.known_steps()?;
        match self.travel(from.0, target.0) {
            Ok(()) => Ok(self.knowledge.arrived(target)),
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn check(&mut self) -> Result<(), DeviceError> {
        let list = self.wire.probe("warnings")?.data;
        self.take_flags(&list);
        let new: Vec<String> = self.flags.iter().filter(|flag| flags::is_by_hand(flag) && !self.reported.contains(flag)).cloned().collect();
        if !new.is_empty() {
            self.mark_reported();
        }
        flags::judge(&new, self.settings.reference)
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
