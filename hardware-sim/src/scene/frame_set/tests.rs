//! Tests of the lists, for the seed on which methods are tuned and for another one.

use super::*;
use crate::scene::{Condition, Nuisances};
use std::collections::HashSet;
use std::sync::LazyLock;

/// The set of seed 1. It has many individuals, so it is made once.
static THE_SET: LazyLock<Vec<FrameSpec>> = LazyLock::new(|| frame_set(1).unwrap());

/// Labels that must agree with the name of the frame.
fn check(specs: &[FrameSpec]) {
    let names: HashSet<_> = specs.iter().map(|s| &s.name).collect();
    assert_eq!(names.len(), specs.len(), "two frames have the same name");
    for s in specs {
        let name = &s.name;
        let larva = matches!(s.class, Class::Larva | Class::DeadLarva);
        assert_eq!(s.labels.head.is_some(), larva, "{name}: {:?}", s.labels);
        if larva {
            assert_eq!(s.labels.head == Some(Side::Right), s.specimens[0].placement.faces_right, "{name}");
            assert_eq!(name.contains("clipped"), !s.labels.clipped.is_empty(), "{name} is clipped at {:?}", s.labels.clipped);
        }
        for (side, named) in [(Side::Left, "clipped_left"), (Side::Right, "clipped_right")] {
            assert!(!name.contains(named) || s.labels.clipped == [side], "{name}: {:?}", s.labels.clipped);
        }
        if name.contains("wedged") {
            let gap = s.labels.gap_px.unwrap();
            assert!(gap[0] < 2.0 && gap[1] < 2.0, "{name}: {gap:?}");
        }
        if let Some(gap) = s.labels.gap_px {
            // A specimen outside the bore would be refused. Perspective adds up to a pixel.
            assert!(gap[0] > -1.0 && gap[1] > -1.0, "{name}: {gap:?}");
        }
        assert!(s.settings.camera.gamma_rad.abs() <= 2.001f64.to_radians(), "{name}");
    }
}

#[test]
fn the_set_has_72_frames_of_all_that_it_names() {
    let specs = &*THE_SET;
    assert_eq!(specs.len(), 72);
    check(specs);
    for difficulty in [Difficulty::Easy, Difficulty::Medium, Difficulty::Hard, Difficulty::Vicious] {
        assert_eq!(specs.iter().filter(|s| s.difficulty == difficulty).count(), 18, "{difficulty:?}");
    }
    let count = |is: &dyn Fn(&FrameSpec) -> bool| specs.iter().filter(|s| is(s)).count();
    let larva = |s: &FrameSpec| s.class == Class::Larva;
    let kind = |s: &FrameSpec, wanted: &dyn Fn(Kind) -> bool| s.specimens.iter().any(|i| wanted(i.kind));
    for dpf in [3, 4, 5] {
        assert!(count(&|s| kind(s, &|k| k == Kind::Larva { dpf, fins: true })) >= 12, "{dpf} dpf");
    }
    assert!(count(&|s| kind(s, &|k| matches!(k, Kind::Larva { fins: false, .. }))) >= 5);
    assert!(count(&|s| s.class == Class::Bead) >= 8);
    assert!(count(&|s| s.class == Class::DeadLarva) >= 2 && count(&|s| s.class == Class::TwoLarvae) >= 1);
    for side in [Side::Left, Side::Right] {
        assert!(count(&|s| larva(s) && s.labels.head == Some(side)) >= 15, "heads {side:?}");
        assert!(count(&|s| s.labels.clipped.contains(&side)) >= 3, "clipped {side:?}");
    }
    assert!(count(&|s| larva(s) && s.labels.touches_wall) >= 15 && count(&|s| larva(s) && !s.labels.touches_wall) >= 25);
    assert!(count(&|s| larva(s) && s.labels.fill < 0.75) >= 5 && count(&|s| larva(s) && s.labels.fill > 0.93) >= 3);
    assert!(count(&|s| s.mono) >= 4 && count(&|s| !s.clutter.is_empty()) >= 10);
    let ratio = |s: &FrameSpec| s.settings.camera.ky_px_per_um / s.settings.camera.kx_px_per_um;
    assert!(count(&|s| (ratio(s) - 1.333).abs() < 1e-9) >= 4);
    assert!(count(&|s| s.settings.nuisances.motion != crate::scene::Motion::default()) >= 6);
    assert!(count(&|s| s.settings.nuisances.glass.scratches > 0) >= 4);
}

#[test]
fn another_seed_gives_other_frames_of_the_same_recipes() {
    let other = frame_set(77).unwrap();
    check(&other);
    for (a, b) in THE_SET.iter().zip(&other) {
        assert_eq!((&a.name, a.class, a.difficulty), (&b.name, b.class, b.difficulty));
        assert_ne!(a.seed, b.seed);
        assert_ne!(a.specimens, b.specimens, "{}", a.name);
    }
}

#[test]
fn detection_has_six_and_more_of_each() {
    let specs = detection_set(1).unwrap();
    check(&specs);
    let count = |is: &dyn Fn(&FrameSpec) -> bool| specs.iter().filter(|s| is(s)).count();
    for class in [Class::Empty, Class::Bead, Class::DeadLarva, Class::TwoLarvae, Class::Bubble, Class::Debris] {
        assert!(count(&|s| s.class == class) >= 6, "{class:?}");
    }
    for side in [Side::Left, Side::Right] {
        assert!(count(&|s| s.class == Class::Larva && s.labels.head == Some(side) && s.labels.clipped.is_empty()) >= 6, "head {side:?}");
        assert!(count(&|s| s.class == Class::Larva && s.labels.clipped == [side]) >= 6, "clipped {side:?}");
    }
}

