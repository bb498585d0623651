//! Classification of the labelled frames of the emulated rig, with seeds that were not used for tuning.

use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::{Detection, Kind, Picture, SegmentSettings, Side, segment};
use hardware_sim::scene::frame_set::{self, Class, FrameSpec, detection_set, vast_detection_set};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::sync::LazyLock;

const SEEDS: [u64; 2] = [101, 102];

struct Judged {
    spec: FrameSpec,
    /// `None` if the frame was refused.
    found: Option<Detection>,
}

fn judge(spec: FrameSpec) -> Judged {
    let frame = spec.frame().unwrap();
    let (format, bytes) = match (spec.mono, frame.height) {
        (true, _) => (PixelFormat::Mono8, frame.to_mono8()),
        // A VAST stores crops in colour.
        (false, 200) => (PixelFormat::RGB8Packed, frame.data.clone()),
        (false, _) => (PixelFormat::BayerRG8, frame.to_bayer_rg8()),
    };
    let picture = Picture::from_frame(&RawFrame::new(frame.width, frame.height, format, bytes).unwrap());
    let found = segment(&picture, &SegmentSettings::of_single_picture());
    if let Err(error) = &found {
        println!("{}: {error}", spec.name);
    }
    Judged { spec, found: found.ok().map(|p| p.detection) }
}

/// Rendered once for all tests.
static JUDGED: LazyLock<Vec<Judged>> =
    LazyLock::new(|| SEEDS.map(|seed| detection_set(seed).unwrap()).concat().into_par_iter().map(judge).collect());

fn kind_of(class: Class) -> Kind {
    match class {
        Class::Empty => Kind::Empty,
        Class::Bead => Kind::Bead,
        // Whether a larva is dead is a separate question.
        Class::Larva | Class::DeadLarva => Kind::Larva,
        Class::TwoLarvae => Kind::Two,
        Class::Bubble => Kind::Bubble,
        Class::Debris => Kind::Debris,
    }
}

/// A single frame cannot distinguish a grain or a scratch on the glass from debris in the bore. Both mean a well without a specimen.
fn no_specimen(expected: Kind, called: Kind) -> bool {
    expected == Kind::Empty && called == Kind::Debris
}

/// Prints how many frames of each class are called what.
fn confusion(judged: &[Judged]) -> BTreeMap<String, BTreeMap<String, usize>> {
    let mut table: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for Judged { spec, found } in judged {
        let called = found.map_or("refused", |d| d.kind.name());
        *table.entry(format!("{:?}", spec.class)).or_default().entry(called.to_owned()).or_default() += 1;
    }
    let columns = ["empty", "larva", "two", "bubble", "debris", "bead", "refused"];
    println!("| | {} |", columns.join(" | "));
    for (class, row) in &table {
        println!("| {class} | {} |", columns.map(|c| row.get(c).copied().unwrap_or(0).to_string()).join(" | "));
    }
    table
}

/// Nine of ten frames of each class get the right label. No wrong label has the confidence that right labels usually have.
#[test]
fn each_class_is_distinguished_from_the_others() {
    let (mut right, mut wrong) = (Vec::new(), Vec::new());
    for Judged { spec, found } in &*JUDGED {
        let expected = kind_of(spec.class);
        let confidence = found.map_or(0.0, |d| d.confidence);
        if found.is_some_and(|d| d.kind == expected || no_specimen(expected, d.kind)) {
            right.push(confidence);
        } else {
            println!("{} called {} with {confidence:.2}", spec.name, found.map_or("refused", |d| d.kind.name()));
            wrong.push(confidence);
        }
    }
    let mean = |of: &[f64]| of.iter().sum::<f64>() / of.len().max(1) as f64;
    println!("confidence of {} right ones {:.3}, of {} wrong ones {:.3}", right.len(), mean(&right), wrong.len(), mean(&wrong));
    let table = confusion(&JUDGED);
    for class in CLASSES {
        let row = &table[&format!("{class:?}")];
        let called = |kind: Kind| row.get(kind.name()).copied().unwrap_or(0);
        let all = row.values().sum::<usize>();
        let good = match class {
            Class::Empty => called(Kind::Empty) + called(Kind::Debris),
            _ => called(kind_of(class)),
        };
        assert!(good as f64 >= 0.9 * all as f64, "{class:?}: {good} of {all}");
    }
    assert!(wrong.is_empty() || mean(&wrong) < mean(&right) - 0.1, "wrong {wrong:.2?}");
}

