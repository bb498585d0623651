//! `carved camera exposure`: finds the longest exposure at which almost no pixel of the background is saturated.
//!
//! ```text
//! expose ── top of the background (99.5th percentile) ── x target / top ──► again, until it is at the target
//!              └─ at 255: the excess is not measurable; x 1/3
//! ```

use super::{Configured, average, cancelled_by_signals};
use anyhow::{bail, ensure};
use carved_core::frame::RawFrame;
use carved_devices::camera::AravisSettings;
use carved_devices::cancel::CancelToken;
use carved_records::Light;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    configured: Configured,
    /// Target level of the brightest half per cent of the pixels, 0 to 255.
    #[arg(long, default_value_t = TARGET)]
    target: f64,
}

/// The printed result.
#[derive(serde::Serialize)]
pub struct FoundExposure {
    camera: String,
    /// The value for `[camera] exposure_us`.
    pub exposure_us: f64,
    /// Level of the brightest half per cent.
    pub top: f64,
    light: Light,
    looks: u32,
}

/// The usual target level, 0 to 255.
pub const TARGET: f64 = 240.0;
/// Maximum number of frames: four decades of light take seven.
const LOOKS: u32 = 15;
/// Tolerance of the level: flicker of the lamp and noise of the sensor change it by about as much.
const NEAR: f64 = 3.0;

pub fn run(args: &Args) -> anyhow::Result<()> {
    ensure!((50.0..=250.0).contains(&args.target), "--target is {}; from 50 to 250 is just under saturation", args.target);
    let (config, settings) = args.configured.load()?;
    let cancel = cancelled_by_signals()?;
    let _lamp = super::light(&config, &cancel)?;
    let found = find(settings, args.target, &cancel)?;
    say!("{}", serde_json::to_string(&found)?);
    note!("put this into [camera]:  exposure_us = {:.1}", found.exposure_us);
    Ok(())
}

/// Finds the exposure at which the brightest half per cent of the pixels has the level `target`.
///
/// # Errors
/// The camera's, a cancelled token, too little light, and light that does not follow the exposure.
pub fn find(mut settings: AravisSettings, target: f64, cancel: &CancelToken) -> anyhow::Result<FoundExposure> {
    let longest_us = f64::from(settings.frame_timeout_ms) * 500.0;
    for looks in 1..=LOOKS {
        let (camera, frames) = average::take(&settings, 1, cancel)?;
        let Some(frame) = frames.first() else { bail!("the camera gave no frame") };
        let top = top(frame);
        if (top - target).abs() <= NEAR {
            return Ok(FoundExposure { camera, exposure_us: settings.exposure_us, top, light: Light::of(frame), looks });
        }
        let next_us = next(&settings, top, target);
        ensure!(
            next_us <= longest_us,
            "too little light: {next_us:.0} us of exposure would do, half of frame_timeout_ms is {longest_us:.0} us; turn the lamp or the gain up"
        );
        settings.exposure_us = next_us;
    }
    bail!(
        "no exposure holds the background at {} within {NEAR}: after {LOOKS} looks it is at {} us; is the lamp steady?",
        target,
        settings.exposure_us
    )
}

/// The next exposure, in proportion to the measured level unless that is saturated, us.
fn next(settings: &AravisSettings, top: f64, target: f64) -> f64 {
    let factor = if top >= 254.5 { 1.0 / 3.0 } else { (target / top.max(1.0)).min(20.0) };
    // Rounded to 0.1 us, so that the configuration gets exactly the value that was tested.
    (settings.exposure_us * factor * 10.0).round() / 10.0
}

/// Level that is exceeded by half a per cent of the pixels.
pub fn top(frame: &RawFrame) -> f64 {
    let mut histogram = [0usize; 256];
    frame.bytes().iter().for_each(|b| histogram[usize::from(*b)] += 1);
    let mut above = 0;
    let at = (0..256).rev().find(|&level| {
        above += histogram[level];
        above * 200 >= frame.bytes().len()
    });
    at.unwrap_or(0) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::frame::PixelFormat;

    #[test]
    fn the_top_leaves_half_a_per_cent_above_it() {
        let mut bytes = vec![100u8; 1000];
        bytes[..4].fill(255);
        let frame = |bytes: &[u8]| RawFrame::new(1000, 1, PixelFormat::Mono8, bytes.to_vec()).unwrap();
        assert!((top(&frame(&bytes)) - 100.0).abs() < 1e-12);
        bytes[4] = 250;
        assert!((top(&frame(&bytes)) - 250.0).abs() < 1e-12);
    }
}
