//! Fluorescence in a second camera: its light, integrated inside the silhouette of the model, and the light per volume.
//!
//! ```text
//!  mesh ── second camera's projection ──► silhouette ── grown by MARGIN ──► signal = sum of (pixel - background)
//!                                             └──────── ring outside it ──► background = mean, its spread
//!  all views ── mean, spread ──┬──► signal per volume
//!  volume, its spread ─────────┘
//! ```
//! The signal is in grey levels times pixels of the second camera, with exposure and gain as configured. It is comparable
//! between specimens of one set-up. Absorption in the body and reflections of the glass are not corrected.

use crate::flag::{Flag, StoredFlag};
use crate::geometry::Projection;
use crate::surface::{Mesh, silhouette};
use serde::{Deserialize, Serialize};

/// Light that blur and a small error of the optics put outside the silhouette is still counted, within this margin, px.
const MARGIN_PX: usize = 6;
/// Width of the ring in which the background is read, px.
const RING_PX: usize = 10;
/// Least pixels of the ring.
const LEAST_RING: usize = 50;
/// um^3 in a nanolitre.
const UM3_PER_NL: f64 = 1e6;
/// Share of saturated pixels above which the signal is only a lower bound.
const MANY_SATURATED: f64 = 0.001;

/// One picture of the second camera, 8 bits grey, with its projection.
#[derive(Debug, Clone, Copy)]
pub struct SecondView<'a> {
    /// Number of the view.
    pub view: u32,
    /// Projection of the second camera in this view.
    pub projection: Projection,
    /// Grey levels, row by row.
    pub pixels: &'a [u8],
    /// Width of the picture, px.
    pub width: usize,
    /// Height of the picture, px.
    pub height: usize,
}

/// The signal of one view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ViewSignal {
    /// Number of the view.
    pub view: u32,
    /// Sum over the silhouette and its margin less the background, grey levels times px.
    pub signal: f64,
    /// Standard deviation of the signal, from the noise of the pixels and of the background.
    pub signal_sd: f64,
    /// Mean of the ring, grey levels.
    pub background: f64,
    /// Pixels of the silhouette.
    pub silhouette_px: usize,
    /// Share of the silhouette's pixels at 255.
    pub saturated: f64,
}

/// Fluorescence of a specimen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Fluorescence {
    /// Signal of each view.
    pub views: Vec<ViewSignal>,
    /// Views that are left out: their silhouette leaves no ring in the picture, or lies outside it.
    pub left_out: Vec<u32>,
    /// Mean over the views, grey levels times px.
    pub signal: f64,
    /// Standard deviation between the views. Of one view, that of its own noise.
    pub signal_sd: f64,
    /// The mean signal over the volume, grey levels times px per nl.
    pub signal_per_nl: f64,
    /// Standard deviation of `signal_per_nl`, from the mean over the views and from the volume. `None` where that of the volume is not
    /// known.
    pub signal_per_nl_sd: Option<f64>,
    /// `saturated`: the signal is only a lower bound.
    pub flags: Vec<StoredFlag>,
}

