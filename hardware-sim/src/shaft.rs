//! The true shaft: the angle at which the capillary really stands. The controller's own count may differ from it.
//!
//! ```text
//!   firmware ── steps issued ──► motor ── minus steps lost ──► shaft ── angle ──► the scene
//!                                                               │
//!   firmware ◄── reference switch, once per revolution ─────────┘
//! ```
//! Angles are unwrapped and counted from the index (the reference switch) at which the firmware last referenced the axis. The
//! closure view at 360 deg is therefore not the first view at 0 deg.
//!
//! A pair of motors may hold the capillary at both ends. The camera then sees the mean of their angles, and their difference twists
//! the capillary.

use crate::clock::RigClock;
use crate::motion::MotionProfile;
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Motor and gear.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ShaftSettings {
    /// Steps of this number of revolutions: microsteps times gear, as an exact ratio.
    pub steps_per_revolution: (u32, u32),
    /// Motor position at which the reference switch trips, steps.
    pub index_steps: i64,
    /// Motor position when the rig is switched on, steps.
    pub power_on_steps: i64,
}

impl Default for ShaftSettings {
    /// The 0.72 deg step of published VAST software. The shaft does not stand at the index when the rig is switched on.
    fn default() -> Self {
        Self { steps_per_revolution: (500, 1), index_steps: 0, power_on_steps: 137 }
    }
}

/// Parts of equal weight of the past that a specimen in the water follows.
const PAST_PARTS: u32 = 64;
/// Changes of the motion that are remembered. A move has some ten, so a turn of 84 stops fits several times.
const REMEMBERED: usize = 20_000;

#[derive(Debug, Clone)]
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
#[derive(Debug, Clone)]
struct Drive {
    /// Its position when the present move began.
    rest_steps: i64,
    motion: Option<Motion>,
    /// Number of its next steps that it does not execute.
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

#[derive(Debug, Clone)]
struct State {
    drives: Vec<Drive>,
    /// The index from which angles are counted.
    datum_steps: f64,
    /// Backlash between motor and capillary.
    play_steps: f64,
    /// Position of the capillary when a move last began or ended.
    capillary_steps: f64,
    /// How far a hose turns the capillary when its motors lose their current.
    pull_steps: i64,
}

impl State {
    /// Position of the capillary. It follows the motors within the backlash.
    fn position(&self, now_s: f64) -> f64 {
        let motors = self.drives.iter().map(|d| d.position(now_s)).sum::<f64>() / self.drives.len() as f64;
        self.capillary_steps.clamp(motors - self.play_steps, motors)
    }
}

/// One shaft with its stepper motors. The firmware turns it, and the camera sees it.
#[derive(Debug)]
pub struct Shaft {
    clock: RigClock,
    settings: ShaftSettings,
    state: Mutex<State>,
    /// Earlier states, each with the instant of rig time at which it ended. They tell where the shaft stood, after it has moved on.
    past: Mutex<VecDeque<(f64, State)>>,
    /// Time constant with which the water follows the glass, s.
    water_lag_s: Mutex<f64>,
}

impl Shaft {
    /// A shaft with one motor, at rest.
    pub fn new(clock: RigClock, settings: ShaftSettings) -> Self {
        let steps = settings.power_on_steps;
        let state = State {
            drives: vec![Drive { rest_steps: steps, motion: None, to_lose: 0 }],
            datum_steps: settings.index_steps as f64,
            play_steps: 0.0,
            capillary_steps: steps as f64,
            pull_steps: 0,
        };
        Self { clock, settings, state: Mutex::new(state), past: Mutex::default(), water_lag_s: Mutex::default() }
    }

    /// Adds a second motor at the other end of the capillary.
    pub(crate) fn paired(self) -> Self {
        let steps = self.settings.power_on_steps;
        self.lock().drives.push(Drive { rest_steps: steps, motion: None, to_lose: 0 });
        self
    }

    /// The true angle now, rad, unwrapped.
    pub fn angle_rad(&self) -> f64 {
        self.angle_at_rad(self.clock.now_s())
    }

    /// The true angle at an instant of rig time, rad, unwrapped. The instant may be past. Angles of the future follow from the moves
    /// that have begun so far.
    pub fn angle_at_rad(&self, at_s: f64) -> f64 {
        let state = self.lock();
        let past = self.past.lock().unwrap_or_else(PoisonError::into_inner);
        let state = past.get(past.partition_point(|(end_s, _)| *end_s <= at_s)).map_or(&*state, |(_, state)| state);
        self.steps_to_rad(state.position(at_s) - state.datum_steps)
    }

