//! The rig's own calibration: scale and refraction. It takes values and returns values.
//!
//! ```text
//!  micrometer   known um, seen px ──────────── weighted k ── the larger of stated and found scatter ─┐
//!  bead, bore   k of today, measured, known ── k measured / known ── certificate, scatter of repeats ┴─ k +- sd, px/um
//!  bead         length over width ── ky / kx: 1.000 behind water, 1.333 behind air
//! ```
//! Silhouettes do not determine `kx` and `ky`: an object of known size must be laid under the camera.

use crate::statistics::Spread;
use serde::{Deserialize, Serialize};

/// ky over kx where air surrounds a capillary with water within: the refractive index of water. Where water surrounds it, the
/// ratio is 1.
pub const KY_OVER_KX_IN_AIR: f64 = 1.333;
/// Largest difference of a bead's length over width from 1. A bead beyond it is no sphere to the fit, and its diameter is no
/// length.
pub const ASPECT_OFF_MOST: f64 = 0.02;
/// Largest difference of ky over kx from the value for water or air at which it still counts as that.
const REFRACTION_WITHIN: f64 = 0.01;

/// A scale and its standard deviation, px/um.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Scale, px/um.
    pub k: f64,
    /// Standard deviation, px/um.
    pub sd: f64,
}

/// The ratio of the scales across and along the capillary, from beads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Refraction {
    /// ky over kx of the camera that the beads were measured with.
    pub ky_over_kx_configured: f64,
    /// ky over kx that makes the beads' length and width equal.
    pub ky_over_kx: f64,
    /// Standard deviation of `ky_over_kx`, of the mean over the beads. `None` for one bead.
    pub ky_over_kx_sd: Option<f64>,
    /// Factor for the configured ky, if kx is right.
    pub ky_factor: f64,
    /// What the ratio means, in a sentence.
    pub words: String,
}

/// Why a scale or a ratio cannot be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RigError {
    /// A value is out of its range.
    #[error("{what} is {found}; expected {expected}")]
    Value {
        /// Name of the value, with its unit.
        what: &'static str,
        /// The value.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// Too few values.
    #[error("{found} {what}; {needed} or more are needed")]
    TooFew {
        /// What there are too few of.
        what: &'static str,
        /// Their number.
        found: usize,
        /// The number needed.
        needed: usize,
    },
    /// A bead is not round to the fit.
    #[error(
        "length over width of a bead is {found:.4}, more than {ASPECT_OFF_MOST} off 1: kx and ky do not belong together; correct ky (carved calibrate beads tells by how much) and measure again"
    )]
    NotRound {
        /// Its length over its width.
        found: f64,
    },
}

fn positive(what: &'static str, found: f64) -> Result<f64, RigError> {
    if found.is_finite() && found > 0.0 { Ok(found) } else { Err(RigError::Value { what, found, expected: "a number above 0" }) }
}

fn not_negative(what: &'static str, found: f64) -> Result<f64, RigError> {
    if found.is_finite() && found >= 0.0 { Ok(found) } else { Err(RigError::Value { what, found, expected: "0 or more" }) }
}

/// Scale from known distances, each with its length in the image: (um, px).
///
/// A reading error in px gives longer distances more weight, by their square: k = sum(um px) / sum(um^2). The standard
/// deviation is the larger of what the stated error `reading_px` makes and what the repeats show, and beside it that of the
/// ruler, `ruler_sd` (relative).
///
/// # Errors
///
/// [`RigError`] where there is no reading, or a value is out of its range.
pub fn from_micrometer(readings: &[[f64; 2]], reading_px: f64, ruler_sd: f64) -> Result<Scale, RigError> {
    if readings.is_empty() {
        return Err(RigError::TooFew { what: "readings of the micrometer", found: 0, needed: 1 });
    }
    positive("the reading error in px", reading_px)?;
    not_negative("the micrometer's own error as a share", ruler_sd)?;
    for [um, px] in readings {
        positive("a known distance in um", *um)?;
        positive("a measured distance in px", *px)?;
    }
    let squares: f64 = readings.iter().map(|[um, _]| um * um).sum();
    let k = readings.iter().map(|[um, px]| um * px).sum::<f64>() / squares;
    let misfit: f64 = readings.iter().map(|[um, px]| (px - k * um).powi(2)).sum();
    let found_px = if readings.len() > 1 { (misfit / (readings.len() as f64 - 1.0)).sqrt() } else { 0.0 };
    Ok(Scale { k, sd: (reading_px.max(found_px) / squares.sqrt()).hypot(k * ruler_sd) })
}

