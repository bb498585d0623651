//! Tests that each nuisance does what it describes, depends on its seed only, and does not change the ground truth.

use crate::scene::*;

/// No noise and even light, so that only the nuisance is visible.
fn settings(nuisances: Nuisances) -> SceneSettings {
    SceneSettings { optics: Optics { blur_px: 0.7, ..Optics::exact() }, nuisances, ..SceneSettings::default() }
}

fn frame(nuisances: Nuisances, angle_rad: f64, number: u64) -> Rgb {
    Scene::new(settings(nuisances)).render(&Exposure { angle_rad, number })
}

fn plain() -> Rgb {
    frame(Nuisances::default(), 0.0, 0)
}

/// The share of pixels that differ by more than one level, and the largest difference.
fn unlike(a: &Rgb, b: &Rgb) -> (f64, u8) {
    let off: Vec<u8> = a.data.iter().zip(&b.data).map(|(a, b)| a.abs_diff(*b)).collect();
    (off.iter().filter(|&&d| d > 1).count() as f64 / off.len() as f64, off.into_iter().max().unwrap())
}

#[test]
fn nuisances_are_off_by_default_and_settings_without_them_can_be_read() {
    assert_eq!(serde_json::from_str::<SceneSettings>("{}").unwrap(), SceneSettings::default());
    let unknown = serde_json::from_str::<SceneSettings>(r#"{"nuisances": {"glas": {}}}"#).unwrap_err();
    assert!(unknown.to_string().contains("glas"), "{unknown}");
    assert_eq!(plain(), frame(Nuisances { seed: 99, ..Nuisances::default() }, 0.5, 30), "a seed alone changes nothing");
}

#[test]
fn marks_on_the_window_stay_and_those_on_the_glass_turn() {
    let marks = Marks { scratches: 12, dust: 40, contrast: 0.5 };
    let window = |seed| Nuisances { seed, window: marks, ..Nuisances::default() };
    let glass = |seed| Nuisances { seed, glass: marks, ..Nuisances::default() };
    assert_eq!(frame(window(1), 0.0, 0), frame(window(1), 1.0, 0));
    assert_eq!(frame(glass(1), 0.7, 0), frame(glass(1), 0.7, 5));
    for (one, other) in [
        (frame(glass(1), 0.0, 0), frame(glass(1), 1.0, 0)),
        (frame(glass(1), 0.0, 0), frame(glass(2), 0.0, 0)),
        (frame(window(1), 0.0, 0), frame(window(2), 0.0, 0)),
        (frame(window(1), 0.0, 0), plain()),
        (frame(glass(1), 0.0, 0), plain()),
    ] {
        let (share, most) = unlike(&one, &other);
        assert!((0.001..0.05).contains(&share) && most > 40, "{share} of the pixels, by up to {most}");
    }
    // After a whole revolution the glass has the same marks.
    assert!(unlike(&frame(glass(1), 0.4, 0), &frame(glass(1), 0.4 + std::f64::consts::TAU, 0)).1 <= 1);
}

#[test]
fn marks_on_the_glass_lie_on_the_glass() {
    let glass = Marks { scratches: 30, dust: 100, contrast: 0.8 };
    let marked = frame(Nuisances { glass, ..Nuisances::default() }, 0.3, 0);
    let plain = plain();
    let capillary = Capillary::default();
    // Of the nearest point of the outer wall, and the widest mark with its blur.
    let reach = (capillary.bore_radius_um() + capillary.glass_um) / 5.5 * 1.01 + 7.0 + 3.0;
    let mut marked_rows = 0;
    for v in 0..1024usize {
        let row = v * 1024 * 3..(v + 1) * 1024 * 3;
        let same = marked.data[row.clone()] == plain.data[row];
        assert!(same || (v as f64 - 511.5).abs() < reach, "row {v} is marked");
        marked_rows += usize::from(!same);
    }
    assert!(marked_rows > 100, "{marked_rows}");
}

/// The share of light that each pixel of one colour loses, without blur.
fn lost(nuisances: Nuisances, angle_rad: f64) -> Vec<f64> {
    let frame = |nuisances| {
        let optics = Optics { light_rgb: [250.0; 3], ..Optics::exact() };
        Scene::new(SceneSettings { optics, nuisances, ..SceneSettings::default() }).render(&Exposure { angle_rad, number: 0 })
    };
    let (clean, dusty) = (frame(Nuisances::default()), frame(nuisances));
    clean.data.iter().zip(&dusty.data).step_by(3).map(|(c, d)| 1.0 - f64::from(*d) / f64::from((*c).max(1))).collect()
}

/// The bore of the default scene is 118 px wide, around row 511.5. Rows near its walls are left out, because eight bits of a dark wall
/// do not show faint specks.
const BORE_ROWS: std::ops::Range<usize> = 457..567;

/// Connected pieces that lose more than 1 % somewhere above `least`, in the rows of the bore.
fn pieces(lost: &[f64], least: f64) -> usize {
    let (width, rows) = (1024, BORE_ROWS.len());
    let inside = |i: usize| lost[BORE_ROWS.start * width + i];
    let mut seen = vec![false; width * rows];
    let mut pieces = 0;
    for first in 0..seen.len() {
        let (mut stack, mut deepest) = (vec![first], 0.0f64);
        while let Some(i) = stack.pop() {
            if seen[i] || inside(i) < 0.01 {
                continue;
            }
            seen[i] = true;
            deepest = deepest.max(inside(i));
            let (u, v) = (i % width, i / width);
            let near = [(u > 0, i.wrapping_sub(1)), (u + 1 < width, i + 1), (v > 0, i.wrapping_sub(width)), (v + 1 < rows, i + width)];
            stack.extend(near.into_iter().filter_map(|(is, j)| is.then_some(j)));
        }
        pieces += usize::from(deepest > least);
    }
    pieces
}

#[test]
fn each_layer_of_dust_has_the_stated_number_of_specks_in_the_image_of_the_bore() {
    let dust = Dust { specks_per_1000px: 60.0, faint_per_1000px: 0.0 };
    // Of a length of 1024 px, and of 110 of the 118 rows.
    let expected = 60.0 * 1.024 * 110.0 / 118.0;
    let clean = Nuisances::default();
    for (layer, of) in [
        ("window", Nuisances { window_dust: dust, ..clean.clone() }),
        ("glass", Nuisances { glass_dust: dust, ..clean.clone() }),
        ("water", Nuisances { water_dust: dust, ..clean.clone() }),
    ] {
        let counts = (0..6u64).map(|seed| pieces(&lost(Nuisances { seed, ..of.clone() }, 0.4), 0.018) as f64);
        let mean = counts.sum::<f64>() / 6.0;
        // One frame varies by 8, six by 3. Some 5 % of the specks overlap another one, and specks at the rows' ends add 5 %.
        assert!((mean - expected).abs() < 9.0, "{layer}: {mean} specks instead of {expected}");
    }
}

#[test]
fn specks_are_as_deep_as_those_of_real_frames() {
    let dust = |specks_per_1000px, faint_per_1000px| Nuisances {
        window_dust: Dust { specks_per_1000px, faint_per_1000px },
        ..Nuisances::default()
    };
    let visible = lost(dust(30.0, 0.0), 0.0);
    let count = |least| pieces(&visible, least) as f64;
    // The median is 4.5 %, and 10 % are deeper than 4.5 % e^(1.28 * 0.62) = 10 %.
    let [half, tenth] = [0.045, 0.10].map(|least| count(least) / count(0.018));
    assert!((0.3..0.7).contains(&half) && (0.02..0.25).contains(&tenth), "{half} and {tenth}");
    let faintest = lost(dust(0.0, 30.0), 0.0).into_iter().fold(0.0, f64::max);
    // One of 250 levels is 0.4 %.
    assert!((0.014..0.033).contains(&faintest), "faint specks lose at most {faintest}");
}

#[test]
fn dust_on_the_window_stays_and_dust_on_glass_and_in_water_turns() {
    let dust = Dust { specks_per_1000px: 80.0, faint_per_1000px: 0.0 };
    let window = Nuisances { window_dust: dust, ..Nuisances::default() };
    assert_eq!(frame(window.clone(), 0.0, 0), frame(window, 1.0, 0));
    for turning in [Nuisances { glass_dust: dust, ..Nuisances::default() }, Nuisances { water_dust: dust, ..Nuisances::default() }] {
        let (share, most) = unlike(&frame(turning.clone(), 0.0, 0), &frame(turning.clone(), 1.0, 0));
        assert!((0.001..0.05).contains(&share) && most > 10, "{share} of the pixels, by up to {most}");
        let whole_turn = frame(turning.clone(), 0.4 + std::f64::consts::TAU, 0);
        assert!(unlike(&frame(turning, 0.4, 0), &whole_turn).1 <= 1, "after a whole turn the dust is at its place again");
    }
}

#[test]
fn dust_in_the_water_stays_in_the_bore_and_lies_at_all_depths() {
    let dust = Dust { specks_per_1000px: 400.0, faint_per_1000px: 0.0 };
    let rows = |angle: f64| -> Vec<usize> {
        let lost = lost(Nuisances { water_dust: dust, ..Nuisances::default() }, angle);
        lost.chunks(1024).enumerate().filter(|(_, row)| row.iter().any(|&l| l > 0.02)).map(|(v, _)| v).collect()
    };
    for angle in [0.0, 1.3] {
        let rows = rows(angle);
        // The wall is 59 px from the axis, and the border of a speck at most 7 px from its middle.
        assert!(rows.iter().all(|&v| (v as f64 - 511.5).abs() < 67.0), "at {angle}: rows {rows:?}");
        assert!(rows.len() > 100, "at {angle}: {} rows", rows.len());
    }
}

#[test]
fn the_lamp_drifts_by_exposure_towards_its_end() {
    let drift = Drift { level: -0.2, colour: 0.05, exposures: 10.0, flicker: 0.0 };
    let at = |number| {
        let f = frame(Nuisances { drift, ..Nuisances::default() }, 0.0, number);
        let field = (200 * 1024 + 500) * 3;
        [0, 1, 2].map(|k| f64::from(f.data[field + k]))
    };
    let (first, tenth, last) = (at(0), at(10), at(1000));
    let light = Optics::default().light_rgb;
    for k in 0..3 {
        let end = 0.8 * (1.0 + 0.05 * (1.0 - k as f64));
        assert!((first[k] - light[k]).abs() <= 0.5);
        assert!((last[k] - light[k] * end).abs() <= 0.5, "{} against {}", last[k], light[k] * end);
        assert!(tenth[k] < first[k] && tenth[k] > last[k]);
    }
    let flicker = Nuisances { drift: Drift { flicker: 0.02, ..Drift::default() }, ..Nuisances::default() };
    assert_ne!(frame(flicker.clone(), 0.0, 1), frame(flicker.clone(), 0.0, 2));
    assert_eq!(frame(flicker.clone(), 0.0, 2), frame(flicker, 0.0, 2));
}

#[test]
fn off_centre_light_is_brightest_at_its_centre() {
    let light_centre = LightCentre { u_px: 300.0, v_px: -200.0, falloff: 0.3 };
    let f = frame(Nuisances { light_centre, ..Nuisances::default() }, 0.0, 0);
    let green = |u: usize, v: usize| f64::from(f.data[(v * 1024 + u) * 3 + 1]);
    let light = Optics::default().light_rgb[1];
    assert!((green(811, 311) - light).abs() < 1.0);
    // (10, 1010) is 801 px and 698 px away, half the diagonal is 723.5 px.
    let expected = light * (1.0 - 0.3 * (801.5f64.powi(2) + 698.5f64.powi(2)) / 723.4f64.powi(2));
    assert!((green(10, 1010) - expected).abs() < 1.0, "{} against {expected}", green(10, 1010));
}

#[test]
fn hot_pixels_are_bright_in_the_dark_and_stay() {
    let hot_pixels = HotPixels { count: 300, level: 150.0 };
    let dark = |hot_pixels, number| {
        let mut settings = settings(Nuisances { hot_pixels, ..Nuisances::default() });
        settings.optics.light_rgb = [20.0; 3];
        Scene::new(settings).render(&Exposure { angle_rad: 0.0, number })
    };
    let hot = dark(hot_pixels, 0);
    let count = hot.data.chunks_exact(3).filter(|p| p[1] > 50).count();
    // Two may share a pixel.
    assert!((295..=300).contains(&count), "{count}");
    assert_eq!(hot, dark(hot_pixels, 1));
}

#[test]
fn motion_widens_an_edge_and_does_not_shift_it() {
    let edge = |motion: Motion| {
        let scene = Scene::new(settings(Nuisances { motion, ..Nuisances::default() }));
        let bead = Specimen::bead(500.0).unwrap().of_material(phantom::Material { absorption_per_mm: [60.0; 3], index_step: 0.0 });
        scene.load(bead).unwrap();
        let frame = scene.render(&Exposure { angle_rad: 0.0, number: 0 }).to_mono8();
        let column: Vec<f64> = (458..500).map(|v| f64::from(frame[v * 1024 + 511])).collect();
        let cross = |part: f64| {
            let level = column[0] * part;
            let i = column.iter().position(|&c| c < level).unwrap();
            458.0 + i as f64 - (level - column[i]) / (column[i - 1] - column[i])
        };
        (cross(0.5), cross(0.2) - cross(0.8))
    };
    let (still, sharp) = edge(Motion::default());
    for motion in [Motion { u_px: 0.0, v_px: 2.0 }, Motion { u_px: 1.0, v_px: 1.7 }] {
        let (moved, wide) = edge(motion);
        assert!((moved - still).abs() < 0.03, "{motion:?}: {moved} against {still}");
        assert!(wide > sharp + 0.2, "{motion:?}: {wide} against {sharp}");
    }
}

#[test]
fn nuisances_do_not_change_the_ground_truth() {
    let marks = Marks { scratches: 10, dust: 30, contrast: 0.6 };
    let spoilt = Nuisances {
        seed: 3,
        light_centre: LightCentre { u_px: 100.0, v_px: 50.0, falloff: 0.2 },
        window: marks,
        glass: marks,
        motion: Motion { u_px: 1.0, v_px: 1.0 },
        drift: Drift { level: 0.1, ..Drift::default() },
        hot_pixels: HotPixels { count: 50, ..HotPixels::default() },
        ..Nuisances::default().with_dust(Dust::USUAL)
    };
    let mask = |nuisances| {
        let scene = Scene::new(settings(nuisances));
        scene.load(Specimen::larva(3, 9).unwrap()).unwrap();
        scene.truth_mask(0.2)
    };
    assert_eq!(mask(spoilt), mask(Nuisances::default()));
}