#[test]
fn a_frame_repeats_and_its_labels_are_those_of_its_outline() {
    let wedged = THE_SET.iter().find(|s| s.name == "vicious_bead_wedged").unwrap();
    let place = THE_SET.iter().position(|s| s == wedged).unwrap();
    assert_eq!(&frames::recipes().swap_remove(place).spec(1, place as u64, Realism::Clean).unwrap(), wedged, "a spec repeats");
    let rendered = wedged.render().unwrap();
    assert_eq!(rendered, wedged.render().unwrap());
    assert_eq!(rendered.frame, wedged.frame().unwrap());
    assert_eq!(rendered.edge.len(), 1);
    let height = rendered.edge[0].iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], p| [l.min(p[1]), h.max(p[1])]);
    // 420 um, and the bead's silhouette fills its bore's.
    assert!((height[1] - height[0] - 420.0 / 5.5).abs() < 0.2, "{height:?}");
    assert!((wedged.labels.fill - 1.0).abs() < 0.01);
}

#[test]
fn the_list_with_dust_differs_from_the_clean_one_by_its_dust_only() {
    let dusty = frame_set_of(1, Realism::Dust).unwrap();
    assert_eq!(dusty.len(), THE_SET.len());
    for (clean, dusty) in THE_SET.iter().zip(&dusty) {
        let Nuisances { window_dust, glass_dust, water_dust, .. } = &dusty.settings.nuisances;
        let density = window_dust.specks_per_1000px + glass_dust.specks_per_1000px + water_dust.specks_per_1000px;
        assert!((70.0..120.0).contains(&density), "{}: {density} specks", dusty.name);
        let mut cleaned = dusty.clone();
        cleaned.settings.nuisances = clean.settings.nuisances.clone();
        assert_eq!(&cleaned, clean);
    }
}

#[test]
fn vast_frames_have_the_bore_the_fill_the_views_and_the_larvae_of_real_ones() {
    let specs = vast_frame_set(1).unwrap();
    assert_eq!(specs.len(), 48);
    let names: HashSet<_> = specs.iter().map(|s| &s.name).collect();
    assert_eq!(names.len(), specs.len());
    let count = |is: &dyn Fn(&FrameSpec) -> bool| specs.iter().filter(|s| is(s)).count();
    for s in &specs {
        let SceneSettings { camera, capillary, .. } = &s.settings;
        assert_eq!((camera.width, camera.height, s.demosaicked), (1024, 200, true));
        assert!((capillary.bore_diameter_um * camera.ky_px_per_um - 112.0).abs() < 1e-9, "{}", s.name);
        assert!(s.labels.clipped.is_empty(), "{} is clipped", s.name);
    }
    for s in specs.iter().step_by(5) {
        let narrowest = s.contents().unwrap().specimens[0].narrowest_bore().diameter_um;
        assert!((0.849..0.971).contains(&(narrowest / s.settings.capillary.bore_diameter_um)), "{}", s.name);
    }
    for dpf in 2..=7 {
        assert_eq!(count(&|s| s.specimens[0].kind == Kind::Larva { dpf, fins: true }), 8, "{dpf} dpf");
    }
    assert_eq!(count(&|s| s.name.contains("above") || s.name.contains("below")), 12);
    let sick = count(&|s| s.specimens[0].look.condition != Condition::Healthy);
    // A quarter of 48, with a standard deviation of 3.
    assert!((4..21).contains(&sick), "{sick}");
    for side in [Side::Left, Side::Right] {
        assert!(count(&|s| s.labels.head == Some(side)) >= 12, "heads {side:?}");
    }
    assert_ne!(specs[0], vast_frame_set(2).unwrap()[0]);
}

#[test]
fn vast_detection_has_500_frames_whose_labels_are_those_of_their_contents() {
    let specs = vast_detection_set(1).unwrap();
    assert_eq!(specs.len(), 500);
    let names: HashSet<_> = specs.iter().map(|s| &s.name).collect();
    assert_eq!(names.len(), specs.len());
    let count = |is: &dyn Fn(&FrameSpec) -> bool| specs.iter().filter(|s| is(s)).count();
    for (class, expected) in [(Class::Empty, 80), (Class::Larva, 170), (Class::DeadLarva, 50), (Class::Bead, 50)] {
        assert_eq!(count(&|s| s.class == class), expected, "{class:?}");
    }
    for s in &specs {
        let objects = match s.class {
            Class::Empty => 0,
            Class::TwoLarvae => 2,
            _ => 1,
        };
        assert_eq!(s.specimens.len(), objects, "{}", s.name);
        if s.class == Class::Larva {
            assert_eq!(s.name.contains("clipped"), !s.labels.clipped.is_empty(), "{}: {:?}", s.name, s.labels.clipped);
        }
        let dust = s.settings.nuisances.glass_dust.specks_per_1000px;
        assert!(dust > 20.0, "{} is clean", s.name);
    }
    assert_eq!(count(&|s| s.class == Class::Larva && !s.labels.clipped.is_empty()), 50);
    assert!(count(&|s| s.class == Class::TwoLarvae && s.labels.fill > 0.3) == 50);
}
