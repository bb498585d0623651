//! The second axis of a Grbl controller, which moves the capillary along the picture.
//!
//! ```text
//! $H ─┬─ rotation: step 0, a new epoch
//!     └─ translation: step 0                 reference = "here" for the rotation: $H and its letter alone
//! ```
//! A port has one owner, so both axes are one [`Grbl`]. If one position becomes suspect, both do.

use super::geometry::Geometry;
use super::settings::{FASTEST, SLOWEST};
use super::{Grbl, Knowledge, Reference};
use crate::cancel::CancelToken;
use crate::rotation::AxisLetter;
use crate::setting::in_range;
use crate::{Achieved, DeviceError, LinearAxis, Position};
use carved_core::range::{Range, Ranged};
use carved_core::ranges;
use carved_core::units::{Sense, Steps};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// The `[translation]` table. Lengths are counted from the reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct TranslationSettings {
    /// The axis that moves the capillary.
    pub axis: AxisLetter,
    /// Motor steps per um as an exact ratio `[num, den]`.
    pub steps_per_um: [u32; 2],
    /// Length of the controller's unit, um. The controller reports thousandths of a unit, which must resolve a step.
    pub um_per_unit: u32,
    /// Speed of every move, units/min. The controller must allow it ($111 for Y).
    pub max_rate_units_per_min: f64,
    /// Acceleration the controller must reach, units/s^2 ($121 for Y).
    pub acceleration_units_per_s2: f64,
    /// First and last permitted position, um.
    pub limits_um: [f64; 2],
    /// Position at which the specimen is in view, um.
    pub position_um: f64,
    /// Which way positive positions move the capillary: 1 if to the right of the picture, -1 if to the left.
    #[serde(default)]
    pub sense: Sense,
}

/// Furthest position from the reference that is meant, um: 10 m.
const FURTHEST_UM: f64 = 1e7;

impl Ranged for TranslationSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        steps_per_um: 1.0, u32::MAX as f64, "(ratio of steps and um)";
        um_per_unit: 1.0, 1e6, "um";
        max_rate_units_per_min: SLOWEST, FASTEST, "units/min";
        acceleration_units_per_s2: SLOWEST, FASTEST, "units/s^2";
        limits_um: -FURTHEST_UM, FURTHEST_UM, "um";
        position_um: -FURTHEST_UM, FURTHEST_UM, "um";
    ];
}

impl TranslationSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range.
    pub fn check(&self) -> Result<(), DeviceError> {
        const DEVICE: &str = "translation axis";
        in_range(DEVICE, self)?;
        let bad = |name: &str, found, rule: &str| Err(DeviceError::Setting { device: DEVICE, name: name.into(), found, rule: rule.into() });
        let [num, den] = self.steps_per_um;
        let per_unit = f64::from(num) * f64::from(self.um_per_unit) / f64::from(den);
        if per_unit > super::settings::MOST_STEPS_PER_UNIT || self.ratio().is_none() {
            let found = format!("[{num}, {den}] with um_per_unit = {}", self.um_per_unit);
            return bad("steps_per_um", found, "a unit must be at most 400 steps");
        }
        let [low, high] = self.limits_um;
        if low >= high {
            return bad("limits_um", format!("[{low}, {high}]"), "the first must be below the second");
        }
        if !(low..=high).contains(&self.position_um) {
            return bad("position_um", self.position_um.to_string(), "it must be within limits_um");
        }
        Ok(())
    }

    fn ratio(&self) -> Option<[u32; 2]> {
        Some([self.steps_per_um[0].checked_mul(self.um_per_unit)?, self.steps_per_um[1]])
    }

    fn geometry(&self) -> Geometry {
        Geometry {
            letter: self.axis,
            // `check` has refused ratios that overflow.
            steps_per_unit: self.ratio().unwrap_or([u32::MAX, 1]),
            max_rate_units_per_min: self.max_rate_units_per_min,
            acceleration_units_per_s2: self.acceleration_units_per_s2,
        }
    }

    /// The position of a step, um from the reference.
    pub fn um(&self, steps: Steps) -> f64 {
        steps.0 as f64 * f64::from(self.steps_per_um[1]) / f64::from(self.steps_per_um[0])
    }

    fn steps(&self, um: f64) -> Steps {
        Steps((um * f64::from(self.steps_per_um[0]) / f64::from(self.steps_per_um[1])).round() as i64)
    }
}

