//! The server program and the machine behind it: a rotation axis that accepts relative moves only, and a stage along and across the
//! capillary.
//!
//! ```text
//!   not started ──boot──► starting ── boot_time ──► started: moves, `busy`, positions
//!        every other answer is empty until then
//! ```

use super::Settings;
use crate::shaft::Shaft;
use std::sync::Arc;

/// Speed of the stage, microsteps per second.
const STAGE_SPEED: f64 = 100_000.0;

pub(super) struct Vast {
    shaft: Arc<Shaft>,
    settings: Settings,
    /// Since when VAST is started, rig seconds. `None`: nobody has started it.
    started_s: Option<f64>,
    stage: [i64; 2],
    /// When the last turn began, if there was one.
    turn_s: Option<f64>,
    busy_until_s: f64,
    autostore: String,
}

impl Vast {
    pub fn new(shaft: Arc<Shaft>, settings: Settings) -> Self {
        let started_s = settings.started.then_some(0.0);
        Self { shaft, settings, started_s, stage: [0; 2], turn_s: None, busy_until_s: 0.0, autostore: String::new() }
    }

    /// Executes a request. Returns the answer. Like the public server, it says nothing of a request that it does not know or cannot
    /// execute.
    pub fn obey(&mut self, request: &str, now_s: f64) -> String {
        if self.settings.knobs.is_closed_by_user() {
            self.started_s = None;
        }
        if self.started_s.is_none_or(|started_s| now_s < started_s) {
            if request == "boot" && self.started_s.is_none() {
                self.started_s = Some(now_s + self.settings.boot_time.as_secs_f64());
            }
            return String::new();
        }
        let (command, rest) = request.split_once(',').unwrap_or((request, ""));
        let numbers: Option<Vec<i64>> = rest.split(',').map(|n| n.parse().ok()).collect();
        let busy = now_s < self.busy_until_s;
        match (command, numbers.as_deref()) {
            ("busy", _) => return i32::from(self.says_busy(busy, now_s)).to_string(),
            ("get_xy_pos", _) => return format!("{},{}", self.stage[0], self.stage[1]),
            ("get_autost", _) => return self.autostore.clone(),
            ("set_autost", _) => rest.clone_into(&mut self.autostore),
            ("rot", Some([steps])) if !busy => self.turn(*steps, now_s),
            ("mabs", Some([_, x, y])) if !busy => self.shift([x - self.stage[0], y - self.stage[1]], now_s),
            ("mrel", Some([_, x, y])) if !busy => self.shift([*x, *y], now_s),
            _ => {}
        }
        String::new()
    }

    fn says_busy(&self, busy: bool, now_s: f64) -> bool {
        let Some(turn_s) = self.turn_s else { return busy };
        let knobs = &self.settings.knobs;
        knobs.is_never_idle() || busy && now_s >= turn_s + knobs.idle_for_s()
    }

    fn turn(&mut self, steps: i64, now_s: f64) {
        let Settings { speed_deg_per_s, acceleration_deg_per_s2, .. } = self.settings;
        self.turn_s = Some(now_s);
        self.busy_until_s = now_s + self.shaft.turn(now_s, steps, speed_deg_per_s, acceleration_deg_per_s2);
    }

    fn shift(&mut self, by: [i64; 2], now_s: f64) {
        let way = by.iter().map(|b| b.unsigned_abs()).max().unwrap_or(0);
        self.busy_until_s = now_s + way as f64 / STAGE_SPEED;
        self.stage = [self.stage[0] + by[0], self.stage[1] + by[1]];
    }
}
