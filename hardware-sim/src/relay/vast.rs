//! The machine behind the relay: a rotation axis that accepts relative moves only, and a stage along and across the capillary.

use super::Settings;
use crate::shaft::Shaft;
use std::sync::Arc;

/// Speed of the stage, microsteps per second.
const STAGE_SPEED: f64 = 100_000.0;

pub(super) struct Vast {
    shaft: Arc<Shaft>,
    settings: Settings,
    stage: [i64; 2],
    /// When the last turn began, if there was one.
    turn_s: Option<f64>,
    busy_until_s: f64,
    autostore: String,
}

impl Vast {
    pub fn new(shaft: Arc<Shaft>, settings: Settings) -> Self {
        Self { shaft, settings, stage: [0; 2], turn_s: None, busy_until_s: 0.0, autostore: String::new() }
    }

    /// Executes a request. Returns the answer.
    pub fn obey(&mut self, request: &str, now_s: f64) -> String {
        let (command, rest) = request.split_once(',').unwrap_or((request, ""));
        let numbers: Option<Vec<i64>> = rest.split(',').map(|n| n.parse().ok()).collect();
        let busy = now_s < self.busy_until_s;
        match (command, numbers.as_deref()) {
            ("busy", _) => i32::from(self.says_busy(busy, now_s)).to_string(),
            ("get_xy_pos", _) => format!("{},{}", self.stage[0], self.stage[1]),
            ("get_autost", _) => self.autostore.clone(),
            ("set_autost", _) => {
                rest.clone_into(&mut self.autostore);
                "ok".into()
            }
            ("boot", _) => "ok".into(),
            ("rot" | "mabs" | "mrel", Some(_)) if busy => "error: busy".into(),
            ("rot", Some([steps])) => {
                self.turn(*steps, now_s);
                "ok".into()
            }
            ("mabs", Some([_, x, y])) => self.shift([x - self.stage[0], y - self.stage[1]], now_s),
            ("mrel", Some([_, x, y])) => self.shift([*x, *y], now_s),
            _ => format!("error: {request:?} is no request"),
        }
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

    fn shift(&mut self, by: [i64; 2], now_s: f64) -> String {
        let way = by.iter().map(|b| b.unsigned_abs()).max().unwrap_or(0);
        self.busy_until_s = now_s + way as f64 / STAGE_SPEED;
        self.stage = [self.stage[0] + by[0], self.stage[1] + by[1]];
        "ok".into()
    }
}
