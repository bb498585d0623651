//! Executes one move at a time on the true axes, and counts the steps that it issues.
//!
//! ```text
//!   Block ──► begin ──► Running ──┬── end ───────────────► finish ──► position
//!                          │      └── hard limit, reset ─► stop ────► position
//!                          └── brake: slows down, then ends earlier
//! ```
//! Axis X turns the [`Shaft`]. Axis Y moves the [`Slide`], if there is one. Axis Z drives nothing and only counts.

use super::planner::Block;
use crate::motion::MotionProfile;
use crate::shaft::Shaft;
use crate::slide::Slide;
use std::sync::Arc;

/// Number of the axis that turns the shaft.
pub(super) const SHAFT: usize = 0;
/// Number of the axis that moves the slide.
pub(super) const SLIDE: usize = 1;

/// Why a move slows down before its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Brake {
    Hold,
    CancelJog,
    SoftLimit,
}

/// What a move does next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MotionEvent {
    HardLimit,
    End,
}

/// A move that has ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Finished {
    /// Why it has ended early, if it has.
    pub brake: Option<Brake>,
    /// The part that was not executed.
    pub rest: Option<Block>,
}

#[derive(Debug)]
struct Running {
    block: Block,
    start_s: f64,
    profile: Arc<MotionProfile>,
    /// When the move trips a limit switch.
    limit_s: Option<f64>,
    brake: Option<Brake>,
}

impl Running {
    fn end_s(&self) -> f64 {
        self.start_s + self.profile.duration_s()
    }

    /// The executed part of the path, 0 to 1.
    fn part(&self, now_s: f64) -> f64 {
        self.profile.travelled(now_s - self.start_s) / self.block.length
    }

    fn steps(&self, now_s: f64) -> [i64; 3] {
        let part = self.part(now_s);
        self.block.steps.map(|s| (s as f64 * part).round() as i64)
    }
}

pub(super) struct Stepper {
    shaft: Arc<Shaft>,
    slide: Option<Arc<Slide>>,
    /// Steps counted until the last move ended.
    position: [i64; 3],
    running: Option<Running>,
    /// When the motors lose their current, unless they move before.
    release_s: Option<f64>,
}

impl Stepper {
    pub fn new(shaft: Arc<Shaft>, slide: Option<Arc<Slide>>) -> Self {
        Self { shaft, slide, position: [0; 3], running: None, release_s: None }
    }

    pub fn has_slide(&self) -> bool {
        self.slide.is_some()
    }

    pub fn is_moving(&self) -> bool {
        self.running.is_some()
    }

    /// Steps counted until the last move ended.
    pub fn position(&self) -> [i64; 3] {
        self.position
    }

    pub fn set_position(&mut self, axis: usize, steps: i64) {
        self.position[axis] = steps;
    }

    /// The controller has lost power. The count starts at 0 again.
    pub fn forget_position(&mut self) {
        self.position = [0; 3];
    }

    /// Steps counted at `now_s`, with those of the move in progress.
    pub fn position_at(&self, now_s: f64) -> [i64; 3] {
        let issued = self.running.as_ref().map_or([0; 3], |r| r.steps(now_s));
        std::array::from_fn(|i| self.position[i] + issued[i])
    }

    /// Where the move in progress ends if it is executed completely, steps.
    pub fn end_position(&self) -> [i64; 3] {
        let steps = self.running.as_ref().map_or([0; 3], |r| r.block.steps);
        std::array::from_fn(|i| self.position[i] + steps[i])
    }

    /// Speed along the path, units/s.
    pub fn speed(&self, now_s: f64) -> f64 {
        self.running.as_ref().map_or(0.0, |r| r.profile.speed(now_s - r.start_s))
    }

    /// Whether the shaft presses its reference switch.
    pub fn at_index(&self, now_s: f64) -> bool {
        self.shaft.at_index(now_s)
    }

    /// Whether an axis presses the homing switch that lies in `direction`.
    pub fn at_switch(&self, axis: usize, direction: i64, now_s: f64) -> bool {
        match (&self.slide, axis) {
            (Some(slide), SLIDE) => slide.steps_to_end(direction) == 0,
            _ => self.shaft.at_index(now_s),
        }
    }

    /// Steps from a standing axis to its homing switch in `direction`.
    pub fn steps_to_switch(&self, axis: usize, direction: i64) -> i64 {
        match (&self.slide, axis) {
            (Some(slide), SLIDE) => slide.steps_to_end(direction),
            _ => self.shaft.steps_to_index(direction),
        }
    }

    /// The firmware has found the reference switch of the shaft. The true angle counts from here.
    pub fn count_from_here(&self) {
        self.shaft.count_from_here();
    }