/// The state of this axis in the driver.
pub(super) struct Slide {
    settings: TranslationSettings,
    pub knowledge: Knowledge,
    /// The machine step of step 0.
    origin: i64,
}

impl Slide {
    pub fn new(settings: TranslationSettings) -> Self {
        Self { settings, knowledge: Knowledge::none_of("translation axis"), origin: 0 }
    }

    pub fn geometry(&self) -> Geometry {
        self.settings.geometry()
    }
}

fn refused(why: &(impl ToString + ?Sized)) -> DeviceError {
    DeviceError::Translation { why: why.to_string() }
}

impl Grbl {
    /// Makes the position after a homing cycle the step 0 of the second axis, if there is one.
    pub(super) fn confirm_slide_homed(&mut self) -> Result<(), DeviceError> {
        let Some(axis) = self.slide.as_ref().map(Slide::geometry) else { return Ok(()) };
        let origin = self.homed_origin(&axis)?;
        if let Some(slide) = &mut self.slide {
            slide.origin = origin;
            slide.knowledge.begin_epoch();
        }
        Ok(())
    }

    fn slide(&mut self) -> Result<&mut Slide, DeviceError> {
        self.slide.as_mut().ok_or_else(|| refused("the configuration has no [translation]"))
    }

    fn slide_from(&mut self) -> Result<(TranslationSettings, i64, Steps), DeviceError> {
        let slide = self.slide()?;
        match slide.knowledge.known_steps() {
            Ok(at) => Ok((slide.settings, slide.origin, at)),
            Err(DeviceError::Suspect { why }) => Err(refused(&format!("its position cannot be trusted ({why})"))),
            Err(_) => Err(refused("not referenced; its position is not known, so it refuses to move")),
        }
    }
}

impl LinearAxis for Grbl {
    fn reference(&mut self, cancel: &CancelToken) -> Result<Achieved, DeviceError> {
        if let Ok((_, _, at)) = self.slide_from() {
            return Ok(self.slide()?.knowledge.arrived(at));
        }
        // If all axes home together, the rotation's reference has homed this axis, or has failed.
        if self.settings.reference == Reference::Home {
            self.slide_from()?;
        }
        self.release(cancel)?;
        match self.home_slide() {
            Ok(()) => Ok(self.slide()?.knowledge.arrived(Steps(0))),
            Err(error) => {
                self.doubt(&error);
                Err(error)
            }
        }
    }

    fn move_to(&mut self, target: Steps) -> Result<Achieved, DeviceError> {
        let (settings, origin, from) = self.slide_from()?;
        let [low, high] = settings.limits_um.map(|um| settings.steps(um));
        if !(low..=high).contains(&target) {
            return Err(refused(&format!("sent to {target}, its limits are {low} and {high}")));
        }
        match self.travel(&settings.geometry(), origin + from.0, origin + target.0, origin) {
            Ok(()) => Ok(self.slide()?.knowledge.arrived(target)),
            Err(error) => {
                self.doubt(&error);
                Err(match error {
                    DeviceError::Missed { .. } | DeviceError::Suspect { .. } => refused(&error),
                    other => other,
                })
            }
        }
    }

    fn limits(&self) -> [Steps; 2] {
        self.slide.as_ref().map_or([Steps(0); 2], |s| s.settings.limits_um.map(|um| s.settings.steps(um)))
    }

    fn position(&self) -> Position {
        self.slide.as_ref().map_or(Position::Unknown, |slide| slide.knowledge.position())
    }

    fn steps_of(&self, um: f64) -> Steps {
        self.slide.as_ref().map_or(Steps(0), |s| s.settings.steps(um))
    }
}

impl Grbl {
    fn home_slide(&mut self) -> Result<(), DeviceError> {
        let Some(axis) = self.slide.as_ref().map(Slide::geometry) else { return Err(refused("the configuration has no [translation]")) };
        self.identify()?;
        self.catch_up()?;
        self.check_free()?;
        self.home(&format!("$H{:?}", axis.letter))?;
        self.confirm_slide_homed()
    }

    /// The machine step at which an axis rests after a homing cycle.
    pub(super) fn homed_origin(&mut self, axis: &Geometry) -> Result<i64, DeviceError> {
        let until = Instant::now() + self.settings.answer_timeout();
        let origin = self.origin(axis, until)?;
        self.confirm_homed(axis, origin)?;
        // Read twice, because every later position depends on it.
        self.confirm(axis, origin, origin, until)?;
        Ok(origin)
    }
}
