//! Comparison of the controller's own settings with the configuration. All differences are reported at once.

use super::geometry::Geometry;
use super::report::Line;
use super::{DEVICE, Grbl, GrblPin, Reference};
use crate::{DeviceError, Difference};
use std::collections::BTreeMap;

/// Rounding of the controller, which prints three decimals.
const PRINTED: f64 = 0.0006;

/// The value of a setting that the answer to `$$` lacks.
const NOT_REPORTED: &str = "not reported";

/// Time for which the motors keep their current after a move, ms; 255 means always.
const IDLE_DELAY: u16 = 1;
const FOR_EVER_MS: u32 = 255;
/// grblHAL: one bit for each motor that keeps its current after that time.
const KEPT_POWERED: u16 = 37;
const STATUS_MASK: u16 = 10;
const INCHES: u16 = 13;
const HOMING: u16 = 22;
const LASER_MODE: u16 = 32;
pub(super) const FULL_SPEED: u16 = 30;
const HOMING_DIRECTIONS: u16 = 23;
const PULL_OFF: u16 = 27;
const STEPS_PER_UNIT: u16 = 100;
const MAX_RATE: u16 = 110;
const ACCELERATION: u16 = 120;
const TRAVEL: u16 = 130;

/// Values of `$$` by their numbers.
pub(super) type ControllerSettings = BTreeMap<u16, f64>;

impl Grbl {
    /// Compares `$$` with the configuration. A difference must be read twice, because a disturbed line can change a number or hide
    /// another line.
    pub(super) fn compare_settings(&mut self) -> Result<(), DeviceError> {
        let mut differences = Vec::new();
        for _ in 0..2 {
            let found = self.read_settings()?;
            differences = self.differences(&found);
            if differences.is_empty() {
                self.memory_erased = false;
                self.controller_settings = found;
                return Ok(());
            }
        }
        if self.memory_erased {
            let erased = Difference::new("settings memory", "kept", "erased, as the controller reports (error:7)");
            differences.insert(0, erased);
        }
        // The firmware reports every setting. Lines that are missing twice were taken by somebody else, or lost on the way.
        let missing: Vec<&str> = differences.iter().filter(|d| d.found == NOT_REPORTED).map(|d| d.name.as_str()).collect();
        if missing.is_empty() || self.memory_erased {
            return Err(DeviceError::Mismatch { device: DEVICE, differences });
        }
        let found = format!("it lacks {}", missing.join(", "));
        Err(DeviceError::Unreadable { device: DEVICE, request: "$$".into(), found, remedy: self.link.exit_the_other() })
    }

    fn read_settings(&mut self) -> Result<ControllerSettings, DeviceError> {
        let mut found = ControllerSettings::new();
        self.command("$$", self.settings.answer_timeout(), |line| {
            if let Line::Setting { number, value } = line {
                found.insert(number, value);
            }
        })?;
        Ok(found)
    }

    fn differences(&self, found: &ControllerSettings) -> Vec<Difference> {
        let mut differences = Vec::new();
        let axes = self.axes().iter().map(|axis| 1 << axis.letter.index()).sum::<u32>();
        let kept = self.is_hal && found.get(&KEPT_POWERED).is_some_and(|mask| *mask as u32 & axes == axes);
        let mut hold = |number: u16, name: &str, configured: String, agrees: &dyn Fn(f64) -> bool| {
            let value = found.get(&number).copied();
            if !value.is_some_and(agrees) {
                let found = value.map_or_else(|| NOT_REPORTED.into(), |v| v.to_string());
                differences.push(Difference::new(format!("${number} ({name})"), configured, found));
            }
        };
        let or_kept = if self.is_hal { format!(", or {axes} in $37") } else { String::new() };
        let powered = format!("255{or_kept}: a motor without current does not hold the capillary while it is exposed");
        hold(IDLE_DELAY, "step idle delay, ms", powered, &|ms| kept || ms as u32 == FOR_EVER_MS);
        hold(STATUS_MASK, "status report", "odd, to report machine positions".into(), &|mask| mask as u32 & 1 == 1);
        hold(INCHES, "report in inches", "0".into(), &|inches| inches == 0.0);
        if self.settings.reference == Reference::Home || self.slide.is_some() {
            hold(HOMING, "homing", "on (odd)".into(), &|homing| homing as u32 & 1 == 1);
        }
        if self.settings.outputs.values().any(|output| output.pin == GrblPin::Spindle) {
            hold(LASER_MODE, "laser mode", "0: in laser mode the spindle output is off unless a G1 is executed".into(), &|mode| {
                mode == 0.0
            });
            hold(FULL_SPEED, "spindle speed at full output", "more than 0".into(), &|speed| speed > 0.0);
        }
        for axis in self.axes() {
            let n = axis.letter.index();
            let steps = axis.steps_per_unit();
            let (rate, acceleration) = (axis.max_rate_units_per_min, axis.acceleration_units_per_s2);
            hold(STEPS_PER_UNIT + n, "steps per unit", format!("{steps:.3}"), &|v| (v - steps).abs() <= PRINTED);
            hold(MAX_RATE + n, "maximum rate, units/min", format!("at least {rate:.3}"), &|v| v >= rate - PRINTED);
            hold(ACCELERATION + n, "acceleration, units/s^2", format!("at least {acceleration:.3}"), &|v| v >= acceleration - PRINTED);
        }
        differences
    }

    /// The controller's own acceleration of an axis, units/s^2; `None` before its settings were read.
    pub(super) fn acceleration(&self, axis: &Geometry) -> Option<f64> {
        self.controller_settings.get(&(ACCELERATION + axis.letter.index())).copied()
    }

    /// The machine step at which a homing cycle ends by the controller's own settings; `None` if it does not report all of them.
    pub(super) fn homed_at(&self, axis: &Geometry) -> Option<i64> {
        let n = axis.letter.index();
        let [pull_off, directions, travel] =
            [PULL_OFF, HOMING_DIRECTIONS, TRAVEL + n].map(|number| self.controller_settings.get(&number).copied());
        let units = if self.zero_at_home {
            0.0
        } else if directions? as u32 >> n & 1 == 1 {
            pull_off? - travel?
        } else {
            -pull_off?
        };
        Some((units * axis.steps_per_unit()).round() as i64)
    }
}
