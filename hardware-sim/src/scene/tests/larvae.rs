//! Tests of the appearance of larvae.

use super::*;

/// Green light that the larva absorbs, without noise, and the larva at the default placement.
fn taken(larva: &Larva, angle_rad: f64) -> Vec<f64> {
    let optics = Optics { full_well_electrons: 0.0, read_noise: 0.0, ..Optics::default() };
    let scene = Scene::new(SceneSettings { optics, ..SceneSettings::default() });
    let exposure = Exposure { angle_rad, number: 0 };
    let empty = scene.render(&exposure);
    scene.load(Some(larva.specimen())).unwrap();
    let frame = scene.render(&exposure);
    empty.data.iter().zip(&frame.data).skip(1).step_by(3).map(|(&a, &b)| f64::from(a) - f64::from(b)).collect()
}

/// The pixels that have a covered pixel within `reach`.
fn near(mask: &Coverage, reach: usize) -> Vec<bool> {
    let (w, h) = (mask.width as usize, mask.height as usize);
    let mut out = vec![false; w * h];
    for (i, _) in mask.data.iter().enumerate().filter(|&(_, &c)| c > 0) {
        let (u, v) = (i % w, i / w);
        for row in v.saturating_sub(reach)..=(v + reach).min(h - 1) {
            out[row * w + u.saturating_sub(reach)..=row * w + (u + reach).min(w - 1)].fill(true);
        }
    }
    out
}

#[test]
fn pigment_and_organs_change_no_pixel_outside_the_larva() {
    for (dpf, angle_rad) in [(3, 0.0), (4, 0.8), (5, 1.6)] {
        let larva = Larva::new(dpf, 6).unwrap();
        let mask = loaded(exact(), larva.specimen()).truth_mask(angle_rad);
        // The blur of 0.7 px ends after 3 px.
        let inside = near(&mask, 3);
        let outside = taken(&larva, angle_rad).into_iter().zip(&inside).filter(|(t, inside)| !**inside && *t != 0.0).count();
        assert_eq!(outside, 0, "{dpf} dpf: {outside} pixels differ outside");
    }
}

#[test]
fn the_fin_absorbs_a_few_grey_levels_and_its_edge_a_few_more() {
    for dpf in [3, 4, 5] {
        for seed in 0..2 {
            let larva = Larva::new(dpf, seed).unwrap();
            let mask = loaded(exact(), larva.specimen()).truth_mask(0.0);
            let body = near(&loaded(exact(), larva.clone().without_fins().specimen()).truth_mask(0.0), 8);
            let fin: Vec<f64> = taken(&larva, 0.0)
                .into_iter()
                .zip(&body)
                .zip(&mask.data)
                .filter(|((_, body), c)| !**body && **c > 0)
                .map(|((t, _), _)| t)
                .collect();
            let mean = fin.iter().sum::<f64>() / fin.len() as f64;
            let most = fin.iter().copied().fold(0.0, f64::max);
            println!("{dpf} dpf, seed {seed}: {} px of fin take {mean:.2}, at most {most}", fin.len());
            assert!(fin.len() > 1000, "{} px of fin", fin.len());
            // Of some 240: real fins show as a line 2 to 6 darker, with little between it and the body.
            assert!((1.0..4.0).contains(&mean) && (2.0..9.0).contains(&most), "mean {mean:.2}, most {most}");
        }
    }
}

#[test]
fn a_larva_nearly_as_thick_as_the_bore_touches_both_walls() {
    for (dpf, seed) in [(3, 1), (4, 2), (5, 3)] {
        let tallest_px = |mask: &Coverage| {
            (0..1024).map(|u| mask.data[u..].iter().step_by(1024).map(|&c| f64::from(c) / 255.0).sum::<f64>()).fold(0.0, f64::max)
        };
        let larva = Specimen::larva(dpf, seed).unwrap();
        // Seen from the side it is tallest: across the fold of the fin as well.
        let extent_um = 5.5 * tallest_px(&loaded(exact(), larva.clone()).truth_mask(0.0));
        let bore_diameter_um = 1.05 * extent_um;
        let tight = SceneSettings { capillary: Capillary { bore_diameter_um, ..Capillary::default() }, ..exact() };
        for roll_rad in [0.0, PI / 2.0, 4.0] {
            let scene = loaded(tight.clone(), larva.clone().placed(Placement { roll_rad, rests_on_wall: true, ..Placement::default() }));
            let tall_px = tallest_px(&scene.truth_mask(-roll_rad));
            // From wall to wall but for the 5 %; a pixel for perspective and the way the body is bent.
            assert!(bore_diameter_um / 5.5 - tall_px < 0.05 * extent_um / 5.5 + 1.0, "{dpf} dpf: {tall_px} px of {bore_diameter_um} um");
        }
    }
}

#[test]
fn pectoral_fins_from_above_are_as_large_and_as_dark_as_real_ones() {
    for seed in 0..3 {
        // Slim enough for the bore without being centred.
        let look = Look { height: 0.9, eyes: 1.0, ..Look::healthy(5, seed) };
        let larva = Larva::new(5, seed).unwrap().with_look(look);
        let none = larva.clone().with_look(Look { pectoral_per_mm: None, ..look });
        // From above the back faces the camera.
        let above = |larva: &Larva| loaded(exact(), larva.specimen()).truth_mask(-PI / 2.0);
        let (with, without) = (above(&larva), above(&none));
        let body = moments(&above(&none.clone().without_fins())).0;
        let share = (moments(&with).0 - moments(&without).0) / body;
        // Real ones: 5 % of the area of the body.
        assert!((0.02..0.07).contains(&share), "seed {seed}: {share:.3} of the body");
        let near_body = near(&without, 4);
        let dark: Vec<f64> = taken(&larva, -PI / 2.0)
            .into_iter()
            .zip(&near_body)
            .zip(&with.data)
            .filter(|((_, body), c)| !**body && **c == 255)
            .map(|((t, _), _)| t / 246.0)
            .collect();
        let mean = dark.iter().sum::<f64>() / dark.len() as f64;
        assert!(dark.len() > 200 && (0.08..0.27).contains(&mean), "seed {seed}: {mean:.3} dark over {} px", dark.len());
    }
}
