//! The true shaft: where the capillary really stands, whatever the controller believes.
//!
//! ```text
//!   firmware ── steps issued ──► motor ── minus steps lost ──► shaft ── angle ──► the scene
//!                                                               │
//!   firmware ◄── reference switch, once per revolution ─────────┘
//! ```
//! Angles are unwrapped and counted from the index at which the firmware last referenced the axis, so the view that closes
//! a revolution (360 deg) is another one than the first (0 deg).
//!
//! A pair of motors holds the capillary at both ends: in the picture it stands at their mean, and their difference twists it.

use crate::clock::RigClock;
use crate::motion::MotionProfile;
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Motor and gear.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShaftSettings {
    /// Steps per revolution as a ratio: microsteps times gear.
    pub steps_per_revolution: (u32, u32),
    /// Where the reference switch trips, in steps.
    pub index_steps: i64,
    /// Where the shaft stands when the rig is switched on, in steps.
    pub power_on_steps: i64,
}

impl Default for ShaftSettings {
    /// The 0.72 deg quantum of published VAST tooling, switched on away from the index.
    fn default() -> Self {
        Self { steps_per_revolution: (500, 1), index_steps: 0, power_on_steps: 137 }
    }
}

#[derive(Debug)]
struct Motion {
    start_s: f64,
    /// Steps that the whole path would issue, and the path's length in the profile's unit.
    steps: i64,
    path: f64,
    profile: Arc<MotionProfile>,
}

impl Motion {
    fn issued(&self, now_s: f64) -> f64 {
        self.steps as f64 * (self.profile.travelled(now_s - self.start_s) / self.path)
    }
}

/// One of the motors at the ends of the capillary.
#[derive(Debug)]
struct Drive {
    /// Where it stood when the present move began.
    rest_steps: i64,
    motion: Option<Motion>,
    /// Steps that it will still fail to make.
    to_lose: u32,
}

impl Drive {
    fn position(&self, now_s: f64) -> f64 {
        let issued = self.motion.as_ref().map_or(0.0, |m| m.issued(now_s));
        self.rest_steps as f64 + issued - issued.signum() * issued.abs().min(f64::from(self.to_lose))
    }

    fn settle(&mut self, now_s: f64) -> i64 {
        let Some(motion) = self.motion.take() else { return 0 };
        let issued = motion.issued(now_s).round() as i64;
        let lost = issued.unsigned_abs().min(u64::from(self.to_lose));
        self.to_lose -= lost as u32;
        self.rest_steps += issued - issued.signum() * lost as i64;
        issued
    }
}

#[derive(Debug)]
struct State {
    drives: Vec<Drive>,
    /// The index from which angles are counted.
    datum_steps: f64,
    /// Play between motor and capillary, and where the capillary stood when a move last began or ended.
    play_steps: f64,
    capillary_steps: f64,
    /// How far a hose pulls the capillary round when its motors lose their current.
    pull_steps: i64,
}

impl State {
    /// Where the capillary stands: dragged along behind the motors by the play.
    fn position(&self, now_s: f64) -> f64 {
        let motors = self.drives.iter().map(|d| d.position(now_s)).sum::<f64>() / self.drives.len() as f64;
        self.capillary_steps.clamp(motors - self.play_steps, motors)
    }
}

/// One stepper-driven shaft, shared by the firmware that turns it and the camera that looks at it.
#[derive(Debug)]
pub struct Shaft {
    clock: RigClock,
    settings: ShaftSettings,
    state: Mutex<State>,
}

impl Shaft {
    pub fn new(clock: RigClock, settings: ShaftSettings) -> Self {
        let steps = settings.power_on_steps;
        let state = State {
            drives: vec![Drive { rest_steps: steps, motion: None, to_lose: 0 }],
            datum_steps: settings.index_steps as f64,
            play_steps: 0.0,
            capillary_steps: steps as f64,
            pull_steps: 0,
        };
        Self { clock, settings, state: Mutex::new(state) }
    }

    /// The same, held by a pair of motors.
    pub(crate) fn paired(self) -> Self {
        let steps = self.settings.power_on_steps;
        self.lock().drives.push(Drive { rest_steps: steps, motion: None, to_lose: 0 });
        self
    }

    /// The true angle at this instant, unwrapped.
    pub fn angle_rad(&self) -> f64 {
        self.angle_at_rad(self.clock.now_s())
    }

