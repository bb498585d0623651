//! The machine: it goes through its list, one line per trigger, and says when it stands.
//!
//! ```text
//!   specimen ──► read the list ──► line 0 ──► stands ──trigger──► line 1 ──► stands ── ... ── last ──trigger──► done
//! ```
//! A trigger while it turns is not seen. A specimen that is taken up while it stands ends the list before: whoever loads
//! has ended it.

use super::{Settings, list};
use crate::shaft::Shaft;
use std::collections::VecDeque;
use std::sync::Arc;

/// How often the machine looks for a specimen, s.
const LOOK_S: f64 = 0.01;

pub(super) struct Vast {
    shaft: Arc<Shaft>,
    settings: Settings,
    /// Lines still to come, degrees.
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

    /// Lets what is due by `now_s` happen; when it came to stand, if it did.
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

    /// Finds its own zero, the index, unseen, and goes to the first line; false where there is no list.
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

    /// Begins a turn and says how long it takes, s.
    fn turn(&self, steps: i64, now_s: f64) -> f64 {
        self.shaft.turn(now_s, steps, self.settings.speed_deg_per_s, self.settings.acceleration_deg_per_s2)
    }
}
