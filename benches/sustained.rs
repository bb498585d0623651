//! Whole frames through demosaicing and segmentation, as a run does it, on the 72 frames of the set:
//! `cargo bench --bench sustained`.
//!
//! ```text
//! one thread    each frame timed: p50 and p95 of demosaicing, segmentation and both
//! two threads   frames per second over three rounds
//! ```
//! The digest is of all masks and outlines, bit by bit: a change that only saves time leaves it as it is.
//! `cargo bench --bench sustained -- --write DIR` writes the frames as PNG, in colour, and measures nothing.

use anyhow::Context;
use carved::frame::{PixelFormat, RawFrame};
use carved::hash::sha256_hex;
use carved::profile::{Picture, SegmentSettings, Segmenter};
use hardware_sim::scene::Exposure;
use hardware_sim::scene::frame_set::{FrameSpec, frame_set};
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

const SEED: u64 = 1;
const THREADS: usize = 2;
const ROUNDS: usize = 3;

fn main() -> anyhow::Result<()> {
    let frames: Vec<(String, RawFrame)> = frame_set(SEED)?.par_iter().map(render).collect::<Result<_, _>>()?;
    let args: Vec<String> = std::env::args().collect();
    if let Some(at) = args.iter().position(|a| a == "--write") {
        return write(&frames, Path::new(args.get(at + 1).context("--write needs a folder")?));
    }
    single(&frames);
    sustained(&frames);
    Ok(())
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
    for round in 0..=ROUNDS {
        for (_, frame) in frames {
            let began = Instant::now();
            let picture = Picture::from_frame(frame);
            let coloured = began.elapsed();
            let profile = segmenter.segment(&picture, &settings, None);
            let whole = began.elapsed();
            if round == 0 {
                // Buffers grow and caches fill: what comes out is kept, the time is not.
                match profile {
                    Ok(p) => {
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
    println!("{} frames, digest {}", frames.len(), &sha256_hex(&told)[..16]);
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
                    // A frame without a profile is a result too.
                    let _ = std::hint::black_box(segmenter.segment(&picture, &settings, None));
                }
            });
        }
    });
    println!("{THREADS} threads: {:.1} frames/s", all as f64 / began.elapsed().as_secs_f64());
}