    /// The true angle at an instant of rig time, as far as the moves begun by now tell.
    pub fn angle_at_rad(&self, now_s: f64) -> f64 {
        let state = self.lock();
        self.steps_to_rad(state.position(now_s) - state.datum_steps)
    }

    /// Whether a move is under way.
    pub fn is_turning(&self) -> bool {
        self.lock().drives.iter().any(|drive| drive.motion.is_some())
    }

    /// Where one motor of a pair stands, in steps.
    pub fn motor_steps(&self, motor: usize) -> f64 {
        self.motor_at(motor, self.clock.now_s())
    }

    pub(crate) fn motor_at(&self, motor: usize, now_s: f64) -> f64 {
        self.lock().drives[motor].position(now_s)
    }

    /// A hand turns the standing shaft, and the motor with it.
    pub fn push(&self, steps: i64) {
        let mut state = self.lock();
        state.drives.iter_mut().for_each(|drive| drive.rest_steps += steps);
        state.capillary_steps += steps as f64;
    }

    /// A hose pulls at the capillary: each time the motors lose their current it turns by this much.
    pub fn pull_when_released(&self, steps: i64) {
        self.lock().pull_steps = steps;
    }

    /// The motors lose their current.
    pub(crate) fn release(&self) {
        let steps = self.lock().pull_steps;
        self.push(steps);
    }

    pub fn steps_to_rad(&self, steps: f64) -> f64 {
        let (steps_of, revolutions) = self.settings.steps_per_revolution;
        steps * TAU * f64::from(revolutions) / f64::from(steps_of)
    }

    /// The motor will not follow the next `steps` steps it is sent, whichever way.
    pub fn lose_steps(&self, steps: u32) {
        self.lose_steps_of(0, steps);
    }

    /// One motor of a pair will not follow the next `steps` steps.
    pub fn lose_steps_of(&self, motor: usize, steps: u32) {
        self.lock().drives[motor].to_lose += steps;
    }

    /// Puts play between motor and capillary: after a reversal it stays behind by this much.
    pub fn set_play(&self, steps: f64) {
        self.lock().play_steps = steps;
    }

    /// Begins a move of `steps` spread evenly over a path of length `path`, which `profile` travels.
    pub(crate) fn begin(&self, start_s: f64, steps: i64, path: f64, profile: Arc<MotionProfile>) {
        self.begin_of(0, start_s, steps, path, profile);
    }

    /// The same, by one motor of a pair.
    pub(crate) fn begin_of(&self, motor: usize, start_s: f64, steps: i64, path: f64, profile: Arc<MotionProfile>) {
        self.end_of(motor, start_s);
        self.lock().drives[motor].motion = Some(Motion { start_s, steps, path, profile });
    }

    /// Begins a move from rest to rest; says how long it takes, s.
    pub(crate) fn turn(&self, start_s: f64, steps: i64, speed_deg_per_s: f64, acceleration_deg_per_s2: f64) -> f64 {
        let per_deg = TAU / 360.0 / self.steps_to_rad(1.0);
        // No way at all still has an end.
        let way = steps.unsigned_abs().max(1) as f64;
        let profile = MotionProfile::trapezoid(way, speed_deg_per_s * per_deg, acceleration_deg_per_s2 * per_deg);
        let duration_s = profile.duration_s();
        self.begin(start_s, steps, way, Arc::new(profile));
        duration_s
    }

    /// The move under way goes on by another profile of the same path.
    pub(crate) fn replan(&self, start_s: f64, profile: Arc<MotionProfile>) {
        self.replan_of(0, start_s, profile);
    }

    pub(crate) fn replan_of(&self, motor: usize, start_s: f64, profile: Arc<MotionProfile>) {
        if let Some(motion) = &mut self.lock().drives[motor].motion {
            motion.start_s = start_s;
            motion.profile = profile;
        }
    }

    /// Ends the move where it is at `now_s`; returns the whole steps that were issued.
    pub(crate) fn end(&self, now_s: f64) -> i64 {
        self.end_of(0, now_s)
    }

    pub(crate) fn end_of(&self, motor: usize, now_s: f64) -> i64 {
        let mut state = self.lock();
        let issued = state.drives[motor].settle(now_s);
        state.capillary_steps = state.position(now_s);
        issued
    }

