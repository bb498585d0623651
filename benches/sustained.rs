//! Demosaicing and segmentation of whole frames as in a run, on the 72 frames of the set: `cargo bench --bench sustained`.
//!
//! ```text
//! one thread    each frame timed: p50 and p95 of demosaicing, segmentation and both
//! two threads   frames per second over three rounds
//! ```
//! The digest covers all masks and outlines, bit by bit: a change that only saves time leaves it unchanged.
//!
//! ```text
//! --write DIR   writes the frames as PNG, in colour, and measures nothing
//! --read DIR    takes the PNG pictures of a folder instead of the set
//! --rows N      keeps the middle N rows of each frame, as if the bore had been found already
//! ```

use anyhow::Context;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::{Picture, SegmentSettings, Segmenter};
use carved_records::sha256_hex;
use clap::Parser;
use hardware_sim::scene::Exposure;
use hardware_sim::scene::frame_set::{FrameSpec, frame_set};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

const SEED: u64 = 1;
const THREADS: usize = 2;
const ROUNDS: usize = 3;

/// Times the segmentation of frames.
#[derive(Parser)]
struct Options {
    #[arg(long, value_name = "DIR")]
    write: Option<PathBuf>,
    #[arg(long, value_name = "DIR")]
    read: Option<PathBuf>,
    #[arg(long, value_name = "N")]
    rows: Option<u32>,
    /// Passed on by `cargo bench`.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    let mut frames: Vec<(String, RawFrame)> = match &options.read {
        Some(folder) => read(folder)?,
        None => frame_set(SEED)?.par_iter().map(render).collect::<Result<_, _>>()?,
    };
    if let Some(rows) = options.rows {
        frames = frames.into_iter().map(|(name, frame)| Ok((name, middle(&frame, rows)?))).collect::<anyhow::Result<_>>()?;
    }
    if let Some(folder) = &options.write {
        return write(&frames, folder);
    }
    single(&frames);
    sustained(&frames);
    Ok(())
}

fn read(folder: &Path) -> anyhow::Result<Vec<(String, RawFrame)>> {
    let mut files = std::fs::read_dir(folder)
        .with_context(|| folder.display().to_string())?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<Vec<PathBuf>>>()?;
    files.retain(|f| f.extension().is_some_and(|e| e == "png"));
    files.sort();
    anyhow::ensure!(!files.is_empty(), "{} has no .png", folder.display());
    let picture = |file: &PathBuf| {
        let rgb = image::open(file).with_context(|| file.display().to_string())?.to_rgb8();
        let (width, height) = rgb.dimensions();
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok((name, RawFrame::new(width, height, PixelFormat::RGB8Packed, rgb.into_raw())?))
    };
    files.iter().map(picture).collect()
}

/// The middle rows of a frame. They begin on an even row, so that the mosaic keeps its pattern.
fn middle(frame: &RawFrame, rows: u32) -> anyhow::Result<RawFrame> {
    let (width, height) = (frame.width(), frame.height());
    anyhow::ensure!((1..=height).contains(&rows), "--rows {rows}: the frames have {height}");
    let first = ((height - rows) / 2) & !1;
    let row_bytes = width as usize * frame.format().bytes_per_pixel();
    let bytes = &frame.bytes()[first as usize * row_bytes..(first + rows) as usize * row_bytes];
    Ok(RawFrame::new(width, rows, frame.format(), bytes.to_vec())?)
}

fn render(spec: &FrameSpec) -> anyhow::Result<(String, RawFrame)> {
    let rgb = spec.scene()?.render(&Exposure { angle_rad: spec.angle_rad, number: spec.number });
    let (format, bytes) = if spec.mono { (PixelFormat::Mono8, rgb.to_mono8()) } else { (PixelFormat::BayerRG8, rgb.to_bayer_rg8()) };
    Ok((spec.name.clone(), RawFrame::new(rgb.width, rgb.height, format, bytes)?))
}

fn write(frames: &[(String, RawFrame)], folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)?;
    for (name, frame) in frames {
        let rgb = Picture::from_frame(frame).to_rgb();
        image::save_buffer(folder.join(format!("{name}.png")), &rgb, frame.width(), frame.height(), image::ColorType::Rgb8)?;
    }
    Ok(())
}

fn single(frames: &[(String, RawFrame)]) {
    let settings = SegmentSettings::default();
    let mut segmenter = Segmenter::default();
    let (mut colours, mut profiles, mut both) = (Vec::new(), Vec::new(), Vec::new());
    let mut told = Vec::new();
    let mut found = 0;
    for round in 0..=ROUNDS {
        for (_, frame) in frames {
            let began = Instant::now();
            let picture = Picture::from_frame(frame);
            let coloured = began.elapsed();
            let profile = segmenter.segment(&picture, &settings, None);
            let whole = began.elapsed();
            if round == 0 {
                // The first pass lets buffers grow and fills caches. Its results are used, its times are not.
                match profile {
                    Ok(p) => {
                        found += 1;
                        told.extend_from_slice(p.mask.data());
                        told.extend(p.edge.iter().flat_map(|e| &e.vertices).flatten().flat_map(|x| x.to_le_bytes()));
                    }
                    Err(e) => told.extend(e.to_string().into_bytes()),
                }
                continue;
            }
            colours.push(coloured);
            profiles.push(whole.saturating_sub(coloured));
            both.push(whole);
        }
    }
    println!("{} frames, {found} profiles, digest {}", frames.len(), &sha256_hex(&told)[..16]);
    for (name, times) in [("demosaic", &mut colours), ("segment", &mut profiles), ("both", &mut both)] {
        times.sort_unstable();
        println!("{name:9} p50 {:6.2} ms   p95 {:6.2} ms   worst {:6.2} ms", ms(times, 0.5), ms(times, 0.95), ms(times, 1.0));
    }
}

fn ms(sorted: &[Duration], share: f64) -> f64 {
    sorted[(share * (sorted.len() - 1) as f64).round() as usize].as_secs_f64() * 1e3
}

fn sustained(frames: &[(String, RawFrame)]) {
    let settings = SegmentSettings::default();
    let next = AtomicUsize::new(0);
    let all = frames.len() * ROUNDS;
    let began = Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..THREADS {
            scope.spawn(|| {
                let mut segmenter = Segmenter::default();
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    if at >= all {
                        break;
                    }
                    let picture = Picture::from_frame(&frames[at % frames.len()].1);
                    // A frame without a profile is also a valid result.
                    let _ = std::hint::black_box(segmenter.segment(&picture, &settings, None));
                }
            });
        }
    });
    println!("{THREADS} threads: {:.1} frames/s", all as f64 / began.elapsed().as_secs_f64());
}
