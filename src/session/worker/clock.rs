//! Where the time of a well went. Kept apart from the numbers, which no clock touches.
//!
//! ```text
//! load | position | detect | revolve | reconstruct |  measure            phases_s
//! -----+----------+--------+---------+-------------+- eject | wash
//! own_s = all of them - motors, exposures, loader and sampler (devices_s)
//! ```

use crate::session::Phase;
use crate::store::{RecordingWriter, StoreError};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};
use utoipa::ToSchema;

/// Where the time of a well went, s. Phases add up to more than the well took where two of them went on side by side.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
pub struct WellTimes {
    /// By the phase's name.
    pub phases_s: BTreeMap<String, f64>,
    /// Of that, what motors, rests, exposures and who brings and takes specimens took.
    pub devices_s: f64,
    /// The rest: what the program itself took.
    pub own_s: f64,
    /// Turns that were begun of the specimen.
    pub attempts: u32,
}

impl WellTimes {
    /// Adds the time of a phase.
    pub fn phase(&mut self, phase: Phase, took: Duration) {
        *self.phases_s.entry(phase.name().into()).or_default() += took.as_secs_f64();
        if matches!(phase, Phase::Load | Phase::Eject | Phase::Wash) {
            self.devices_s += took.as_secs_f64();
        }
        self.own_s = self.phases_s.values().sum::<f64>() - self.devices_s;
    }

    /// Says that so much of a phase was a device's.
    pub fn device(&mut self, took: Duration) {
        self.devices_s += took.as_secs_f64();
        self.own_s -= took.as_secs_f64();
    }

    /// Does what a device takes its time for.
    pub fn of_device<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let began = Instant::now();
        let result = work();
        self.device(began.elapsed());
        result
    }
}

/// Per view and for the surface, ms.
#[derive(Debug, Default, Serialize)]
pub struct StageClock {
    #[serde(rename = "store_ms")]
    pub store: Times,
    #[serde(rename = "profile_ms")]
    pub profile: Times,
    #[serde(rename = "carve_ms")]
    pub carve: Times,
    #[serde(rename = "refine_ms")]
    pub refine: Times,
    /// What the method's rule for an early end is asked with.
    #[serde(rename = "estimate_ms")]
    pub estimate: Times,
    /// Encoding what the page shows.
    #[serde(rename = "live_ms")]
    pub live: Times,
    #[serde(rename = "calibrate_ms")]
    pub calibrate: Times,
    #[serde(rename = "surface_ms")]
    pub surface: Times,
}

/// Beside a specimen's numbers.
pub const TIMINGS: &str = "timings.json";

/// `timings.json`.
#[derive(Debug, Serialize)]
pub struct Timings<'a> {
    #[serde(flatten)]
    pub stages: &'a StageClock,
    #[serde(flatten)]
    pub well: &'a WellTimes,
}

/// Writes the `timings.json` of a specimen whose numbers were made by another life than its views, where none is there.
pub fn add_timings(writer: &mut RecordingWriter, well: &WellTimes) -> Result<(), StoreError> {
    if writer.has(TIMINGS) {
        return Ok(());
    }
    writer.add_json(TIMINGS, &Timings { stages: &StageClock::default(), well })
}

#[derive(Debug, Default, Serialize)]
#[serde(transparent)]
pub struct Times(Vec<f64>);

impl Times {
    pub fn time<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let began = Instant::now();
        let result = work();
        self.0.push(began.elapsed().as_secs_f64() * 1e3);
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn own_time_is_what_devices_leave() {
        let mut times = WellTimes::default();
        let s = Duration::from_secs;
        times.phase(Phase::Load, s(30));
        times.device(s(3));
        times.phase(Phase::Revolve, s(4));
        times.phase(Phase::Measure, s(2));
        times.phase(Phase::Eject, s(5));
        assert!((times.own_s - 3.0).abs() < 1e-9 && (times.devices_s - 38.0).abs() < 1e-9, "{times:?}");
    }
}