    /// Steps to go until the reference switch trips, turning in `direction`; 0 where it is pressed already.
    pub(crate) fn steps_to_index(&self, direction: i64) -> i64 {
        self.steps_to_index_of(0, direction)
    }

    pub(crate) fn steps_to_index_of(&self, motor: usize, direction: i64) -> i64 {
        let per_revolution = self.steps_per_revolution();
        let ahead = ((self.settings.index_steps - self.lock().drives[motor].rest_steps) * direction) as f64;
        let to_go = ahead.rem_euclid(per_revolution);
        // Just past the index by less than half a step is still at it.
        if per_revolution - to_go < 0.5 { 0 } else { to_go.round() as i64 }
    }

    /// The same, where a switch that is pressed already trips only after a whole revolution.
    pub(crate) fn steps_to_next_index(&self, direction: i64) -> i64 {
        match self.steps_to_index(direction) {
            0 => self.steps_per_revolution().round() as i64,
            steps => steps,
        }
    }

    fn steps_per_revolution(&self) -> f64 {
        let (steps, revolutions) = self.settings.steps_per_revolution;
        f64::from(steps) / f64::from(revolutions)
    }

    /// Whether the reference switch is pressed.
    pub(crate) fn at_index(&self, now_s: f64) -> bool {
        let per_revolution = self.steps_per_revolution();
        let off = (self.lock().position(now_s) - self.settings.index_steps as f64).rem_euclid(per_revolution);
        off.min(per_revolution - off) < 0.5
    }

    /// The firmware has found the index here: angles count from it.
    pub(crate) fn count_from_here(&self) {
        let mut state = self.lock();
        state.datum_steps = state.position(self.clock.now_s());
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    // Whole steps and what they print are exact; that they are is what is tested.
    #![allow(clippy::float_cmp)]

    use super::*;

    fn shaft(steps_per_revolution: (u32, u32)) -> Shaft {
        Shaft::new(RigClock::new(1.0), ShaftSettings { steps_per_revolution, index_steps: 0, power_on_steps: 137 })
    }

    fn go(shaft: &Shaft, start_s: f64, steps: i64) -> f64 {
        let profile = MotionProfile::trapezoid(steps.unsigned_abs() as f64, 800.0, 2000.0);
        let end_s = start_s + profile.duration_s();
        shaft.begin(start_s, steps, steps.unsigned_abs() as f64, Arc::new(profile));
        end_s
    }

    #[test]
    fn a_finished_move_stands_on_whole_steps_and_is_counted_from_the_index() {
        let s = shaft((500, 1));
        let to_index = s.steps_to_index(1);
        assert_eq!(to_index, 500 - 137);
        let end = go(&s, 0.0, to_index);
        assert!(!s.at_index(0.5 * end));
        assert_eq!(s.end(end), to_index);
        assert!(s.at_index(end));
        s.count_from_here();
        assert_eq!(s.angle_at_rad(end), 0.0);
        let end = go(&s, end, 500);
        assert_eq!(s.angle_at_rad(end + 1.0), TAU, "unwrapped: closure is not view 0");
        assert_eq!(s.steps_to_index(-1), 0);
    }

    #[test]
    fn lost_steps_leave_the_shaft_behind_what_was_issued() {
        let s = shaft((500, 1));
        s.lose_steps(50);
        let end = go(&s, 0.0, 800);
        assert_eq!(s.end(end), 800, "the firmware cannot see it");
        assert_eq!(s.angle_at_rad(end), s.steps_to_rad(137.0 + 750.0));
        let later = go(&s, end, -10);
        s.end(later);
        assert_eq!(s.angle_at_rad(later), s.steps_to_rad(137.0 + 740.0), "the fault is used up");
    }

    #[test]
    fn a_ratio_of_steps_closes_after_its_revolutions() {
        let s = shaft((6400, 3));
        assert!((s.steps_to_rad(6400.0) - 3.0 * TAU).abs() < 1e-12);
    }

    #[test]
    fn an_interrupted_move_rests_on_the_nearest_step() {
        let s = shaft((500, 1));
        let end = go(&s, 0.0, 400);
        let issued = s.end(0.4 * end);
        assert!(issued > 0 && issued < 400);
        assert_eq!(s.angle_at_rad(end), s.steps_to_rad((137 + issued) as f64));
    }
}
