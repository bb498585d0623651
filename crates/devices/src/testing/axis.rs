//! A fake rotation axis.

use super::FakeInput;
use crate::cancel::CancelToken;
use crate::{Achieved, Begun, Capabilities, DeviceError, EvenMotion, Link, Position, RotationAxis, SpecimenInput, StopHandle};
use carved_core::units::Steps;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

#[derive(Default)]
struct Record {
    targets: Vec<Steps>,
    steps: Steps,
    stops: u32,
    /// A stop that no reference has released yet.
    is_stopped: bool,
    is_closed: bool,
    begun: Option<Begun>,
}

/// What a [`FakeAxis`] has done. It stays readable after the axis was handed over or dropped.
#[derive(Clone, Default)]
pub struct AxisLog(Arc<Mutex<Record>>);

impl AxisLog {
    /// The targets of all executed moves, in order.
    pub fn targets(&self) -> Vec<Steps> {
        self.lock().targets.clone()
    }

    /// Where the axis stands, counted from the reference.
    pub fn steps(&self) -> Steps {
        self.lock().steps
    }

    /// How often the axis was stopped.
    pub fn stops(&self) -> u32 {
        self.lock().stops
    }

    /// The last move at a constant speed.
    pub fn begun(&self) -> Option<Begun> {
        self.lock().begun
    }

    /// Whether the axis was dropped.
    pub fn is_closed(&self) -> bool {
        self.lock().is_closed
    }

    fn lock(&self) -> MutexGuard<'_, Record> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

type Answer = Box<dyn FnMut() -> Result<(), DeviceError> + Send>;
type Arrive = Box<dyn FnMut(Achieved) -> Achieved + Send>;

/// A rotation axis that reaches each target at once. It refuses to move before its first reference and after a stop, as a real axis
/// does.
pub struct FakeAxis {
    log: AxisLog,
    /// Of the last reference; 0 before the first one.
    epoch: u32,
    trigger_only: bool,
    even: Option<EvenMotion>,
    /// By how much later than its speed says it arrives, s.
    late_s: f64,
    input: Option<FakeInput>,
    answer: Answer,
    arrive: Arrive,
    link: Link,
}

impl Default for FakeAxis {
    fn default() -> Self {
        Self::new()
    }
}

impl FakeAxis {
    /// An axis that was never referenced.
    pub fn new() -> Self {
        Self {
            log: AxisLog::default(),
            epoch: 0,
            trigger_only: false,
            even: None,
            late_s: 0.0,
            input: None,
            answer: Box::new(|| Ok(())),
            arrive: Box::new(|achieved| achieved),
            link: Link::new(|| false),
        }
    }

    /// The axis stands at step 0 of epoch 1.
    #[must_use]
    pub fn referenced(mut self) -> Self {
        self.epoch = 1;
        self
    }

    /// The axis reports [`Capabilities::trigger_only`]. It still accepts any target.
    #[must_use]
    pub fn trigger_only(mut self) -> Self {
        self.trigger_only = true;
        self
    }

    /// The axis can turn at a constant speed. Such a move has begun so long ago that it ends at once.
    #[must_use]
    pub fn even(mut self, can: EvenMotion) -> Self {
        self.even = Some(can);
        self
    }

    /// A move at a constant speed ends so much later than its speed says, or earlier if it is negative, s.
    #[must_use]
    pub fn late_by(mut self, late_s: f64) -> Self {
        self.late_s = late_s;
        self
    }

    /// Before each reference, move and check the axis asks `answer`, and fails with its error.
    #[must_use]
    pub fn answering(mut self, answer: impl FnMut() -> Result<(), DeviceError> + Send + 'static) -> Self {
        self.answer = Box::new(answer);
        self
    }

    /// After each move the axis stands at, and reports, what `arrive` makes of the target and the present epoch.
    #[must_use]
    pub fn arriving(mut self, arrive: impl FnMut(Achieved) -> Achieved + Send + 'static) -> Self {
        self.arrive = Box::new(arrive);
        self
    }

    /// Other threads learn from this link whether the axis is lost.
    #[must_use]
    pub fn linked(mut self, link: Link) -> Self {
        self.link = link;
        self
    }

    /// The axis has this specimen input.
    #[must_use]
    pub fn with_input(mut self, input: FakeInput) -> Self {
        self.input = Some(input);
        self
    }

    /// The specimen input, to change its script.
    ///
    /// # Panics
    /// The axis has no input.
    pub fn input(&mut self) -> &mut FakeInput {
        self.input.as_mut().unwrap_or_else(|| panic!("this fake axis has no specimen input"))
    }

    /// What the axis has done, and will do.
    pub fn log(&self) -> AxisLog {
        self.log.clone()
    }
}

impl Drop for FakeAxis {
    fn drop(&mut self) {
        self.log.lock().is_closed = true;
    }
}

impl RotationAxis for FakeAxis {
    fn identity(&self) -> &'static str {
        "fake axis"
    }

    fn capabilities(&self) -> Capabilities {
        let trigger_only = self.trigger_only;
        Capabilities {
            has_position: true,
            has_encoder: false,
            has_stall: false,
            can_stop: true,
            absolute: true,
            trigger_only,
            outside: false,
        }
    }

    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        (self.answer)()?;
        if cancel.is_cancelled() {
            return Err(DeviceError::Stopped);
        }
        self.epoch += 1;
        let mut record = self.log.lock();
        (record.steps, record.is_stopped) = (Steps(0), false);
        Ok(Achieved { steps: Steps(0), epoch: self.epoch })
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        (self.answer)()?;
        let mut record = self.log.lock();
        if record.is_stopped {
            return Err(DeviceError::Stopped);
        }
        if self.epoch == 0 {
            return Err(DeviceError::NotReferenced);
        }
        let achieved = (self.arrive)(Achieved { steps: target, epoch: self.epoch });
        record.targets.push(target);
        record.steps = achieved.steps;
        Ok(achieved)
    }

    fn even_motion(&self) -> Option<EvenMotion> {
        self.even
    }

    fn move_evenly(&mut self, target: Steps, steps_per_s: f64, begun: &mut dyn FnMut(Begun)) -> Result<Achieved, DeviceError> {
        let can = self.even.ok_or(DeviceError::Uneven { steps_per_s, fastest: None })?;
        (self.answer)()?;
        let acceleration_steps_per_s2 = can.acceleration_steps_per_s2;
        let way = (target.0 - self.log.steps().0) as f64;
        let took_s = way / steps_per_s + steps_per_s / acceleration_steps_per_s2;
        let now = std::time::Instant::now();
        let began = now.checked_sub(Duration::from_secs_f64((took_s + self.late_s).max(0.0))).unwrap_or(now);
        let at = Begun { sent: began, taken: began, steps_per_s, acceleration_steps_per_s2 };
        self.log.lock().begun = Some(at);
        begun(at);
        self.move_to(target)
    }

    fn specimen_input(&mut self) -> Option<&mut dyn SpecimenInput> {
        self.input.as_mut().map(|input| input as &mut dyn SpecimenInput)
    }

    fn check(&mut self) -> Result<(), DeviceError> {
        (self.answer)()
    }

    fn position(&self) -> Position {
        match self.epoch {
            0 => Position::Unknown,
            epoch => Position::Referenced { steps: self.log.steps(), epoch },
        }
    }

    fn stop_handle(&self) -> StopHandle {
        let log = self.log();
        StopHandle::new(move || {
            let mut record = log.lock();
            record.stops += 1;
            record.is_stopped = true;
        })
        .with_link(self.link.clone())
    }
}