const CLASSES: [Class; 7] = [Class::Empty, Class::Bead, Class::Larva, Class::DeadLarva, Class::TwoLarvae, Class::Bubble, Class::Debris];

/// The frames of [`vast_detection_set`] with a seed that nothing was tuned on, `step` apart.
fn dirty(step: usize) -> Vec<Judged> {
    vast_detection_set(103).unwrap().into_par_iter().step_by(step).map(judge).collect()
}

/// At real dirt, in frames as a VAST takes them. A dirty empty capillary is empty. Of ten frames per class one may be wrong, of bubbles two.
#[test]
fn classes_are_distinguished_at_real_dirt() {
    let table = confusion(&dirty(5));
    for class in CLASSES {
        let row = &table[&format!("{class:?}")];
        let (good, all) = (row.get(kind_of(class).name()).copied().unwrap_or(0), row.values().sum::<usize>());
        let wrong = if class == Class::Bubble { 2 } else { all.div_ceil(10) };
        assert!(good + wrong >= all, "{class:?}: {good} of {all}");
    }
}

#[test]
#[ignore = "prints the table of docs/measured.md: 500 frames"]
fn confusion_of_500_frames() {
    confusion(&dirty(1));
}

#[test]
fn no_bead_is_skipped() {
    for Judged { spec, found } in JUDGED.iter().filter(|j| j.spec.class == Class::Bead) {
        assert_eq!(found.and_then(|d| d.skip_reason()), None, "{}", spec.name);
    }
}

/// Share of right answers among some of the frames.
fn share(name: &str, answers: impl Iterator<Item = (String, bool, f64)>) -> f64 {
    let (mut right, mut all) = (0usize, 0usize);
    for (frame, good, confidence) in answers {
        all += 1;
        right += usize::from(good);
        if !good {
            println!("{name}: {frame} wrong with {confidence:.2}");
        }
    }
    println!("{name}: {right} of {all}");
    right as f64 / all.max(1) as f64
}

fn larvae() -> impl Iterator<Item = (&'static FrameSpec, Detection)> {
    let larva = |j: &&Judged| matches!(j.spec.class, Class::Larva | Class::DeadLarva);
    JUDGED.iter().filter(larva).filter_map(|j| Some((&j.spec, j.found?)))
}

#[test]
fn the_head_is_on_the_side_that_is_named() {
    let answers = larvae().filter(|(spec, _)| spec.labels.head.is_some()).map(|(spec, d)| {
        let expected = spec.labels.head.map(|side| if side == frame_set::Side::Left { Side::Left } else { Side::Right });
        (spec.name.clone(), d.head.side == expected, d.head.confidence)
    });
    assert!(share("head", answers) >= 0.9);
}

#[test]
fn dead_and_living_are_distinguished() {
    for dead in [true, false] {
        let answers = larvae()
            .filter(|(spec, _)| (spec.class == Class::DeadLarva) == dead)
            .map(|(spec, d)| (spec.name.clone(), d.looks_dead() == dead, d.dead));
        assert!(share(if dead { "dead" } else { "living" }, answers) >= 0.9);
    }
}

#[test]
fn a_larva_that_leaves_the_picture_says_where() {
    for side in [frame_set::Side::Left, frame_set::Side::Right] {
        for leaves in [true, false] {
            let answers = larvae().filter(|(spec, _)| spec.labels.clipped.contains(&side) == leaves).map(|(spec, d)| {
                let confidence = if side == frame_set::Side::Left { d.clipped_left } else { d.clipped_right };
                (spec.name.clone(), (confidence > 0.5) == leaves, confidence)
            });
            assert!(share(&format!("leaves to the {side:?}: {leaves}"), answers) >= 0.9);
        }
    }
}
