//! Turns that are none, of any renderer: frames of a turn, of the same turn mirrored, upside down, without turning, and of another larva, put
//! together. Used by the second renderer and by `tests/science/turning.rs`.

use carved_core::flag::Flag;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::pipeline::{Pipeline, PipelineSettings, SegmentedFrame, SpecimenRecord};
use carved_core::profile::Columns;
use carved_core::quality::{CoarseOutline, TurnFinding};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// The bytes of an RGB frame at an angle, rad. Each number has its own noise. The last value asks for the other larva.
pub type Render = Box<dyn Fn(f64, u64, bool) -> RawFrame + Sync>;

/// The frames of a turn of so many views.
pub struct Turn {
    pub views: usize,
    pub settings: PipelineSettings,
    pub render: Render,
    /// The views that were looked at, by their shot and number.
    seen: Mutex<BTreeMap<String, Arc<SegmentedFrame>>>,
}

/// Where the picture of each view comes from.
#[derive(Debug, Clone, Copy)]
pub struct Shot {
    /// Place in the turn, in views.
    pub at: f64,
    pub left_right: bool,
    pub upside_down: bool,
    pub other_larva: bool,
    /// The view whose exposure it is. `None` for one of its own.
    pub exposure: Option<usize>,
    /// How it was stored, and how again.
    pub stored: [Stored; 2],
}

/// How a picture is stored.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(dead_code)] // only the second renderer stores pictures again
pub enum Stored {
    AsItIs,
    /// As JPEG of a quality, %.
    Jpeg(u8),
    /// In steps of a number of grey levels.
    Rounded(u8),
    /// With all grey values multiplied.
    Gain(f64),
    /// With more noise of a standard deviation, grey levels.
    Noise(f64),
}

impl Stored {
    fn bytes(self, bytes: Vec<u8>, [w, h]: [u32; 2]) -> Vec<u8> {
        match self {
            Self::AsItIs => bytes,
            Self::Jpeg(quality) => {
                let mut file = Vec::new();
                let coder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, quality);
                image::ImageEncoder::write_image(coder, &bytes, w, h, image::ExtendedColorType::Rgb8).unwrap();
                image::load_from_memory_with_format(&file, image::ImageFormat::Jpeg).unwrap().into_rgb8().into_raw()
            }
            Self::Rounded(step) => bytes.into_iter().map(|grey| grey / step * step).collect(),
            Self::Noise(sd) => {
                let mut state = 0x9e37_79b9_7f4a_7c15_u64;
                let mut uniform = || {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 11) as f64 / (1_u64 << 53) as f64
                };
                // The sum of 12 has a variance of 1.
                let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
                bytes.into_iter().map(|grey| (f64::from(grey) + sd * normal()).round().clamp(0.0, 255.0) as u8).collect()
            }
            Self::Gain(gain) => bytes.into_iter().map(|grey| (gain * f64::from(grey)).round().min(255.0) as u8).collect(),
        }
    }
}

pub const AS_TOLD: Shot =
    Shot { at: 0.0, left_right: false, upside_down: false, other_larva: false, exposure: None, stored: [Stored::AsItIs; 2] };

impl Turn {
    pub fn new(views: usize, settings: PipelineSettings, render: Render) -> Self {
        Self { views, settings, render, seen: Mutex::default() }
    }

    pub fn omega(&self, at: f64) -> f64 {
        TAU * at / self.views as f64
    }

    fn frame(&self, view: usize, shot: Shot) -> RawFrame {
        let frame = (self.render)(self.omega(shot.at), shot.exposure.unwrap_or(view) as u64, shot.other_larva);
        let (w, h) = (frame.width() as usize, frame.height() as usize);
        let place = |u: usize, v: usize| {
            let [u, v] = [if shot.left_right { w - 1 - u } else { u }, if shot.upside_down { h - 1 - v } else { v }];
            3 * (v * w + u)
        };
        let bytes = (0..w * h).flat_map(|i| {
            let at = place(i % w, i / w);
            frame.bytes()[at..at + 3].to_vec()
        });
        let size = [w as u32, h as u32];
        let bytes = shot.stored.iter().fold(bytes.collect(), |bytes, stored| stored.bytes(bytes, size));
        RawFrame::new(size[0], size[1], PixelFormat::RGB8Packed, bytes).unwrap()
    }

