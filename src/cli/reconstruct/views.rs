//! Silhouettes from a folder.

use anyhow::{Context, bail};
use carved_offline::silhouettes::View;
use image::{ImageFormat, ImageReader};
use rayon::prelude::*;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Reads the PNG and PGM files of a folder, sorted by name in byte order. Other files are ignored.
pub(in crate::cli) fn read(folder: &Path) -> anyhow::Result<Vec<View>> {
    let entries = std::fs::read_dir(folder).with_context(|| format!("--views {}: cannot be read as a folder", folder.display()))?;
    let mut paths = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        if matches!(extension.as_deref(), Some("png" | "pgm")) {
            paths.push(path);
        }
    }
    paths.sort();
    if paths.is_empty() {
        bail!("--views {}: found no .png or .pgm file, expected one per view", folder.display());
    }
    // The headers are checked first: decoding one large picture among the views would take minutes and gigabytes.
    let mut first = None;
    for path in &paths {
        let (w, h) = reader(path)?.into_dimensions().with_context(|| unreadable(path))?;
        let (w0, h0) = *first.get_or_insert((w, h));
        if (w, h) != (w0, h0) {
            let name = paths[0].file_name().unwrap_or_default().display();
            bail!("{} is {w} x {h} px, expected {w0} x {h0} as {name}", path.display());
        }
    }
    // All files are read before any is judged, so that the same error is reported on any number of threads.
    paths.par_iter().map(|path| view(path)).collect::<Vec<_>>().into_iter().collect()
}

fn unreadable(path: &Path) -> String {
    format!("{}: not a readable PNG or PGM", path.display())
}

/// Opens a picture file of a known format.
fn reader(path: &Path) -> anyhow::Result<ImageReader<BufReader<File>>> {
    let name = || path.display().to_string();
    let file = carved_files::open(path).with_context(name)?;
    let reader = ImageReader::new(BufReader::new(file)).with_guessed_format().with_context(name)?;
    match reader.format() {
        Some(ImageFormat::Png | ImageFormat::Pnm) => Ok(reader),
        Some(other) => bail!("{}: found an image of format {other:?}, expected PNG or PGM", name()),
        None => bail!("{}: found no image, expected PNG or PGM", name()),
    }
}

/// Reads a view. Grey values are coverage; transparent pixels are not covered. A view may be blank.
pub(in crate::cli) fn view(path: &Path) -> anyhow::Result<View> {
    let image = reader(path)?.decode().with_context(|| unreadable(path))?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = image.into_luma_alpha8();
    let coverage: Vec<u8> = pixels.pixels().map(|p| ((u32::from(p[0]) * u32::from(p[1]) + 127) / 255) as u8).collect();
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    View::from_coverage(name, width, height, &coverage).with_context(|| path.display().to_string())
}
