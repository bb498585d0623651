//! The conversion between the controller's units and whole steps, for one axis.

use super::report::Status;
use super::settings::{AxisLetter, GrblSettings};
use std::time::Duration;

/// Scale and dynamics of an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Geometry {
    pub letter: AxisLetter,
    /// An exact ratio.
    pub steps_per_unit: [u32; 2],
    pub max_rate_units_per_min: f64,
    pub acceleration_units_per_s2: f64,
}

impl Geometry {
    pub fn of(settings: &GrblSettings) -> Self {
        Self {
            letter: settings.axis,
            steps_per_unit: settings.steps_per_unit,
            max_rate_units_per_min: settings.max_rate_units_per_min,
            acceleration_units_per_s2: settings.acceleration_units_per_s2,
        }
    }

    pub fn steps_per_unit(&self) -> f64 {
        f64::from(self.steps_per_unit[0]) / f64::from(self.steps_per_unit[1])
    }

    /// The speed of every move, steps/s.
    pub fn steps_per_s(&self) -> f64 {
        self.max_rate_units_per_min / 60.0 * self.steps_per_unit()
    }

    /// The same axis with a lower speed, which a line states in thousandths; `None` above its own speed or below what a line can state.
    pub fn slowed(&self, steps_per_s: f64) -> Option<Self> {
        let rate = (steps_per_s / self.steps_per_unit() * 60.0 * 1e3).round() / 1e3;
        (rate > 0.0 && rate <= self.max_rate_units_per_min).then_some(Self { max_rate_units_per_min: rate, ..*self })
    }

    /// Machine steps as the controller's units.
    pub fn units(&self, machine_steps: i64) -> f64 {
        machine_steps as f64 * f64::from(self.steps_per_unit[1]) / f64::from(self.steps_per_unit[0])
    }

    /// The machine step at a reported position; `None` if the position lies between two steps, which no healthy controller reports.
    pub fn machine_steps(&self, units: f64) -> Option<i64> {
        let steps = units * self.steps_per_unit();
        // Half a thousandth of a unit from printing, 2^-23 of the value from float32 in the controller, and room for its
        // own rounding of steps per unit.
        let tolerance = 0.0005 * self.steps_per_unit() + steps.abs() * 3.0e-7 + 0.05;
        ((steps - steps.round()).abs() <= tolerance.min(0.45)).then(|| steps.round() as i64)
    }

    /// The machine position in a report, in units; `None` if the report has none.
    pub fn units_of(&self, status: &Status) -> Option<f64> {
        status.machine.as_ref()?.get(usize::from(self.letter.index())).copied()
    }

    /// The longest time that a healthy controller needs for a move: a trapezoid of speed, plus a tenth for rounding.
    pub fn travel_time(&self, steps: i64) -> Duration {
        let per_second = self.max_rate_units_per_min / 60.0;
        let seconds = self.units(steps).abs() / per_second + per_second / self.acceleration_units_per_s2;
        // A day is longer than any turn, and Duration can hold it.
        Duration::from_secs_f64((1.1 * seconds).min(86_400.0))
    }

    /// The line that moves the axis to a machine step: absolute, in machine coordinates. It has all its modes, because another program may have
    /// left others in force: units (G21), distance (G90), feed per minute (G94).
    pub fn line(&self, machine_steps: i64) -> String {
        format!("G21G90G94G53G1{:?}{}F{:.3}", self.letter, three_decimals(self.units(machine_steps)), self.max_rate_units_per_min)
    }
}

/// Three decimals and no minus zero.
pub(super) fn three_decimals(units: f64) -> String {
    let text = format!("{units:.3}");
    if text == "-0.000" { "0.000".into() } else { text }
}