    fn look(&self, pipeline: &Pipeline, view: usize, shot: Shot) -> Arc<SegmentedFrame> {
        let key = format!("{view} {shot:?}");
        let known = self.seen.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned();
        known.unwrap_or_else(|| {
            let seen = Arc::new(pipeline.look(&self.frame(view, shot)).unwrap());
            self.seen.lock().unwrap_or_else(PoisonError::into_inner).insert(key, Arc::clone(&seen));
            seen
        })
    }

    /// The given views of the turn, each with its picture.
    pub fn seen(&self, views: Range<usize>, shot: impl Fn(usize) -> Shot + Sync) -> (Pipeline, Vec<Arc<SegmentedFrame>>) {
        let pipeline = Pipeline::new(self.settings.clone()).unwrap();
        let seen = views.into_par_iter().map(|view| self.look(&pipeline, view, shot(view))).collect();
        (pipeline, seen)
    }

    pub fn measured(&self, shot: impl Fn(usize) -> Shot + Sync) -> SpecimenRecord {
        let (mut pipeline, seen) = self.seen(0..self.views, shot);
        for (view, frame) in seen.iter().enumerate() {
            pipeline.observe(view as u32, self.omega(view as f64), frame).unwrap();
        }
        pipeline.finish().unwrap().1
    }

    /// The kinds of turns that are not found as what they are, or `good` if the good turn is found to be none. Empty where all is right.
    /// Exchanged neighbours that change the volume by less than the share `harmless` count as found.
    pub fn judged(&self, name: &str, only: &[&str], harmless: f64) -> Vec<String> {
        let left_out = |record: &SpecimenRecord| record.views.iter().filter(|v| !v.used).map(|v| v.index).collect::<Vec<_>>();
        let mut wrong = Vec::new();
        let is_shown = |kind: &str| kind != REVERSED || self.settings.camera.f < PARALLEL_UM;
        let known: Vec<&str> = kinds(self.views).iter().map(|(kind, ..)| *kind).chain([GOOD]).collect();
        assert!(only.iter().all(|kind| known.contains(kind)), "{only:?} are not all of {known:?}");
        let kinds = kinds(self.views).into_iter().filter(|(kind, ..)| is_shown(kind) && (only.is_empty() || only.contains(kind)));
        let good = self.measured(|view| Shot { at: view as f64, ..AS_TOLD });
        for (kind, flag, shot) in kinds {
            let record = self.measured(shot);
            let found: Vec<Flag> = record.turn_findings.iter().map(TurnFinding::flag).collect();
            let is_named =
                found.contains(&flag) && record.flags.iter().any(|f| *f == flag) && record.quality.as_ref().is_some_and(|q| !q.passed);
            // A single view that does not belong may be left out instead. A view of which the fins were misread may be left out beside it.
            let is_left_out = kind == UPSIDE_DOWN && left_out(&record).contains(&3) && left_out(&record).len() <= 2;
            // Neighbours that look alike may be exchanged.
            let change = record.measurement.volume_um3 / good.measurement.volume_um3 - 1.0;
            let is_harmless = kind == NEIGHBOURS && change.abs() < harmless;
            if !is_named && !is_left_out && !is_harmless {
                wrong.push(format!("{name}, {} views, {kind}: {found:?} {:?}", self.views, record.flags));
            }
        }
        if !good.turn_findings.is_empty() {
            wrong.push(format!("{name}, {} views, good: {:?}", self.views, good.turn_findings));
        }
        wrong
    }
}

