//! The numbers of the slices.

use super::sections::Sections;
use crate::measure::{SphereFit, fit_sphere};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// What smoothing, the series' end and the slices' step leave of volume and area, as shares: seen on phantoms with exact and with
/// noisy profiles.
const METHOD: [f64; 2] = [2e-4, 3e-4];
/// One harmonic makes a disc of every slice: larvae of all ages scatter by this share about that.
const DISCS: [f64; 2] = [0.06, 0.03];

/// A slice is hollow when a view shows more than this of its extent to be uncovered.
const HOLLOW: f64 = 0.03;
/// Share of the volume in hollow slices from which slices are no longer nearly convex.
const HOLLOW_MOST: f64 = 0.05;
/// What is taken off as the profiles' errors is a small correction, or none.
const BIAS_MOST: f64 = 0.03;

/// Numbers by support functions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SupportEstimate {
    pub volume_um3: f64,
    /// Repeatability: what it would scatter by on another turn of the same specimen (jackknife over the views), and what the method
    /// itself leaves.
    pub volume_sd_um3: f64,
    /// Already taken off: what profiles' errors make of the volume on average.
    pub volume_bias_um3: f64,
    pub area_um2: f64,
    pub area_sd_um2: f64,
    /// Along the capillary.
    pub length_um: f64,
    /// Of the thickest slice.
    pub mean_radius_um: f64,
    pub slices: usize,
    /// Of each slice's Fourier series.
    pub harmonics: usize,
    /// Between the profiles' edges and the fitted outlines, root of the mean square.
    pub residual_um: f64,
    /// Of the volume, what lies in slices that a view shows to be hollow or two: there the estimate fills what is empty.
    pub hollow_share: f64,
}

impl SupportEstimate {
    pub fn of(sections: &Sections) -> Self {
        let bias = sections.volume_bias_um3() + sections.shift_bias_um3()[0];
        let areas = sections.areas_um2();
        let hollow: f64 = sections.sections.iter().zip(&areas).filter(|(s, _)| s.gap_share > HOLLOW).map(|(_, a)| a).sum();
        let (volume_um3, area_um2) = (sections.volume_um3() - bias, sections.area_um2());
        let [volume_method, area_method] = if sections.harmonics > 1 { METHOD } else { DISCS };
        Self {
            volume_um3,
            volume_sd_um3: sections.volume_sd_um3().hypot(volume_method * volume_um3),
            volume_bias_um3: bias,
            area_um2,
            area_sd_um2: sections.area_sd_um2().hypot(area_method * area_um2),
            length_um: sections.length_um(),
            mean_radius_um: sections.sections.iter().map(|s| s.support.coefficients[0]).fold(0.0, f64::max),
            slices: sections.sections.len(),
            harmonics: sections.harmonics,
            residual_um: sections.residual_sd_um,
            hollow_share: hollow / areas.iter().sum::<f64>(),
        }
    }

    /// Whether so much lies in hollow slices that what they fill is no small part.
    pub(crate) fn is_hollow(&self) -> bool {
        self.hollow_share > HOLLOW_MOST
    }

    /// Whether the profiles' errors make more of the volume than can be taken off.
    pub(crate) fn is_all_error(&self) -> bool {
        self.volume_bias_um3.abs() > BIAS_MOST * self.volume_um3.abs()
    }
}

impl Sections {
    /// The sphere nearest to points of the slices' outlines.
    pub(crate) fn sphere(&self) -> Option<SphereFit> {
        const DIRECTIONS: u32 = 48;
        let points: Vec<[f64; 3]> = self
            .sections
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
