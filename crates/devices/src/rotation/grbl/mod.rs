//! Driver for Grbl 1.1 and grblHAL, which uses the same lines.
//!
//! ```text
//! Unknown ──reference──► Referenced(epoch) ──any doubt──► Suspect(epoch + 1) ──reference──► Referenced(epoch + 2)
//!                          │  move_to:  ?  idle at the expected step?
//!                          │            G53 absolute line, await ok     (queued; no ok: ? tells whether it was taken)
//!                          │            G4 barrier, await ok            (planner drained; no ok: ? tells the same)
//!                          └────────    ?  idle at the target?          (read again: a disturbed report can parse)
//! ```
//! All positions are whole machine steps: the reported units times steps per unit. Step 0 of the axis is the machine step that
//! the reference found. Moves are absolute and in machine coordinates. Their modes stand on the same line, because a reset restores
//! the controller's modes, and work offsets survive in its memory.
//!
//! `ok` means queued, not arrived. Any greeting means a restart: the controller then counts from 0 without an alarm. A restart that
//! carved did not request counts as a person's ([`intervention`]), and so does another position at rest than the last one, which is
//! checked before every move and every reference. The target is checked after each move. A failed move is stopped, makes the position suspect and is not tried again by this driver.
//!
//! ```text
//! open ──► free? ─┬─ idle ─────────────────────────────── $I ── $$ ──► identified         nothing moves
//!                 ├─ an alarm, no answer ── soft reset ─┘
//!                 └─ a person holds it ──► open, not identified: nothing but ? is sent
//!                                             └─ check, reference or begin, once it is free ──► identified
//! ```
//! An idle controller that answers `$I` is not reset to be identified or referenced: the reset would release a hold that a person presses then.

mod agree;
mod entry;
mod geometry;
mod intervention;
mod linear;
mod outputs;
pub(super) mod report;
mod settings;
mod specimen;
mod talk;

pub(super) use entry::ENTRY;
pub use linear::TranslationSettings;
pub use settings::{AxisLetter, Dialect, GrblPin, GrblSettings};

use super::Reference;
use super::knowledge::Knowledge;
use super::link::{Link, Stop};
use crate::cancel::CancelToken;
use crate::outputs::{Bank, Outputs};
use crate::{Achieved, Begun, Capabilities, DeviceError, EvenMotion, Position, RotationAxis, StopHandle};
use agree::ControllerSettings;
use carved_core::units::Steps;
use geometry::Geometry;
use linear::Slide;
use report::{State, error_text};
use std::time::Instant;

const DEVICE: &str = "rotation axis (Grbl)";

/// Feed hold, then soft reset: the hold begins to brake at once, the reset ends the cycle and empties the queue.
const STOP: &[u8] = b"!\x18";
const SOFT_RESET: &[u8] = b"\x18";
/// The error of a line to a controller that an alarm locks.
const LOCKED: u16 = 9;
const STATUS: &[u8] = b"?";
/// End the overrides of the feed and of the spindle's speed, which another program may have left in force. They are acted on at once, and not
/// answered.
const FULL_FEED: &[u8] = b"\x90";
const FULL_SPINDLE: &[u8] = b"\x99";
/// grblHAL alone.
const FULL_STATUS: &[u8] = b"\x87";
/// Answered as soon as every queued motion has ended. Grbl and grblHAL round any longer dwell up to 50 ms.
const BARRIER: &str = "G4P0";

/// Machine steps beyond which a reference "here" first turns the axis back. A float32 holds 2^24 whole steps, and a hundredth of a step
/// must be resolved.
const FARTHEST_STEPS: i64 = (1 << 24) / 100;

/// A rotation axis on a Grbl controller.
#[allow(clippy::struct_excessive_bools)] // facts about the controller, not a state
pub struct Grbl {
    link: Link,
    settings: GrblSettings,
    identity: String,
    /// The version was read since the port was opened.
    is_identified: bool,
    knowledge: Knowledge,
    /// The machine step of step 0; machine steps count from the controller's own zero.
    origin: i64,
    /// It is grblHAL, by its greeting.
    is_hal: bool,
    /// It reported an erased settings memory at a start, and its settings were not equal to the configuration since.
    memory_erased: bool,
    /// The firmware was built so that the homing switch is at machine position 0.
    zero_at_home: bool,
    /// The axis that moves the capillary along the picture, if this controller drives it.
    slide: Option<Slide>,
    /// Its settings when they were last equal to the configuration.
    controller_settings: ControllerSettings,
    outputs: Bank<GrblPin>,
    /// What the controller said at a reset that carved did not request, until it is reported.
    unreported_reset: Option<String>,
    /// When carved last reset the controller, or may have: as it opened the port, or woke it.
    own_reset: Instant,
    /// Stops of carved whose greetings were not read yet. They may be read much later than they came. An abort may stop an axis twice.
    owed_greetings: u32,
    /// When carved was last found to have stopped the controller.
    own_stop: Instant,
}

