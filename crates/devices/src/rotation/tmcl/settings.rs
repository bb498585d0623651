//! The `[rotation]` table of a Trinamic module with a pair of motors.

use crate::DeviceError;
use crate::outputs::{self, OutputSettings, OutputTable, SETTLE_MOST_MS};
use crate::rotation::driver::serial_driver;
use crate::rotation::knowledge::travel_time;
use crate::rotation::{Port, Reference};
use crate::setting::{ANSWER_MOST_MS, BAUD_LEAST, BAUD_MOST, HOMING_MOST_MS, in_range};
use carved_core::range::{OutOfRange, Range, Ranged, outside_in};
use carved_core::ranges;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// How a Trinamic module is connected, and the settings that it must have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct TmclSettings {
    /// Serial port, by its name or by its USB adapter's serial number.
    pub port: Port,
    /// Speed of the serial line; without effect on USB. The module's own is its global parameter 65. With the factory setting of 9600 every
    /// look at the pair takes 0.1 s.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// The module's serial address.
    #[serde(default = "default_module_address")]
    pub module_address: u8,
    /// The address to which the module answers.
    #[serde(default = "default_host_address")]
    pub host_address: u8,
    /// The two motors at the ends of the capillary. Where they face each other, parameter 251 of one of them reverses its sense.
    #[serde(default = "default_motors")]
    pub motors: [u8; 2],
    /// Parameter 140: 2^n microsteps per full step.
    pub microstep_resolution: u8,
    /// Parameter 4, in the module's own unit: microsteps/s, or a fraction of its clock.
    pub max_speed: u32,
    /// Parameter 5, in the module's own unit.
    pub max_acceleration: u32,
    /// Parameters 154 and 153 of a module with speeds in fractions of its clock. Leave them out if its unit is microsteps/s.
    #[serde(default)]
    pub clock_divisors: Option<ClockDivisors>,
    /// Largest permitted difference between the two motors, microsteps: the largest twist of the glass.
    pub max_skew_steps: u32,
    /// Parameter 181, the lowest speed at which a stall stops a motor. If it is left out, stalls are not detected.
    #[serde(default)]
    pub stop_on_stall: Option<u32>,
    /// How step 0 is found.
    pub reference: Reference,
    /// Longest wait for an answer, ms.
    #[serde(default = "default_answer_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub answer_timeout_ms: u32,
    /// Longest reference search, ms.
    #[serde(default = "default_homing_timeout_ms")]
    #[cfg_attr(feature = "schema", schemars(extend("x-level" = "expert")))]
    pub homing_timeout_ms: u32,
    /// Outputs that switch a light or a valve, by name: lower-case letters, digits and `_`.
    #[serde(default, skip_serializing_if = "OutputTable::is_empty")]
    pub outputs: OutputTable<TmclPin>,
}

/// The number of a digital output in bank 2 (`SIO`, `GIO`): 0 is `OUT_0`. The modules have up to 8; a module refuses one that it lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(transparent)]
pub struct TmclPin(pub u8);

impl carved_core::range::Numbers for TmclPin {
    fn numbers(&self) -> Vec<f64> {
        vec![self.0.into()]
    }
}

impl Ranged for OutputSettings<TmclPin> {
    const RANGES: &'static [Range<Self>] = ranges![
        pin: 0.0, 7.0, "(number of the output)";
        settle_ms: 0.0, SETTLE_MOST_MS, "ms";
    ];
}

/// The divisors of the 16 MHz clock in a module of the TMC428/429 family.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(transform = carved_core::range::in_schema::<Self>))]
#[serde(deny_unknown_fields)]
pub struct ClockDivisors {
    /// Parameter 154.
    pub pulse: u8,
    /// Parameter 153.
    pub ramp: u8,
}

fn default_baud() -> u32 {
    115_200
}

fn default_module_address() -> u8 {
    1
}

fn default_host_address() -> u8 {
    2
}

fn default_motors() -> [u8; 2] {
    [0, 1]
}

fn default_answer_timeout_ms() -> u32 {
    200
}

fn default_homing_timeout_ms() -> u32 {
    30_000
}