impl Fluorescence {
    /// Measures the signal inside the silhouette of a mesh (um). `None` where no view can be measured, or the volume is not
    /// above 0.
    pub fn measure(mesh: &Mesh, views: &[SecondView<'_>], volume_um3: f64, volume_sd_um3: Option<f64>) -> Option<Self> {
        let mut signals = Vec::new();
        let mut left_out = Vec::new();
        for view in views {
            match ViewSignal::of(mesh, view) {
                Some(signal) => signals.push(signal),
                None => left_out.push(view.view),
            }
        }
        let n = signals.len() as f64;
        if signals.is_empty() || volume_um3 <= 0.0 {
            return None;
        }
        let signal = signals.iter().map(|s| s.signal).sum::<f64>() / n;
        let between = signals.iter().map(|s| (s.signal - signal).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
        // One view has no spread between views. Its own noise is used instead.
        let variance = if signals.len() > 1 { between } else { signals[0].signal_sd.powi(2) };
        let per_nl = UM3_PER_NL / volume_um3;
        let saturated = signals.iter().any(|s| s.saturated > MANY_SATURATED);
        Some(Self {
            views: signals,
            left_out,
            signal,
            signal_sd: variance.sqrt(),
            signal_per_nl: signal * per_nl,
            signal_per_nl_sd: volume_sd_um3.map(|sd| (variance / n + (signal * sd / volume_um3).powi(2)).sqrt() * per_nl),
            flags: saturated.then(|| Flag::Saturated.into()).into_iter().collect(),
        })
    }
}

impl ViewSignal {
    fn of(mesh: &Mesh, view: &SecondView<'_>) -> Option<Self> {
        let SecondView { width, height, pixels, .. } = *view;
        let mask = silhouette(mesh, &view.projection, width, height);
        let silhouette_px = mask.area_px();
        if silhouette_px == 0 || pixels.len() != width * height {
            return None;
        }
        let inside: Vec<bool> = (0..width * height).map(|i| mask.get(i % width, i / width)).collect();
        let counted = grown(&inside, width, MARGIN_PX);
        let around = grown(&counted, width, RING_PX);
        let (mut ring, mut sum, mut counted_px, mut top) = (Vec::new(), 0.0, 0usize, 0usize);
        for (i, &pixel) in pixels.iter().enumerate() {
            if counted[i] {
                sum += f64::from(pixel);
                counted_px += 1;
            } else if around[i] {
                ring.push(f64::from(pixel));
            }
            top += usize::from(inside[i] && pixel == u8::MAX);
        }
        if ring.len() < LEAST_RING {
            return None;
        }
        let (n, m) = (ring.len() as f64, counted_px as f64);
        let background = ring.iter().sum::<f64>() / n;
        let variance = ring.iter().map(|p| (p - background).powi(2)).sum::<f64>() / (n - 1.0);
        Some(Self {
            view: view.view,
            signal: sum - m * background,
            // The noise of as many pixels, and the noise of the background as many times.
            signal_sd: (variance * (m + m * m / n)).sqrt(),
            background,
            silhouette_px,
            saturated: top as f64 / silhouette_px as f64,
        })
    }
}

/// A set with all pixels within `by` of it, along rows and columns. Diagonals reach further, which does no harm here.
fn grown(set: &[bool], width: usize, by: usize) -> Vec<bool> {
    let height = set.len() / width;
    let mut across = vec![false; set.len()];
    for v in 0..height {
        for u in (0..width).filter(|u| set[v * width + u]) {
            across[v * width + u.saturating_sub(by)..=v * width + (u + by).min(width - 1)].fill(true);
        }
    }
    let mut both = across.clone();
    for v in 0..height {
        for other in v.saturating_sub(by)..=(v + by).min(height - 1) {
            for u in 0..width {
                both[v * width + u] |= across[other * width + u];
            }
        }
    }
    both
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 20 x 20 px, seen as it is.
    fn square() -> (Mesh, Projection) {
        let plain = Projection::from_matrix([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).unwrap();
        let (a, b) = (30.0, 49.0);
        let vertices = vec![[a, a, 1.0], [b, a, 1.0], [b, b, 1.0], [a, b, 1.0]];
        (Mesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3]] }, plain)
    }

    #[test]
    fn the_sum_is_what_stands_above_the_ring() {
        let (mesh, projection) = square();
        // 12 of background; 50 more in the square, and 3 more in a rim of blur around it.
        let at = |u: usize, v: usize, grow: usize| (30 - grow..50 + grow).contains(&u) && (30 - grow..50 + grow).contains(&v);
        let pixels: Vec<u8> =
            (0..6400).map(|i| 12 + if at(i % 80, i / 80, 0) { 50 } else { 0 } + if at(i % 80, i / 80, 2) { 3 } else { 0 }).collect();
        let view = SecondView { view: 0, projection, pixels: &pixels, width: 80, height: 80 };
        let found = Fluorescence::measure(&mesh, &[view, view], 2e6, Some(2e4)).unwrap();
        let expected = 400.0 * 50.0 + 24.0 * 24.0 * 3.0;
        assert!((found.signal - expected).abs() < 1e-6 && found.views[0].silhouette_px == 400, "{found:?}");
        assert!((found.signal_per_nl - expected / 2.0).abs() < 1e-6);
        // No spread between equal views: one per cent of the volume is all.
        assert!((found.signal_per_nl_sd.unwrap() - 0.01 * expected / 2.0).abs() < 1e-6, "{found:?}");
        let unknown = Fluorescence::measure(&mesh, &[view, view], 2e6, None).unwrap();
        assert_eq!(unknown.signal_per_nl_sd, None, "without that of the volume it would be too small");
        assert!(found.flags.is_empty());
    }

    #[test]
    fn saturation_is_flagged_and_a_view_without_a_ring_left_out() {
        let (mesh, projection) = square();
        let bright = vec![255; 6400];
        let view = SecondView { view: 3, projection, pixels: &bright, width: 80, height: 80 };
        assert_eq!(Fluorescence::measure(&mesh, &[view], 1e6, None).unwrap().flags, [Flag::Saturated]);
        let nowhere = SecondView { pixels: &bright[..400], width: 20, height: 20, ..view };
        assert!(Fluorescence::measure(&mesh, &[nowhere], 1e6, None).is_none());
        assert_eq!(Fluorescence::measure(&mesh, &[view, nowhere], 1e6, None).unwrap().left_out, [3]);
    }
}
