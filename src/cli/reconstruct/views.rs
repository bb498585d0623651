//! Silhouettes from a folder.

use crate::profile::Mask;
use anyhow::{Context, bail};
use image::{ImageFormat, ImageReader};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

pub(super) struct View {
    pub path: PathBuf,
    pub mask: Mask,
}

impl View {
    pub fn name(&self) -> String {
        self.path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
    }
}

/// The PNG and PGM files of a folder in the order of their names, byte by byte; other files are left alone.
pub(super) fn read(folder: &Path) -> anyhow::Result<Vec<View>> {
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
    let views: Vec<View> = paths.into_par_iter().map(|path| Ok(View { mask: mask(&path)?, path })).collect::<anyhow::Result<_>>()?;
    let size = |view: &View| (view.mask.width(), view.mask.height());
    if let Some(other) = views.iter().find(|v| size(v) != size(&views[0])) {
        let ((w, h), (w0, h0)) = (size(other), size(&views[0]));
        bail!("{} is {w} x {h} px, expected {w0} x {h0} as {}", other.path.display(), views[0].name());
    }
    Ok(views)
}

/// Grey is coverage; what is transparent is not covered.
fn mask(path: &Path) -> anyhow::Result<Mask> {
    let name = || path.display().to_string();
    let reader = ImageReader::open(path).with_context(name)?.with_guessed_format().with_context(name)?;
    match reader.format() {
        Some(ImageFormat::Png | ImageFormat::Pnm) => {}
        Some(other) => bail!("{}: found an image of format {other:?}, expected PNG or PGM", name()),
        None => bail!("{}: found no image, expected PNG or PGM", name()),
    }
    let image = reader.decode().with_context(|| format!("{}: not a readable PNG or PGM", name()))?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = image.into_luma_alpha8();
    let coverage: Vec<u8> = pixels.pixels().map(|p| ((u32::from(p[0]) * u32::from(p[1]) + 127) / 255) as u8).collect();
    let largest = coverage.iter().copied().max().unwrap_or(0);
    if largest < 128 {
        bail!(
            "{}: the largest value found is {largest}; expected 128 or more inside the silhouette, and a view without one carves all",
            name()
        );
    }
    Mask::from_coverage(width, height, coverage).with_context(name)
}
