//! Prints the statistics of all frames of folders, real or emulated: walls, light, noise, dust, edges and body.
//!
//! `frame_statistics [--demosaic] FOLDER...`. Frames are PNG, TIFF and JPEG files. `NAME.truth.png` beside `NAME.png` is the mask of
//! the specimen with its fins; without it the body is found in the frame. `--demosaic` first takes each frame through a colour mosaic,
//! for emulated frames that are not. Numbers are the median over the frames, with the 10 and 90 % quantiles in brackets.
//! `docs/frames.md` explains each row.

mod measured;

use hardware_sim::scene::Rgb;
use measured::{Frame, FrameStatistics, quantile};
use rayon::prelude::*;
use std::error::Error;
use std::path::{Path, PathBuf};

type Failure = Box<dyn Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let mut folders: Vec<String> = std::env::args().skip(1).collect();
    let demosaic = folders.iter().any(|arg| arg == "--demosaic");
    folders.retain(|arg| arg != "--demosaic");
    if folders.is_empty() {
        return Err("frame_statistics [--demosaic] FOLDER...".into());
    }
    let columns = folders.iter().map(|folder| column(Path::new(folder), demosaic)).collect::<Result<Vec<_>, _>>()?;
    println!("| | {} |", folders.join(" | "));
    println!("|---|{}", "---|".repeat(columns.len()));
    println!("| frames | {} |", columns.iter().map(|c| c.len().to_string()).collect::<Vec<_>>().join(" | "));
    for row in ROWS {
        println!("| {} | {} |", row.name, columns.iter().map(|c| row.cell(c)).collect::<Vec<_>>().join(" | "));
    }
    Ok(())
}

/// The statistics of all frames of a folder.
fn column(folder: &Path, demosaic: bool) -> Result<Vec<FrameStatistics>, Failure> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)?.map(|entry| entry.map(|e| e.path())).collect::<Result<_, _>>()?;
    files.retain(|file| is_frame(file));
    files.sort();
    let measured: Vec<Option<FrameStatistics>> = files
        .par_iter()
        .map(|file| {
            let frame = read(file, demosaic)?;
            Ok(FrameStatistics::measured(&frame).inspect_err(|why| eprintln!("{}: {why}", file.display())).ok())
        })
        .collect::<Result<_, Failure>>()?;
    Ok(measured.into_iter().flatten().collect())
}

fn is_frame(file: &Path) -> bool {
    let name = file.file_name().and_then(|n| n.to_str()).unwrap_or_default().to_lowercase();
    let picture = [".png", ".tif", ".tiff", ".jpg", ".jpeg"].iter().any(|end| name.ends_with(end));
    picture && ![".truth.png", ".bayer.png", ".mono.png"].iter().any(|end| name.ends_with(end))
}

fn read(file: &Path, demosaic: bool) -> Result<Frame, Failure> {
    let image = image::open(file)?.to_rgb8();
    let (width, height) = image.dimensions();
    let picture = Rgb { width, height, data: image.into_raw() };
    let beside = file.with_extension("truth.png");
    let mask =
        if beside.exists() { Some(image::open(beside)?.to_luma8().into_raw().into_iter().map(|c| c >= 128).collect()) } else { None };
    Ok(Frame { picture: if demosaic { picture.demosaicked() } else { picture }, mask })
}

/// A row of the table: a statistic of a frame in the unit of the row.
struct Row {
    name: &'static str,
    digits: usize,
    of: fn(&FrameStatistics) -> Option<f64>,
}

const fn row(name: &'static str, digits: usize, of: fn(&FrameStatistics) -> Option<f64>) -> Row {
    Row { name, digits, of }
}

const ROWS: [Row; 30] = [
    row("bore, px", 0, |s| Some(s.bore_px)),
    row("background level", 0, |s| Some(s.level)),
    row("blue - red", 0, |s| Some(s.blue_minus_red)),
    row("level in the bore / outside", 3, |s| Some(s.bore_over_outside)),
    row("noise sd per channel", 2, |s| Some(s.noise_sd)),
    row("noise autocorrelation at 1 px, green", 2, |s| Some(s.noise_green)),
    row("noise autocorrelation at 1 px, red", 2, |s| Some(s.noise_red)),
    row("specks per 1000 px of bore", 0, |s| Some(s.specks_per_1000px)),
    row("of these 2 to 4 % deep", 0, |s| Some(s.shallow_per_1000px)),
    row("of these over 4 % deep", 0, |s| Some(s.deep_per_1000px)),
    row("speck depth at 50 %, % of light", 1, |s| s.speck_depth.map(|d| 100.0 * d[0])),
    row("speck depth at 90 %, % of light", 1, |s| s.speck_depth.map(|d| 100.0 * d[1])),
    row("speck FWHM at 10 %, px", 1, |s| s.speck_fwhm_px.map(|w| w[0])),
    row("speck FWHM at 50 %, px", 1, |s| s.speck_fwhm_px.map(|w| w[1])),
    row("speck FWHM at 90 %, px", 1, |s| s.speck_fwhm_px.map(|w| w[2])),
    row("specks nearer than 25 px to the body", 0, |s| s.specks_near_body),
    row("upper wall line, depth", 2, |s| Some(s.wall_depth[0])),
    row("upper wall line, FWHM px", 1, |s| Some(s.wall_fwhm_px[0])),
    row("lower wall line, depth", 2, |s| Some(s.wall_depth[1])),
    row("lower wall line, FWHM px", 1, |s| Some(s.wall_fwhm_px[1])),
    row("shade at 6 px from the wall, %", 1, |s| Some(100.0 * s.shade[0])),
    row("shade at 10 px from the wall, %", 1, |s| Some(100.0 * s.shade[1])),
    row("sharpest edges 10-90 %, px", 1, |s| s.edge_px),
    row("body: median, part of the light", 2, |s| s.body.as_ref().map(|b| b.median)),
    row("body: share darker than 25 % of the light", 2, |s| s.body.as_ref().map(|b| b.dark_share)),
    row("texture sd inside", 0, |s| s.body.as_ref().map(|b| b.texture_sd)),
    row("least gap to the upper wall, px", 0, |s| s.body.as_ref().map(|b| b.gap_px[0])),
    row("least gap to the lower wall, px", 0, |s| s.body.as_ref().map(|b| b.gap_px[1])),
    row("faint fins, % of the body's area", 1, |s| Some(100.0 * s.body.as_ref()?.fins?[0])),
    row("faint fins, % dark", 1, |s| Some(100.0 * s.body.as_ref()?.fins?[1])),
];

impl Row {
    fn cell(&self, frames: &[FrameStatistics]) -> String {
        let values: Vec<f64> = frames.iter().filter_map(self.of).filter(|value| value.is_finite()).collect();
        if values.is_empty() {
            return "-".to_owned();
        }
        let [median, low, high] = [0.5, 0.1, 0.9].map(|part| format!("{:.*}", self.digits, quantile(&values, part)));
        format!("{median} ({low} to {high})")
    }
}
