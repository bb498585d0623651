//! One motor of the module: its ramp generator, its counter and its axis parameters.

use crate::motion::MotionProfile;
use crate::motor_faults::{Fault, MotorFaults};
use crate::shaft::Shaft;
use std::collections::BTreeMap;
use std::sync::Arc;

pub(super) const TARGET: u8 = 0;
pub(super) const ACTUAL: u8 = 1;
const SPEED: u8 = 3;
const MAX_SPEED: u8 = 4;
const MAX_ACCELERATION: u8 = 5;
const POSITION_REACHED: u8 = 8;
const RIGHT_LIMIT: u8 = 10;
const LEFT_LIMIT: u8 = 11;
pub(super) const STOP_ON_STALL: u8 = 181;
const LOAD: u8 = 206;
/// A load of 0 is a stall.
const LOAD_TURNING: i32 = 512;

#[derive(Debug)]
struct Running {
    steps: i64,
    start_s: f64,
    profile: Arc<MotionProfile>,
    /// When a fault ends this move early, and the fault.
    cut: Option<(f64, Fault)>,
    searching: bool,
}

impl Running {
    fn end_s(&self) -> f64 {
        self.start_s + self.profile.duration_s()
    }

    fn issued(&self, now_s: f64) -> i64 {
        (self.profile.travelled(now_s - self.start_s) * self.steps.signum() as f64).round() as i64
    }
}

pub(super) struct Motor {
    number: usize,
    shaft: Arc<Shaft>,
    faults: Arc<MotorFaults>,
    parameters: BTreeMap<u8, i32>,
    /// Microsteps counted until the last move ended.
    counter: i64,
    target: i64,
    running: Option<Running>,
    /// Whether the ramp generator is in position mode. It then moves to the target again if the counter is overwritten.
    positioning: bool,
    /// Whether a detected stall has ended the last move. The move continues if the stall detection is set again.
    stalled: bool,
}

impl Motor {
    pub fn new(number: usize, shaft: Arc<Shaft>, faults: Arc<MotorFaults>, parameters: BTreeMap<u8, i32>) -> Self {
        Self { number, shaft, faults, parameters, counter: 0, target: 0, running: None, positioning: false, stalled: false }
    }

    pub fn next_event_s(&self) -> Option<f64> {
        self.running.as_ref().map(|r| r.cut.map_or_else(|| r.end_s(), |(at_s, _)| at_s))
    }

    pub fn advance(&mut self, now_s: f64) {
        while let Some(at_s) = self.next_event_s().filter(|at| *at <= now_s) {
            let Some(running) = &self.running else { return };
            match running.cut {
                Some((_, fault)) => self.cut(at_s, fault),
                None => self.arrived(at_s),
            }
        }
    }

    fn arrived(&mut self, at_s: f64) {
        let searching = self.running.as_ref().is_some_and(|r| r.searching);
        self.rest(at_s);
        if searching {
            (self.counter, self.target) = (0, 0);
            self.shaft.count_from_here();
        }
        self.parameters.insert(POSITION_REACHED, i32::from(self.counter == self.target));
    }

    fn cut(&mut self, at_s: f64, fault: Fault) {
        self.rest(at_s);
        let to_go = self.target - self.counter;
        match fault {
            Fault::Limit { .. } => {
                self.parameters.insert(if to_go > 0 { RIGHT_LIMIT } else { LEFT_LIMIT }, 1);
            }
            Fault::Stall { .. } if self.parameters[&STOP_ON_STALL] > 0 => {
                self.stalled = true;
                self.parameters.insert(LOAD, 0);
            }
            _ => {
                // The module does not notice it: it counts on to the target, and the shaft stays.
                self.shaft.lose_steps_of(self.number, to_go.unsigned_abs() as u32);
                self.run(to_go, at_s, false);
            }
        }
    }

    /// Absolute positioning. The ramp begins at once.
    pub fn go(&mut self, target: i64, now_s: f64) {
        self.rest(now_s);
        self.target = target;
        (self.positioning, self.stalled) = (true, false);
        self.parameters.insert(LOAD, LOAD_TURNING);
        self.run(target - self.counter, now_s, false);
    }

