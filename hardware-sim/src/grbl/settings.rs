//! The `$` settings. They are stored in the EEPROM and survive every reset.

use super::dialect::Dialect;
use std::collections::BTreeMap;

/// Settings that Grbl prints as integers.
const INTEGERS: [u16; 15] = [0, 1, 2, 3, 4, 5, 6, 10, 20, 21, 22, 23, 26, 30, 31];
pub(super) const LASER_MODE: u16 = 32;
/// grblHAL: bit mask of the motors that keep their current after the time of `$1`.
const KEPT_POWERED: u16 = 37;

/// The value of `$1`, ms, with which the motors always keep their current.
const ALWAYS_POWERED_MS: f32 = 255.0;

/// The settings of one controller, by their numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    values: BTreeMap<u16, f32>,
}

impl Default for Settings {
    /// A rotation axis on X with 500 steps per revolution. 1 unit is 100 steps, so that every whole step is exact with three decimals.
    /// Motors keep their current ($1=255), and there is a reference switch ($22=1).
    fn default() -> Self {
        let mut values: BTreeMap<u16, f32> = [
            (0, 10.0),
            (1, 255.0),
            (2, 0.0),
            (3, 0.0),
            (4, 0.0),
            (5, 0.0),
            (6, 0.0),
            (10, 1.0),
            (11, 0.010),
            (12, 0.002),
            (13, 0.0),
            (20, 0.0),
            (21, 0.0),
            (22, 1.0),
            (23, 0.0),
            (24, 25.0),
            (25, 500.0),
            (26, 25.0),
            (27, 0.05),
            (30, 1000.0),
            (31, 0.0),
            (LASER_MODE, 0.0),
            (KEPT_POWERED, 0.0),
        ]
        .into();
        for axis in 0..3 {
            values.insert(100 + axis, 100.0);
            values.insert(110 + axis, 500.0);
            values.insert(120 + axis, 20.0);
            values.insert(130 + axis, 10.0);
        }
        Self { values }
    }
}

impl Settings {
    /// The values after the settings memory was erased. They are compiled into the firmware.
    pub(super) fn factory() -> Self {
        let mut settings = Self::default();
        settings.values.extend([(1, 25.0), (22, 0.0), (27, 1.0), (26, 250.0)]);
        for axis in 0..3 {
            settings.values.extend([(100 + axis, 250.0), (110 + axis, 500.0), (120 + axis, 10.0), (130 + axis, 200.0)]);
        }
        settings
    }

    /// The value of a setting. It is 0 if there is no such setting.
    pub fn get(&self, number: u16) -> f32 {
        self.values.get(&number).copied().unwrap_or(0.0)
    }

    /// How long the motor of an axis keeps its current after a move, s. `None` if it always keeps it.
    pub(super) fn idle_s(&self, axis: usize, dialect: Dialect) -> Option<f64> {
        let kept = dialect.is_hal() && self.get(KEPT_POWERED) as u32 >> axis & 1 == 1;
        let idle_ms = self.get(1);
        (idle_ms < ALWAYS_POWERED_MS && !kept).then(|| f64::from(idle_ms) / 1000.0)
    }

    /// Whether a setting is not 0.
    pub fn is_on(&self, number: u16) -> bool {
        self.get(number) != 0.0
    }

    /// The values for the axes X, Y and Z, whose settings begin at `base`.
    pub(super) fn per_axis(&self, base: u16) -> [f32; 3] {
        [self.get(base), self.get(base + 1), self.get(base + 2)]
    }

    /// Converts positions of the axes X, Y and Z from steps to units.
    pub(super) fn to_units(&self, steps: [i64; 3]) -> [f32; 3] {
        let per_unit = self.per_axis(100);
        std::array::from_fn(|i| steps[i] as f32 / per_unit[i])
    }

    /// Stores a setting as the firmware does.
    ///
    /// # Errors
    /// The error number of Grbl.
    pub fn set(&mut self, number: u16, value: f32) -> Result<(), u8> {
        if !self.values.contains_key(&number) {
            return Err(3);
        }
        if value < 0.0 {
            return Err(4);
        }
        if number == 0 && value < 3.0 {
            return Err(6);
        }
        if number == 20 && value != 0.0 && !self.is_on(22) {
            return Err(10);
        }
        if number == 22 && value == 0.0 {
            self.values.insert(20, 0.0);
        }
        let stored = if is_integer(number) { value.trunc() } else { value };
        self.values.insert(number, stored);
        Ok(())
    }

    /// The answer to `$$`.
    pub(super) fn report(&self, dialect: Dialect) -> String {
        self.values
            .iter()
            .filter(|(n, _)| **n != KEPT_POWERED || dialect.is_hal())
            .map(|(n, v)| if is_integer(*n) { format!("${n}={}\r\n", *v as i64) } else { format!("${n}={v:.3}\r\n") })
            .collect()
    }
}

fn is_integer(number: u16) -> bool {
    number == LASER_MODE || number == KEPT_POWERED || INTEGERS.contains(&number)
}