    /// When the next thing happens without a command, rig seconds.
    pub fn next_event_s(&self) -> Option<f64> {
        let motion = self.running.as_ref().map(|r| r.limit_s.unwrap_or_else(|| r.end_s()));
        [motion, self.release_s].into_iter().flatten().reduce(f64::min)
    }

    /// Takes the current from the motors if it is time.
    pub fn release_if_due(&mut self, at_s: f64) {
        if self.release_s.is_some_and(|release_s| release_s <= at_s) {
            self.release_s = None;
            self.shaft.release();
        }
    }

    /// What the move in progress has reached by `at_s`, if anything.
    pub fn event_due(&self, at_s: f64) -> Option<MotionEvent> {
        let running = self.running.as_ref()?;
        if running.limit_s.is_some_and(|limit_s| limit_s <= at_s) {
            return Some(MotionEvent::HardLimit);
        }
        (running.end_s() <= at_s).then_some(MotionEvent::End)
    }

    /// Begins a move at `start_s`. With `hard_limits` it trips the limit switches on its way.
    pub fn begin(&mut self, block: Block, start_s: f64, hard_limits: bool) {
        self.release_s = None;
        let profile = Arc::new(MotionProfile::trapezoid(block.length, block.speed, block.acceleration));
        let limit_s = hard_limits.then(|| self.limit_hit_s(&block, &profile, start_s)).flatten();
        if block.steps[SHAFT] != 0 {
            self.shaft.begin(start_s, block.steps[SHAFT], block.length, Arc::clone(&profile));
        }
        if let (Some(slide), true) = (&self.slide, block.steps[SLIDE] != 0) {
            slide.begin(start_s, block.steps[SLIDE], block.length, Arc::clone(&profile));
        }
        self.running = Some(Running { block, start_s, profile, limit_s, brake: None });
    }

    /// Slows the move in progress down. Returns `false` if there is none.
    pub fn brake(&mut self, why: Brake, now_s: f64) -> bool {
        let Some(running) = &mut self.running else { return false };
        if running.brake.is_none() {
            let elapsed_s = now_s - running.start_s;
            let (from, speed) = (running.profile.travelled(elapsed_s), running.profile.speed(elapsed_s));
            let profile = Arc::new(MotionProfile::braking(from, speed, running.block.acceleration, running.block.length));
            if running.block.steps[SHAFT] != 0 {
                self.shaft.replan(now_s, Arc::clone(&profile));
            }
            if let (Some(slide), true) = (&self.slide, running.block.steps[SLIDE] != 0) {
                slide.replan(now_s, Arc::clone(&profile));
            }
            running.start_s = now_s;
            running.profile = profile;
        }
        running.brake = Some(why);
        true
    }

    /// Ends the move in progress, complete or after braking. The motors keep their current for `idle_s`, or for ever if it is
    /// `None`. Returns `None` if there is no move.
    pub fn finish(&mut self, at_s: f64, idle_s: Option<f64>) -> Option<Finished> {
        let running = self.running.take()?;
        let done = self.count(&running, at_s);
        self.release_s = idle_s.map(|idle_s| at_s + idle_s);
        let steps: [i64; 3] = std::array::from_fn(|i| running.block.steps[i] - done[i]);
        let length = running.block.length * (1.0 - running.part(at_s)).max(f64::EPSILON);
        let rest = (steps != [0; 3]).then_some(Block { steps, length, ..running.block });
        Some(Finished { brake: running.brake, rest })
    }

    /// Ends the move in progress at once, without slowing down.
    pub fn stop(&mut self, now_s: f64) {
        if let Some(running) = self.running.take() {
            self.count(&running, now_s);
        }
    }

    /// Ends the move of the true axes and adds the issued steps to the position. Returns these steps.
    fn count(&mut self, running: &Running, at_s: f64) -> [i64; 3] {
        let mut done = running.steps(at_s);
        if running.block.steps[SHAFT] != 0 {
            done[SHAFT] = self.shaft.end(at_s);
        }
        if let (Some(slide), true) = (&self.slide, running.block.steps[SLIDE] != 0) {
            done[SLIDE] = slide.end(at_s);
        }
        for (p, d) in self.position.iter_mut().zip(done) {
            *p += d;
        }
        done
    }

    fn limit_hit_s(&self, block: &Block, profile: &MotionProfile, start_s: f64) -> Option<f64> {
        let hit = |steps: i64, to_switch: i64| {
            (steps != 0 && to_switch <= steps.abs())
                .then(|| start_s + profile.time_at_s(block.length * to_switch as f64 / steps.unsigned_abs() as f64))
        };
        let [turn, along, _] = block.steps;
        let index = hit(turn, self.shaft.steps_to_next_index(turn.signum()));
        let end = self.slide.as_ref().and_then(|slide| hit(along, slide.steps_to_end(along.signum())));
        index.into_iter().chain(end).reduce(f64::min)
    }
}
