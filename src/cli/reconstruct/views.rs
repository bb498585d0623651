//! Silhouettes from a folder.

use crate::cli::import::natural::natural;
use anyhow::{Context, bail};
use carved_offline::silhouettes::{View, coverage_of};
use carved_pictures::decode::{self, SILHOUETTES};
use rayon::prelude::*;
use std::path::Path;

/// Reads the PNG and PGM files of a folder, sorted by name in natural order (view2 before view10). Other files and hidden ones, as `._view1.png`
/// of macOS, are ignored.
pub(in crate::cli) fn read(folder: &Path) -> anyhow::Result<Vec<View>> {
    let entries = std::fs::read_dir(folder).with_context(|| format!("--views {}: cannot be read as a folder", folder.display()))?;
    let mut paths = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        let is_hidden = path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        if !is_hidden && matches!(extension.as_deref(), Some("png" | "pgm")) {
            paths.push(path);
        }
    }
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    paths.sort_by(|a, b| natural(&name(a), &name(b)));
    if paths.is_empty() {
        bail!("--views {}: found no .png or .pgm file, expected one per view", folder.display());
    }
    // The headers are checked first: decoding one large picture among the views would take minutes and gigabytes.
    let mut first = None;
    for path in &paths {
        let (w, h) = decode::read(path).and_then(|bytes| decode::size(&bytes, SILHOUETTES)).with_context(|| path.display().to_string())?;
        let (w0, h0) = *first.get_or_insert((w, h));
        if (w, h) != (w0, h0) {
            let name = paths[0].file_name().unwrap_or_default().display();
            bail!("{} is {w} x {h} px, expected {w0} x {h0} as {name}", path.display());
        }
    }
    // All files are read before any is judged, so that the same error is reported on any number of threads.
    paths.par_iter().map(|path| view(path)).collect::<Vec<_>>().into_iter().collect()
}

/// Reads a view. Grey values are coverage; transparent pixels are not covered. A view may be blank.
pub(in crate::cli) fn view(path: &Path) -> anyhow::Result<View> {
    let image = decode::read(path).and_then(|bytes| decode::decode(&bytes, SILHOUETTES)).with_context(|| path.display().to_string())?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let is_deep = image.color().bytes_per_pixel() / image.color().channel_count() > 1;
    let (values, full): (Vec<u16>, u16) = if is_deep {
        (image.into_luma_alpha16().pixels().map(|p| covered(p[0].into(), p[1].into(), 65535)).collect(), 65535)
    } else {
        (image.into_luma_alpha8().pixels().map(|p| covered(p[0].into(), p[1].into(), 255)).collect(), 255)
    };
    let coverage = coverage_of(&values, width, full).with_context(|| path.display().to_string())?;
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    View::from_coverage(name, width, height, &coverage).with_context(|| path.display().to_string())
}

/// A transparent pixel is not covered.
fn covered(value: u64, alpha: u64, full: u64) -> u16 {
    ((value * alpha + full / 2) / full) as u16
}