/// Longest time of a module from a request to its answer.
const MODULE_TIME: Duration = Duration::from_millis(3);
/// Requests of two looks at the pair: three counters and the mark each.
const EXCHANGES_OF_TWO_LOOKS: u32 = 8;
/// Requests that start both motors and stop one again.
const EXCHANGES_APART: u32 = 3;
/// Clock of the TMC428/429, Hz.
const CLOCK_HZ: f64 = 16.0e6;
/// Largest value of a parameter of the module.
const PARAMETER_MOST: f64 = i32::MAX as f64;

impl Ranged for TmclSettings {
    const RANGES: &'static [Range<Self>] = ranges![
        baud: BAUD_LEAST, BAUD_MOST, "baud";
        module_address: 0.0, 255.0, "(address)";
        host_address: 0.0, 255.0, "(address)";
        motors: 0.0, 255.0, "(number)";
        // 2^8 = 256 microsteps.
        microstep_resolution: 0.0, 8.0, "(exponent of 2)";
        max_speed: 1.0, PARAMETER_MOST, "(the module's unit)";
        max_acceleration: 1.0, PARAMETER_MOST, "(the module's unit)";
        max_skew_steps: 1.0, PARAMETER_MOST, "microsteps";
        stop_on_stall: 1.0, PARAMETER_MOST, "(the module's unit of speed)";
        answer_timeout_ms: 1.0, ANSWER_MOST_MS, "ms";
        homing_timeout_ms: 1.0, HOMING_MOST_MS, "ms";
    ];

    fn outside_below(&self) -> Vec<OutOfRange> {
        let divisors = self.clock_divisors.iter().flat_map(|divisors| outside_in("clock_divisors", divisors));
        divisors.chain(outputs::outside(&self.outputs)).collect()
    }
}

impl Ranged for ClockDivisors {
    const RANGES: &'static [Range<Self>] = ranges![
        pulse: 0.0, 13.0, "(exponent of 2)";
        ramp: 0.0, 13.0, "(exponent of 2)";
    ];
}

impl TmclSettings {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that is out of range, or a skew that one motor exceeds before both can be started.
    pub fn check(&self) -> Result<(), DeviceError> {
        in_range(super::DEVICE, self)?;
        outputs::check(super::DEVICE, &self.outputs)?;
        let bad = |name: &str, found, rule| Err(DeviceError::Setting { device: super::DEVICE, name: name.into(), found, rule });
        if self.motors[0] == self.motors[1] {
            return bad("motors", format!("{:?}", self.motors), "each end of the capillary has its own motor".into());
        }
        let (apart_ms, needed_ms) = (self.apart_s() * 1e3, (EXCHANGES_APART * self.exchange_time()).as_secs_f64() * 1e3);
        if apart_ms < needed_ms {
            let found = format!("{}, which one motor turns in {apart_ms:.1} ms at max_speed", self.max_skew_steps);
            let rule = format!(
                "to start both motors and to stop one again takes {needed_ms:.1} ms at {} baud: allow {:.0} steps, or lower max_speed or \
                 raise baud",
                self.baud,
                (needed_ms * 1e-3 * self.rates().0).ceil()
            );
            return bad("max_skew_steps", found, rule);
        }
        Ok(())
    }

    /// Microsteps/s and microsteps/s^2. For fractions of the clock by the formulas of the TMC429 data sheet.
    pub(super) fn rates(&self) -> (f64, f64) {
        self.rates_at(self.max_speed)
    }

    /// The same for another speed in the module's own unit.
    pub(super) fn rates_at(&self, speed: u32) -> (f64, f64) {
        let (speed, acceleration) = (f64::from(speed), f64::from(self.max_acceleration));
        match self.clock_divisors {
            None => (speed, acceleration),
            Some(ClockDivisors { pulse, ramp }) => {
                let (pulse, ramp) = (i32::from(pulse), i32::from(ramp));
                (speed * CLOCK_HZ / (2_f64.powi(pulse) * 2048.0 * 32.0), acceleration * CLOCK_HZ.powi(2) / 2_f64.powi(pulse + ramp + 29))
            }
        }
    }

    /// A speed in the module's own unit; `None` above `max_speed`, or if it rounds to 0.
    pub(super) fn speed(&self, steps_per_s: f64) -> Option<u32> {
        let speed = (steps_per_s / self.rates_at(1).0).round();
        (speed >= 1.0 && speed <= f64::from(self.max_speed)).then_some(speed as u32)
    }

    /// The longest time that a healthy module needs for a move.
    pub(super) fn travel_time(&self, steps: i64) -> Duration {
        self.travel_time_at(steps, self.max_speed)
    }

