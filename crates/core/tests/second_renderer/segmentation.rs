//! Segmentation of the renderer's frames against their truth.

use crate::cases::{Kind, Size, scene};
use crate::dust::Dirt;
use crate::judge::{Judged, judge, raw_frame};
use crate::pictures::write_profile;
use crate::scene::Frame;
use crate::truth::mask;
use carved_core::frame::PixelFormat;
use carved_core::profile::{Damage, Mask, Picture, ProfileError, SegmentSettings, Wall, segment};
use rayon::prelude::*;
use std::ops::Range;

/// Frames of one kind, and what segmentation reaches on them at least.
struct Row {
    name: &'static str,
    kind: Kind,
    size: Size,
    format: PixelFormat,
    dirt: Dirt,
    specimens: u64,
    floor: Floor,
}

/// What segmentation reaches on the frames of a row.
struct Floor {
    /// Least median and least worst overlap (intersection over union).
    iou: [f64; 2],
    /// Largest median distance of the outline from the truth, px, to either side.
    beside_px: f64,
    /// Least median share of the fins.
    fins: f64,
    /// Most false pixels in the median frame, and in the worst.
    false_px: [usize; 2],
    /// Most frames that are refused.
    refused: usize,
}

/// The floors lie a little below the worst of three sets: those of `survey` (seeds from 100 and from 200), and the one that the test uses.
#[rustfmt::skip]
const ROWS: [Row; 10] = [
    // Name, kind, size, dirt, specimens; overlap in the median and at worst, distance in px, fins, false pixels in the median and at most, refused.
    row("finned, 1024 x 200", Kind::Finned, Size::Crop, Dirt::NONE, 4, [0.945, 0.86], 0.6, 0.82, [30, 300], 0),
    row("finned, 1024 x 200, dust", Kind::Finned, Size::Crop, Dirt::MEASURED, 4, [0.94, 0.87], 0.8, 0.74, [60, 1300], 0),
    row("finless, 1024 x 200", Kind::Finless, Size::Crop, Dirt::NONE, 3, [0.985, 0.97], 0.2, 0.0, [2, 40], 0),
    row("finless, 1024 x 200, dust", Kind::Finless, Size::Crop, Dirt::MEASURED, 3, [0.985, 0.965], 0.3, 0.0, [5, 400], 0),
    row("finned, 1024 x 1024", Kind::Finned, Size::Full, Dirt::NONE, 4, [0.95, 0.92], 0.7, 0.84, [20, 250], 0),
    row("finned, 1024 x 1024, dust", Kind::Finned, Size::Full, Dirt::MEASURED, 4, [0.94, 0.865], 0.8, 0.77, [20, 200], 0),
    row("ellipsoid, 1024 x 200", Kind::Ellipsoid, Size::Crop, Dirt::NONE, 3, [0.99, 0.975], 0.2, 0.0, [2, 20], 0),
    row("ellipsoid, 1024 x 200, dust", Kind::Ellipsoid, Size::Crop, Dirt::MEASURED, 3, [0.99, 0.95], 0.2, 0.0, [2, 300], 0),
    row("bead, 1024 x 200", Kind::Bead, Size::Crop, Dirt::NONE, 3, [0.992, 0.985], 0.15, 0.0, [2, 10], 0),
    row("bead, 1024 x 200, dust", Kind::Bead, Size::Crop, Dirt::MEASURED, 3, [0.99, 0.983], 0.15, 0.0, [2, 30], 0),
];

#[allow(clippy::too_many_arguments, reason = "a row of a table")]
const fn row(
    name: &'static str,
    kind: Kind,
    size: Size,
    dirt: Dirt,
    specimens: u64,
    iou: [f64; 2],
    beside_px: f64,
    fins: f64,
    false_px: [usize; 2],
    refused: usize,
) -> Row {
    // A whole sensor sends its mosaic, a VAST stores colours.
    let format = match size {
        Size::Full => PixelFormat::BayerRG8,
        Size::Crop => PixelFormat::RGB8Packed,
    };
    Row { name, kind, size, format, dirt, specimens, floor: Floor { iou, beside_px, fins, false_px, refused } }
}

