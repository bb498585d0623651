//! Tests on drawn frames whose statistics are known.

use super::*;
use hardware_sim::scene::{Exposure, Scene, SceneSettings};

const WIDTH: usize = 1000;
const HEIGHT: usize = 200;
/// Rows of the wall lines.
const WALLS: [f64; 2] = [44.0, 156.0];

/// A frame with walls, drawn by a function of column and row that returns the part of the light that passes.
fn drawn(light: [f64; 3], noise_sd: f64, passes: impl Fn(f64, f64) -> f64) -> Rgb {
    let mut random = hardware_sim::scene::seeded::Seeded::new(5);
    let mut data = Vec::with_capacity(WIDTH * HEIGHT * 3);
    for v in 0..HEIGHT {
        for u in 0..WIDTH {
            let (u, v) = (u as f64, v as f64);
            let part = wall(v - WALLS[0]) * wall(v - WALLS[1]) * passes(u, v);
            data.extend(light.map(|level| (level * part + random.normal(noise_sd)).round().clamp(0.0, 255.0) as u8));
        }
    }
    Rgb { width: WIDTH as u32, height: HEIGHT as u32, data }
}

/// A line of a depth of 0.6 and a standard deviation of 2.5 px: 5.9 px wide at half maximum.
fn wall(from_line: f64) -> f64 {
    1.0 - 0.6 * gauss(from_line, 2.5)
}

fn gauss(x: f64, sigma: f64) -> f64 {
    (-0.5 * (x / sigma).powi(2)).exp()
}

fn measured(picture: Rgb) -> FrameStatistics {
    FrameStatistics::measured(&Frame { picture, mask: None }).unwrap()
}

/// The part of light that passes an edge with its middle at 0, dark for negative distances.
fn edge(distance: f64, sigma: f64, dark: f64) -> f64 {
    // The normal distribution by a logistic curve is 1 % off, so it is summed up.
    let steps = 200;
    let share = (0..steps).map(|i| 8.0 * (f64::from(i) + 0.5) / f64::from(steps) - 4.0).filter(|x| x * sigma < distance);
    let total: f64 = share.map(|x| gauss(x, 1.0)).sum::<f64>() * 8.0 / f64::from(steps) / (2.0 * std::f64::consts::PI).sqrt();
    dark + (1.0 - dark) * total
}

#[test]
fn walls_light_and_colour_are_those_that_were_drawn() {
    for slope in [0.0, 0.02, -0.013] {
        let mut random = hardware_sim::scene::seeded::Seeded::new(2);
        let tilted = |u: f64, v: f64| v - slope * (u - 499.5);
        let mut data = Vec::new();
        for v in 0..HEIGHT {
            for u in 0..WIDTH {
                let row = tilted(u as f64, v as f64);
                let inside = if (WALLS[0]..WALLS[1]).contains(&row) { 0.95 } else { 1.0 };
                let part = inside * wall(row - WALLS[0]) * wall(row - WALLS[1]);
                data.extend([220.0, 225.0, 212.0].map(|light: f64| (light * part + random.normal(1.0)).round() as u8));
            }
        }
        let s = measured(Rgb { width: WIDTH as u32, height: HEIGHT as u32, data });
        assert!((s.bore_px - 112.0).abs() < 0.4, "{slope}: bore {}", s.bore_px);
        for wall in 0..2 {
            // The light beside a line is 1 outside and 0.95 inside.
            assert!((s.wall_depth[wall] - 0.6).abs() < 0.03, "{slope}: depth {:?}", s.wall_depth);
            assert!((s.wall_fwhm_px[wall] - 5.9).abs() < 0.4, "{slope}: width {:?}", s.wall_fwhm_px);
        }
        assert!((s.level - 0.95 * 219.0).abs() < 0.6 && (s.blue_minus_red + 0.95 * 8.0).abs() < 0.6, "{} {}", s.level, s.blue_minus_red);
        assert!((s.bore_over_outside - 0.95).abs() < 0.004, "{}", s.bore_over_outside);
        assert!(s.body.is_none() && s.edge_px.is_none() && s.specks_near_body.is_none());
    }
}

