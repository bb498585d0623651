//! No picture and no allowed settings make segmentation panic.
//!
//! ```text
//!    _______----------      walls: one dark line or two, tilted and bent
//!       ##   (###) .:        blobs, black or hardly there; marks; noise
//!    _______----------       in every format, of every size, under settings anywhere in their ranges
//! ```

use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::{EdgeSettings, FringeSettings, LevelSetSettings, Method, Picture, SegmentSettings, WallSettings, segment};
use carved_core::range::Ranged;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use std::cell::Cell;

/// A random drawing. Lengths are shares of the picture's sides, darkness is a share of the light.
#[derive(Debug, Clone)]
struct Drawing {
    size: (u32, u32),
    light: u8,
    noise: u8,
    seed: u64,
    /// Rows of the two walls in the middle of the picture, their darkness, their slope, their bend, and the glass between the two lines of
    /// a wall.
    walls: Option<([f64; 2], f64, f64, f64, f64)>,
    /// Centre, half axes, darkness.
    blobs: Vec<([f64; 2], [f64; 2], f64)>,
    /// Corner, size, darkness.
    marks: Vec<([f64; 2], [f64; 2], f64)>,
}

fn drawing() -> impl Strategy<Value = Drawing> {
    let share = || [0.0..1.0f64, 0.0..1.0];
    let size = prop_oneof![4 => (90u32..240, 70u32..200), 1 => (1u32..90, 1u32..90)];
    let light = prop_oneof![4 => 120u8..=240, 1 => 0u8..=255];
    let noise = prop_oneof![4 => 0u8..=12, 1 => 0u8..=80];
    let walls = ([0.02..0.45f64, 0.55..0.98], 0.2..1.0f64, -0.04..0.04f64, -0.04..0.04f64, 0.0..0.12f64);
    let blobs = prop::collection::vec((share(), [0.01..0.5f64, 0.01..0.3], 0.02..1.0f64), 0..5);
    let marks = prop::collection::vec((share(), [0.0..0.3f64, 0.0..0.05], 0.0..1.0f64), 0..5);
    (size, light, noise, any::<u64>(), prop::option::weighted(0.9, walls), blobs, marks)
        .prop_map(|(size, light, noise, seed, walls, blobs, marks)| Drawing { size, light, noise, seed, walls, blobs, marks })
}

impl Drawing {
    /// Transmitted share of the light at `x, y`.
    fn through(&self, x: f64, y: f64) -> f64 {
        let mut light = 1.0;
        if let Some((rows, dark, sink, sag, glass)) = self.walls {
            let off = sink * (x - 0.5) + sag * (2.0 * x - 1.0).powi(2);
            for (row, inwards) in rows.into_iter().zip([1.0, -1.0]) {
                for line in [row, row + inwards * glass] {
                    light *= 1.0 - dark * (-0.5 * ((y - off - line) * f64::from(self.size.1) / 1.3).powi(2)).exp();
                }
            }
        }
        for ([u, v], [a, b], dark) in &self.blobs {
            if ((x - u) / a).hypot((y - v) / b) < 1.0 {
                light *= 1.0 - dark;
            }
        }
        for ([u, v], [wide, high], dark) in &self.marks {
            if (*u..=u + wide).contains(&x) && (*v..=v + high).contains(&y) {
                light *= 1.0 - dark;
            }
        }
        light
    }

    fn picture(&self, format: PixelFormat) -> Picture {
        let (width, height) = self.size;
        let mut state = self.seed | 1;
        let mut bytes = Vec::new();
        for v in 0..height {
            for u in 0..width {
                let light = f64::from(self.light) * self.through(f64::from(u) / f64::from(width), f64::from(v) / f64::from(height));
                for _ in 0..format.bytes_per_pixel() {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    let off = ((state >> 40) % (u64::from(self.noise) + 1)) as u8;
                    bytes.push((light as u8).saturating_add(off));
                }
            }
        }
        Picture::from_frame(&RawFrame::new(width, height, format, bytes).unwrap())
    }
}

