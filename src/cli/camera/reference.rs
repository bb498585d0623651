//! `carved camera empty` and `flat-field`: the mean of some frames as a PNG, with a JSON file beside it that records time, settings and
//! identity.
//!
//! Frames are compared with the picture of the empty capillary (`[optics] empty_capillary`), which contains lamp, glass and dirt. A flat
//! field contains the lamp alone. The segmentation models the lamp by itself, and the empty capillary describes it better, so a flat field
//! is stored but not applied.

use super::{Configured, average, cancelled_by_signals};
use crate::config::Config;
use anyhow::{Context, ensure};
use carved_core::frame::RawFrame;
use carved_core::pipeline::Pipeline;
use carved_core::profile::{EmptyCapillary, Picture};
use carved_records::{Light, sha256_hex};
use carved_store::{Software, durable, frames};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    configured: Configured,
    /// PNG file to write; its metadata go into a `.json` beside it.
    #[arg(long)]
    out: PathBuf,
    /// Number of frames in the mean.
    #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..=1000))]
    frames: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Empty,
    FlatField,
}

/// The JSON file beside the picture.
#[derive(serde::Serialize)]
struct Facts {
    schema: &'static str,
    software: Software,
    kind: Kind,
    /// RFC 3339, UTC.
    taken: String,
    camera: String,
    exposure_us: f64,
    gain: Option<f64>,
    gain_raw: Option<i64>,
    frames: u32,
    light: Light,
    /// SHA-256 of the PNG file.
    file_sha256: String,
    /// SHA-256 of the raw pixels, called `empty_capillary_sha256` in `run.json` and `recording.json`.
    pixels_sha256: String,
}

/// Largest accepted share of saturated pixels: a reference frame must not be saturated.
const MANY_SATURATED: f64 = 0.01;

pub fn run(args: &Args, kind: Kind) -> anyhow::Result<()> {
    let (config, settings) = args.configured.load()?;
    let facts_file = args.out.with_extension("json");
    for file in [&args.out, &facts_file] {
        ensure!(
            !file.exists(),
            "{} exists; references are kept, not overwritten: choose another name, as with today's date",
            file.display()
        );
    }
    let cancel = cancelled_by_signals()?;
    let lamp = super::light(&config, &cancel)?;
    let (camera, taken) = average::take(&settings, args.frames, &cancel)?;
    drop(lamp);
    let frame = average::mean(&taken)?;
    let light = Light::of(&frame);
    ensure!(
        light.saturated <= MANY_SATURATED,
        "{:.1} % of the pixels are saturated; at most {:.0} % can be: `carved camera exposure` finds a shorter exposure",
        100.0 * light.saturated,
        100.0 * MANY_SATURATED
    );
    if kind == Kind::Empty {
        is_empty(&config, &frame)?;
    }
    let png = frames::encode(&frame)?;
    let facts = Facts {
        schema: "carved.reference_frame/1",
        software: Software::this(),
        kind,
        taken: jiff::Timestamp::now().to_string(),
        camera,
        exposure_us: settings.exposure_us,
        gain: settings.gain,
        gain_raw: settings.gain_raw,
        frames: args.frames,
        light,
        file_sha256: sha256_hex(&png),
        pixels_sha256: sha256_hex(frame.bytes()),
    };
    durable::write(&args.out, &png)?;
    durable::write(&facts_file, &durable::json_text(&facts_file, &facts)?)?;
    say!("{}", serde_json::to_string(&facts)?);
    let next = match kind {
        Kind::Empty => {
            format!("beside the configuration file, put this into [optics]:  empty_capillary = {:?}", args.out.display().to_string())
        }
        Kind::FlatField => {
            "stored. Frames are compared with the empty capillary, which holds the lamp too; a flat field is applied nowhere".into()
        }
    };
    note!("{next}");
    Ok(())
}

/// Segments the picture as a method does: it must show two walls and nothing between them.
fn is_empty(config: &Config, frame: &RawFrame) -> anyhow::Result<()> {
    for (name, method) in &config.methods {
        let of_method = || format!("method {name:?}");
        EmptyCapillary::new(Picture::from_frame(frame), &method.segment.walls)
            .context("no capillary is seen; bring it into the picture, or look at the light")
            .with_context(of_method)?;
        let seen = Pipeline::new(method.pipeline(&config.optics, false)?)?.look(frame)?;
        if let Ok(profile) = &seen.profile {
            let found = profile.detection.skip_reason();
            ensure!(
                found == Some("empty"),
                "{}: the capillary is not empty, there is {} in it; flush it and take the picture again",
                of_method(),
                found.unwrap_or("a specimen")
            );
        }
    }
    Ok(())
}
