//! The pectoral fins: two thin plates behind the gills that stand away from the flanks.
//!
//! ```text
//!   from above    ____________________          in a slice    \  ___  /
//!     head  ====(__ gill  \____  \  body            fin        \/   \/
//!               ( eye     =====\__|=========                   (     )     each slice of a fin begins inside
//!                          fin                                  \___/      the body, so that a slice is one piece
//! ```
//! A fin is an outgrowth like the fin fold: part of the outline and of the ideal hull, not of the body. Because each slice of body and
//! fins is connected, the ideal hull of a slice is its convex hull, and the true values stay exact.

use super::{Larva, smooth_step};
use crate::scene::phantom::{Material, Mesh, Part, Within};
use std::f64::consts::{FRAC_PI_2, TAU};

/// First and last s of a fin. At 4100 um its length is 325 um, which is 60 px in VAST frames.
const FROM: f64 = 0.175;
const TO: f64 = 0.255;
/// How far a fin reaches beyond the flank, um. This is 18 px in VAST frames.
const REACH_UM: f64 = 97.0;
/// At 3 dpf the fins have this part of their later reach.
const YOUNG: f64 = 0.6;
/// Its root on the flank: angle from the belly. It hangs down from there by this angle.
const ROOT: f64 = FRAC_PI_2 + 0.15;
const DROOP: f64 = 0.45;
/// A fin begins this far below the skin, as a part of the radius.
const ROOTED: f64 = 0.8;
/// Half the thickness of a fin.
const HALF_THICK_UM: f64 = 5.0;
/// Index step of a fin. Its outline has a weak rim.
const INDEX_STEP: f64 = 0.008;

impl Larva {
    /// Both pectoral fins, or none.
    pub(super) fn pectorals(&self, rings: u32, segments: u32) -> Vec<Part> {
        let Some(per_mm) = self.look.pectoral_per_mm.filter(|_| self.finned) else { return Vec::new() };
        let material = Material { absorption_per_mm: [per_mm, 1.03 * per_mm, 1.12 * per_mm], index_step: INDEX_STEP };
        [1.0, -1.0]
            .map(|side| Part { mesh: self.pectoral(side, rings, segments), material, within_body: Within::Replaced })
            .into_iter()
            .collect()
    }

    fn pectoral(&self, side: f64, rings: u32, segments: u32) -> Mesh {
        let stations = super::stations(rings).map(|t| FROM + (TO - FROM) * t);
        let rows: Vec<Vec<[f64; 3]>> = stations.map(|s| self.pectoral_ring(s, side, segments)).collect();
        let middle = |row: &Vec<[f64; 3]>| {
            let opposite = row.len() / 2;
            std::array::from_fn(|i| f64::midpoint(row[0][i], row[opposite][i]))
        };
        match (rows.first().map(middle), rows.last().map(middle)) {
            (Some(first), Some(last)) => Mesh::lofted(first, &rows, last),
            _ => Mesh::default(),
        }
    }

    /// Slice of both fins at `s`.
    pub(super) fn pectoral_points(&self, s: f64, segments: u32) -> Vec<[f64; 3]> {
        if self.finned && self.look.pectoral_per_mm.is_some() && FROM < s && s < TO {
            [1.0, -1.0].into_iter().flat_map(|side| self.pectoral_ring(s, side, segments)).collect()
        } else {
            Vec::new()
        }
    }

    /// Slice of one fin: a thin ellipse from its root below the skin to its margin.
    pub(super) fn pectoral_ring(&self, s: f64, side: f64, segments: u32) -> Vec<[f64; 3]> {
        let t = (s - FROM) / (TO - FROM);
        let size = if self.dpf > 3 { 1.0 } else { YOUNG };
        // The margin rises slowly behind the gill and ends in a rounded tip.
        let reach = size * REACH_UM * smooth_step(t / 0.6) * (1.0 - ((t - 0.82) / 0.18).max(0.0).powi(4)).max(0.0).sqrt();
        let [x, y, z] = self.centre(s);
        let (sin, cos) = ROOT.sin_cos();
        let skin = self.radius(s, side * ROOT);
        let at = |from_centre: f64| [y + from_centre * cos, z + side * from_centre * sin];
        let (root, flank) = (at(ROOTED * skin), at(skin));
        // From the flank on it hangs down.
        let (sin, cos) = (ROOT - DROOP).sin_cos();
        let margin = [flank[0] + reach * cos, flank[1] + side * reach * sin];
        let middle: [f64; 2] = std::array::from_fn(|i| f64::midpoint(root[i], margin[i]));
        let long: [f64; 2] = std::array::from_fn(|i| (margin[i] - root[i]) / 2.0);
        let length = long[0].hypot(long[1]).max(1e-9);
        let thin = HALF_THICK_UM * (1.0 - (2.0 * t - 1.0).powi(4)).max(0.0).sqrt();
        let across = [-long[1] / length * thin, long[0] / length * thin];
        (0..segments)
            .map(|k| {
                let (sin, cos) = (TAU * f64::from(k) / f64::from(segments)).sin_cos();
                [x, middle[0] + cos * long[0] + sin * across[0], middle[1] + cos * long[1] + sin * across[1]]
            })
            .collect()
    }
}