    /// The same for a move with another speed in the module's own unit.
    pub(super) fn travel_time_at(&self, steps: i64, speed: u32) -> Duration {
        let (steps_per_s, steps_per_s2) = self.rates_at(speed);
        travel_time(steps, steps_per_s, steps_per_s2) + self.answer_timeout()
    }

    /// The time in which one motor alone reaches the permitted skew at full speed, s.
    fn apart_s(&self) -> f64 {
        f64::from(self.max_skew_steps) / self.rates().0
    }

    /// Longest time for both acknowledgements, which leaves enough time to stop the pair again.
    pub(super) fn start_time(&self) -> Duration {
        let apart = Duration::try_from_secs_f64(self.apart_s()).unwrap_or(Duration::MAX);
        apart.saturating_sub(self.exchange_time()).min(self.answer_timeout())
    }

    /// Longest time without a look at a turning pair, before it is stopped: the time to reach the permitted skew, but at least the time of
    /// two looks.
    pub(super) fn blind_time(&self) -> Duration {
        self.start_time().max(EXCHANGES_OF_TWO_LOOKS * self.exchange_time())
    }

    /// Time of a request on the wire, its answer, and the module between them.
    pub(super) fn exchange_time(&self) -> Duration {
        let bits = 2.0 * 10.0 * super::frame::BYTES as f64;
        Duration::from_secs_f64(bits / f64::from(self.baud)) + MODULE_TIME
    }
}

serial_driver!(TmclSettings, super::Tmcl::link, |settings, _| super::Tmcl::open(settings));

#[cfg(test)]
mod tests {
    use super::*;

    pub fn settings() -> TmclSettings {
        toml::from_str(
            "port = \"p\"\nmicrostep_resolution = 5\nmax_speed = 1000\nmax_acceleration = 500\nmax_skew_steps = 80\nreference = \"here\"",
        )
        .unwrap()
    }

    #[test]
    fn a_module_that_counts_in_its_clock_is_given_the_time_that_its_data_sheet_says() {
        // 1000 * 16e6 / (2^5 * 65536) = 7629.4 microsteps/s; 500 * 2.56e14 / 2^(5 + 7 + 29) = 58 208 microsteps/s^2.
        let clocked = TmclSettings { clock_divisors: Some(ClockDivisors { pulse: 5, ramp: 7 }), ..settings() };
        let (speed, acceleration) = clocked.rates();
        assert!((speed - 7629.4).abs() < 0.1 && (acceleration - 58_207.7).abs() < 0.1, "{speed} {acceleration}");
        assert!(clocked.travel_time(6400) < settings().travel_time(6400));
    }

    #[test]
    fn what_no_module_can_have_is_named() {
        settings().check().unwrap();
        for (broken, name) in [
            (TmclSettings { motors: [1, 1], ..settings() }, "motors"),
            (TmclSettings { microstep_resolution: 9, ..settings() }, "microstep_resolution"),
            (TmclSettings { max_skew_steps: 0, ..settings() }, "max_skew_steps"),
            (TmclSettings { stop_on_stall: Some(0), ..settings() }, "stop_on_stall"),
            (TmclSettings { clock_divisors: Some(ClockDivisors { pulse: 14, ramp: 0 }), ..settings() }, "clock_divisors.pulse"),
            (TmclSettings { baud: 0, ..settings() }, "baud"),
        ] {
            assert!(matches!(broken.check(), Err(DeviceError::Setting { name: found, .. }) if found == name), "{name}");
        }
    }

    #[test]
    fn a_pair_that_comes_apart_before_both_are_commanded_is_refused_with_both_times() {
        // 8 steps at 1000 steps/s are 8 ms; three exchanges at 115200 baud are 3 * (180 bits + 3 ms).
        let said = TmclSettings { max_skew_steps: 8, ..settings() }.check().unwrap_err().to_string();
        for part in ["max_skew_steps = 8,", "8.0 ms", "13.7 ms", "115200 baud", "14 steps"] {
            assert!(said.contains(part), "{part} is not in: {said}");
        }
        TmclSettings { max_skew_steps: 14, ..settings() }.check().unwrap();
        assert!(TmclSettings { max_skew_steps: 14, baud: 9600, ..settings() }.check().is_err());
    }
}
