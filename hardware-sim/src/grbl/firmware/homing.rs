//! The homing cycle of `$H`: it finds the switch of each axis and sets the position there.
//!
//! ```text
//!   Search ──────────► PullOff ──► Locate ──────────► Leave ──► position known ──► the next axis, or Done
//!   fast, to the       back        slowly, to the     back
//!   switch                         switch
//!
//!   no switch in reach: Failed(9)          still at the switch after PullOff: Failed(8)
//! ```

use super::planner::{Block, SLOWEST};
use super::stepper::{SHAFT, SLIDE, Stepper};
use crate::grbl::Settings;

/// How far the first search may go, as a multiple of the travel.
const SEARCH_RANGE: f64 = 1.5;
/// How far the second search may go, as a multiple of the pull-off.
const LOCATE_RANGE: f64 = 5.0;

/// What `$H`, `$HX` or `$HY` homes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HomingAxes {
    All,
    Shaft,
    Slide,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    Search,
    PullOff,
    Locate,
    Leave,
}

/// How a cycle goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum HomingProgress {
    /// The stepper executes the next move.
    Moving,
    /// All axes have their position.
    Done,
    /// The cycle has ended with the alarm of this number.
    Failed(u8),
}

#[derive(Debug)]
pub(super) struct HomingCycle {
    phase: Phase,
    /// The axis that is homed now.
    axis: usize,
    /// Whether the slide follows the shaft.
    all: bool,
}

impl HomingCycle {
    pub fn new(axes: HomingAxes) -> Self {
        let axis = if axes == HomingAxes::Slide { SLIDE } else { SHAFT };
        Self { phase: Phase::Search, axis, all: axes == HomingAxes::All }
    }

    /// Begins the first move.
    pub fn start(&mut self, now_s: f64, settings: &Settings, stepper: &mut Stepper) -> HomingProgress {
        self.enter(Phase::Search, now_s, settings, stepper)
    }

    /// A move of the cycle is complete. Begins the next one.
    pub fn move_done(&mut self, at_s: f64, settings: &Settings, stepper: &mut Stepper) -> HomingProgress {
        match self.phase {
            Phase::Search => self.enter(Phase::PullOff, at_s, settings, stepper),
            Phase::PullOff if stepper.at_switch(self.axis, self.direction(settings), at_s) => HomingProgress::Failed(8),
            Phase::PullOff => self.enter(Phase::Locate, at_s, settings, stepper),
            Phase::Locate => {
                if self.axis == SHAFT {
                    stepper.count_from_here();
                }
                self.enter(Phase::Leave, at_s, settings, stepper)
            }
            Phase::Leave => {
                stepper.set_position(self.axis, self.home_steps(settings));
                if self.all && self.axis == SHAFT && stepper.has_slide() {
                    self.axis = SLIDE;
                    return self.enter(Phase::Search, at_s, settings, stepper);
                }
                HomingProgress::Done
            }
        }
    }

    fn enter(&mut self, phase: Phase, start_s: f64, settings: &Settings, stepper: &mut Stepper) -> HomingProgress {
        self.phase = phase;
        let axis = self.axis;
        let per_unit = f64::from(settings.per_axis(100)[axis]);
        let direction = self.direction(settings);
        let pull_off = f64::from(settings.get(27)) * per_unit;
        let (range, feed) = match phase {
            Phase::Search => (Some(SEARCH_RANGE * f64::from(settings.per_axis(130)[axis]) * per_unit), settings.get(25)),
            Phase::Locate => (Some(LOCATE_RANGE * pull_off), settings.get(24)),
            Phase::PullOff | Phase::Leave => (None, settings.get(25)),
        };
        let steps = match range {
            Some(range) => {
                let to_go = stepper.steps_to_switch(axis, direction);
                if to_go as f64 > range {
                    return HomingProgress::Failed(9);
                }
                direction * to_go
            }
            None => -direction * pull_off.round() as i64,
        };
        if steps == 0 {
            return self.move_done(start_s, settings, stepper);
        }
        let length = steps.unsigned_abs() as f64 / per_unit;
        let (speed, acceleration) = ((f64::from(feed) / 60.0).max(SLOWEST), f64::from(settings.per_axis(120)[axis]).max(SLOWEST));
        let debounce_s = f64::from(settings.get(26)) / 1000.0;
        let mut block = Block { steps: [0; 3], length, speed, acceleration };
        block.steps[axis] = steps;
        stepper.begin(block, start_s + debounce_s, false);
        HomingProgress::Moving
    }

    /// The direction in which the switch lies, 1 or -1.
    fn direction(&self, settings: &Settings) -> i64 {
        if (settings.get(23) as i64 >> self.axis) & 1 == 0 { 1 } else { -1 }
    }

    /// Where the axis stands after the cycle, steps. The machine coordinates of Grbl go from minus the travel to 0.
    fn home_steps(&self, settings: &Settings) -> i64 {
        let pull_off = settings.get(27);
        let travel = settings.per_axis(130)[self.axis];
        let units = if self.direction(settings) > 0 { -pull_off } else { pull_off - travel };
        (units * settings.per_axis(100)[self.axis]).round() as i64
    }
}
