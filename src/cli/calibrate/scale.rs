//! `carved calibrate scale`: kx and ky with their standard deviations, and the lines to put into the configuration.
//!
//! ```text
//!  --micrometer UM,PX,..  ── kx      --micrometer-across UM,PX,.. ── ky
//!  --bead-um D  BEADS     ── kx, ky of length and width
//!  --bore-um W  RECORDINGS ── ky of the walls
//! ```

use super::beads::each;
use super::keep;
use super::measured;
use anyhow::{Context, ensure};
use carved_core::calibration::rig::{self, RigError, Scale};
use carved_core::measure::references::limb::BeadMaterial;
use carved_core::statistics::Spread;
use carved_records::Mode;
use carved_store::calibrations::SCALE_SCHEMA;
use serde::Serialize;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("ruler").required(true).args(["micrometer", "bead_um", "bore_um"])))]
pub struct Args {
    /// Distances on a stage micrometer along the capillary: known um, measured px, repeated
    #[arg(long, value_name = "UM,PX,..", value_delimiter = ',', requires = "reading_px", requires = "rig")]
    micrometer: Vec<f64>,
    /// The same across the capillary
    #[arg(long, value_name = "UM,PX,..", value_delimiter = ',', requires = "micrometer")]
    micrometer_across: Vec<f64>,
    /// Standard deviation of one distance read in the picture
    #[arg(long, value_name = "PX")]
    reading_px: Option<f64>,
    /// Standard deviation of the micrometer's scale
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0)]
    micrometer_sd_percent: f64,
    /// Name of the rig; needed only without recordings
    #[arg(long, value_name = "NAME", conflicts_with_all = ["bead_um", "bore_um"])]
    rig: Option<String>,
    /// Certified mean diameter of the beads
    #[arg(long, value_name = "UM", requires = "bead_sd", requires = "recordings")]
    bead_um: Option<f64>,
    /// Standard deviation of this mean, from the certificate; more beads do not reduce it
    #[arg(long, value_name = "UM")]
    bead_sd: Option<f64>,
    /// Standard deviation of single beads around the mean, from the certificate
    #[arg(long, value_name = "UM", default_value_t = 0.0)]
    bead_spread: f64,
    /// What the beads are made of: polystyrene, pmma, glass, opaque or unknown. Clear beads look smaller than they are
    #[arg(long, value_name = "NAME", default_value = "unknown")]
    bead_material: BeadMaterial,
    /// Certified inner diameter of the capillary
    #[arg(long, value_name = "UM", requires = "recordings")]
    bore_um: Option<f64>,
    /// Its standard deviation
    #[arg(long, value_name = "UM", default_value_t = 0.0)]
    bore_sd: f64,
    /// Recordings (`runs/RUN/A01`) or whole runs (`runs/RUN`)
    #[arg(value_name = "RECORDING_OR_RUN", conflicts_with = "micrometer")]
    recordings: Vec<PathBuf>,
    /// Folder for a dated file in addition to the output
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report {
    schema: &'static str,
    id: String,
    /// When this was computed, RFC 3339.
    date: String,
    /// When the newest recording was made; for a micrometer, when this was computed.
    measured: jiff::Timestamp,
    #[serde(flatten)]
    found: MeasuredScale,
}

/// What was measured. The id is the hash of this.
#[derive(Serialize)]
struct MeasuredScale {
    rig: String,
    mode: Mode,
    ruler: &'static str,
    /// Readings or recordings, along and across.
    n: [usize; 2],
    kx_px_per_um: Option<f64>,
    kx_sd_px_per_um: Option<f64>,
    kx_sd_percent: Option<f64>,
    ky_px_per_um: Option<f64>,
    ky_sd_px_per_um: Option<f64>,
    ky_sd_percent: Option<f64>,
    /// The larger of both. The standard deviation of the volume is three times this value.
    scale_sd_percent: f64,
    toml: Vec<String>,
}

/// Computes the scale and prints it.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let now = jiff::Timestamp::now();
    let (found, measured) = match (args.bead_um, args.bore_um) {
        (Some(known), _) => bead(args, known)?,
        (_, Some(known)) => bore(args, known)?,
        _ => (micrometer(args)?, now),
    };
    let report = Report { schema: SCALE_SCHEMA, id: measured::id(&found)?, date: now.to_string(), measured, found };
    if let Some(folder) = &args.out {
        keep::keep(folder, "scale", measured, &report.id, &report)?;
    }
    say!("{}", serde_json::to_string_pretty(&report)?);
    Ok(())
}