#[test]
fn noise_has_its_standard_deviation_and_correlation() {
    let white = drawn([220.0; 3], 2.0, |_, _| 1.0);
    let s = measured(white.clone());
    // Rounding to whole levels adds 1/12.
    assert!((s.noise_sd - 2.02).abs() < 0.08, "{}", s.noise_sd);
    // The light is the mean of 49 columns. Neighbours share its error, which takes 1/49 off.
    assert!((s.noise_green + 0.02).abs() < 0.015 && (s.noise_red + 0.02).abs() < 0.015, "{} {}", s.noise_green, s.noise_red);
    // The colours of a mosaic: green 0.40 and red 0.67, by counting shared pixels. The local mean takes 0.04 off.
    let mosaic = measured(white.demosaicked());
    assert!((mosaic.noise_green - 0.36).abs() < 0.03 && (mosaic.noise_red - 0.63).abs() < 0.03, "{mosaic:?}");
}

#[test]
fn shade_beside_the_walls_is_measured_against_the_bore() {
    let s = measured(drawn([220.0; 3], 0.5, |_, v| {
        let inside = (v - WALLS[0]).min(WALLS[1] - v);
        if inside > 3.0 { 1.0 - 0.3 * (-inside / 4.0).exp() } else { 1.0 }
    }));
    // 0.3 e^(-6/4) = 6.7 % and the line's own 3.4 %; 0.3 e^(-10/4) = 2.5 %; at 14 to 20 px 0.5 % remain.
    assert!((s.shade[0] - 0.094).abs() < 0.012 && (s.shade[1] - 0.020).abs() < 0.005, "{:?}", s.shade);
}

/// Specks on a grid, all alike: 4 rows of 25.
fn specks_of(depth: f64, fwhm: f64) -> impl Fn(f64, f64) -> f64 {
    move |u, v| {
        let near = |x: f64, first: f64, step: f64| x - first - step * ((x - first) / step).round();
        let (du, dv) = (near(u, 20.0, 40.0), near(v, 70.0, 20.0));
        let within = (60.0..140.0).contains(&v);
        if within { 1.0 - depth * gauss(du.hypot(dv), fwhm / 2.354_82) } else { 1.0 }
    }
}

#[test]
fn specks_have_their_number_depth_and_width() {
    for (depth, fwhm) in [(0.03, 4.0), (0.06, 3.0), (0.12, 5.0), (0.4, 4.0)] {
        let s = measured(drawn([220.0; 3], 0.8, specks_of(depth, fwhm)));
        let [half, _] = s.speck_depth.unwrap();
        let [_, width, _] = s.speck_fwhm_px.unwrap();
        assert!((half / depth - 1.0).abs() < 0.15, "{depth}, {fwhm} px: depth {half}");
        assert!((width - fwhm).abs() < 0.6, "{depth}, {fwhm} px: width {width}");
        // 100 specks in 94 of the 112 rows of the bore.
        assert!((s.specks_per_1000px - 100.0 * 112.0 / 94.0).abs() < 8.0, "{depth}, {fwhm} px: {}", s.specks_per_1000px);
        let (shallow, deep) = if depth < 0.04 { (s.specks_per_1000px, 0.0) } else { (0.0, s.specks_per_1000px) };
        assert!((s.shallow_per_1000px - shallow).abs() < 12.0 && (s.deep_per_1000px - deep).abs() < 12.0, "{s:?}");
    }
    let clean = measured(drawn([220.0; 3], 2.0, |_, _| 1.0));
    assert!(clean.specks_per_1000px < 3.0, "noise is no dust: {}", clean.specks_per_1000px);
}

/// A body of 600 x 80 px of which 36 rows pass 10 % of the light and 44 rows 40 %, 12 px above the lower wall.
fn body(u: f64, v: f64) -> f64 {
    let (from_side, from_top) = ((u - 200.0).min(800.0 - u), (v - 64.0).min(144.0 - v));
    let dark = if v < 100.0 { 0.1 } else { 0.4 };
    edge(-from_side.min(from_top), 1.25, dark)
}