    /// The water, and the specimen in it, follow the glass with this time constant, s. At constant speed the specimen then stays behind
    /// by the turn of that time. Water of viscosity nu in a bore of radius r has r^2/(5.78 nu): 16 ms for 300 um. It is 0 at first.
    pub fn set_water_lag(&self, seconds: f64) {
        *self.water_lag_s.lock().unwrap_or_else(PoisonError::into_inner) = seconds;
    }

    /// The angle that the camera sees at an instant of rig time, rad: that of the specimen, and with it of the whole capillary.
    pub(crate) fn seen_at_rad(&self, at_s: f64) -> f64 {
        let lag_s = *self.water_lag_s.lock().unwrap_or_else(PoisonError::into_inner);
        if lag_s <= 0.0 {
            return self.angle_at_rad(at_s);
        }
        // The weight of the past falls exponentially, so its quantiles are at the logarithms of equal parts.
        let ago_s = |part: u32| -lag_s * ((f64::from(part) + 0.5) / f64::from(PAST_PARTS)).ln();
        (0..PAST_PARTS).map(|part| self.angle_at_rad(at_s - ago_s(part))).sum::<f64>() / f64::from(PAST_PARTS)
    }

    /// The state, to be changed at an instant of rig time.
    fn changing(&self, at_s: f64) -> MutexGuard<'_, State> {
        let state = self.lock();
        let mut past = self.past.lock().unwrap_or_else(PoisonError::into_inner);
        if past.len() == REMEMBERED {
            past.pop_front();
        }
        let at_s = if at_s.is_finite() { at_s } else { self.clock.now_s() };
        let end_s = past.back().map_or(at_s, |(end_s, _)| at_s.max(*end_s));
        past.push_back((end_s, state.clone()));
        drop(past);
        state
    }

    /// Whether a move is in progress.
    pub fn is_turning(&self) -> bool {
        self.lock().drives.iter().any(|drive| drive.motion.is_some())
    }

    /// Position of one motor of a pair, steps. Motors are numbered from 0.
    pub fn motor_steps(&self, motor: usize) -> f64 {
        self.motor_at(motor, self.clock.now_s())
    }

    pub(crate) fn motor_at(&self, motor: usize, now_s: f64) -> f64 {
        self.lock().drives[motor].position(now_s)
    }

    /// Turns the standing shaft and its motor from outside, as a hand does.
    pub fn push(&self, steps: i64) {
        let mut state = self.changing(self.clock.now_s());
        state.drives.iter_mut().for_each(|drive| drive.rest_steps += steps);
        state.capillary_steps += steps as f64;
    }

    /// Turns the capillary by this much each time the motors lose their current, as a hose that pulls at it does.
    pub fn pull_when_released(&self, steps: i64) {
        self.lock().pull_steps = steps;
    }

    /// The motors lose their current.
    pub(crate) fn release(&self) {
        let steps = self.lock().pull_steps;
        self.push(steps);
    }

    /// The angle of this many steps, rad.
    pub fn steps_to_rad(&self, steps: f64) -> f64 {
        let (steps_of, revolutions) = self.settings.steps_per_revolution;
        steps * TAU * f64::from(revolutions) / f64::from(steps_of)
    }

    /// The motor does not execute the next `steps` steps, in either direction.
    pub fn lose_steps(&self, steps: u32) {
        self.lose_steps_of(0, steps);
    }

    /// One motor of a pair does not execute the next `steps` steps.
    pub fn lose_steps_of(&self, motor: usize, steps: u32) {
        self.lock().drives[motor].to_lose += steps;
    }

    /// Sets the backlash between motor and capillary, steps. After a reversal the capillary stays behind by this much.
    pub fn set_play(&self, steps: f64) {
        self.lock().play_steps = steps;
    }

    /// Begins a move of `steps`, spread evenly over a path of length `path`. `profile` has the same unit of length.
    pub(crate) fn begin(&self, start_s: f64, steps: i64, path: f64, profile: Arc<MotionProfile>) {
        self.begin_of(0, start_s, steps, path, profile);
    }

    /// Begins a move of one motor of a pair.
    pub(crate) fn begin_of(&self, motor: usize, start_s: f64, steps: i64, path: f64, profile: Arc<MotionProfile>) {
        self.end_of(motor, start_s);
        self.lock().drives[motor].motion = Some(Motion { start_s, steps, path, profile });
    }

