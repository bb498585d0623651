//! The folder of a rig's calibrations, written by `carved calibrate beads` and `scale`. Finds the one that is valid.
//!
//! ```text
//! DATA/calibrations/calibration-DAY-ID.json   from beads     the newest of this rig and mode counts
//!                   scale-DAY-ID.json         from a scale
//!                   marked-DAY-ID.json        sense and mirror: no scale, it does not expire
//! ```

use super::{StoreError, disk, durable};
use carved_records::{CalibrationStatus, Mode, is_fresh, is_of_the_future};
use serde::Deserialize;
use std::path::Path;

pub const BEADS_SCHEMA: &str = "carved.calibration-beads/1";
pub const SCALE_SCHEMA: &str = "carved.calibration-scale/1";

/// The common part of these files. The rest depends on the schema.
#[derive(Debug, Deserialize)]
struct Kept {
    schema: String,
    #[serde(flatten)]
    rest: serde_json::Value,
}

/// The common part of calibrations from beads and from a scale. The optional fields exist only for beads.
#[derive(Debug, Deserialize)]
struct OfSize {
    id: String,
    rig: String,
    mode: Mode,
    measured: jiff::Timestamp,
    diameter_um: Option<Mean>,
    against: Option<Nominal>,
}

#[derive(Debug, Deserialize)]
struct Mean {
    mean: f64,
}

#[derive(Debug, Deserialize)]
struct Nominal {
    nominal_um: f64,
    /// What the beads show, by their material. `None` in files of earlier versions.
    expected_um: Option<f64>,
}

/// The newest calibration of a rig's scale.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCalibration {
    pub id: String,
    /// `beads` or `scale`.
    pub kind: &'static str,
    pub measured: jiff::Timestamp,
    /// Deviation of the beads' mean diameter from the one that beads of their material show, percent. `None` for a scale.
    pub bead_bias_percent: Option<f64>,
}

impl RigCalibration {
    fn age_s(&self, now: jiff::Timestamp) -> f64 {
        now.duration_since(self.measured).as_secs_f64()
    }

    /// The calibration as the status shows it at the time `now`.
    pub fn status(self, max_age_days: f64, now: jiff::Timestamp) -> CalibrationStatus {
        let age_s = self.age_s(now);
        let max_age_s = max_age_days * 86400.0;
        CalibrationStatus {
            id: self.id,
            kind: self.kind.to_owned(),
            measured: self.measured.to_string(),
            age_s,
            max_age_s,
            bead_bias_percent: self.bead_bias_percent,
            valid: is_fresh(age_s, max_age_s),
            gate: None,
        }
    }
}

/// The newest calibration of this rig in the folder. A file that cannot be read is logged and skipped.
///
/// # Errors
/// The folder exists and cannot be listed.
pub fn newest(folder: &Path, rig: &str, mode: Mode) -> Result<Option<RigCalibration>, StoreError> {
    let now = jiff::Timestamp::now();
    let mut newest: Option<RigCalibration> = None;
    for path in disk::watched(false, || durable::json_files(folder))? {
        match disk::watched(false, || of_rig(&path, rig, mode)) {
            // The clock was set back. A calibration of today must not be outranked by it.
            Ok(Some(c)) if is_of_the_future(c.age_s(now)) => {
                tracing::warn!(path = %path.display(), measured = %c.measured, "a calibration that is later than the clock is passed over");
            }
            // The id makes the choice between equal times unique, because a folder has no order.
            Ok(Some(c)) if newest.as_ref().is_none_or(|n| (c.measured, &c.id) > (n.measured, &n.id)) => newest = Some(c),
            Ok(_) => {}
            Err(error) => tracing::warn!(%error, "a calibration is passed over"),
        }
    }
    Ok(newest)
}

fn of_rig(path: &Path, rig: &str, mode: Mode) -> Result<Option<RigCalibration>, StoreError> {
    let Kept { schema, rest }: Kept = durable::read_json(path, "what carved calibrate leaves")?;
    let kind = match schema.as_str() {
        BEADS_SCHEMA => "beads",
        SCALE_SCHEMA => "scale",
        _ => return Ok(None),
    };
    let format = |e: serde_json::Error| StoreError::Format { path: path.to_owned(), expected: "a rig's calibration", found: e.to_string() };
    let OfSize { id, rig: of, mode: made, measured, diameter_um, against } = serde_json::from_value(rest).map_err(format)?;
    let bead_bias_percent = diameter_um.zip(against).map(|(d, a)| 100.0 * (d.mean / a.expected_um.unwrap_or(a.nominal_um) - 1.0));
    Ok((of == rig && made == mode).then_some(RigCalibration { id, kind, measured, bead_bias_percent }))
}