    fn run(&mut self, steps: i64, now_s: f64, searching: bool) {
        self.parameters.insert(POSITION_REACHED, i32::from(steps == 0));
        let fault = if steps == 0 { None } else { self.faults.take(self.number) };
        let start_s = if let Some(Fault::Late { by_s }) = fault { now_s + by_s } else { now_s };
        let length = steps.unsigned_abs() as f64;
        let (speed, acceleration) = (f64::from(self.parameters[&MAX_SPEED]), f64::from(self.parameters[&MAX_ACCELERATION]));
        if steps != 0 {
            self.parameters.insert(if steps > 0 { LEFT_LIMIT } else { RIGHT_LIMIT }, 0);
        }
        let profile = Arc::new(MotionProfile::trapezoid(length, speed, acceleration));
        let cut = fault.and_then(|fault| match fault {
            Fault::Stall { after_steps } | Fault::Limit { after_steps } if f64::from(after_steps) < length => {
                Some((start_s + profile.time_at_s(f64::from(after_steps)), fault))
            }
            _ => None,
        });
        self.shaft.begin_of(self.number, start_s, steps, length.max(1.0), Arc::clone(&profile));
        self.running = Some(Running { steps, start_s, profile, cut, searching });
    }

    /// `MST`: brakes with the highest permitted acceleration in velocity mode. The target and a stall are dropped.
    pub fn stop(&mut self, now_s: f64) {
        (self.positioning, self.stalled) = (false, false);
        self.parameters.insert(POSITION_REACHED, 0);
        let acceleration = f64::from(self.parameters[&MAX_ACCELERATION]);
        if let Some(running) = &mut self.running {
            let elapsed_s = now_s - running.start_s;
            let (from, speed) = (running.profile.travelled(elapsed_s), running.profile.speed(elapsed_s));
            let braking = Arc::new(MotionProfile::braking(from, speed, acceleration, running.profile.distance()));
            self.shaft.replan_of(self.number, now_s, Arc::clone(&braking));
            *running = Running { steps: running.steps, start_s: now_s, profile: braking, cut: None, searching: false };
        }
    }

    /// `RFS START`: turns forward to the reference switch and counts from there.
    pub fn search(&mut self, now_s: f64) {
        self.rest(now_s);
        (self.positioning, self.stalled) = (true, false);
        let steps = self.shaft.steps_to_index_of(self.number, 1);
        self.target = self.counter + steps;
        self.run(steps, now_s, true);
    }

    pub fn is_searching(&self) -> bool {
        self.running.as_ref().is_some_and(|r| r.searching)
    }

    /// The module loses power. The motor stops, and the module loses its count.
    pub fn lose_power(&mut self, parameters: BTreeMap<u8, i32>, now_s: f64) {
        self.rest(now_s);
        (self.counter, self.target, self.positioning, self.stalled) = (0, 0, false, false);
        self.parameters = parameters;
    }

    fn rest(&mut self, now_s: f64) {
        if self.running.take().is_some() {
            self.counter += self.shaft.end_of(self.number, now_s);
        }
    }

    pub fn get(&self, parameter: u8, now_s: f64) -> Option<i32> {
        let running = self.running.as_ref();
        let value = match parameter {
            TARGET => self.target,
            ACTUAL => self.counter + running.map_or(0, |r| r.issued(now_s)),
            SPEED => running.map_or(0, |r| (r.profile.speed(now_s - r.start_s) * r.steps.signum() as f64).round() as i64),
            _ => return self.parameters.get(&parameter).copied(),
        };
        Some(value as i32)
    }

    pub fn set(&mut self, parameter: u8, value: i32, now_s: f64) -> bool {
        match parameter {
            TARGET => self.go(value.into(), now_s),
            ACTUAL => {
                self.rest(now_s);
                self.counter = value.into();
                if self.positioning {
                    self.go(self.target, now_s);
                }
            }
            SPEED | POSITION_REACHED | RIGHT_LIMIT | LEFT_LIMIT | LOAD => return false,
            _ => {
                if self.parameters.insert(parameter, value).is_none() {
                    self.parameters.remove(&parameter);
                    return false;
                }
                if parameter == STOP_ON_STALL && self.stalled {
                    // The stall no longer blocks the ramp, and the motor continues to its target.
                    self.go(self.target, now_s);
                }
            }
        }
        true
    }
}