impl Row {
    /// The profiles of all frames; `None` for a frame that is refused.
    fn judged(&self, first_seed: u64) -> Vec<Option<Judged>> {
        // Views of each specimen, one every 60 deg from an angle of its own.
        let views = if self.size == Size::Full { 2 } else { 3 };
        let seeds: Vec<u64> = (first_seed..first_seed + self.specimens).collect();
        let of_one = |seed: &u64| {
            let scene = scene(self.kind, self.size, self.dirt, *seed);
            let judged = (0..views).map(|view| {
                let frame = scene.render(0.4 * *seed as f64 + (60.0 * view as f64).to_radians(), view);
                let picture = Picture::from_frame(&raw_frame(&frame, self.format));
                let Ok(profile) = segment(&picture, &SegmentSettings::of_single_picture()) else {
                    write_profile(&format!("refused {} {seed} {view}", self.name), &frame, &mask(&frame, &frame.covered));
                    return None;
                };
                let judged = judge(&profile, &frame);
                if judged.false_px > 200 {
                    write_profile(&format!("false {} {seed} {view}", self.name), &frame, &profile.mask);
                }
                Some(judged)
            });
            judged.collect::<Vec<_>>()
        };
        seeds.par_iter().flat_map_iter(of_one).collect()
    }
}

/// The median; of an even number of values the upper one of the middle.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}

/// The figures of a row: median and worst overlap, median distance, median share of fins, median and most false pixels, refused frames.
struct Figures {
    frames: usize,
    iou: [f64; 2],
    beside_px: f64,
    fins: Option<f64>,
    false_px: [usize; 2],
    refused: usize,
}

impl Figures {
    fn of(row: &Row, first_seed: u64) -> Self {
        let frames = row.judged(first_seed);
        let judged: Vec<Judged> = frames.iter().flatten().copied().collect();
        let all = |of: fn(&Judged) -> Option<f64>| judged.iter().filter_map(of);
        let worst = all(|j| Some(j.iou)).fold(1.0, f64::min);
        let found = Self {
            frames: frames.len(),
            iou: [median(all(|j| Some(j.iou))).unwrap(), worst],
            beside_px: median(all(|j| j.signed_px)).unwrap_or(f64::INFINITY),
            fins: median(all(|j| j.fins)),
            false_px: [median(all(|j| Some(j.false_px as f64))).unwrap() as usize, judged.iter().map(|j| j.false_px).max().unwrap()],
            refused: frames.len() - judged.len(),
        };
        let Self { frames, iou: [median, worst], beside_px, fins, false_px: [usual, most], refused } = &found;
        let fins = fins.map_or("-".to_owned(), |f| format!("{f:.2}"));
        println!("| {:27} | {frames} | {median:.3}, {worst:.3} | {beside_px:+.2} | {fins} | {usual}, {most} | {refused} |", row.name);
        found
    }
}

const HEAD: &str = "| | frames | IoU: median, worst | edge, px | fins found | false px: median, most | refused |";

/// Seeds of the frames that the floors are checked on.
const FIRST_SEED: u64 = 500;

#[test]
fn profiles_are_those_of_the_truth() {
    println!("{HEAD}");
    let mut below = Vec::new();
    for row in &ROWS {
        let (found, floor) = (Figures::of(row, FIRST_SEED), &row.floor);
        let mut hold = |is_held: bool, what: &str| {
            if !is_held {
                below.push(format!("{}: {what}", row.name));
            }
        };
        hold(found.iou[0] >= floor.iou[0], "median overlap");
        hold(found.iou[1] >= floor.iou[1], "worst overlap");
        hold(found.beside_px.abs() <= floor.beside_px, "distance of the outline");
        hold(found.fins.is_none_or(|fins| fins >= floor.fins), "share of the fins");
        hold(found.false_px[0] <= floor.false_px[0], "false pixels in the median");
        hold(found.false_px[1] <= floor.false_px[1], "false pixels at most");
        hold(found.refused <= floor.refused, "refused frames");
    }
    assert!(below.is_empty(), "{below:#?}");
}

