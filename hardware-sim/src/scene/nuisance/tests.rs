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
    };
    let mask = |nuisances| {
        let scene = Scene::new(settings(nuisances));
        scene.load(Specimen::larva(3, 9).unwrap()).unwrap();
        scene.truth_mask(0.2)
    };
    assert_eq!(mask(spoilt), mask(Nuisances::default()));
}