/// Judges turns of many specimens and prints what is wrong. `CARVED_TURNS` is the number of specimens, `CARVED_FROM` the first one,
/// `CARVED_VIEWS` the number of views, and `CARVED_KINDS` a kind of turn, or `good` for good turns only.
pub fn survey(turn: impl Fn(u64, usize) -> (String, Turn)) {
    let number = |key: &str, otherwise: u64| std::env::var(key).ok().and_then(|n| n.parse().ok()).unwrap_or(otherwise);
    let only = std::env::var("CARVED_KINDS").ok();
    let only: Vec<&str> = only.as_deref().into_iter().collect();
    let (from, turns) = (number("CARVED_FROM", 0), number("CARVED_TURNS", 4));
    let mut missed = 0;
    for seed in from..from + turns {
        let (name, turn) = turn(seed, number("CARVED_VIEWS", [21, 12, 21, 32][seed as usize % 4]) as usize);
        for wrong in turn.judged(&name, &only, HARMLESS) {
            missed += 1;
            println!("{wrong}");
        }
    }
    let of_each = 1 + kinds(21).iter().filter(|(kind, ..)| only.is_empty() || only.contains(kind)).count() as u64;
    println!("{turns} specimens from {from}, {missed} wrong of {} turns", turns * of_each);
}

/// Least share of the views that are known again in another format: 351 of 360 were in a survey.
const KNOWN_SHARE: f64 = 0.85;

/// The larvae that are not known again in another format, and those of which a picture is taken for one of another. Three views of each larva;
/// the first `copied` larvae are stored again.
pub fn unlike_copies(larvae: &[Turn], copied: usize) -> Vec<String> {
    const COPIES: [Stored; 5] = [Stored::Jpeg(90), Stored::Jpeg(75), Stored::Noise(2.0), Stored::Rounded(2), Stored::Gain(0.98)];
    let mut wrong = Vec::new();
    let outlines = |larva: &Turn, stored| -> Vec<Option<CoarseOutline>> {
        let (_, seen) = larva.seen(0..3, |view| Shot { at: view as f64, stored: [stored, Stored::AsItIs], ..AS_TOLD });
        seen.iter()
            .map(|frame| {
                let body = &frame.profile.as_ref().unwrap().body;
                CoarseOutline::of(&Columns::from_outlines(body, frame.picture.width(), frame.picture.height()))
            })
            .collect()
    };
    let (mut known, mut nearest) = (0, f64::INFINITY);
    let own: Vec<Vec<Option<CoarseOutline>>> = larvae.iter().map(|larva| outlines(larva, Stored::AsItIs)).collect();
    for (number, (larva, own)) in larvae.iter().zip(&own).enumerate().take(copied) {
        for stored in COPIES {
            let copies = outlines(larva, stored);
            let same = own.iter().zip(&copies).filter(|(a, b)| a.as_ref().zip(b.as_ref()).is_some_and(|(a, b)| a.is_same(b))).count();
            known += same;
            if same == 0 {
                wrong.push(format!("larva {number} is not known: {stored:?}"));
            }
        }
    }
    let (mut pairs, mut comparable) = (0, 0);
    for (number, own_views) in own.iter().enumerate() {
        for (other, others) in own[..number].iter().enumerate() {
            for (a, b) in own_views.iter().flatten().flat_map(|a| others.iter().flatten().map(move |b| (a, b))) {
                pairs += 1;
                comparable += usize::from(a.distance_px(b).is_some());
                nearest = nearest.min(a.distance_px(b).unwrap_or(f64::INFINITY));
                if a.is_same(b) {
                    wrong.push(format!("larvae {other} and {number}: {:?} px", a.distance_px(b)));
                }
            }
        }
    }
    assert!(comparable > 0, "no two larvae lie at one place");
    // A well is known by two views of its turn.
    let of = 3 * COPIES.len() * copied.min(larvae.len());
    assert!(known as f64 >= KNOWN_SHARE * of as f64, "{known} of {of} views are known again");
    println!(
        "{} larvae: {known} of {of} views are known again; {pairs} pairs of views of different larvae, {comparable} at the same place, at least \
         {nearest:.2} px apart",
        larvae.len()
    );
    wrong
}

