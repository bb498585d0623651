//! Runs one hot path once, to count its instructions: `benches/peers/run.sh instructions` runs this under callgrind.
//!
//! ```text
//! instructions FOLDER carve|surface|fairing --sd 5.5       FOLDER: views.json and sil/ of benches/peers/phantom.py
//! instructions PICTURE segment
//! ```
//! The counts are the same in every run and on a busy machine, unlike times. All work is done on the main thread. Each path is in a
//! function of its own, at whose name callgrind starts and stops, so that nothing else is counted.

use anyhow::Context;
use carved_core::carver::{CarveError, Carver, Leaves};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::geometry::{BoxUm, Projection, VoxelGrid};
use carved_core::profile::{Mask, Picture, Profile, ProfileError, SegmentSettings, Segmenter};
use carved_core::surface::{Fairing, FairingError, Mesh, Occupancy, extract, fair};
use clap::{Parser, ValueEnum};
use serde::Deserialize;
use std::hint::black_box;
use std::path::{Path, PathBuf};

const EPSILON: f64 = 0.05;

#[derive(Parser)]
struct Options {
    input: PathBuf,
    path: HotPath,
    #[arg(long, default_value_t = 5.5)]
    sd: f64,
    /// Passed on by `cargo bench`.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum HotPath {
    Carve,
    Surface,
    Fairing,
    Segment,
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    // callgrind counts by thread, so the pool must use only this thread.
    rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global()?;
    if options.path == HotPath::Segment {
        let picture = picture(&options.input)?;
        black_box(hot_segment(&mut Segmenter::default(), &picture, &SegmentSettings::default()))?;
        return Ok(());
    }
    let views = views(&options.input)?;
    let mut carver = Carver::new(VoxelGrid::new(BoxUm::PAPER, options.sd)?, views.len(), EPSILON)?;
    hot_carve(&mut carver, &views)?;
    if options.path == HotPath::Carve {
        return Ok(());
    }
    let mesh = hot_surface(&carver);
    if options.path == HotPath::Fairing {
        black_box(hot_fairing(&mesh, Fairing { lambda: 0.8, iterations: 10 }))?;
    }
    Ok(())
}

// These four functions contain no closures: the name of a closure contains that of its function, and callgrind would stop at it.

#[inline(never)]
fn hot_carve(carver: &mut Carver, views: &[(Mask, Projection)]) -> Result<(), CarveError> {
    for (mask, projection) in views {
        carver.observe(mask, projection, Leaves::default())?;
    }
    Ok(())
}

#[inline(never)]
fn hot_surface(carver: &Carver) -> Mesh {
    extract(&Occupancy(carver))
}

#[inline(never)]
fn hot_fairing(mesh: &Mesh, fairing: Fairing) -> Result<Mesh, FairingError> {
    fair(mesh, fairing)
}

#[inline(never)]
fn hot_segment(segmenter: &mut Segmenter, picture: &Picture, settings: &SegmentSettings) -> Result<Profile, ProfileError> {
    segmenter.segment(picture, settings, None)
}

#[derive(Deserialize)]
struct Told {
    views: Vec<View>,
}

#[derive(Deserialize)]
struct View {
    #[serde(rename = "P")]
    matrix: [[f64; 4]; 3],
    file: PathBuf,
}

fn views(folder: &Path) -> anyhow::Result<Vec<(Mask, Projection)>> {
    let file = folder.join("views.json");
    let text = std::fs::read_to_string(&file).with_context(|| file.display().to_string())?;
    let told: Told = serde_json::from_str(&text).with_context(|| file.display().to_string())?;
    told.views.iter().map(|view| Ok((mask(&folder.join(&view.file))?, Projection::from_matrix(view.matrix)?))).collect()
}

fn mask(file: &Path) -> anyhow::Result<Mask> {
    let grey = image::open(file).with_context(|| file.display().to_string())?.to_luma8();
    let (width, height) = grey.dimensions();
    Ok(Mask::from_coverage(width as usize, height as usize, grey.into_raw())?)
}

fn picture(file: &Path) -> anyhow::Result<Picture> {
    let rgb = image::open(file).with_context(|| file.display().to_string())?.to_rgb8();
    let (width, height) = rgb.dimensions();
    Ok(Picture::from_frame(&RawFrame::new(width, height, PixelFormat::RGB8Packed, rgb.into_raw())?))
}