    /// Begins a move from rest to rest. Returns its duration, s.
    pub(crate) fn turn(&self, start_s: f64, steps: i64, speed_deg_per_s: f64, acceleration_deg_per_s2: f64) -> f64 {
        let per_deg = TAU / 360.0 / self.steps_to_rad(1.0);
        // A move of 0 steps also needs a path that is longer than 0.
        let way = steps.unsigned_abs().max(1) as f64;
        let profile = MotionProfile::trapezoid(way, speed_deg_per_s * per_deg, acceleration_deg_per_s2 * per_deg);
        let duration_s = profile.duration_s();
        self.begin(start_s, steps, way, Arc::new(profile));
        duration_s
    }

    /// Continues the move in progress with another profile of the same path.
    pub(crate) fn replan(&self, start_s: f64, profile: Arc<MotionProfile>) {
        self.replan_of(0, start_s, profile);
    }

    pub(crate) fn replan_of(&self, motor: usize, start_s: f64, profile: Arc<MotionProfile>) {
        if let Some(motion) = &mut self.changing(start_s).drives[motor].motion {
            motion.start_s = start_s;
            motion.profile = profile;
        }
    }

    /// Ends the move at its position at `now_s`. Returns the whole steps that were issued.
    pub(crate) fn end(&self, now_s: f64) -> i64 {
        self.end_of(0, now_s)
    }

    pub(crate) fn end_of(&self, motor: usize, now_s: f64) -> i64 {
        let mut state = self.changing(now_s);
        let issued = state.drives[motor].settle(now_s);
        state.capillary_steps = state.position(now_s);
        issued
    }

    /// Steps in `direction` (1 or -1) until the reference switch trips. It is 0 if the switch is pressed.
    pub(crate) fn steps_to_index(&self, direction: i64) -> i64 {
        self.steps_to_index_of(0, direction)
    }

    pub(crate) fn steps_to_index_of(&self, motor: usize, direction: i64) -> i64 {
        let per_revolution = self.steps_per_revolution();
        let ahead = ((self.settings.index_steps - self.lock().drives[motor].rest_steps) * direction) as f64;
        let to_go = ahead.rem_euclid(per_revolution);
        // Less than half a step beyond the index still presses the switch.
        if per_revolution - to_go < 0.5 { 0 } else { to_go.round() as i64 }
    }

    /// As `steps_to_index`, but a switch that is pressed trips only after a whole revolution.
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

    /// The firmware has found the index at the present position. Angles count from here.
    pub(crate) fn count_from_here(&self) {
        let mut state = self.changing(self.clock.now_s());
        state.datum_steps = state.position(self.clock.now_s());
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    // Whole steps are exact in floating point, and these tests check that.
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
        assert_eq!(s.end(end), 800, "the firmware does not notice the lost steps");
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

    /// A camera whose thread is late asks where the shaft stood during an exposure that is over.
    #[test]
    fn where_the_shaft_stood_is_known_after_it_has_moved_on() {
        let s = shaft((500, 1));
        let end = go(&s, 0.0, 400);
        let instants: Vec<f64> = (0..50).map(|i| 0.02 * f64::from(i) * end).collect();
        let under_way: Vec<f64> = instants.iter().map(|t| s.angle_at_rad(*t)).collect();
        s.end(end);
        let later = go(&s, end + 1.0, -250);
        s.replan(end + 1.0 + 0.5 * (later - end - 1.0), Arc::new(MotionProfile::braking(125.0, 100.0, 2000.0, 250.0)));
        s.push(10);
        let afterwards: Vec<f64> = instants.iter().map(|t| s.angle_at_rad(*t)).collect();
        assert_eq!(afterwards, under_way);
        assert_eq!(s.angle_at_rad(end + 0.5), s.steps_to_rad(537.0), "between the moves");
    }

    #[test]
    fn a_specimen_in_water_stays_behind_by_a_constant_angle_and_catches_up_at_rest() {
        let s = shaft((500, 1));
        let end = go(&s, 0.0, 2000);
        let lag_s = 0.016;
        s.set_water_lag(lag_s);
        // 800 steps/s after a ramp of 0.4 s.
        for at_s in [0.6, 1.0, 2.0] {
            let behind = s.angle_at_rad(at_s) - s.seen_at_rad(at_s);
            let expected = s.steps_to_rad(800.0) * lag_s;
            // The parts leave out half of a percent, the oldest past.
            assert!((behind / expected - 1.0).abs() < 0.01, "{behind} of {expected}");
        }
        s.end(end);
        assert!((s.angle_at_rad(end + 1.0) - s.seen_at_rad(end + 1.0)).abs() < 1e-9);
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