fn micrometer(args: &Args) -> anyhow::Result<MeasuredScale> {
    let reading_px = args.reading_px.context("--reading-px is missing: the error of one distance read in the picture")?;
    let of = |option: &str, numbers: &[f64]| -> anyhow::Result<Scale> {
        let (pairs, odd) = numbers.as_chunks::<2>();
        ensure!(odd.is_empty(), "{option}: {} numbers; expected pairs of um and px, an even number", numbers.len());
        let scale = rig::from_micrometer(pairs, reading_px, args.micrometer_sd_percent / 100.0).with_context(|| option.to_owned())?;
        // A distance that was misread by a whole division would distort the result.
        for [um, px] in pairs {
            let expected = scale.k * um;
            ensure!(
                (px / expected - 1.0).abs() <= 0.1,
                "{option}: {um} um is seen as {px} px, but all distances together make it {expected:.1} px, more than 10 % off: read it again"
            );
        }
        Ok(scale)
    };
    let along = of("--micrometer", &args.micrometer)?;
    let across = (!args.micrometer_across.is_empty()).then(|| of("--micrometer-across", &args.micrometer_across)).transpose()?;
    let rig = args.rig.clone().context("--rig is missing")?;
    // A micrometer cannot be under an emulated camera.
    Ok(MeasuredScale::new(
        (rig, Mode::Hardware),
        "micrometer",
        [args.micrometer.len() / 2, args.micrometer_across.len() / 2],
        Some(along),
        across,
    ))
}

fn bead(args: &Args, known_um: f64) -> anyhow::Result<(MeasuredScale, jiff::Timestamp)> {
    let known_sd_um = args.bead_sd.context("--bead-sd is missing: the certificate's standard deviation")?;
    let set = measured::read(&args.recordings, true)?;
    let diameters = each(&set.recordings, "diameter_um", |m| m.file.record.measurement.diameter_um)?;
    let aspects = each(&set.recordings, "aspect_ratio", |m| m.file.record.measurement.aspect_ratio)?;
    let (mut lengths, mut widths) = (Vec::new(), Vec::new());
    for ((bead, diameter), aspect) in set.recordings.iter().zip(diameters).zip(aspects) {
        let [length, width] = rig::bead_extents(diameter, aspect).with_context(|| bead.path.display().to_string())?;
        lengths.push(length);
        widths.push(width);
    }
    let [looks_um, looks_sd_um] = args.bead_material.apparent_um(known_um);
    let of = |k, measured: &[f64]| {
        rig::from_known(k, measured, looks_um, known_sd_um.hypot(looks_sd_um), args.bead_spread).map_err(|e| hint(e, args))
    };
    let (along, across) = (of(set.camera.kx, &lengths)?, of(set.camera.ky, &widths)?);
    let measured = set.measured()?;
    Ok((MeasuredScale::new((set.rig, set.mode), "bead", [lengths.len(), widths.len()], Some(along), Some(across)), measured))
}

fn hint(error: RigError, args: &Args) -> anyhow::Error {
    let few = matches!(error, RigError::TooFew { .. }) && args.bead_um.is_some();
    let error = anyhow::Error::new(error);
    if few { error.context("one bead tells nothing of its scatter: measure it again, or give --bead-spread") } else { error }
}

fn bore(args: &Args, known_um: f64) -> anyhow::Result<(MeasuredScale, jiff::Timestamp)> {
    let set = measured::read(&args.recordings, false)?;
    let of_recording = |m: &measured::Measured| {
        let bores: Vec<f64> = m.file.record.views.iter().filter_map(|v| v.walls.map(|w| w.bore_um)).collect();
        let n = bores.len();
        let mean = Spread::of(&bores).map(|s| s.mean);
        mean.with_context(|| format!("{}: {n} of {} views show the walls", m.path.display(), m.file.record.views.len()))
    };
    // The views of one recording share its errors, so they count as one reading.
    let bores = set.recordings.iter().map(of_recording).collect::<anyhow::Result<Vec<_>>>()?;
    let across = rig::from_known(set.camera.ky, &bores, known_um, args.bore_sd, 0.0).map_err(|e| hint(e, args))?;
    let measured = set.measured()?;
    Ok((MeasuredScale::new((set.rig, set.mode), "bore", [0, bores.len()], None, Some(across)), measured))
}

impl MeasuredScale {
    fn new((rig, mode): (String, Mode), ruler: &'static str, n: [usize; 2], along: Option<Scale>, across: Option<Scale>) -> Self {
        let percent = |s: Option<Scale>| s.map(|s| 100.0 * s.sd / s.k);
        let scale_sd_percent = [percent(along), percent(across)].into_iter().flatten().fold(0.0, f64::max);
        let line = |key: &str, s: Option<Scale>| s.map(|s| format!("{key} = {:.9}   # +- {:.2e}, by {ruler}", s.k, s.sd));
        let mut toml = vec!["[optics]".to_owned()];
        toml.extend(line("kx_px_per_um", along));
        toml.extend(line("ky_px_per_um", across));
        toml.push("[methods.NAME.calibration]".into());
        toml.push(format!("scale_sd_percent = {scale_sd_percent:.4}"));
        Self {
            rig,
            mode,
            ruler,
            n,
            kx_px_per_um: along.map(|s| s.k),
            kx_sd_px_per_um: along.map(|s| s.sd),
            kx_sd_percent: percent(along),
            ky_px_per_um: across.map(|s| s.k),
            ky_sd_px_per_um: across.map(|s| s.sd),
            ky_sd_percent: percent(across),
            scale_sd_percent,
            toml,
        }
    }
}
