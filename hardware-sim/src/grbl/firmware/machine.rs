//! The state machine of the motion: what moves, what waits, and what a person holds.
//!
//! ```text
//!               requests                                        ends of moves
//!   Firmware ── push, hold, resume, home, ... ──► Machine ──► MoveEnd ──► Firmware
//!                                                  ├── Mode, Inputs
//!                                                  ├── Planner ──► Stepper ──► the true axes
//!                                                  └── HomingCycle ──► Stepper
//! ```
//! It reads no line and answers nothing.

use super::homing::{HomingAxes, HomingCycle, HomingProgress};
use super::mode::{Inputs, Mode};
use super::planner::{Block, Planner};
use super::stepper::{Brake, MotionEvent, Stepper};
use crate::grbl::Settings;
use crate::serial::Button;

/// How a move has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MoveEnd {
    /// At its target, or at rest in a hold.
    AtRest,
    /// A cancelled jog. The position is not the one that the parser knows.
    JogCancelled,
    /// At rest after a soft limit.
    SoftLimit,
    /// A move of the homing cycle.
    Homing(HomingProgress),
}

pub(super) struct Machine {
    mode: Mode,
    inputs: Inputs,
    planner: Planner,
    stepper: Stepper,
    homing: Option<HomingCycle>,
    /// Whether a homing cycle was completed since the start.
    is_homed: bool,
}

impl Machine {
    /// A machine at rest, with room for `planner_blocks` moves.
    pub fn new(stepper: Stepper, planner_blocks: usize) -> Self {
        Self { mode: Mode::Idle, inputs: Inputs::default(), planner: Planner::new(planner_blocks), stepper, homing: None, is_homed: false }
    }

    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Changes the mode without moving anything.
    pub fn enter(&mut self, mode: Mode) {
        self.mode = mode;
    }

    /// The mode of an unlocked controller at rest.
    pub fn rest_mode(&self) -> Mode {
        if self.inputs.door_open() { Mode::Door } else { Mode::Idle }
    }

    pub fn inputs(&self) -> Inputs {
        self.inputs
    }

    /// Sets a control input. The caller then acts on it.
    pub fn set_input(&mut self, button: Button, pressed: bool) {
        self.inputs.set(button, pressed);
    }

    pub fn stepper(&self) -> &Stepper {
        &self.stepper
    }

    pub fn is_homed(&self) -> bool {
        self.is_homed
    }

    /// The position is not known any more. The count of steps stays.
    pub fn forget_homing(&mut self) {
        self.is_homed = false;
    }

    /// The controller has lost power: the motors stand still, and the count starts at 0.
    pub fn lose_power(&mut self, now_s: f64) {
        self.stepper.stop(now_s);
        self.stepper.forget_position();
        self.is_homed = false;
    }

    // ---- moves

    /// Where the axes stand after all moves, steps.
    pub fn planned_position(&self) -> [i64; 3] {
        self.planner.end(self.stepper.end_position())
    }

    pub fn free_blocks(&self) -> usize {
        self.planner.free(self.stepper.is_moving())
    }

    /// Whether all moves have ended and nothing holds the machine.
    pub fn is_drained(&self) -> bool {
        self.planner.is_empty() && !self.stepper.is_moving() && self.mode == Mode::Idle
    }

    /// Queues a move. Without a free block it does nothing and returns `false`.
    pub fn push(&mut self, block: Block) -> bool {
        let has_room = self.free_blocks() > 0;
        if has_room {
            self.planner.push(block);
        }
        has_room
    }

    pub fn drop_queued(&mut self) {
        self.planner.clear();
    }

    /// Starts the next move, if one may start now.
    pub fn start_next(&mut self, now_s: f64, hard_limits: bool) {
        if self.stepper.is_moving() || !self.mode.starts_moves() {
            return;
        }
        match self.planner.pop() {
            Some(block) => {
                if self.mode == Mode::Idle {
                    self.mode = Mode::Run;
                }
                self.stepper.begin(block, now_s, hard_limits);
            }
            None => self.mode = Mode::Idle,
        }
    }