impl Grbl {
    /// Opens the port, reads the controller's version and compares its settings with the configured ones. Nothing moves.
    ///
    /// A controller that a person holds (feed hold, open door, emergency stop) is opened too. Nothing is sent that moves or resets it.
    /// [`RotationAxis::check`] reports the intervention, and reads version and settings once the controller is free.
    ///
    /// # Errors
    /// A bad setting, a port that cannot be opened, a silent controller, one of another kind or with other settings.
    pub fn open(settings: GrblSettings) -> Result<Self, DeviceError> {
        Self::with_translation(settings, None)
    }

    /// As [`Self::open`], for a controller that also moves the capillary along the picture with a second axis.
    ///
    /// # Errors
    /// As `open`.
    pub fn with_translation(settings: GrblSettings, translation: Option<TranslationSettings>) -> Result<Self, DeviceError> {
        settings.check()?;
        if let Some(translation) = &translation {
            translation.check()?;
        }
        let link = Self::link(&settings)?;
        let outputs = Bank::new(&settings.outputs);
        let mut grbl = Self {
            link,
            outputs,
            settings,
            identity: "Grbl controller whose version was not read yet".into(),
            is_identified: false,
            knowledge: Knowledge::none_of("rotation axis"),
            origin: 0,
            is_hal: false,
            memory_erased: false,
            zero_at_home: false,
            slide: translation.map(Slide::new),
            controller_settings: ControllerSettings::new(),
            unreported_reset: None,
            own_reset: Instant::now(),
            owed_greetings: 0,
            own_stop: Instant::now(),
        };
        match grbl.identify() {
            // The daemon can start and show it: `check` reports it again.
            Err(error @ DeviceError::Intervention { .. }) => tracing::warn!(%error, "the rotation axis is opened, but a person holds it"),
            identified => identified?,
        }
        tracing::info!(identity = grbl.identity, port = %grbl.settings.port, "rotation axis opened");
        Ok(grbl)
    }

    /// Opens the port.
    fn link(settings: &GrblSettings) -> Result<Link, DeviceError> {
        Link::serial(DEVICE, &settings.port, settings.baud, Stop::of(STOP))
    }

    /// Reads the controller's version and compares its settings, once after the port was opened. Nothing moves.
    ///
    /// # Errors
    /// [`DeviceError::Intervention`] while a person holds the controller, which keeps the hold. The next check, reference or specimen tries
    /// it again.
    fn identify(&mut self) -> Result<(), DeviceError> {
        if self.is_identified {
            return Ok(());
        }
        let is_idle = self.wait_until_free()?;
        let version = self.make_answers_void(is_idle)?;
        self.zero_at_home =
            version.lines.iter().any(|v| v.strip_prefix("[OPT:").is_some_and(|o| o.split(',').next().is_some_and(|o| o.contains('Z'))));
        self.is_hal = self.settings.dialect.of(&version.name)?;
        self.identity = format!("{} {}", version.name, version.lines.join(" "));
        if is_idle {
            // A program that was killed may have left an output on. A reset since the report, as by the opening of the port, has switched it
            // off and may have locked the controller until it is homed.
            match self.code("M5M9") {
                Err(DeviceError::Unexpected { found, .. }) if found == error_text(LOCKED) => {}
                done => done?,
            }
        }
        self.is_identified = true;
        self.first(Self::compare_settings)
    }

    /// Asks for a report, and identifies the controller if that was not possible before. A motion that continues after a hold is not waited
    /// for, and a stopped controller is not reset: a later check, or the reference, identifies it.
    fn check_at_rest(&mut self) -> Result<(), DeviceError> {
        self.check_no_reset()?;
        let report = self.free_report_at_rest()?;
        let is_moving = report.is_none_or(|status| status.state == State::Run);
        if self.is_identified || is_moving || self.link.is_stopped() { Ok(()) } else { self.identify() }
    }

    fn rotation(&self) -> Geometry {
        Geometry::of(&self.settings)
    }

    /// The rotation with the acceleration that the controller has, which may exceed the configured one.
    fn rotation_as_it_is(&self) -> Geometry {
        let axis = self.rotation();
        let acceleration_units_per_s2 = self.acceleration(&axis).unwrap_or(axis.acceleration_units_per_s2);
        Geometry { acceleration_units_per_s2, ..axis }
    }