/// Scale from an object of known size that was measured with the present scale `k`, px/um.
///
/// `known_sd_um` is the standard deviation of the certificate; it does not shrink with the number of measurements.
/// `batch_sd_um` is that of single objects about the certificate; it shrinks with their number, as the scatter of the measured
/// sizes does. The scatter contains it, so the larger one counts.
///
/// # Errors
///
/// [`RigError`] where there are too few sizes, or a value is out of its range.
pub fn from_known(k: f64, measured_um: &[f64], known_um: f64, known_sd_um: f64, batch_sd_um: f64) -> Result<Scale, RigError> {
    positive("the scale of today in px/um", k)?;
    positive("the certified size in um", known_um)?;
    not_negative("the certificate's standard deviation in um", known_sd_um)?;
    not_negative("the batch's standard deviation in um", batch_sd_um)?;
    for um in measured_um {
        positive("a measured size in um", *um)?;
    }
    let needed = if batch_sd_um > 0.0 { 1 } else { 2 };
    let Some(found) = Spread::of(measured_um).filter(|s| s.n >= needed) else {
        return Err(RigError::TooFew { what: "measured sizes", found: measured_um.len(), needed });
    };
    let scatter = found.sd.unwrap_or(0.0).max(batch_sd_um) / (found.n as f64).sqrt();
    let k = k * found.mean / known_um;
    Ok(Scale { k, sd: k * (scatter / found.mean).hypot(known_sd_um / known_um) })
}

/// Length and width of a bead, um, from the diameter of its sphere and its length over width.
///
/// The sphere nearest to a nearly round spheroid has a third of its diameter from the length: D = (L + 2 W) / 3. The error is
/// 0.2 times the square of the aspect's difference from 1, which is under 1e-4 within [`ASPECT_OFF_MOST`].
///
/// # Errors
///
/// [`RigError`] where the diameter is not above 0, or the bead is not round.
pub fn bead_extents(diameter_um: f64, aspect: f64) -> Result<[f64; 2], RigError> {
    positive("a bead's diameter in um", diameter_um)?;
    if aspect.is_nan() || (aspect - 1.0).abs() > ASPECT_OFF_MOST {
        return Err(RigError::NotRound { found: aspect });
    }
    let width = 3.0 * diameter_um / (2.0 + aspect);
    Ok([aspect * width, width])
}

