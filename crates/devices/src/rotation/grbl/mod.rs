//! Driver for Grbl 1.1 (and grblHAL, which speaks the same lines).
//!
//! ```text
//! Unknown ──reference──► Referenced(epoch) ──any doubt──► Suspect(epoch + 1) ──reference──► Referenced(epoch + 2)
//!                          │  move_to:  ?  idle at the expected step?
//!                          │            G53 absolute line, await ok     (queued; no ok: ? says whether it was taken)
//!                          │            G4 barrier, await ok            (planner drained; no ok: ? says the same)
//!                          └────────    ?  idle at the target?          (asked again: a disturbed report can parse)
//! ```
//! All positions are whole machine steps: the reported units times steps per unit. Step 0 of the axis is the machine step
//! found by the reference. Moves are absolute and in machine coordinates, their modes on the same line, because a reset
//! restores the controller's modes and work offsets survive in its memory.
//!
//! `ok` means queued, never arrived. Any greeting means a restart: the controller then counts from 0 without an alarm, so
//! the place it was left at is checked before every move and the target after it. A failed move is stopped, makes the
//! position suspect and is never tried again from here.

mod agree;
mod geometry;
mod intervention;
mod linear;
mod report;
mod settings;
mod specimen;
mod talk;

pub use linear::TranslationSettings;
pub use settings::{AxisLetter, Dialect, GrblSettings};

use super::Reference;
use super::knowledge::Knowledge;
use super::link::{Link, Stop};
use crate::cancel::CancelToken;
use crate::{Achieved, Capabilities, DeviceError, Position, RotationAxis, StopHandle};
use agree::ControllerSettings;
use carved_core::units::Steps;
use geometry::Geometry;
use linear::Slide;
use report::{Line, State};
use std::time::Instant;

const DEVICE: &str = "rotation axis (Grbl)";

/// Feed hold, then soft reset: the hold begins to brake at once, the reset ends the cycle and empties the queue.
const STOP: &[u8] = b"!\x18";
const SOFT_RESET: &[u8] = b"\x18";
const STATUS: &[u8] = b"?";
/// grblHAL alone.
const FULL_STATUS: &[u8] = b"\x87";
/// Answered only once every queued motion has ended, and then at once: any longer dwell is rounded up to 50 ms, by Grbl as by grblHAL.
const BARRIER: &str = "G4P0";

/// Machine steps beyond which a reference "here" turns the axis back first: float32 holds 2^24 steps, and a hundredth of
/// a step is to stay resolved.
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
    /// It said at a start that its settings memory was erased, and has not agreed with the configuration since.
    memory_erased: bool,
    /// Homing makes the switch machine position 0, by the firmware's build options.
    zero_at_home: bool,
    /// The axis that moves the capillary along, where this controller has it.
    slide: Option<Slide>,
    /// Its settings when they last agreed with the configuration.
    controller_settings: ControllerSettings,
}

impl Grbl {
    /// Opens the port, resets the controller and compares its settings with the configured ones. Nothing moves.
    ///
    /// A controller that somebody has (feed hold, open door, emergency stop) is opened and left alone: nothing is sent to it that moves
    /// or resets it. [`RotationAxis::check`] reports that, and asks for version and settings once the controller is free.
    ///
    /// # Errors
    /// A bad setting, a port that cannot be opened, a silent controller, one of another kind or with other settings.
    pub fn open(settings: GrblSettings) -> Result<Self, DeviceError> {
        Self::with_translation(settings, None)
    }

    /// The same for a controller that moves the capillary along as well, on another of its axes.
    ///
    /// # Errors
    /// As `open`.
    pub fn with_translation(settings: GrblSettings, translation: Option<TranslationSettings>) -> Result<Self, DeviceError> {
        settings.check()?;
        if let Some(translation) = &translation {
            translation.check()?;
        }
        let link = Link::serial(DEVICE, &settings.port, settings.baud, Stop::of(STOP))?;
        let mut grbl = Self {
            link,
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
        };
        match grbl.identify() {
            // The instrument can start and show this: `check` reports it again.
            Err(error @ DeviceError::Intervention { .. }) => tracing::warn!(%error, "the rotation axis is opened, but somebody has it"),
            identified => identified?,
        }
        tracing::info!(identity = grbl.identity, port = %grbl.settings.port, "rotation axis opened");
        Ok(grbl)
    }

    /// Resets the controller, reads its version and compares its settings; once for each open port. Nothing moves.
    ///
    /// # Errors
    /// While somebody has the controller it is not reset, and this is an [`DeviceError::Intervention`]. It is tried again by the next
    /// check, reference or specimen.
    fn identify(&mut self) -> Result<(), DeviceError> {
        if self.is_identified {
            return Ok(());
        }
        self.wait_until_free()?;
        self.identity = self.wake()?;
        let mut version = Vec::new();
        self.first(|grbl| {
            version.clear();
            grbl.command("$I", grbl.settings.answer_timeout(), |line| {
                if let Line::Message(text) = line {
                    version.push(text);
                }
            })
        })?;
        self.zero_at_home =
            version.iter().any(|v| v.strip_prefix("[OPT:").is_some_and(|o| o.split(',').next().is_some_and(|o| o.contains('Z'))));
        self.identity = format!("{} {}", self.identity, version.join(" "));
        self.is_identified = true;
        self.first(Self::compare_settings)
    }

    fn rotation(&self) -> Geometry {
        Geometry::of(&self.settings)
    }