    /// The axes that are driven through this controller.
    fn axes(&self) -> Vec<Geometry> {
        std::iter::once(self.rotation()).chain(self.slide.as_ref().map(Slide::geometry)).collect()
    }

    /// Moves an axis from one machine step to another and returns once it has arrived.
    fn travel(&mut self, axis: &Geometry, from: i64, to: i64, origin: i64) -> Result<(), DeviceError> {
        self.travel_begun(axis, from, to, origin, None)
    }

    /// As `travel`. With `begun` the speed has to stay as it is: `begun` is called once the controller has taken the line, and the controller
    /// is then asked again and again whether somebody holds it.
    fn travel_begun(
        &mut self,
        axis: &Geometry,
        from: i64,
        to: i64,
        origin: i64,
        begun: Option<&mut dyn FnMut(Begun)>,
    ) -> Result<(), DeviceError> {
        self.catch_up()?;
        self.confirm_left(axis, from, origin)?;
        if from == to {
            return Ok(());
        }
        let wait = axis.travel_time(to - from) + self.settings.answer_timeout();
        self.link.set_moving(true);
        let sent = Instant::now();
        self.send_off(axis, from, to)?;
        let taken = Instant::now();
        let until = taken + wait;
        if let Some(begun) = begun {
            let acceleration_steps_per_s2 = axis.acceleration_units_per_s2 * axis.steps_per_unit();
            begun(Begun { sent, taken, steps_per_s: axis.steps_per_s(), acceleration_steps_per_s2 });
            self.watch(axis, to, until)?;
        }
        // Its `ok` ends the wait. The report proves the arrival.
        self.exchange(BARRIER, wait, |_| {})?;
        self.confirm(axis, to, origin, until)?;
        self.link.set_moving(false);
        Ok(())
    }

    /// Stops the axis and makes its position suspect. Nothing is sent in an intervention.
    fn doubt(&mut self, error: &DeviceError) {
        if matches!(error, DeviceError::Intervention { .. }) {
            self.unreported_reset = None;
        } else if self.link.is_moving() {
            self.link.halt();
        }
        self.link.set_moving(false);
        self.outputs.forget();
        if let Some(slide) = &mut self.slide {
            slide.knowledge.doubt(error);
        }
        self.knowledge.doubt(error);
    }

    /// Finds the reference position. A second attempt follows if the first was only disturbed: by a missing answer, or by a late greeting
    /// before anything moved. No answer to the first counts for the second.
    fn find_origin(&mut self) -> Result<i64, DeviceError> {
        self.check_no_reset()?;
        self.identify()?;
        let is_idle = self.wait_until_free()?;
        self.unwind()?;
        // From here on a greeting may be that of the driver's own reset.
        self.knowledge.forget();
        self.make_answers_void(is_idle)?;
        match self.found_origin() {
            Err(error) if self.was_only_disturbed(&error) => {
                tracing::warn!(%error, "the reference is tried once more");
                self.doubt(&error);
                let is_idle = self.wait_until_free()?;
                self.make_answers_void(is_idle)?;
                self.found_origin()
            }
            found => found,
        }
    }

    /// Releases a latched stop. The stop has reset the controller, so the position is suspect, and its greeting is no intervention.
    fn release(&mut self, cancel: &CancelToken) -> Result<(), DeviceError> {
        let was_stopped = self.link.is_stopped();
        self.link.release(cancel)?;
        if was_stopped {
            self.doubt(&DeviceError::Stopped);
        }
        Ok(())
    }

    fn was_only_disturbed(&self, error: &DeviceError) -> bool {
        match error {
            DeviceError::Silent { .. } | DeviceError::Unexpected { .. } | DeviceError::Unreadable { .. } => true,
            DeviceError::Suspect { .. } => !self.link.is_moving(),
            _ => false,
        }
    }

    /// Turns the axis back if it has turned so far that a float32 hardly resolves its steps.
    fn unwind(&mut self) -> Result<(), DeviceError> {
        if let (Reference::Here, Ok(at)) = (self.settings.reference, self.knowledge.known_steps())
            && (self.origin + at.0).abs() > FARTHEST_STEPS
        {
            self.travel(&self.rotation(), self.origin + at.0, 0, self.origin)?;
        }
        Ok(())
    }

