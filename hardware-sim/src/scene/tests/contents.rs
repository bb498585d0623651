//! Tests of contents other than one living larva: ground truth, appearance and order.

use super::*;

/// Bounding box of the covered pixels of a mask: first u, last u, first v, last v.
fn bounds(mask: &Coverage) -> [usize; 4] {
    let mut b = [usize::MAX, 0, usize::MAX, 0];
    for (i, _) in mask.data.iter().enumerate().filter(|(_, c)| **c >= 128) {
        let (u, v) = (i % mask.width as usize, i / mask.width as usize);
        b = [b[0].min(u), b[1].max(u), b[2].min(v), b[3].max(v)];
    }
    b
}

fn level(scene: &Scene, u: usize, v: usize) -> f64 {
    let frame = scene.render(&Exposure { angle_rad: 0.0, number: 0 }).to_mono8();
    f64::from(frame[v * 1024 + u])
}

#[test]
fn a_larva_that_faces_right_is_the_one_that_faces_left_turned() {
    let mut settings = exact();
    settings.camera.f_um = 6e7;
    let larva = || Specimen::larva(4, 3).unwrap();
    let mask =
        |faces_right, angle| loaded(settings.clone(), larva().placed(Placement { faces_right, ..Placement::default() })).truth_mask(angle);
    // Half a turn around y shows a far camera the mirror image of what it sees from the other side: 511.5 is the middle, so
    // column u mirrors to 1023 - u.
    for angle in [0.0, 0.6] {
        let (left, right) = (mask(false, -angle), mask(true, angle));
        let unlike = (0..1024usize * 1024).filter(|i| left.data[*i].abs_diff(right.data[i / 1024 * 1024 + 1023 - i % 1024]) > 16).count();
        assert!(unlike < 20, "{unlike} pixels differ from the mirror image at {angle}");
    }
    let (left, right) = (mask(false, 0.0), mask(true, 0.0));
    let mass = |mask: &Coverage| moments(mask).1;
    assert!(mass(&left) < 500.0 && mass(&right) > 523.0, "the head is the heavy end: {} and {}", mass(&left), mass(&right));
}

#[test]
fn two_larvae_have_one_truth_mask_and_no_single_truth() {
    let one = |x_um| Specimen::larva(3, 5).unwrap().placed(Placement { x_um, ..Placement::default() });
    let scene = Scene::new(exact());
    scene.load(one(-1900.0)).unwrap();
    let first = scene.truth_mask(0.3);
    assert!(scene.truth().is_some());
    scene.load(one(1900.0)).unwrap();
    let second = scene.truth_mask(0.3);
    scene.load(Contents { specimens: vec![one(-1900.0), one(1900.0)], clutter: Vec::new() }).unwrap();
    assert!(scene.truth().is_none());
    let both = scene.truth_mask(0.3);
    let gap = (bounds(&first)[1], bounds(&second)[0]);
    assert!(gap.0 + 10 < gap.1, "the two are apart: {gap:?}");
    for (i, &c) in both.data.iter().enumerate() {
        assert_eq!(c, first.data[i].max(second.data[i]), "pixel {i}");
    }
}

#[test]
fn each_fin_is_rooted_in_its_own_body() {
    // Where the second larva's fin counts only outside the second body, both larvae are equally bright.
    let one = |x_um| Specimen::larva(3, 5).unwrap().placed(Placement { x_um, ..Placement::default() });
    let mut settings = exact();
    settings.camera.f_um = 6e7;
    let alone = loaded(settings.clone(), one(1900.0));
    let with_another = Scene::new(settings);
    with_another.load(Contents { specimens: vec![one(-1900.0), one(1900.0)], clutter: Vec::new() }).unwrap();
    for u in [700, 800, 900] {
        assert!((level(&alone, u, 511) - level(&with_another, u, 511)).abs() < 0.5, "column {u}");
    }
}

#[test]
fn clutter_is_drawn_and_not_in_the_ground_truth_even_where_it_touches() {
    let larva = || Specimen::larva(4, 2).unwrap();
    let nose_um = -larva().truth().length_um / 2.0;
    let bare = loaded(exact(), larva());
    let scene = Scene::new(exact());
    let bubble = Specimen::bubble(300.0).unwrap().placed(at(nose_um - 100.0, 0.0, 0.0));
    scene.load(Contents::from(larva()).beside(bubble)).unwrap();
    assert_eq!(scene.truth_mask(0.7), bare.truth_mask(0.7));
    assert_eq!(scene.truth(), bare.truth());
    let u = (511.5 + (nose_um - 180.0) / 5.5) as usize;
    assert!(level(&scene, u, 511) < 0.3 * level(&bare, u, 511), "the bubble is drawn");
}

#[test]
fn a_bubble_is_black_with_a_small_bright_centre() {
    let scene = loaded(exact(), Specimen::bubble(400.0).unwrap());
    let field = level(&Scene::new(exact()), 511, 511);
    assert!(level(&scene, 511, 511) > 0.9 * field);
    // A third of the radius out, rays are bent by 2 x 0.333 x 0.35 = 0.24 rad: three times the aperture.
    for u in [511 + 13, 511 + 24, 511 + 34] {
        assert!(level(&scene, u, 511) < 0.12 * field, "column {u}: {}", level(&scene, u, 511));
    }
    let plug = loaded(exact(), Specimen::plug(1500.0, 640.0).unwrap());
    assert!(level(&plug, 450, 480) < 0.12 * field && level(&plug, 450, 550) < 0.12 * field, "nearly all black");
    let [_, _, top, bottom] = bounds(&plug.truth_mask(0.0));
    assert!((bottom - top + 1).abs_diff(116) <= 1, "it fills the bore: {top} to {bottom}");
}

#[test]
fn debris_is_dark_and_a_dead_larva_much_darker_than_a_living_one() {
    let field = level(&Scene::new(exact()), 511, 511);
    let chip = loaded(exact(), Specimen::chip(150.0, 4).unwrap());
    assert!(level(&chip, 511, 511) < 0.2 * field);
    let mean_of = |specimen: Specimen| {
        let scene = loaded(exact(), specimen);
        let frame = scene.render(&Exposure { angle_rad: 0.0, number: 0 }).to_mono8();
        let mask = scene.truth_mask(0.0);
        let inside: Vec<f64> = frame.iter().zip(&mask.data).filter(|(_, c)| **c == 255).map(|(g, _)| f64::from(*g)).collect();
        inside.iter().sum::<f64>() / inside.len() as f64
    };
    for dpf in [3, 4, 5] {
        let (dead, alive) = (mean_of(Specimen::dead_larva(dpf, 7).unwrap()), mean_of(Specimen::larva(dpf, 7).unwrap()));
        assert!(dead < 0.6 * alive, "{dpf} dpf: {dead:.0} against {alive:.0}");
    }
}

#[test]
fn a_dead_larva_fits_the_bore_and_keeps_the_volume_it_had() {
    for dpf in [3, 4, 5] {
        for seed in 0..6 {
            let rests = Placement { rests_on_wall: true, ..Placement::default() };
            Scene::new(exact()).load(Specimen::dead_larva(dpf, seed).unwrap().placed(rests)).unwrap();
        }
    }
    // The tail is displaced slice by slice, which keeps volumes; the drawn mesh is within 1e-3 of the measured one.
    let off = Specimen::dead_larva(3, 4).unwrap().truth().volume_um3 / Specimen::larva(3, 4).unwrap().truth().volume_um3 - 1.0;
    assert!(off.abs() < 1e-3, "{off:.1e}");
}