    /// When the next thing happens without a command, rig seconds.
    pub fn next_event_s(&self) -> Option<f64> {
        self.stepper.next_event_s()
    }

    pub fn release_if_due(&mut self, at_s: f64) {
        self.stepper.release_if_due(at_s);
    }

    pub fn event_due(&self, at_s: f64) -> Option<MotionEvent> {
        self.stepper.event_due(at_s)
    }

    /// Ends the move in progress, complete or after braking. The motors keep their current for `idle_s`, or for ever if it is
    /// `None`. Returns `None` if there is no move.
    pub fn finish_move(&mut self, at_s: f64, idle_s: Option<f64>, settings: &Settings) -> Option<MoveEnd> {
        let finished = self.stepper.finish(at_s, idle_s)?;
        Some(match finished.brake {
            None => match &mut self.homing {
                Some(cycle) if self.mode == Mode::Home => {
                    let progress = cycle.move_done(at_s, settings, &mut self.stepper);
                    MoveEnd::Homing(self.homing_went(progress))
                }
                _ => MoveEnd::AtRest,
            },
            Some(Brake::Hold) => {
                if let Some(rest) = finished.rest {
                    self.planner.push_rest(rest);
                }
                MoveEnd::AtRest
            }
            Some(Brake::CancelJog) => {
                self.planner.clear();
                self.mode = Mode::Idle;
                MoveEnd::JogCancelled
            }
            Some(Brake::SoftLimit) => MoveEnd::SoftLimit,
        })
    }

    /// Begins a homing cycle.
    pub fn home(&mut self, axes: HomingAxes, now_s: f64, settings: &Settings) -> HomingProgress {
        self.mode = Mode::Home;
        self.is_homed = false;
        let cycle = self.homing.insert(HomingCycle::new(axes));
        let progress = cycle.start(now_s, settings, &mut self.stepper);
        self.homing_went(progress)
    }

    fn homing_went(&mut self, progress: HomingProgress) -> HomingProgress {
        match progress {
            HomingProgress::Moving => {}
            HomingProgress::Done => {
                self.mode = Mode::Idle;
                self.is_homed = true;
            }
            HomingProgress::Failed(_) => self.mode = Mode::Alarm,
        }
        progress
    }

    // ---- requests that act at once

    /// Slows down and holds. A jog is cancelled instead, as Grbl does.
    pub fn hold(&mut self, now_s: f64) {
        match self.mode {
            Mode::Jog => self.cancel_jog(now_s),
            Mode::Idle | Mode::Run => {
                self.mode = Mode::Hold;
                self.stepper.brake(Brake::Hold, now_s);
            }
            _ => {}
        }
    }

    /// Ends a hold once the axes are at rest, and the state of the door once it is closed.
    pub fn resume(&mut self) {
        let is_held = self.mode == Mode::Hold || self.mode == Mode::Door && !self.inputs.door_open();
        if is_held && !self.stepper.is_moving() {
            self.mode = Mode::Idle;
        }
    }

    pub fn cancel_jog(&mut self, now_s: f64) {
        if self.mode == Mode::Jog {
            self.stepper.brake(Brake::CancelJog, now_s);
        }
    }

    /// Slows down and holds until the door is closed. Returns `false` if this ends a homing cycle.
    pub fn open_door(&mut self, now_s: f64) -> bool {
        match self.mode {
            Mode::Idle | Mode::Run | Mode::Jog | Mode::Hold => {
                self.mode = Mode::Door;
                self.stepper.brake(Brake::Hold, now_s);
            }
            Mode::Home => {
                self.stepper.stop(now_s);
                self.mode = Mode::Alarm;
                return false;
            }
            _ => {}
        }
        true
    }

    /// Drops the queued moves and slows down. Returns `false` if the axes are at rest.
    pub fn brake_at_soft_limit(&mut self, now_s: f64) -> bool {
        self.planner.clear();
        let brakes = self.stepper.brake(Brake::SoftLimit, now_s);
        if brakes {
            self.mode = Mode::Hold;
        }
        brakes
    }

    /// Stops the axes at once, without slowing down.
    pub fn stop(&mut self, now_s: f64) {
        self.stepper.stop(now_s);
    }
}
