//! Driver for Zaber controllers with the ASCII protocol.
//!
//! ```text
//! reference:  checksums on ─ settings ─ intervention? ─ stop ─ warnings clear ─ home | here: counter to 0 ─ encoder's offset
//! move_to:    flags? ─ counter and encoder where they were left? ─ move abs ─ state, state, ... IDLE
//!               │                                                    └─ no reply: state, flags, counter ─ not received: move abs
//!               └─ flags? ─ counter at the target? ─ encoder there too? ─► arrived
//! ```
//! Every reply carries the most important warning flag. So a restart, a stall, a limit and an intervention show in the next reply.
//! One flag hides those below it, so all are read if there is one. [`flags`] has their meanings. The encoder measures the angle of
//! the shaft, so that lost steps are detected.
//!
//! **Interventions.** A turned knob, a pushed shaft and a hardware stop are reported once, and nothing that turns the axis is sent
//! until the next reference. A restart counts as one, because carved never restarts the controller. Their flags stay set until the axis moves, so the driver remembers the reported ones. Its own stop sets
//! the same flag (NI) as a person who interrupts a move. After an own stop this flag counts as reported.

mod entry;
mod flags;
pub(super) mod packet;
mod settings;
mod wire;

pub(super) use entry::ENTRY;
pub use settings::{ZaberPin, ZaberSettings};

use super::Reference;
use super::knowledge::Knowledge;
use super::link::{Link, Stop};
use crate::cancel::CancelToken;
use crate::outputs::{Bank, OutputStatus, Outputs};
use crate::{Achieved, Begun, Capabilities, DeviceError, Difference, EvenMotion, Position, RotationAxis, StopHandle};
use carved_core::units::Steps;
use packet::Reply;
use std::time::{Duration, Instant};
use wire::Wire;

const DEVICE: &str = "rotation axis (Zaber)";
/// Pause between two readings of a turning axis.
const LOOK_AGAIN: Duration = Duration::from_millis(1);
/// How often a motion is sent that the controller has not received.
const MOTION_ATTEMPTS: u32 = 3;

/// A rotation axis on a Zaber controller.
pub struct Zaber {
    wire: Wire,
    settings: ZaberSettings,
    identity: String,
    knowledge: Knowledge,
    /// The encoder's reading at counter 0.
    encoder_origin: i64,
    /// A motion was requested and its end was not seen.
    in_flight: bool,
    /// All flags at the last reading.
    flags: Vec<String>,
    /// Flags of an intervention that were reported, or that this program's own stop has set.
    reported: Vec<String>,
    outputs: Bank<ZaberPin>,
    /// The firmware takes a speed with a move.
    states_speed: bool,
}

/// The first firmware that takes a speed with a move.
const STATES_SPEED: (u32, u32) = (7, 25);

/// The first two numbers of a version such as `7.32`; 0 for what cannot be read.
fn version_numbers(version: &str) -> (u32, u32) {
    let mut numbers = version.trim().split('.').map(|number| number.parse().unwrap_or(0));
    (numbers.next().unwrap_or(0), numbers.next().unwrap_or(0))
}

impl Zaber {
    /// Opens the port and compares the controller's settings with the configured ones. Nothing moves. A controller that a person holds is
    /// opened too: its settings can be read, and [`RotationAxis::check`] reports the intervention.
    ///
    /// # Errors
    /// A bad setting, a port that cannot be opened, a silent controller, or one with other settings.
    pub fn open(settings: ZaberSettings) -> Result<Self, DeviceError> {
        settings.check()?;
        let wire = Wire::new(Self::link(&settings)?, &settings);
        let outputs = Bank::new(&settings.outputs);
        let mut zaber = Self {
            outputs,
            wire,
            settings,
            identity: String::new(),
            knowledge: Knowledge::none_of("rotation axis"),
            encoder_origin: 0,
            in_flight: false,
            flags: Vec::new(),
            reported: Vec::new(),
            states_speed: false,
        };
        zaber.compare_settings().map_err(|error| zaber.wire.first_contact(error))?;
        // NI alone comes from the stop of the program that drove the axis before.
        let state = zaber.wire.ask("")?;
        zaber.read_flags(&state)?;
        zaber.reported.extend(zaber.flags.iter().filter(|flag| *flag == flags::INTERRUPTED).cloned());
        let serial = zaber.wire.ask_device("get system.serial")?.data;
        let version = zaber.wire.ask_device("get version")?.data;
        zaber.states_speed = version_numbers(&version) >= STATES_SPEED;
        zaber.identity = format!("Zaber {serial}, firmware {version}");
        tracing::info!(identity = zaber.identity, port = %zaber.settings.port, "rotation axis opened");
        Ok(zaber)
    }