/// A kind of turn that is none, the flag that it must raise, and the picture of each view.
pub type WrongTurn = (&'static str, Flag, Box<dyn Fn(usize) -> Shot + Sync>);

/// Of a survey of good turns only.
const GOOD: &str = "good";
const UPSIDE_DOWN: &str = "one view upside down";
const REVERSED: &str = "reversed";
const NEIGHBOURS: &str = "two neighbours exchanged";
/// Largest change of the volume, as a share, by neighbours that are exchanged unnoticed, in a survey.
const HARMLESS: f64 = 0.001;
/// A camera farther away shows a turn in the other sense as that of the mirror image, um.
const PARALLEL_UM: f64 = 1e6;

/// The kinds of turns that are none.
pub fn kinds(views: usize) -> Vec<WrongTurn> {
    const STILL: Flag = Flag::RotationSuspect;
    const MIRRORED: Flag = Flag::MirroredViews;
    const ELSEWHERE: Flag = Flag::ViewsDisagree;
    let n = views as f64;
    let told = |view: usize| Shot { at: view as f64, ..AS_TOLD };
    let from = views / 2 + 1;
    vec![
        ("still", STILL, Box::new(move |_| Shot { at: 3.0, ..AS_TOLD })),
        ("stalled half way", STILL, Box::new(move |view| Shot { at: (view as f64).min(n / 2.0), ..AS_TOLD })),
        ("the second half mirrored", MIRRORED, Box::new(move |view| Shot { left_right: view >= from, ..told(view) })),
        ("every second view mirrored", MIRRORED, Box::new(move |view| Shot { left_right: view % 2 == 1, ..told(view) })),
        ("one view mirrored", MIRRORED, Box::new(move |view| Shot { left_right: view == 5, ..told(view) })),
        (
            "the second half turned in the plane",
            MIRRORED,
            Box::new(move |view| Shot { left_right: view >= from, upside_down: view >= from, ..told(view) }),
        ),
        ("the second half upside down", ELSEWHERE, Box::new(move |view| Shot { upside_down: view >= from, ..told(view) })),
        ("every second view upside down", ELSEWHERE, Box::new(move |view| Shot { upside_down: view % 2 == 1, ..told(view) })),
        (UPSIDE_DOWN, ELSEWHERE, Box::new(move |view| Shot { upside_down: view == 3, ..told(view) })),
        ("the second half reversed", ELSEWHERE, Box::new(move |view| if view < from { told(view) } else { told(views - 1 + from - view) })),
        (
            "two views exchanged",
            ELSEWHERE,
            Box::new(move |view| {
                told(match view {
                    4 => 7,
                    7 => 4,
                    other => other,
                })
            }),
        ),
        (
            NEIGHBOURS,
            ELSEWHERE,
            Box::new(move |view| {
                told(match view {
                    _ if view == from - 1 => from,
                    _ if view == from => from - 1,
                    other => other,
                })
            }),
        ),
        (REVERSED, Flag::WrongSense, Box::new(move |view| told(views - view))),
        ("two turns", ELSEWHERE, Box::new(move |view| told(2 * view))),
        ("half a turn", ELSEWHERE, Box::new(move |view| Shot { at: view as f64 / 2.0, ..AS_TOLD })),
        ("two larvae", ELSEWHERE, Box::new(move |view| Shot { other_larva: view >= from, ..told(view) })),
        ("some views of another larva", ELSEWHERE, Box::new(move |view| Shot { other_larva: view % 7 == 3, ..told(view) })),
    ]
}