#[test]
fn the_body_is_found_and_measured_with_and_without_a_mask() {
    let picture = drawn([220.0; 3], 0.8, |u, v| body(u, v) * specks_of(0.08, 4.0)(u, v));
    let mask: Vec<bool> = (0..WIDTH * HEIGHT)
        .map(|i| ((i % WIDTH) as f64, (i / WIDTH) as f64))
        .map(|(u, v)| (200.0..=800.0).contains(&u) && (64.0..=144.0).contains(&v))
        .collect();
    for mask in [None, Some(mask)] {
        let s = FrameStatistics::measured(&Frame { picture: picture.clone(), mask }).unwrap();
        let body = s.body.unwrap();
        // The soft edge adds a px or two of lighter border.
        assert!((body.dark_share - 0.43).abs() < 0.03 && (body.median - 0.4).abs() < 0.02, "{body:?}");
        // 64 - 44 and 156 - 144, less a px or two of the soft edge.
        assert!((body.gap_px[0] - 19.0).abs() < 2.0 && (body.gap_px[1] - 11.0).abs() < 2.0, "{body:?}");
        // 2.563 standard deviations lie between 10 and 90 %.
        let px = s.edge_px.unwrap();
        assert!((px - 3.2).abs() < 0.35, "edge {px}");
        // The body and its border hide the specks of 15 of 25 columns, and some of the others are near.
        assert!((s.specks_near_body.unwrap() - 8.0).abs() < 5.0, "{:?}", s.specks_near_body);
    }
}

#[test]
fn texture_is_the_deviation_from_the_local_mean() {
    // Stripes of 2 px: 50 levels up and down.
    let s = measured(drawn([200.0; 3], 0.0, |u, v| {
        if (200.0..800.0).contains(&u) && (70.0..130.0).contains(&v) {
            0.4 + if (u as usize / 2).is_multiple_of(2) { 0.05 } else { -0.05 }
        } else {
            1.0
        }
    }));
    let texture = s.body.unwrap().texture_sd;
    // 10 levels, and the mean of 9 columns follows by a tenth.
    assert!((texture - 10.0).abs() < 1.2, "{texture}");
}

#[test]
fn fins_of_a_mask_have_their_area_and_darkness() {
    let mask: Vec<bool> =
        (0..WIDTH * HEIGHT).map(|i| (i % WIDTH, i / WIDTH)).map(|(u, v)| (200..800).contains(&u) && (70..146).contains(&v)).collect();
    let picture = drawn([220.0; 3], 0.5, |u, v| match v as usize {
        70..130 if (200.0..800.0).contains(&u) => 0.3,
        130..146 if (200.0..800.0).contains(&u) => 0.95,
        _ => 1.0,
    });
    let s = FrameStatistics::measured(&Frame { picture, mask: Some(mask) }).unwrap();
    let [area, dark] = s.body.unwrap().fins.unwrap();
    // 16 rows of fin below 60 rows of body.
    assert!((area - 16.0 / 60.0).abs() < 0.03 && (dark - 0.05).abs() < 0.012, "{area} and {dark}");
}

#[test]
fn frames_without_a_capillary_are_refused_with_the_reason() {
    let of = |picture: Rgb, mask| FrameStatistics::measured(&Frame { picture, mask }).unwrap_err();
    let flat = Rgb { width: 300, height: 100, data: vec![200; 90_000] };
    assert_eq!(of(flat.clone(), None), StatisticsError::NoWalls);
    assert_eq!(of(flat, Some(vec![false; 7])), StatisticsError::Mask { expected: 30_000, found: 7 });
    assert_eq!(of(Rgb { width: 50, height: 50, data: vec![0; 7500] }, None), StatisticsError::Small { width: 50, height: 50 });
}

#[test]
fn an_emulated_frame_has_the_dust_of_real_ones() {
    let count = |seed| {
        let frame = Scene::new(SceneSettings::real(seed)).render(&Exposure { angle_rad: 0.3, number: 1 }).demosaicked();
        measured(frame).specks_per_1000px
    };
    let mean = (0..6).map(count).sum::<f64>() / 6.0;
    // Real frames have 76 to 82. Frames differ by a factor of 1.3, so that the mean of six has a standard deviation of 6.
    assert!((62.0..98.0).contains(&mean), "{mean}");
}
