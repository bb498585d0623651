//! Whether the views show one specimen that turns: turns that are none are named, and good turns are not refused.
//!
//! ```text
//!  frames of a turn, of the same turn mirrored, upside down, without turning, and of another larva ── put together ── Pipeline ── findings
//! ```

use crate::cases::{Kind, Size, scene};
use crate::dust::Dirt;
use crate::judge::raw_frame;
use crate::wrong_turns::{AS_TOLD, Shot, Stored, Turn, unlike_copies};
use carved_core::frame::PixelFormat;
use carved_core::geometry::{BoxUm, Camera, VoxelGrid};
use carved_core::pipeline::PipelineSettings;
use carved_core::profile::SegmentSettings;
use carved_core::quality::{QualitySettings, TurnFinding};
use carved_core::reconstruction::ReconstructionSettings;

fn turn(kind: Kind, dirt: Dirt, seed: u64, views: usize) -> Turn {
    let of = |seed| scene(kind, Size::Crop, dirt, seed);
    let (scene, other) = (of(seed), of(seed + 5000));
    let (view, specimen) = (scene.view, scene.specimen.as_ref().unwrap());
    let scale = 1.0 / view.px_um;
    let [ux, uy] = view.origin_px;
    let published = Camera::published(view.width as u32, view.height as u32);
    let camera = Camera { f: 1e8, kx: scale, ky: scale, ux, uy: uy + 1.2, ..published };
    let span = specimen.slices();
    let along = |slice: isize, more_um: f64| slice as f64 * view.step_um() + more_um;
    let across_um = scene.glass.bore_um + 30.0;
    let region = BoxUm { min: [along(span.start, -250.0), -across_um, -across_um], max: [along(span.end, 250.0), across_um, across_um] };
    let settings = PipelineSettings {
        camera,
        grid: VoxelGrid::new(region, 20.0).unwrap(),
        planned_views: views as u32,
        segment: SegmentSettings::default(),
        empty_capillary: None,
        reconstruction: ReconstructionSettings::default(),
        quality: QualitySettings::default(),
        sphere: false,
    };
    Turn::new(
        views,
        settings,
        Box::new(move |omega, number, is_other| {
            raw_frame(&if is_other { &other } else { &scene }.render(omega, number), PixelFormat::RGB8Packed)
        }),
    )
}

#[test]
fn a_turn_that_is_none_is_named() {
    let few = ["still", "every second view mirrored", "the second half upside down", "two neighbours exchanged", "two larvae"];
    let wrong: Vec<String> = [(Kind::Finned, 301, 21), (Kind::Finless, 302, 12)]
        .iter()
        .flat_map(|&(kind, seed, views)| turn(kind, Dirt::MEASURED, seed, views).judged(&format!("{kind:?} {seed}"), &few, 0.0))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A picture of the turn under another angle is named however it was stored again, and no turn is refused for how it is stored.
#[test]
fn an_exposure_that_is_stored_again_is_found() {
    const STORED: [Stored; 6] =
        [Stored::AsItIs, Stored::Jpeg(95), Stored::Jpeg(75), Stored::Rounded(2), Stored::Gain(1.01), Stored::Gain(0.99)];
    let mut wrong = Vec::new();
    for (kind, seed, views, copied) in [(Kind::Finned, 321, 21, [5, 11]), (Kind::Finless, 322, 12, [2, 3])] {
        let turn = turn(kind, Dirt::MEASURED, seed, views);
        let told = |view: usize| Shot { at: view as f64, ..AS_TOLD };
        let [from, to] = copied;
        let of_turn = [Stored::AsItIs, Stored::Jpeg(90)];
        for (all, again) in of_turn.iter().flat_map(|all| STORED.iter().map(move |again| (*all, *again))) {
            let shot = |view: usize| {
                if view == to {
                    Shot { exposure: Some(from), stored: [all, again], ..told(from) }
                } else {
                    Shot { stored: [all, Stored::AsItIs], ..told(view) }
                }
            };
            let found = turn.measured(shot).turn_findings;
            let is_named =
                found.iter().any(|f| matches!(f, TurnFinding::Repeated { view, other, .. } if [*view as usize, *other as usize] == copied));
            // This coding changes as much as the noise does. The copy still does not fit its angle.
            let is_found = is_named || (again == Stored::Jpeg(75) && !found.is_empty());
            if !is_found {
                wrong.push(format!("{kind:?} {seed}: {again:?} in a turn stored {all:?}: {found:?}"));
            }
        }
        for (even, odd) in [(Stored::AsItIs, Stored::AsItIs), (Stored::Jpeg(75), Stored::Jpeg(75)), (Stored::AsItIs, Stored::Jpeg(75))] {
            let good =
                turn.measured(|view| Shot { stored: [if view % 2 == 0 { even } else { odd }, Stored::AsItIs], ..told(view) }).turn_findings;
            if !good.is_empty() {
                wrong.push(format!("{kind:?} {seed}, stored {even:?} and {odd:?}: {good:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A picture of another well is known again in another format, and no other larva is taken for it.
#[test]
fn a_picture_in_another_format_is_known_and_another_larva_is_not() {
    assert_unlike(2, 2, 4);
}

fn assert_unlike(finned: u64, finless: u64, copied: usize) {
    let larvae = |kind, from: u64, number| (from..from + number).map(move |seed| turn(kind, Dirt::MEASURED, seed, 4));
    let wrong = unlike_copies(&larvae(Kind::Finned, 341, finned).chain(larvae(Kind::Finless, 371, finless)).collect::<Vec<_>>(), copied);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// `cargo test -p carved-core --test second_renderer turning::survey_of_copies -- --ignored --nocapture`
#[test]
#[ignore = "a survey: 24 larvae"]
fn survey_of_copies() {
    assert_unlike(12, 12, 24);
}

/// A still specimen is seen from the third view on, a turning one never. The outline of the nearly round larva does not change over the three views.
#[test]
fn a_specimen_that_stands_still_is_seen_at_the_third_view() {
    let nearly_round = (Kind::Finless, 10_001, 84, 7);
    for (kind, seed, views, first) in [(Kind::Finned, 311, 84, 0), (Kind::Finned, 312, 21, 0), (Kind::Finless, 313, 12, 0), nearly_round] {
        let turn = turn(kind, Dirt::MEASURED, seed, views);
        let after_three = |step: f64| {
            let (mut pipeline, seen) =
                turn.seen(first..first + 3, |view| Shot { at: first as f64 + step * (view - first) as f64, ..AS_TOLD });
            for (view, frame) in (first..).zip(&seen) {
                assert!(pipeline.still().is_none(), "before the third view");
                pipeline.observe(view as u32, turn.omega(view as f64), frame).unwrap();
            }
            pipeline.still().is_some()
        };
        assert_eq!((after_three(0.0), after_three(1.0)), (true, false), "{kind:?} {seed}, {views} views");
    }
}

/// Turns of many specimens: `CARVED_TURNS=50 cargo test --release -p carved-core --test second_renderer turning::survey -- --ignored --nocapture`
#[test]
#[ignore = "a survey: it prints what is missed"]
fn survey() {
    crate::wrong_turns::survey(|seed, views| {
        let kind = if seed % 2 == 0 { Kind::Finned } else { Kind::Finless };
        (format!("{kind:?} {}", 1000 + seed), turn(kind, Dirt::MEASURED, 1000 + seed, views))
    });
}