    /// Opens the port.
    fn link(settings: &ZaberSettings) -> Result<Link, DeviceError> {
        let stop = packet::stop(settings.device, settings.axis);
        Link::serial(DEVICE, &settings.port, settings.baud, Stop::of(stop.as_bytes()))
    }

    fn compare_settings(&mut self) -> Result<(), DeviceError> {
        // A restart switches checksums off. The answer to this command may still come without one.
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

    /// Reads all flags if `reply` carries one, which hides those below it.
    fn read_flags(&mut self, reply: &Reply) -> Result<(), DeviceError> {
        let list = if reply.flag == flags::NONE { String::new() } else { self.wire.ask("warnings")?.data };
        self.take_flags(&list);
        Ok(())
    }

    /// Keeps a list of flags as the controller prints it: their number, then each.
    fn take_flags(&mut self, list: &str) {
        self.flags = list.split_whitespace().skip(1).map(str::to_owned).collect();
        self.reported.retain(|flag| self.flags.contains(flag));
    }

    /// The error that the last flags show, without the reported ones.
    fn judge(&self) -> Result<(), DeviceError> {
        let is_new = |flag: &&String| flags::switches_off(flag) || !self.reported.contains(flag);
        let new: Vec<String> = self.flags.iter().filter(is_new).cloned().collect();
        flags::judge(&new, self.settings.reference, self.knowledge.is_known())
    }

    /// Waits until the axis rests or an intervention shows, and reads the flags.
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

    /// Confirms that the axis rests at `position` within `wait`, without a flag, by its counter and by its encoder. Anything else must be
    /// read twice before it is an error.
    fn confirm(&mut self, position: i64, wait: Duration) -> Result<(), DeviceError> {
        if self.rests_at(position, wait)?.is_ok() {
            return Ok(());
        }
        self.rests_at(position, wait)?
    }

    /// One reading of flags, counter and encoder: the inner error if it differs, the outer one if it failed.
    fn rests_at(&mut self, position: i64, wait: Duration) -> Result<Result<(), DeviceError>, DeviceError> {
        self.rest(wait)?;
        let missed = |achieved| Ok(Err(DeviceError::Missed { target: Steps(position), achieved: Steps(achieved) }));
        let counter = self.wire.get("pos")?;
        if let Err(error) = self.judge() {
            let is_stall = matches!(error, DeviceError::Alarm { .. }) && self.flags.iter().any(|flag| flag == flags::STALLED);
            return Ok(Err(if is_stall { self.stalled(counter, position) } else { error }));
        }
        if counter != position {
            return missed(counter);
        }
        let Some(tolerance) = self.settings.encoder_tolerance_steps else { return Ok(Ok(())) };
        let measured = self.wire.get("encoder.pos")? - self.encoder_origin;
        if measured.abs_diff(position) > u64::from(tolerance) { missed(measured) } else { Ok(Ok(())) }
    }

    fn stalled(&self, at: i64, target: i64) -> DeviceError {
        let motor = format!("axis {}", self.settings.axis);
        DeviceError::Stalled { device: DEVICE, motor, at: Steps(at), target: Steps(target), evidence: flags::STALLED.into() }
    }

    fn travel(&mut self, from: i64, to: i64) -> Result<(), DeviceError> {
        self.travel_by(&format!("move abs {to}"), from, to, self.settings.travel_time(to - from), |_sent| ())
    }

    /// Moves by this command. `begun` is called once the controller has taken it, with the time at which it was sent.
    fn travel_by(&mut self, command: &str, from: i64, to: i64, wait: Duration, begun: impl FnOnce(Instant)) -> Result<(), DeviceError> {
        self.confirm(from, Duration::ZERO)?;
        if from == to {
            return Ok(());
        }
        let sent = Instant::now();
        self.set_going(command, Some(from))?;
        begun(sent);
        self.confirm(to, wait)?;
        self.in_flight = false;
        Ok(())
    }

    /// The position after a move, or its error.
    fn ended(&mut self, target: Steps, moved: Result<(), DeviceError>) -> Result<Achieved, DeviceError> {
        match moved {
            Ok(()) => Ok(self.knowledge.arrived(target)),
            Err(error) => {
                let error = match error {
                    DeviceError::Suspect { why } if self.wire.is_bare() => flags::restarted(&why),
                    other => other,
                };
                self.doubt(&error);
                Err(error)
            }
        }
    }

    /// Sends a motion to an axis that rests at `from`; `None` for a motion from an unknown position. The motion clears the flags of an
    /// earlier intervention.
    ///
    /// Without a reply, the controller may have received the motion or not. It is sent again only if it was not received: a motion that is
    /// sent to a moving axis interrupts it, and the controller then reports NI as after an intervention.
    fn set_going(&mut self, command: &str, from: Option<i64>) -> Result<(), DeviceError> {
        self.in_flight = true;
        for _ in 0..MOTION_ATTEMPTS {
            if self.wire.begin(command)? || self.was_received(from)? {
                self.reported.clear();
                return Ok(());
            }
            tracing::info!(command, "no reply, and the axis has not moved: the motion is sent again");
        }
        Err(self.wire.silent(command, MOTION_ATTEMPTS))
    }

    /// Whether the controller has received a motion without a reply: the axis moves, rests elsewhere, or a new flag shows an intervention,
    /// which may have interrupted the motion at once. The wait for its end then reads the flags.
    fn was_received(&mut self, from: Option<i64>) -> Result<bool, DeviceError> {
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

    /// An error for an intervention that was not reported yet. Nothing is sent that could turn the axis. A motor driver that was switched
    /// off, and reported so, is switched on again. The controller refuses that while a stop is pressed.
    fn require_free(&mut self) -> Result<(), DeviceError> {
        let reply = self.wire.ask("")?;
        self.read_flags(&reply)?;
        self.check_not_restarted()?;
        let by_hand: Vec<String> = self.flags.iter().filter(|flag| flags::is_by_hand(flag)).cloned().collect();
        let is_new = |flag: &String| !self.reported.contains(flag) || (reply.moving && flag == flags::KNOB);
        if by_hand.iter().any(is_new) {
            return flags::judge(&by_hand, self.settings.reference, false);
        }
        if by_hand.iter().any(|flag| flags::switches_off(flag)) {
            if !self.wire.is_accepted("driver enable")? {
                return flags::judge(&by_hand, self.settings.reference, false);
            }
            let reply = self.wire.ask("")?;
            self.read_flags(&reply)?;
            self.judge_before_a_reference()?;
        }
        Ok(())
    }

    /// The error of a referenced axis whose flags show that the controller was restarted.
    fn check_not_restarted(&self) -> Result<(), DeviceError> {
        let signs: Vec<String> = self.flags.iter().filter(|flag| flags::is_of_a_restart(flag)).cloned().collect();
        if self.knowledge.is_known() { flags::judge(&signs, self.settings.reference, true) } else { Ok(()) }
    }

    /// The error of flags that are still set after `warnings clear`, without those that a reference clears.
    fn judge_before_a_reference(&self) -> Result<(), DeviceError> {
        let left: Vec<String> = self.flags.iter().filter(|flag| !flags::ends_with_a_reference(flag)).cloned().collect();
        flags::judge(&left, self.settings.reference, false)
    }

    fn find_origin(&mut self) -> Result<(), DeviceError> {
        self.compare_settings()?;
        self.require_free()?;
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
        // Every later angle depends on these readings.
        self.confirm(0, Duration::ZERO)
    }

    /// Stops the axis and makes its position suspect.
    fn doubt(&mut self, error: &DeviceError) {
        if matches!(error, DeviceError::Intervention { .. }) {
            self.mark_reported();
        }
        if self.in_flight {
            self.wire.halt();
            self.in_flight = false;
            self.reported.push(flags::INTERRUPTED.into());
        }
        self.outputs.forget();
        self.knowledge.doubt(error);
    }

    /// Remembers the flags of an intervention as reported.
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
        // The controller detects a stall by its encoder.
        Capabilities {
            has_position: true,
            has_encoder,
            has_stall: has_encoder,
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
        let moved = self.travel(from.0, target.0);
        self.ended(target, moved)
    }

    /// A firmware of 7.25 or later takes a speed with a move.
    fn even_motion(&self) -> Option<EvenMotion> {
        self.states_speed.then(|| self.settings.motion())
    }

    fn move_evenly(&mut self, target: Steps, steps_per_s: f64, begun: &mut dyn FnMut(Begun)) -> Result<Achieved, DeviceError> {
        let can = self.even_motion();
        let fastest = can.map(|can| can.fastest_steps_per_s);
        let speed = can.and_then(|can| Some((can.acceleration_steps_per_s2, self.settings.speed(steps_per_s)?)));
        let (acceleration_steps_per_s2, speed) = speed.ok_or(DeviceError::Uneven { steps_per_s, fastest })?;
        let from = self.knowledge.known_steps()?;
        let wait = self.settings.travel_time_at(target.0 - from.0, speed);
        let moved = self.travel_by(&format!("move abs {} {speed}", target.0), from.0, target.0, wait, |sent| {
            begun(Begun { sent, taken: Instant::now(), steps_per_s: settings::steps_per_s(speed), acceleration_steps_per_s2 });
        });
        self.ended(target, moved)
    }

    fn check(&mut self) -> Result<(), DeviceError> {
        let list = self.wire.probe("warnings")?.data;
        self.take_flags(&list);
        let new: Vec<String> = self.flags.iter().filter(|flag| flags::is_by_hand(flag) && !self.reported.contains(flag)).cloned().collect();
        if !new.is_empty() {
            self.mark_reported();
        }
        self.look_at_outputs();
        let found = self.check_not_restarted().and_then(|()| flags::judge(&new, self.settings.reference, false));
        if let Err(error) = &found
            && self.knowledge.is_known()
        {
            self.doubt(error);
        }
        found
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

impl Outputs for Zaber {
    fn statuses(&self) -> Vec<OutputStatus> {
        self.outputs.statuses()
    }

    fn switch(&mut self, name: &str, on: bool) -> Result<(), DeviceError> {
        let ZaberPin(channel) = self.outputs.pin(DEVICE, name)?;
        self.wire.pass_latch(true);
        let switched = self.set_output(channel, on);
        self.wire.pass_latch(false);
        self.outputs.note(DEVICE, name, on, switched)
    }
}

impl Zaber {
    /// A restart has switched the outputs off. Its flag may be set for another reason too, so they are read.
    fn look_at_outputs(&mut self) {
        self.wire.pass_latch(true);
        for ZaberPin(channel) in self.outputs.pins_on() {
            let is_on = self.wire.ask_device(&format!("io get do {channel}")).is_ok_and(|reply| reply.data == "1");
            if !is_on {
                self.outputs.forget();
            }
        }
        self.wire.pass_latch(false);
    }

    fn set_output(&mut self, channel: u8, on: bool) -> Result<(), DeviceError> {
        // A restart switches checksums off, and all outputs.
        self.wire.ask_device("set comm.checksum 1")?;
        let level = if on { "1" } else { "0" };
        self.wire.ask_device(&format!("io set do {channel} {level}"))?;
        let found = self.wire.ask_device(&format!("io get do {channel}"))?.data;
        if found == level {
            return Ok(());
        }
        let expected = format!("output {channel} to read {level}");
        Err(DeviceError::Unexpected { device: DEVICE, expected, found })
    }
}

impl Drop for Zaber {
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
