//! `carved calibrate beads`: what measured beads show about the rig, stored as a dated file.
//!
//! ```text
//!  measurement.json of beads ── diameter ──────── mean, SD, t against N(500, 25)
//!                            ├─ length over width ── ky / kx: water or air
//!                            └─ the turn's axis ──── uy, gamma        ── calibration-DAY-ID.json ── history
//! ```

use super::keep;
use super::measured::{self, Measured};
use anyhow::{Context, ensure};
use carved_core::calibration::rig::{self, Refraction};
use carved_core::measure::references::bead::BeadScore;
use carved_core::measure::references::limb::BeadMaterial;
use carved_core::statistics::Spread;
use carved_records::Mode;
use carved_store::calibrations::BEADS_SCHEMA;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Recordings (`runs/RUN/A01`) or whole runs (`runs/RUN`); recordings of other specimens are skipped
    #[arg(required = true, value_name = "RECORDING_OR_RUN")]
    recordings: Vec<PathBuf>,
    /// Nominal mean diameter of the beads
    #[arg(long, value_name = "UM", default_value_t = 500.0)]
    nominal_um: f64,
    /// Standard deviation of the batch around the nominal diameter
    #[arg(long, value_name = "UM", default_value_t = 25.0)]
    nominal_sd_um: f64,
    /// What the beads are made of: polystyrene, pmma, glass, opaque or unknown. Clear beads look smaller than they are
    #[arg(long, value_name = "NAME", default_value = "unknown")]
    bead_material: BeadMaterial,
    /// Folder for the dated file
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

/// Contents of `calibration-DAY-ID.json`.
#[derive(Debug, Serialize, Deserialize)]
pub struct BeadsFile {
    pub schema: String,
    pub id: String,
    /// When this was computed, RFC 3339.
    pub date: String,
    #[serde(flatten)]
    pub found: MeasuredBeads,
}

/// What the beads show. The id of the file is the hash of this.
#[derive(Debug, Serialize, Deserialize)]
pub struct MeasuredBeads {
    pub rig: String,
    pub mode: Mode,
    /// When the last bead was recorded, RFC 3339. Its day is in the file's name.
    pub measured: jiff::Timestamp,
    pub recordings: Vec<PathBuf>,
    pub diameter_um: Spread,
    pub sphere_rms_um: Option<Spread>,
    pub against: Against,
    /// Length along the capillary over width across it.
    pub aspect_ratio: Spread,
    pub refraction: Refraction,
    /// Row of the axis, px, of the turns that calibrated themselves. `None` if there is none.
    pub uy_px: Option<Spread>,
    /// Root mean square of the turns' own standard deviations, px: the expected `uy_px.sd` if the rig does not move.
    pub uy_turn_sd_px: Option<f64>,
    pub gamma_rad: Option<Spread>,
}

/// The measured mean diameter compared with the nominal one.
#[derive(Debug, Serialize, Deserialize)]
pub struct Against {
    pub nominal_um: f64,
    pub nominal_sd_um: f64,
    #[serde(default)]
    pub bead_material: BeadMaterial,
    /// Diameter that beads of this material show. `None` in files of earlier versions: the nominal one.
    pub expected_um: Option<f64>,
    /// Standard deviation of the scale from this number of beads of the batch, in per cent. The measurement itself cannot be better.
    pub scale_sd_percent: f64,
    /// The paper's t score with its critical value. `null` for fewer than three beads, or if all beads are equal.
    pub score: Option<serde_json::Value>,
}

/// Reads the beads, compares them with the nominal diameter, stores the file and prints it.
pub fn run(args: &Args) -> anyhow::Result<()> {
    for (option, um) in [("--nominal-um", args.nominal_um), ("--nominal-sd-um", args.nominal_sd_um)] {
        ensure!(um.is_finite() && um > 0.0, "{option} is {um}; expected a number above 0");
    }
    let found = find(args)?;
    let file = BeadsFile { schema: BEADS_SCHEMA.into(), id: measured::id(&found)?, date: jiff::Timestamp::now().to_string(), found };
    keep::keep(&args.out, "calibration", file.found.measured, &file.id, &file)?;
    say!("{}", serde_json::to_string_pretty(&file)?);
    Ok(())
}

fn find(args: &Args) -> anyhow::Result<MeasuredBeads> {
    let set = measured::read(&args.recordings, true)?;
    let beads = &set.recordings;
    let diameters = each(beads, "diameter_um", |m| m.file.record.measurement.diameter_um)?;
    let aspects = each(beads, "aspect_ratio", |m| m.file.record.measurement.aspect_ratio)?;
    let rms: Vec<f64> = beads.iter().filter_map(|m| m.file.record.measurement.sphere_rms_um).collect();
    let turns: Vec<_> = beads.iter().filter_map(|m| m.file.record.calibration.as_ref()).collect();
    let of_turns = |value: fn(&carved_core::reconstruction::CalibrationRecord) -> f64| turns.iter().map(|c| value(c)).collect::<Vec<_>>();
    let squares = of_turns(|c| c.uy_sd_px * c.uy_sd_px);
    let measured = set.measured()?;
    let [expected_um, _] = args.bead_material.apparent_um(args.nominal_um);
    let score = BeadScore::of(&diameters, expected_um).map(serde_json::to_value).transpose()?;
    Ok(MeasuredBeads {
        rig: set.rig,
        mode: set.mode,
        measured,
        recordings: beads.iter().map(|m| m.path.clone()).collect(),
        against: Against {
            nominal_um: args.nominal_um,
            nominal_sd_um: args.nominal_sd_um,
            bead_material: args.bead_material,
            expected_um: Some(expected_um),
            scale_sd_percent: 100.0 * args.nominal_sd_um / args.nominal_um / (beads.len() as f64).sqrt(),
            score,
        },
        diameter_um: spread(&diameters)?,
        sphere_rms_um: Spread::of(&rms),
        refraction: rig::refraction(&aspects, set.camera.ky / set.camera.kx)?,
        aspect_ratio: spread(&aspects)?,
        uy_px: Spread::of(&of_turns(|c| c.psi.uy)),
        uy_turn_sd_px: Spread::of(&squares).map(|s| s.mean.sqrt()),
        gamma_rad: Spread::of(&of_turns(|c| c.psi.gamma)),
    })
}

fn spread(values: &[f64]) -> anyhow::Result<Spread> {
    Spread::of(values).context("0 beads; 1 or more is expected")
}

/// The value of each bead. The error names a bead without this value.
pub fn each(beads: &[Measured], name: &str, value: impl Fn(&Measured) -> Option<f64>) -> anyhow::Result<Vec<f64>> {
    let one = |m: &Measured| {
        let found = value(m).with_context(|| {
            format!("{}: measurement.{name} is null: no sphere was fitted to this bead; leave it out", m.path.display())
        })?;
        ensure!(found.is_finite() && found > 0.0, "{}: measurement.{name} is {found}; expected a number above 0", m.path.display());
        Ok(found)
    };
    beads.iter().map(one).collect()
}
