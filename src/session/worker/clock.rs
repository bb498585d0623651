//! Times of a well. They are kept apart from the numbers, which do not depend on any clock.
//!
//! ```text
//! load | position | detect | revolve | reconstruct |  measure            phases_s
//! -----+----------+--------+---------+-------------+- eject | wash
//! own_s = all of them - motors, exposures, loader and sampler (devices_s)
//! ```

use carved_records::WellTimes;
use carved_store::{RecordingWriter, StoreError};
use serde::Serialize;
use std::time::Instant;

/// Runs `work` and counts its time as time of a device.
pub fn of_device<T>(times: &mut WellTimes, work: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    let result = work();
    times.device(began.elapsed());
    result
}

/// Time of each processing stage, per view and for the surface, in ms.
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
    /// Estimates that the method's rule for an early end asks for.
    #[serde(rename = "estimate_ms")]
    pub estimate: Times,
    /// Encoding of the live pictures.
    #[serde(rename = "live_ms")]
    pub live: Times,
    #[serde(rename = "calibrate_ms")]
    pub calibrate: Times,
    #[serde(rename = "surface_ms")]
    pub surface: Times,
}

/// Name of the file with the times of a specimen, in its recording.
pub const TIMINGS: &str = "timings.json";

/// Content of `timings.json`.
#[derive(Debug, Serialize)]
pub struct Timings<'a> {
    #[serde(flatten)]
    pub stages: &'a StageClock,
    #[serde(flatten)]
    pub well: &'a WellTimes,
}

/// Writes `timings.json` for a specimen whose numbers were computed after a restart, unless the file exists.
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