/// Walls whose two lines blend, 5 px apart. Each piece of a wall may show another of its lines as the darker.
#[test]
fn walls_of_two_lines_are_found() {
    let refused = two_lines(FIRST_SEED);
    assert_eq!(refused, 0, "{refused} of 12 frames refused");
}

/// Refused frames of 12 beads in glass whose walls have two lines.
fn two_lines(first_seed: u64) -> usize {
    let is_refused = |seed: u64| {
        let mut scene = scene(Kind::Bead, Size::Crop, Dirt::NONE, seed);
        (scene.glass.outer, scene.glass.apart_px) = (0.4, 5.0);
        let frame = raw_frame(&scene.render(0.4 * seed as f64, 0), PixelFormat::RGB8Packed);
        segment(&Picture::from_frame(&frame), &SegmentSettings::of_single_picture()).is_err()
    };
    (first_seed..first_seed + 12).into_par_iter().filter(|seed| is_refused(*seed)).count()
}

/// A program that was stopped while it wrote leaves zeros below what it has written. Rows of zeros are not of the picture: they count neither
/// as the light beside the capillary nor as enough of it.
#[test]
fn rows_of_zeros_beside_the_capillary_change_no_outline() {
    let of = |frame: &Frame| segment(&Picture::from_frame(&raw_frame(frame, PixelFormat::BayerRG8)), &SegmentSettings::of_single_picture());
    for seed in FIRST_SEED..FIRST_SEED + 4 {
        let mut frame = scene(Kind::Finned, Size::Full, Dirt::MEASURED, seed).render(0.4 * seed as f64, 0);
        let whole = of(&frame).unwrap();
        let wall = [0.0, frame.width as f64].map(|u| whole.walls.lower.outer.at(u)).into_iter().fold(0.0, f64::max) as usize;
        let pixels = || (0..frame.height).flat_map(|v| (0..frame.width).map(move |u| (u, v)));
        let area = pixels().filter(|&(u, v)| whole.mask.get(u, v)).count();
        let apart = |cut: &Mask| pixels().filter(|&(u, v)| whole.mask.get(u, v) != cut.get(u, v)).count();
        let mut found = Vec::new();
        for beyond_px in [150, 40] {
            let mut cut = Frame { mosaic: frame.mosaic.clone(), covered: Vec::new(), body: Vec::new(), ..frame };
            cut.mosaic[(wall + beyond_px) * frame.width..].fill(0);
            found.push(apart(&of(&cut).unwrap().mask));
        }
        assert_eq!(found[0], 0, "{seed}: nothing is read so far from the wall");
        // A third of the band tells the light less exactly. With the zeros in it, one of these larvae loses 1292 px of a fin.
        assert!(200 * found[1] <= area, "{seed}: {} of {area} px", found[1]);
        // Too little is left on both sides.
        frame.mosaic[(wall + 4) * frame.width..].fill(0);
        let first = whole.walls.upper.outer.at(0.0).min(whole.walls.upper.outer.at(frame.width as f64)) as usize;
        frame.mosaic[..(first - 4) * frame.width].fill(0);
        assert!(of(&frame).is_err(), "{seed}");
    }
}

