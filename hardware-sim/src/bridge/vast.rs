//! The machine. It goes through its list, one line per trigger, and reports each arrival.
//!
//! ```text
//!   specimen ──► read the list ──► line 0 ──► at rest ──trigger──► line 1 ──► at rest ── ... ── last ──trigger──► done
//! ```
//! A trigger during a turn is ignored. A specimen that is loaded while the machine is at rest ends the list in progress.

use super::{Settings, list};
use crate::shaft::Shaft;
use std::collections::VecDeque;
use std::sync::Arc;

/// How often the machine checks for a specimen, rig seconds.
const LOOK_S: f64 = 0.01;

pub(super) struct Vast {
    shaft: Arc<Shaft>,
    settings: Settings,
    /// The remaining lines, degrees.
    lines: VecDeque<f64>,
    phase: Phase,
    look_s: f64,
    at_steps: i64,
    at_deg: f64,
}

enum Phase {
    Idle,
    Turning { until_s: f64 },
    Stands,
}

impl Vast {
    pub fn new(shaft: Arc<Shaft>, settings: Settings) -> Self {
        Self { shaft, settings, lines: VecDeque::new(), phase: Phase::Idle, look_s: 0.0, at_steps: 0, at_deg: 0.0 }
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

    /// Turns to its own zero, which is the index, without a report, and goes to the first line. Returns `false` if there is no list.
    fn begin(&mut self, now_s: f64) -> bool {
        let text = std::fs::read_to_string(&self.settings.list).unwrap_or_default();
        self.lines = list::degrees(&text).into();
        if self.lines.is_empty() {
            return false;
        }
        self.turn(self.shaft.steps_to_index(1), now_s);
        self.shaft.end(f64::INFINITY);
        self.shaft.count_from_here();
        (self.at_steps, self.at_deg) = (0, 0.0);
        self.next_line(now_s)
    }

    fn next_line(&mut self, now_s: f64) -> bool {
        let Some(degrees) = self.lines.pop_front() else { return false };
        self.at_deg = if self.settings.relative { self.at_deg + degrees } else { degrees };
        let target = (self.at_deg.to_radians() / self.shaft.steps_to_rad(1.0)).round() as i64;
        let steps = target - self.at_steps;
        self.at_steps = target;
        self.phase = Phase::Turning { until_s: now_s + self.turn(steps, now_s) };
        true
    }

    /// Begins a turn. Returns its duration, rig seconds.
    fn turn(&self, steps: i64, now_s: f64) -> f64 {
        self.shaft.turn(now_s, steps, self.settings.speed_deg_per_s, self.settings.acceleration_deg_per_s2)
    }
}