    /// The axes that are driven through this controller.
    fn axes(&self) -> Vec<Geometry> {
        std::iter::once(self.rotation()).chain(self.slide.as_ref().map(Slide::geometry)).collect()
    }

    /// Moves an axis from one machine step to another and returns once it stands there.
    fn travel(&mut self, axis: &Geometry, from: i64, to: i64, origin: i64) -> Result<(), DeviceError> {
        self.catch_up()?;
        self.confirm(axis, from, origin, Instant::now())?;
        if from == to {
            return Ok(());
        }
        let wait = axis.travel_time(to - from) + self.settings.answer_timeout();
        self.link.set_moving(true);
        self.send_off(axis, from, to)?;
        let until = Instant::now() + wait;
        // Its `ok` only ends the wait; what proves the arrival is the report.
        self.exchange(BARRIER, wait, |_| {})?;
        self.confirm(axis, to, origin, until)?;
        self.link.set_moving(false);
        Ok(())
    }

    /// Brings the axis to rest and no longer believes its position. What somebody else has stopped is left as it is.
    fn doubt(&mut self, error: &DeviceError) {
        if !matches!(error, DeviceError::Intervention { .. }) && self.link.is_moving() {
            self.link.halt();
        }
        self.link.set_moving(false);
        if let Some(slide) = &mut self.slide {
            slide.knowledge.doubt(error);
        }
        self.knowledge.doubt(error);
    }

    /// Finds the axis, with a second try where the first was disturbed and nothing hurt: an answer that did not come, or a late
    /// greeting before anything moved. A reset stands between the two, so that no answer to the first is taken for one to the second.
    fn find_origin(&mut self) -> Result<i64, DeviceError> {
        self.identify()?;
        self.wait_until_free()?;
        self.unwind()?;
        self.wake()?;
        match self.found_origin() {
            Err(error) if self.was_only_disturbed(&error) => {
                tracing::warn!(%error, "the reference is tried once more");
                self.doubt(&error);
                self.wait_until_free()?;
                self.wake()?;
                self.found_origin()
            }
            found => found,
        }
    }

    fn was_only_disturbed(&self, error: &DeviceError) -> bool {
        match error {
            DeviceError::Silent { .. } | DeviceError::Unexpected { .. } => true,
            DeviceError::Suspect { .. } => !self.link.is_moving(),
            _ => false,
        }
    }

    /// An axis that has turned so far that its steps are about to blur is turned back first.
    fn unwind(&mut self) -> Result<(), DeviceError> {
        if let (Reference::Here, Ok(at)) = (self.settings.reference, self.knowledge.known_steps())
            && (self.origin + at.0).abs() > FARTHEST_STEPS
        {
            self.travel(&self.rotation(), self.origin + at.0, 0, self.origin)?;
        }
        Ok(())
    }

    /// The machine step where the axis is found, after a reset.
    fn found_origin(&mut self) -> Result<i64, DeviceError> {
        self.first(Self::compare_settings)?;
        let axis = self.rotation();
        if self.settings.reference == Reference::Home {
            self.home("$H")?;
            self.slide_has_homed()?;
            return self.homed_origin(&axis);
        }
        if self.status()?.state == State::Alarm {
            self.command("$X", self.settings.answer_timeout(), |_| {})?;
        }
        let until = Instant::now() + self.settings.answer_timeout();
        let origin = self.origin(&axis, until)?;
        // Read twice: every later angle hangs on this number.
        self.confirm(&axis, origin, origin, until)?;
        Ok(origin)
    }

    /// The machine step where an axis stands that has just been referenced.
    fn origin(&mut self, axis: &Geometry, until: Instant) -> Result<i64, DeviceError> {
        let lies_between = || DeviceError::Suspect { why: "the controller reports a place between two steps".into() };
        self.standing(axis, until)?.ok_or_else(lies_between)
    }

    /// An `ok` to `$H` alone is no proof: one bit makes it `$X`, which is answered by `ok` as well.
    fn has_homed(&mut self, axis: &Geometry, stands_at: i64) -> Result<(), DeviceError> {
        let unexpected = |expected: String, found| Err(DeviceError::Unexpected { device: DEVICE, expected, found });
        if self.is_hal {
            return match self.full_status()?.homed {
                Some(false) => unexpected("a homed axis after $H".into(), "H:0".into()),
                _ => Ok(()),
            };
        }
        match self.homed_at(axis) {
            // Its pull-off is printed with three decimals.
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

    /// Open loop: the position is what was commanded, and a lost step shows only in the pictures.
    fn capabilities(&self) -> Capabilities {
        Capabilities { has_position: true, has_encoder: false, has_stall: false, can_stop: true, absolute: true, trigger_only: false }
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        self.link.release(cancel)?;
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

    fn check(&mut self) -> Result<(), DeviceError> {
        let result = self.answers().and_then(|()| if self.link.is_stopped() { Ok(()) } else { self.identify() });
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

    fn position(&self) -> Position {
        self.knowledge.position()
    }

    fn stop_handle(&self) -> StopHandle {
        let stopper = self.link.stopper();
        let twin = stopper.clone();
        StopHandle::new(move || stopper.stop()).with_end_of_motion(move || twin.end_motion())
    }
}

impl Drop for Grbl {
    fn drop(&mut self) {
        if self.link.is_moving() {
            self.link.halt();
        }
    }
}

#[cfg(test)]
mod dialogues;
