//! The numbers of the slices.

use super::sections::Sections;
use crate::measure::{SphereFit, fit_sphere};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Relative errors of volume and area that smoothing, the end of the series and the step of the slices leave, on phantoms with
/// exact and with noisy profiles.
const METHOD: [f64; 2] = [2e-4, 3e-4];
/// Relative errors with one harmonic, which makes a disc of every slice: larvae of all ages scatter by as much.
const DISCS: [f64; 2] = [0.06, 0.03];

/// Share of a slice's extent that a view shows uncovered, from which on the slice is hollow.
const HOLLOW: f64 = 0.03;
/// Share of the volume in hollow slices from which slices are no longer nearly convex.
const HOLLOW_MOST: f64 = 0.05;
/// Largest relative bias that is a small correction.
const BIAS_MOST: f64 = 0.03;

/// Volume and area by support functions of the slices.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SupportEstimate {
    /// Volume. `volume_bias_um3` is taken off already.
    pub volume_um3: f64,
    /// Standard deviation of the volume on another turn of the same specimen (jackknife over the views), with the errors of the
    /// method.
    pub volume_sd_um3: f64,
    /// What errors of the profiles add to the volume on average.
    pub volume_bias_um3: f64,
    /// Area.
    pub area_um2: f64,
    /// Standard deviation of the area on another turn.
    pub area_sd_um2: f64,
    /// Length along the capillary.
    pub length_um: f64,
    /// Mean radius of the thickest slice.
    pub mean_radius_um: f64,
    /// Number of slices.
    pub slices: usize,
    /// Harmonics of each slice's Fourier series.
    pub harmonics: usize,
    /// Root of the mean square distance between the profiles' edges and the fitted outlines.
    pub residual_um: f64,
    /// Share of the volume in slices that a view shows hollow, or as two bodies. There the estimate fills what is empty.
    pub hollow_share: f64,
}

impl SupportEstimate {
    /// The numbers of a specimen's slices.
    pub fn of(sections: &Sections) -> Self {
        let bias = sections.volume_bias_um3() + sections.shift_bias_um3()[0];
        let areas = sections.areas_um2();
        let hollow: f64 = sections.slices.iter().zip(&areas).filter(|(s, _)| s.gap_share > HOLLOW).map(|(_, a)| a).sum();
        let (volume_um3, area_um2) = (sections.volume_um3() - bias, sections.area_um2());
        let [volume_method, area_method] = if sections.harmonics > 1 { METHOD } else { DISCS };
        Self {
            volume_um3,
            volume_sd_um3: sections.volume_sd_um3().hypot(volume_method * volume_um3),
            volume_bias_um3: bias,
            area_um2,
            area_sd_um2: sections.area_sd_um2().hypot(area_method * area_um2),
            length_um: sections.length_um(),
            mean_radius_um: sections.slices.iter().map(|s| s.outline().coefficients[0]).fold(0.0, f64::max),
            slices: sections.slices.len(),
            harmonics: sections.harmonics,
            residual_um: sections.residual_sd_um,
            hollow_share: hollow / areas.iter().sum::<f64>(),
        }
    }

    /// Whether so much lies in hollow slices that filling them is no small error.
    pub(crate) fn is_hollow(&self) -> bool {
        self.hollow_share > HOLLOW_MOST
    }

    /// Whether the errors of the profiles are too large a part of the volume to be taken off.
    pub(crate) fn is_all_error(&self) -> bool {
        self.volume_bias_um3.abs() > BIAS_MOST * self.volume_um3.abs()
    }
}

impl Sections {
    /// The sphere nearest to points of the slices' outlines.
    pub(crate) fn sphere(&self) -> Option<SphereFit> {
        const DIRECTIONS: u32 = 48;
        let points: Vec<[f64; 3]> = self
            .slices
            .iter()
            .flat_map(|section| {
                (0..DIRECTIONS).map(|i| {
                    let theta = TAU * f64::from(i) / f64::from(DIRECTIONS);
                    let (sin, cos) = theta.sin_cos();
                    let [h, slope] = section.support.at(theta);
                    [section.x_um, h * cos - slope * sin, h * sin + slope * cos]
                })
            })
            .collect();
        fit_sphere(&points).ok()
    }
}
