//! The true slide: where along the image x axis the capillary really stands. The controller's own count may differ from it.
//!
//! ```text
//!   - <──┤ end ────────────── in view ─────────── switch ├──> +        0 is the reference switch
//!        │                       │                  │
//!     limit switch        the scene's middle    reference and limit switch
//! ```
//! The scene is shifted along x by the distance of the slide from `in_view_um`.

use crate::clock::RigClock;
use crate::motion::MotionProfile;
use crate::scene::Exposure;
use crate::sight::{PixelFormat, Pixels, Sight};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Motor, spindle and travel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlideSettings {
    /// Steps of this number of um, as an exact ratio.
    pub steps_per_um: (u32, u32),
    /// Distance from the reference switch to the other end, um.
    pub travel_um: f64,
    /// Position at which the middle of the capillary is the middle of the scene, um from the reference switch.
    pub in_view_um: f64,
    /// Position when the rig is switched on, um from the reference switch.
    pub power_on_um: f64,
}

impl Default for SlideSettings {
    /// The 21.333 microsteps per um of a published rig.
    fn default() -> Self {
        Self { steps_per_um: (64, 3), travel_um: 20_000.0, in_view_um: -5000.0, power_on_um: -1234.5 }
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

#[derive(Debug)]
struct State {
    rest_steps: i64,
    motion: Option<Motion>,
}

/// One slide with its stepper motor. The firmware moves it, and the scene moves with it.
#[derive(Debug)]
pub struct Slide {
    clock: RigClock,
    settings: SlideSettings,
    state: Mutex<State>,
}

impl Slide {
    /// A slide at rest.
    pub fn new(clock: RigClock, settings: SlideSettings) -> Self {
        let rest_steps = (settings.power_on_um * per_um(&settings)).round() as i64;
        Self { clock, settings, state: Mutex::new(State { rest_steps, motion: None }) }
    }

    /// The true position, um from the reference switch.
    pub fn position_um(&self) -> f64 {
        let state = self.lock();
        let issued = state.motion.as_ref().map_or(0.0, |m| issued(m, self.clock.now_s()));
        (state.rest_steps as f64 + issued) / per_um(&self.settings)
    }

    /// The shift of the scene along x, um.
    pub fn shift_um(&self) -> f64 {
        self.position_um() - self.settings.in_view_um
    }

    /// Begins a move of `steps`, spread evenly over a path of length `path`. `profile` has the same unit of length.
    pub(crate) fn begin(&self, start_s: f64, steps: i64, path: f64, profile: Arc<MotionProfile>) {
        self.end(start_s);
        self.lock().motion = Some(Motion { start_s, steps, path, profile });
    }

    /// Continues the move in progress with another profile of the same path.
    pub(crate) fn replan(&self, start_s: f64, profile: Arc<MotionProfile>) {
        if let Some(motion) = &mut self.lock().motion {
            motion.start_s = start_s;
            motion.profile = profile;
        }
    }

    /// Ends the move at its position at `now_s`. Returns the whole steps that were issued.
    pub(crate) fn end(&self, now_s: f64) -> i64 {
        let mut state = self.lock();
        let Some(motion) = state.motion.take() else { return 0 };
        let steps = issued(&motion, now_s).round() as i64;
        state.rest_steps += steps;
        steps
    }

    /// Steps of the standing slide until the limit switch in `direction` (1 or -1) trips. It is 0 if the switch is pressed.
    pub(crate) fn steps_to_end(&self, direction: i64) -> i64 {
        let end = if direction > 0 { 0 } else { -(self.settings.travel_um * per_um(&self.settings)).round() as i64 };
        ((end - self.lock().rest_steps) * direction).max(0)
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn per_um(settings: &SlideSettings) -> f64 {
    f64::from(settings.steps_per_um.0) / f64::from(settings.steps_per_um.1)
}

fn issued(motion: &Motion, now_s: f64) -> f64 {
    motion.steps as f64 * (motion.profile.travelled(now_s - motion.start_s) / motion.path)
}

/// A scene that moves with the slide.
pub(crate) struct OnSlide {
    pub sight: Arc<dyn Sight>,
    pub slide: Arc<Slide>,
}

impl Sight for OnSlide {
    fn size(&self) -> (u32, u32) {
        self.sight.size()
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        self.sight.slide_to(self.slide.shift_um());
        self.sight.look(exposure, format)
    }

    fn look_along(&self, exposure: &Exposure, path_rad: &dyn Fn(f64) -> f64, format: PixelFormat) -> Pixels {
        self.sight.slide_to(self.slide.shift_um());
        self.sight.look_along(exposure, path_rad, format)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slide_rests_on_whole_steps_and_has_a_limit_at_both_ends() {
        let slide = Slide::new(RigClock::new(1.0), SlideSettings { power_on_um: -3.0, ..SlideSettings::default() });
        assert_eq!((slide.steps_to_end(1), slide.steps_to_end(-1)), (64, 426_667 - 64));
        let profile = MotionProfile::trapezoid(64.0, 800.0, 2000.0);
        let end_s = profile.duration_s();
        slide.begin(0.0, -64, 64.0, Arc::new(profile));
        assert_eq!(slide.end(end_s), -64);
        assert!((slide.position_um() + 6.0).abs() < 1e-9);
        assert_eq!(slide.steps_to_end(1), 128);
    }
}