/// ky over kx from the length over width of beads. A bead is round, so ky over kx is the configured ratio over the aspect.
///
/// # Errors
///
/// [`RigError`] where there is no bead, or a value is not above 0.
pub fn refraction(aspects: &[f64], ky_over_kx_configured: f64) -> Result<Refraction, RigError> {
    positive("ky over kx as configured", ky_over_kx_configured)?;
    for aspect in aspects {
        positive("a bead's length over its width", *aspect)?;
    }
    let aspect = Spread::of(aspects).ok_or(RigError::TooFew { what: "beads", found: 0, needed: 1 })?;
    let ky_over_kx = ky_over_kx_configured / aspect.mean;
    let ky_over_kx_sd = aspect.sd_of_mean().map(|sd| ky_over_kx * sd / aspect.mean);
    let within = REFRACTION_WITHIN.max(3.0 * ky_over_kx_sd.unwrap_or(0.0));
    let near = |nominal: f64| (ky_over_kx - nominal).abs() <= within;
    let words = match (near(1.0), near(KY_OVER_KX_IN_AIR)) {
        (true, true) => {
            format!("the beads scatter too much to tell water (1.000) from air ({KY_OVER_KX_IN_AIR}) around the capillary: measure more")
        }
        (true, false) => "water within and around the capillary (1.000): nothing refracts".into(),
        (false, true) => format!("air around a capillary with water within ({KY_OVER_KX_IN_AIR})"),
        (false, false) => format!(
            "neither water (1.000) nor air ({KY_OVER_KX_IN_AIR}) around the capillary: another liquid, a wall that is not round, or edges that are wrong along or across"
        ),
    };
    Ok(Refraction { ky_over_kx_configured, ky_over_kx, ky_over_kx_sd, ky_factor: 1.0 / aspect.mean, words })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: f64, wanted: f64) {
        assert!((found - wanted).abs() < 1e-9 * wanted.abs().max(1e-3), "{found} is not {wanted}");
    }

    // k = (1000 181 + 2000 364) / 5e6; misfits -0.8 and 0.4 px, 0.8 = 0.64 + 0.16; sqrt(5e6) = 2236.07 um.
    #[test]
    fn a_micrometer_weighs_longer_distances_and_takes_the_larger_scatter() {
        let readings = [[1000.0, 181.0], [2000.0, 364.0]];
        let scale = from_micrometer(&readings, 0.1, 0.0).unwrap();
        near(scale.k, 0.1818);
        near(scale.sd, 0.8_f64.sqrt() / 5e6_f64.sqrt());
        near(from_micrometer(&readings, 2.0, 0.0).unwrap().sd, 2.0 / 5e6_f64.sqrt());
        near(from_micrometer(&readings[..1], 0.3, 0.002).unwrap().sd, 0.0003_f64.hypot(0.181 * 0.002));
    }

    // Mean 505, scatter 5 / sqrt(3); certificate 2 of 500.
    #[test]
    fn a_certificate_does_not_shrink_with_repeats_and_a_batch_does() {
        let measured = [500.0, 505.0, 510.0];
        let scale = from_known(0.2, &measured, 500.0, 2.0, 0.0).unwrap();
        near(scale.k, 0.202);
        near(scale.sd / scale.k, (5.0 / 3.0_f64.sqrt() / 505.0).hypot(0.004));
        // 25 beads of N(500, 25) tell 1 %, whatever they scatter by.
        let many = from_known(0.2, &[500.0; 25], 500.0, 0.0, 25.0).unwrap();
        near(many.sd / many.k, 0.01);
        let repeats = from_known(0.2, &[500.0; 25], 500.0, 5.0, 0.0).unwrap();
        near(repeats.sd / repeats.k, 0.01);
    }

    #[test]
    fn what_is_no_measure_is_refused_with_its_number() {
        let said = |e: RigError| e.to_string();
        assert_eq!(said(from_known(0.2, &[500.0], 500.0, 2.0, 0.0).unwrap_err()), "1 measured sizes; 2 or more are needed");
        assert!(from_known(0.2, &[500.0], 500.0, 2.0, 25.0).is_ok());
        assert!(said(from_known(0.2, &[500.0, -1.0], 500.0, 2.0, 0.0).unwrap_err()).contains("is -1; expected a number above 0"));
        assert!(said(from_micrometer(&[[0.0, 1.0]], 0.5, 0.0).unwrap_err()).contains("in um is 0; expected"));
        assert!(said(from_micrometer(&[[1.0, 1.0]], 0.0, 0.0).unwrap_err()).contains("in px is 0; expected"));
        assert!(said(bead_extents(500.0, 0.97).unwrap_err()).contains("0.9700, more than 0.02 off 1"));
        assert!(bead_extents(500.0, f64::NAN).is_err());
        assert_eq!(refraction(&[], 1.0).unwrap_err(), RigError::TooFew { what: "beads", found: 0, needed: 1 });
    }

    // The mean distance of a spheroid's surface from its centre, over even steps along it, is what a sphere fits.
    #[test]
    fn a_bead_that_is_nearly_round_gives_length_and_width() {
        let (length, width): (f64, f64) = (509.0, 500.0);
        let steps = 10_000;
        let radius = |i: i32| {
            let c = (f64::from(i) + 0.5) / f64::from(steps);
            1.0 / ((2.0 * c / length).powi(2) + (1.0 - c * c) * (2.0 / width).powi(2)).sqrt()
        };
        let diameter = 2.0 * (0..steps).map(radius).sum::<f64>() / f64::from(steps);
        let [found_length, found_width] = bead_extents(diameter, length / width).unwrap();
        assert!((found_length / length - 1.0).abs() < 1e-4 && (found_width / width - 1.0).abs() < 1e-4, "{found_length} {found_width}");
    }

    // Air: the image is 1.333 times too wide, so that a bead is 0.75 as long as wide while ky is kx.
    #[test]
    fn the_aspect_tells_what_is_around_the_capillary() {
        let air = refraction(&[0.749, 0.7504, 0.751], 1.0).unwrap();
        assert!((air.ky_over_kx - 1.3328).abs() < 1e-3 && air.words.starts_with("air"), "{air:?}");
        near(air.ky_factor, air.ky_over_kx);
        let taken_in = refraction(&[1.001, 0.999], 1.333).unwrap();
        assert!(taken_in.words.starts_with("air") && (taken_in.ky_factor - 1.0).abs() < 1e-9, "{taken_in:?}");
        near(taken_in.ky_over_kx_sd.unwrap(), 1.333 * 0.001);
        assert!(refraction(&[1.004, 1.0], 1.0).unwrap().words.starts_with("water"));
        assert!(refraction(&[0.87, 0.88], 1.0).unwrap().words.starts_with("neither"));
        assert!(refraction(&[0.6, 1.2], 1.0).unwrap().words.contains("measure more"));
    }
}
