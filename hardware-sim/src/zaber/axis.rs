//! The axis: its ramp, its counter, its encoder and its flags.

use super::Settings;
use crate::motion::MotionProfile;
use crate::motor_faults::{Fault, MotorFaults};
use crate::shaft::Shaft;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Displacement of a standing axis that sets the flag `WM`, microsteps.
const DISPLACED_STEPS: f64 = 50.0;

#[derive(Debug)]
struct Running {
    steps: i64,
    start_s: f64,
    profile: Arc<MotionProfile>,
    /// When a fault ends this move early, and the fault.
    cut: Option<(f64, Fault)>,
    homing: bool,
}

pub(super) struct Axis {
    shaft: Arc<Shaft>,
    faults: Arc<MotorFaults>,
    /// Microsteps counted until the last move ended.
    counter: i64,
    /// True motor position at which the encoder reads 0.
    encoder_zero: f64,
    /// Reading of the encoder when the axis came to rest.
    rest_encoder: f64,
    running: Option<Running>,
    flags: BTreeSet<&'static str>,
    /// Whether the motor has current. A hardware stop switches it off until the driver is enabled again.
    enabled: bool,
    /// A move has ended since this was last cleared.
    pub ended: bool,
}

impl Axis {
    pub fn new(shaft: Arc<Shaft>, faults: Arc<MotorFaults>) -> Self {
        let flags = BTreeSet::from(["WR"]);
        let (enabled, ended) = (true, false);
        let mut axis = Self { shaft, faults, counter: 0, encoder_zero: 0.0, rest_encoder: 0.0, running: None, flags, enabled, ended };
        axis.encoder_zero = axis.shaft.motor_at(0, 0.0);
        axis
    }

    pub fn is_moving(&self) -> bool {
        self.running.is_some()
    }

