//! The machine. It goes through its list, one line per trigger, and reports each arrival.
//!
//! ```text
//!   specimen ──► the loaded list ──► line 0 ──► at rest ──trigger──► line 1 ──► at rest ── ... ── last ──trigger──► done
//! ```
//! Before a person has loaded a list, the machine does nothing with a specimen. A trigger during a turn is ignored. A specimen that is loaded while the machine is at rest ends the list in progress.

use super::{Settings, ToSmaller, list};
use crate::shaft::Shaft;
use std::collections::VecDeque;
use std::sync::Arc;

/// How often the machine checks for a specimen, rig seconds.
const LOOK_S: f64 = 0.01;

pub(super) struct Vast {
    shaft: Arc<Shaft>,
    settings: Settings,
    /// The list in the machine's program, degrees.
    list: Vec<f64>,
    /// The remaining lines, degrees.
    lines: VecDeque<f64>,
    phase: Phase,
    look_s: f64,
    at_steps: i64,
}

enum Phase {
    Idle,
    Turning { until_s: f64 },
    Stands,
}

impl Vast {
    pub fn new(shaft: Arc<Shaft>, settings: Settings) -> Self {
        Self { shaft, settings, list: Vec::new(), lines: VecDeque::new(), phase: Phase::Idle, look_s: 0.0, at_steps: 0 }
    }

    pub fn next_event_s(&self) -> f64 {
        match self.phase {
            Phase::Turning { until_s } => until_s,
            Phase::Idle | Phase::Stands => self.look_s,
        }
    }

    /// Executes what is due by `now_s`. Returns the time of an arrival, if there was one.
    pub fn advance(&mut self, now_s: f64) -> Option<f64> {
        if self.next_event_s() > now_s {
            return None;
        }
        if let Phase::Turning { until_s } = self.phase {
            self.shaft.end(until_s);
            self.phase = Phase::Stands;
            return Some(until_s);
        }
        self.look_s = now_s + LOOK_S;
        if self.settings.knobs.list_is_to_be_loaded() {
            self.load_list();
        }
        if self.settings.knobs.taken_up() && !self.begin(now_s) {
            self.phase = Phase::Idle;
        }
        None
    }

    pub fn trigger(&mut self, now_s: f64) {
        if matches!(self.phase, Phase::Stands) && !self.next_line(now_s) {
            self.phase = Phase::Idle;
            self.settings.knobs.list_finished();
        }
    }

    fn load_list(&mut self) {
        self.list = list::degrees(&std::fs::read_to_string(&self.settings.list).unwrap_or_default());
    }

    /// Turns to its own zero, which is the index, without a report, and goes to the first line. Returns `false` if there is no list.
    fn begin(&mut self, now_s: f64) -> bool {
        if self.settings.knobs.loads_list_for_every_specimen() {
            self.load_list();
        }
        self.lines = self.list.clone().into();
        if self.lines.is_empty() {
            return false;
        }
        self.turn(self.shaft.steps_to_index(1), now_s);
        self.shaft.end(f64::INFINITY);
        self.shaft.count_from_here();
        self.at_steps = 0;
        self.next_line(now_s)
    }

    fn next_line(&mut self, now_s: f64) -> bool {
        let Some(degrees) = self.lines.pop_front() else { return false };
        let steps_of = |deg: f64| (deg.to_radians() / self.shaft.steps_to_rad(1.0)).round() as i64;
        let (target, whole_turn) = (steps_of(degrees), steps_of(360.0));
        let back = target - self.at_steps;
        let goes_on = back < 0 && self.settings.to_smaller == ToSmaller::Shortest && back + whole_turn < -back;
        let steps = if goes_on { back + whole_turn } else { back };
        self.at_steps = target;
        self.phase = Phase::Turning { until_s: now_s + self.turn(steps, now_s) };
        true
    }

    /// Begins a turn. Returns its duration, rig seconds.
    fn turn(&self, steps: i64, now_s: f64) -> f64 {
        self.shaft.turn(now_s, steps, self.settings.speed_deg_per_s, self.settings.acceleration_deg_per_s2)
    }
}