/// Rows, columns and blocks that a camera or a program has not filled, or has filled with others, are no light and no specimen: such a frame is
/// refused by name.
#[test]
fn a_frame_that_is_damaged_in_the_bore_is_refused_and_one_that_is_cut_beside_it_is_read() {
    let of = |frame: &Frame| segment(&Picture::from_frame(&raw_frame(frame, PixelFormat::BayerRG8)), &SegmentSettings::of_single_picture());
    for seed in FIRST_SEED..FIRST_SEED + 4 {
        let frame = scene(Kind::Finned, Size::Full, Dirt::MEASURED, seed).render(0.4 * seed as f64, 0);
        let whole = of(&frame).unwrap();
        let (width, height) = (frame.width, frame.height);
        let at_ends = |wall: &Wall| [0.0, width as f64].map(|u| wall.outer.at(u));
        let top = at_ends(&whole.walls.upper).into_iter().fold(f64::INFINITY, f64::min) as usize;
        let bottom = at_ends(&whole.walls.lower).into_iter().fold(0.0, f64::max) as usize;
        let floor = [0.0, width as f64].map(|u| whole.walls.lower.inner.at(u)).into_iter().fold(f64::INFINITY, f64::min) as usize;
        let in_mask = |u: usize| (0..height).filter(|&v| whole.mask.get(u, v)).collect::<Vec<_>>();
        let columns: Vec<usize> = (0..width).filter(|&u| !in_mask(u).is_empty()).collect();
        let column = columns[columns.len() / 2];
        let (edge, middle) = (in_mask(column)[0], usize::midpoint(top, bottom));
        // The pixels are those of a source, row and column, or one value.
        let changed = |rows: Range<usize>, columns: Range<usize>, source: &dyn Fn(usize, usize) -> u8| {
            let mut spoiled = Frame { mosaic: frame.mosaic.clone(), covered: Vec::new(), body: Vec::new(), ..frame };
            for v in rows {
                for u in columns.clone() {
                    spoiled.mosaic[v * width + u] = source(u, v);
                }
            }
            of(&spoiled)
        };
        let refused = |what: &str, found: Result<_, ProfileError>, as_filled: Option<u8>| match found {
            Err(ProfileError::Damaged { damage: Damage::Filled(value), .. }) => assert_eq!(Some(value), as_filled, "{seed} {what}"),
            Err(ProfileError::Damaged { damage: Damage::Copied { .. }, .. }) => assert_eq!(as_filled, None, "{seed} {what}"),
            Err(other) => panic!("{seed} {what}: {other}"),
            Ok(_) => panic!("{seed} {what} was read"),
        };
        for value in [0, 128, 255] {
            for dead in [middle..middle + 1, edge..edge + 1, middle - 3..middle + 5, floor - 20..floor - 10, middle..height, 0..middle] {
                refused(&format!("rows {dead:?}"), changed(dead, 0..width, &|_, _| value), Some(value));
            }
            for dead in [column..column + 1, 300..301, 500..508, 900..width, 0..100] {
                refused(&format!("columns {dead:?}"), changed(0..height, dead, &|_, _| value), Some(value));
            }
            for side in [16, 64] {
                let block = changed(edge - side / 2..edge + side / 2, column..column + side, &|_, _| value);
                refused(&format!("a block of {side} px"), block, Some(value));
            }
        }
        let sound = |u: usize, v: usize| frame.mosaic[v * width + u];
        for count in [1, 2, 8, 20] {
            let copy = changed(edge..edge + count, 0..width, &|u, v| sound(u, v - count));
            refused(&format!("{count} rows of those above"), copy, None);
        }
        let copy = changed(edge - 32..edge + 32, column..column + 64, &|u, v| sound(u - 64, v));
        refused("a block of another", copy, None);
        for beside in [bottom + 40..height, 0..top - 40] {
            assert!(changed(beside.clone(), 0..width, &|_, _| 0).is_ok(), "{seed} {beside:?}");
        }
    }
}

/// The table for other seeds: what the floors are taken from.
#[test]
#[ignore = "prints the figures of seeds that no floor is checked on"]
fn survey() {
    println!("{HEAD}");
    for first_seed in [100, 200] {
        for row in &ROWS {
            Figures::of(row, first_seed);
        }
        println!("walls of two lines: {} of 12 frames refused", two_lines(first_seed));
    }
}
