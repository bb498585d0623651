//! Whether the views show one specimen that turns, on the emulated rig with frames that look like those of a VAST.

use crate::closures;
use crate::wrong_turns::{self, AS_TOLD, Shot, Turn};
use carved::cli::emulated;
use carved_core::flag::Flag;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::geometry::{Camera, GlassTube};
use carved_core::pipeline::SpecimenRecord;
use hardware_sim::scene::{Capillary, Contents, Exposure, Larva, Look, Placement, Scene, SceneSettings, Specimen};

/// A larva in the middle of the capillary, and another one of the same age.
fn turn(seed: u64, views: usize) -> Turn {
    of_age(3 + (seed % 3) as u8, seed, views)
}

fn of_age(dpf: u8, seed: u64, views: usize) -> Turn {
    of_specimens(seed, views, |seed| {
        let larva = Larva::new(dpf, seed).unwrap().with_look(Look::healthy(dpf, seed)).specimen().centred();
        Contents::from(larva)
    })
}

/// A turn of what is in the capillary for a seed, and of what is there for another one.
fn of_specimens(seed: u64, views: usize, contents: impl Fn(u64) -> Contents) -> Turn {
    let mut settings = closures::settings();
    settings.planned_views = views as u32;
    let real = SceneSettings::real(1 + seed % 7);
    let capillary = Capillary { bore_diameter_um: Capillary::default().bore_diameter_um, ..real.capillary };
    let rig = SceneSettings { camera: emulated::scene_camera(&settings.camera), capillary, ..real };
    // A few larvae are too wide for the bore.
    let of = |seed: u64| {
        let loaded = |seed: u64| {
            let scene = Scene::new(rig.clone());
            scene.load(contents(seed)).is_ok().then_some(scene)
        };
        (0..4).find_map(|again| loaded(seed + 1_000_000 * again)).unwrap()
    };
    let (scene, other) = (of(seed), of(seed + 5000));
    Turn::new(
        views,
        settings,
        Box::new(move |angle_rad, number, is_other| {
            let rgb = if is_other { &other } else { &scene }.render(&Exposure { angle_rad, number }).demosaicked();
            RawFrame::new(rgb.width, rgb.height, PixelFormat::RGB8Packed, rgb.data).unwrap()
        }),
    )
}

#[test]
fn a_turn_that_is_none_is_named_on_the_emulated_rig() {
    let few = ["still", "every second view mirrored", "the second half upside down", "two neighbours exchanged", "reversed"];
    let mut wrong = turn(1, 12).judged("larva 1", &few, 0.0);
    // In a turn of two like larvae every view is a compromise. In a turn of 6 views none is held against the others.
    wrong.extend(turn(7001, 12).judged("larva 7001", &["two larvae"], 0.0));
    wrong.extend(turn(9001, 6).judged("larva 9001", &["still"], 0.0));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

fn as_told(turn: &Turn) -> SpecimenRecord {
    turn.measured(|view| Shot { at: view as f64, ..AS_TOLD })
}

/// Pictures that were binned by two with the scale of whole frames have an eighth of the volume. The bore has 650 um, and 600 are assumed where
/// none is stated.
#[test]
fn a_scale_that_the_bore_contradicts_is_flagged() {
    let mut turn = turn(1, 6);
    let camera = turn.settings.camera.clone();
    for (scale, glass, is_off) in
        [(2.0, Some(GlassTube::THIN), true), (0.5, Some(GlassTube::THIN), true), (1.0, Some(GlassTube::THIN), false), (2.0, None, false)]
    {
        let (kx, ky) = (scale * camera.kx, scale * camera.ky);
        turn.settings.camera = Camera { kx, ky, glass, ..camera.clone() };
        let found = as_told(&turn).flags;
        assert_eq!(found.iter().any(|flag| *flag == Flag::ScaleOffBore), is_off, "{scale} {found:?}");
    }
}

#[test]
fn a_turn_of_two_larvae_behind_each_other_is_flagged() {
    let at = |x_um, seed| Specimen::larva(3, seed).unwrap().placed(Placement { x_um, ..Placement::default() });
    let pair = |seed| Contents { specimens: vec![at(-1950.0, seed), at(1950.0, seed + 1)], clutter: Vec::new() };
    let found = as_told(&of_specimens(1, 6, pair));
    assert!(found.flags.iter().any(|flag| *flag == Flag::NotOneSpecimen), "{:?}", found.flags);
}

/// Copies of pictures in another format: `cargo test --test science turning::survey_of_copies -- --ignored --nocapture`
#[test]
#[ignore = "a survey: 24 larvae of one age"]
fn survey_of_copies() {
    let wrong = wrong_turns::unlike_copies(&(1..25).map(|seed| of_age(4, seed, 4)).collect::<Vec<_>>(), 6);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Turns of many larvae: `CARVED_TURNS=50 cargo test --test science turning::survey -- --ignored --nocapture`
#[test]
#[ignore = "a survey: it prints what is missed"]
fn survey() {
    wrong_turns::survey(|seed, views| (format!("larva {seed}"), turn(seed, views)));
}