    /// The machine step of the reference position, after a reset.
    fn found_origin(&mut self) -> Result<i64, DeviceError> {
        self.first(Self::compare_settings)?;
        let axis = self.rotation();
        if self.settings.reference == Reference::Home {
            self.home("$H")?;
            self.confirm_slide_homed()?;
            return self.homed_origin(&axis);
        }
        if self.free_status()?.state == State::Alarm {
            self.command("$X", self.settings.answer_timeout(), |_| {})?;
        }
        let until = Instant::now() + self.settings.answer_timeout();
        let origin = self.origin(&axis, until)?;
        // Read twice, because every later angle depends on it.
        self.confirm(&axis, origin, origin, until)?;
        Ok(origin)
    }

    /// The machine step at which an axis rests after its reference.
    fn origin(&mut self, axis: &Geometry, until: Instant) -> Result<i64, DeviceError> {
        let lies_between = || DeviceError::Suspect { why: "the controller reports a position between two steps".into() };
        self.standing(axis, until)?.ok_or_else(lies_between)
    }

    /// Checks that the axis was homed. An `ok` is no proof: one flipped bit makes `$H` an `$X`, which is also answered with `ok`.
    fn confirm_homed(&mut self, axis: &Geometry, stands_at: i64) -> Result<(), DeviceError> {
        let unexpected = |expected: String, found| Err(DeviceError::Unexpected { device: DEVICE, expected, found });
        if self.is_hal {
            return match self.full_status()?.homed {
                Some(false) => unexpected("a homed axis after $H".into(), "H:0".into()),
                _ => Ok(()),
            };
        }
        match self.homed_at(axis) {
            // The pull-off is printed with three decimals.
            Some(expected) if (stands_at - expected).abs() > 1 => unexpected(
                format!("homing to end at {:.3} units, as its $27 says", axis.units(expected)),
                format!("{:.3}", axis.units(stands_at)),
            ),
            _ => Ok(()),
        }
    }
}

impl RotationAxis for Grbl {
    fn identity(&self) -> &str {
        &self.identity
    }

    /// Open loop: the position is the commanded one, and a lost step shows only in the pictures.
    fn capabilities(&self) -> Capabilities {
        Capabilities {
            has_position: true,
            has_encoder: false,
            has_stall: false,
            can_stop: true,
            absolute: true,
            trigger_only: false,
            outside: false,
        }
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        self.release(cancel)?;
        match self.find_origin() {
            Ok(origin) => {
                self.origin = origin;
                Ok(self.knowledge.begin_epoch())
            }
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let (origin, from) = (self.origin, self.knowledge.known_steps()?);
        match self.travel(&self.rotation(), origin + from.0, origin + target.0, origin) {
            Ok(()) => Ok(self.knowledge.arrived(target)),
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn even_motion(&self) -> Option<EvenMotion> {
        let axis = self.rotation_as_it_is();
        Some(EvenMotion {
            fastest_steps_per_s: axis.steps_per_s(),
            acceleration_steps_per_s2: axis.acceleration_units_per_s2 * axis.steps_per_unit(),
        })
    }

    fn move_evenly(&mut self, target: Steps, steps_per_s: f64, begun: &mut dyn FnMut(Begun)) -> Result<Achieved, DeviceError> {
        let (origin, from) = (self.origin, self.knowledge.known_steps()?);
        let axis = self.rotation_as_it_is();
        let slow = axis.slowed(steps_per_s).ok_or(DeviceError::Uneven { steps_per_s, fastest: Some(axis.steps_per_s()) })?;
        match self.travel_begun(&slow, origin + from.0, origin + target.0, origin, Some(begun)) {
            Ok(()) => Ok(self.knowledge.arrived(target)),
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn check(&mut self) -> Result<(), DeviceError> {
        let result = self.check_at_rest();
        if let Err(error) = &result {
            self.doubt(error);
        }
        result
    }

    fn linear(&mut self) -> Option<&mut dyn crate::LinearAxis> {
        self.slide.is_some().then_some(self as &mut dyn crate::LinearAxis)
    }

    fn specimen_input(&mut self) -> Option<&mut dyn crate::SpecimenInput> {
        Some(self)
    }

    fn outputs(&mut self) -> Option<&mut dyn Outputs> {
        if self.outputs.is_empty() { None } else { Some(self) }
    }

    fn position(&self) -> Position {
        self.knowledge.position()
    }

    fn stop_handle(&self) -> StopHandle {
        let stopper = self.link.stopper();
        let (twin, link) = (stopper.clone(), stopper.link());
        StopHandle::new(move || stopper.stop()).with_end_of_motion(move || twin.end_motion()).with_link(link)
    }
}

impl Drop for Grbl {
    fn drop(&mut self) {
        if self.link.is_moving() {
            self.link.halt();
        }
        for name in self.outputs.left_on() {
            let _switched = self.switch(&name, false);
        }
    }
}

#[cfg(test)]
mod dialogues;