/// Random settings: most keep their default, the others lie anywhere in their ranges.
fn settings() -> impl Strategy<Value = SegmentSettings> {
    let drawn = (prop::bool::weighted(0.2), 0.0..=1.0f64);
    (prop::sample::select(vec![Method::Hybrid, Method::Hybrid, Method::LevelSet]), prop::collection::vec(drawn, 64)).prop_map(
        |(method, drawn)| {
            let mut drawn = drawn.into_iter();
            let mut number = |default: f64, least: f64, most: f64| match drawn.next() {
                Some((true, share)) => least + share * (most - least),
                _ => default,
            };
            let (w, e, f, l, s) = (
                WallSettings::default(),
                EdgeSettings::default(),
                FringeSettings::default(),
                LevelSetSettings::default(),
                SegmentSettings::default(),
            );
            SegmentSettings {
                method,
                walls: WallSettings {
                    max_tilt_deg: number(w.max_tilt_deg, 0.0, 10.0),
                    max_sag_share: number(w.max_sag_share, 0.0, 0.05),
                    min_support: number(w.min_support, 0.05, 1.0),
                    min_depth: number(f64::from(w.min_depth), 0.5, 100.0) as f32,
                    line_reach_share: number(w.line_reach_share, 0.001, 0.2),
                    min_bore_share: number(w.min_bore_share, 0.01, 0.95),
                    max_wall_share: number(w.max_wall_share, 0.01, 0.45),
                },
                level_set: LevelSetSettings {
                    level_share: number(l.level_share, 0.01, 1.0),
                    least_sigma: number(l.least_sigma, 0.1, 100.0),
                    region: number(l.region, 0.0, 2.0),
                    edge: number(l.edge, 0.0, 2.0),
                    steps: number(l.steps as f64, 0.0, 1000.0) as usize,
                },
                fringe: FringeSettings {
                    reach_bore: number(f.reach_bore, 0.0, 1.0),
                    along_px: number(f.along_px, 0.3, 30.0),
                    bar: number(f.bar, 0.0, 100.0),
                    most: number(f.most, 0.0, 100.0),
                    run_px: number(f.run_px, 2.0, 1000.0),
                    least: number(f.least, 0.0, 100.0),
                    opaque_sigma: number(f.opaque_sigma, 0.0, 1000.0),
                    kink: number(f.kink, 0.0, 100.0),
                },
                edge: EdgeSettings {
                    blur_px: number(e.blur_px, 0.3, 4.0),
                    search_outside_px: number(e.search_outside_px, 0.5, 7.0),
                    search_inside_px: number(e.search_inside_px, 0.5, 7.0),
                    along_px: number(e.along_px, 0.3, 10.0),
                    outline_smoothing_px: number(e.outline_smoothing_px, 0.3, 10.0),
                    shift_smoothing_px: number(e.shift_smoothing_px, 0.3, 10.0),
                    stiffness: number(e.stiffness, 0.0, 1000.0),
                },
                faint_sigma: number(s.faint_sigma, 0.1, 100.0),
                faint_sure: number(s.faint_sure, 1.0, 100.0),
                closing_px: number(s.closing_px as f64, 0.0, 30.0) as usize,
                opening_px: number(s.opening_px as f64, 0.0, 30.0) as usize,
                wall_margin_px: number(s.wall_margin_px, 0.0, 20.0),
                speck_bore2: number(s.speck_bore2, 0.0, 1.0),
                min_area_bore2: number(s.min_area_bore2, 1e-4, 1.0),
                join_gap_bore: number(s.join_gap_bore, 0.0, 1.0),
                black_below: number(f64::from(s.black_below), 0.0, 254.0) as u8,
                max_saturated_share: number(s.max_saturated_share, 0.0, 1.0),
                mean_shift: s.mean_shift,
                high_sigma: s.high_sigma,
                low_sigma: s.low_sigma,
            }
        },
    )
}

/// At least one picture in ten must give an outline (a quarter does): a test in which all drawings are refused would prove nothing.
#[test]
fn no_picture_and_no_settings_make_it_panic() {
    const CASES: u32 = 150;
    let (segmented, outlined) = (Cell::new(0), Cell::new(0));
    let config = ProptestConfig { cases: CASES, failure_persistence: None, ..ProptestConfig::default() };
    let run = TestRunner::new(config).run(&(drawing(), settings()), |(drawing, settings)| {
        prop_assert_eq!(settings.outside().len(), 0);
        for format in [PixelFormat::Mono8, PixelFormat::BayerRG8, PixelFormat::RGB8Packed] {
            let Ok(profile) = segment(&drawing.picture(format), &settings) else { continue };
            segmented.set(segmented.get() + 1);
            outlined.set(outlined.get() + u32::from(!profile.edge.is_empty()));
            prop_assert_eq!((profile.mask.width() as u32, profile.mask.height() as u32), drawing.size);
            prop_assert!(profile.edge.iter().flat_map(|e| &e.vertices).flatten().all(|x| x.is_finite()));
            prop_assert!(profile.detection.confidence.is_finite() && profile.quality.edge_error_px.is_finite());
        }
        Ok(())
    });
    println!("{} of {} pictures segmented, {} with an outline", segmented.get(), 3 * CASES, outlined.get());
    run.unwrap();
    assert!(outlined.get() > 3 * CASES / 10, "{} of {} pictures have an outline", outlined.get(), 3 * CASES);
}