    /// All flags, the most important first: faults, warnings, notes.
    pub fn flags(&self) -> Vec<&'static str> {
        let kind = |flag: &&str| "FWN".find(flag.chars().next().unwrap_or('N'));
        let mut flags: Vec<_> = self.flags.iter().copied().collect();
        flags.sort_by_key(kind);
        flags
    }

    pub fn flag(&self) -> &'static str {
        self.flags().first().copied().unwrap_or("--")
    }

    pub fn clear_flags(&mut self) {
        self.flags.retain(|f| matches!(*f, "WR" | "WH" | "FH"));
    }

    pub fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// Switches the current on again. Returns `false` while the hardware stop is pressed.
    pub fn enable(&mut self) -> bool {
        if self.faults.hardware_stop() {
            return false;
        }
        self.flags.remove("FH");
        self.enabled = true;
        true
    }

    /// Applies what a person does at the controller: the hardware stop and the knob.
    fn apply_manual_controls(&mut self, now_s: f64, settings: &Settings) {
        if self.faults.hardware_stop() && self.enabled {
            self.rest(now_s);
            self.flags.insert("FH");
            self.enabled = false;
        }
        if let Some(steps) = self.faults.take_knob_steps() {
            if self.is_moving() {
                self.rest(now_s);
                self.flags.insert("NI");
            }
            self.flags.insert("NC");
            self.run(steps, now_s, settings, false);
        }
    }

    pub fn next_event_s(&self) -> Option<f64> {
        self.running.as_ref().map(|r| r.cut.map_or(r.start_s + r.profile.duration_s(), |(at_s, _)| at_s))
    }

    pub fn advance(&mut self, now_s: f64, settings: &Settings) {
        while let Some(at_s) = self.next_event_s().filter(|at| *at <= now_s) {
            let Some(Running { cut, homing, steps, .. }) = self.running.as_ref().map(|r| Running { profile: Arc::clone(&r.profile), ..*r })
            else {
                return;
            };
            let before = self.counter;
            self.rest(at_s);
            let to_go = steps - (self.counter - before);
            match cut {
                Some((_, Fault::Limit { .. })) => _ = self.flags.insert("FE"),
                Some((_, Fault::Stall { .. })) if settings.encoder => _ = self.flags.insert("FS"),
                Some(_) => {
                    // The controller does not notice it: it counts on to the target, and the shaft stays.
                    self.shaft.lose_steps(to_go.unsigned_abs() as u32);
                    self.run(to_go, at_s, settings, homing);
                    continue;
                }
                None if homing => self.found(at_s),
                None => {}
            }
            self.ended = true;
        }
        self.apply_manual_controls(now_s, settings);
        // Somebody has turned the standing axis.
        if !self.is_moving() && settings.encoder && (self.encoder(now_s) - self.rest_encoder).abs() > DISPLACED_STEPS {
            self.flags.insert("WM");
        }
    }

    fn found(&mut self, now_s: f64) {
        self.shaft.count_from_here();
        self.set_counter(0);
        self.encoder_zero = self.shaft.motor_at(0, now_s);
        self.rest_encoder = 0.0;
        self.flags.clear();
    }

    pub fn go(&mut self, target: i64, now_s: f64, settings: &Settings) {
        self.interrupt(now_s);
        self.run(target - self.counter, now_s, settings, false);
    }

    pub fn home(&mut self, now_s: f64, settings: &Settings) {
        self.interrupt(now_s);
        let steps = self.shaft.steps_to_index(1);
        self.run(steps, now_s, settings, true);
    }

    /// A new move ends the move in progress. The flags of earlier moves are cleared.
    fn interrupt(&mut self, now_s: f64) {
        self.clear_flags();
        if self.is_moving() {
            self.flags.insert("NI");
            self.rest(now_s);
        }
    }

    fn run(&mut self, steps: i64, now_s: f64, settings: &Settings, homing: bool) {
        let length = steps.unsigned_abs() as f64;
        let fault = if steps == 0 { None } else { self.faults.take(0) };
        let start_s = if let Some(Fault::Late { by_s }) = fault { now_s + by_s } else { now_s };
        let profile = Arc::new(MotionProfile::trapezoid(length, settings.steps_per_s(), settings.steps_per_s2()));
        let cut = fault.and_then(|fault| match fault {
            Fault::Stall { after_steps } | Fault::Limit { after_steps } if f64::from(after_steps) < length => {
                Some((start_s + profile.time_at_s(f64::from(after_steps)), fault))
            }
            _ => None,
        });
        self.shaft.begin(start_s, steps, length.max(1.0), Arc::clone(&profile));
        self.running = Some(Running { steps, start_s, profile, cut, homing });
    }

    /// Brakes with the highest permitted acceleration.
    pub fn stop(&mut self, now_s: f64, settings: &Settings) {
        if let Some(running) = &mut self.running {
            let elapsed_s = now_s - running.start_s;
            let (from, speed) = (running.profile.travelled(elapsed_s), running.profile.speed(elapsed_s));
            let braking = Arc::new(MotionProfile::braking(from, speed, settings.steps_per_s2(), running.profile.distance()));
            self.shaft.replan(now_s, Arc::clone(&braking));
            *running = Running { steps: running.steps, start_s: now_s, profile: braking, cut: None, homing: false };
            self.flags.insert("NI");
        }
    }

    fn rest(&mut self, now_s: f64) {
        if self.running.take().is_some() {
            self.counter += self.shaft.end(now_s);
        }
        self.rest_encoder = self.encoder(now_s);
    }

    /// The axis loses power. It stops, and the controller loses its count.
    pub fn lose_power(&mut self, now_s: f64) {
        self.rest(now_s);
        self.counter = 0;
        self.encoder_zero = self.shaft.motor_at(0, now_s);
        self.rest_encoder = 0.0;
        self.flags = BTreeSet::from(["WR"]);
        self.enabled = true;
    }

    pub fn counter(&self, now_s: f64) -> i64 {
        let issued = |r: &Running| (r.profile.travelled(now_s - r.start_s) * r.steps.signum() as f64).round() as i64;
        self.counter + self.running.as_ref().map_or(0, issued)
    }

    pub fn set_counter(&mut self, value: i64) {
        self.counter = value;
        // The position is now known, but not from homing.
        if self.flags.remove("WR") {
            self.flags.insert("WH");
        }
    }

    pub fn encoder(&self, now_s: f64) -> f64 {
        self.shaft.motor_at(0, now_s) - self.encoder_zero
    }
}
