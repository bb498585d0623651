//! The pictures of a turn: the files, their order, and the check that they belong together.
//!
//! ```text
//!  DIR or FILES ── list ── natural order: view2 before view10 ──┬─ look at every one ── one size, one format, one depth
//!  one FILE of several pages ── the order of its pages ─────────┘
//! ```

use super::natural::{chunks, natural};
use crate::cli::segment::input::{self, Input, Kind};
use anyhow::{Context, bail, ensure};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::profile::Picture;
use carved_pictures::decode::{self, FRAMES};
use carved_records::picture_name::{ENDINGS, is_picture};
use carved_records::sha256_hex;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Where the picture of a view is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Source {
    path: PathBuf,
    /// The page and the number of pages, where the file holds a whole turn.
    page: Option<(usize, usize)>,
}

impl Source {
    /// A file with one picture.
    pub fn file(path: PathBuf) -> Self {
        Self { path, page: None }
    }

    /// The files of a turn, or the pages of the only one.
    pub fn of_turn(paths: Vec<PathBuf>) -> anyhow::Result<Vec<Self>> {
        let [path] = &paths[..] else { return Ok(paths.into_iter().map(Self::file).collect()) };
        let place = || path.display().to_string();
        let pages = decode::read_turn(path).and_then(|bytes| decode::pages(&bytes, FRAMES)).with_context(place)?;
        let page = |page| (pages > 1).then_some((page, pages));
        Ok((0..pages).map(|at| Self { path: path.clone(), page: page(at) }).collect())
    }

    fn name(&self) -> String {
        let name = file_name(&self.path);
        match self.page {
            None => name,
            Some((page, pages)) => format!("{name} page {:0width$}", page + 1, width = pages.to_string().len()),
        }
    }

    fn read(&self, mosaic: Option<PixelFormat>) -> anyhow::Result<Input> {
        let read = match self.page {
            None => input::read(&self.path, mosaic),
            Some((page, _)) => input::read_page(&self.path, page, mosaic),
        };
        read.with_context(|| self.path.with_file_name(self.name()).display().to_string())
    }
}

/// A picture that was checked. Its pixels are read again when they are written.
pub(super) struct Looked {
    source: Source,
    /// SHA-256 of the file.
    pub file_sha256: String,
    pixels_sha256: String,
    kind: Kind,
    blocky: bool,
}

impl Looked {
    pub fn name(&self) -> String {
        self.source.name()
    }

    /// Reads the pixels again. Fails if the file has changed since the check.
    pub fn frame(&self) -> anyhow::Result<RawFrame> {
        let input = self.source.read(Some(self.kind.format).filter(|format| format.mosaic().is_some()))?;
        ensure!(input.sha256 == self.file_sha256, "{}: the file was changed while it was imported", self.source.path.display());
        Ok(input.frame)
    }
}

pub(super) fn file_name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The named pictures, or those of the single named folder, in natural order.
pub(super) fn list(named: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut paths = match named {
        [folder] if folder.is_dir() => of_folder(folder)?,
        files => {
            if let Some(path) = files.iter().find(|p| !p.is_file()) {
                let found = if path.is_dir() { "a folder among several names" } else { "no such file" };
                bail!("{}: found {found}, expected one folder of frames, or the frames' files", path.display());
            }
            files.to_vec()
        }
    };
    let given = paths.clone();
    paths.sort_by(|a, b| natural(&file_name(a), &file_name(b)).then_with(|| a.cmp(b)));
    // A shell pattern gives names in byte order, or without regard to case.
    let by_shell = given.is_sorted() || given.is_sorted_by_key(|p| p.to_string_lossy().to_lowercase());
    if named.len() > 1
        && !by_shell
        && let Some((is, should)) = given.iter().zip(&paths).find(|(a, b)| a != b)
    {
        bail!(
            "{} was named where {} comes by the order of names, which alone counts (view2 before view10): give them names in the order of the turn",
            is.display(),
            should.display()
        );
    }
    for pair in paths.windows(2) {
        ensure!(
            pair[0].file_stem() != pair[1].file_stem(),
            "{} and {} have one name: are they one view? Leave one out",
            pair[0].display(),
            pair[1].display()
        );
    }
    Ok(paths)
}

fn of_folder(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let place = || format!("{}: cannot be read as a folder", folder.display());
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(place)? {
        let path = entry.with_context(place)?.path();
        if is_picture(&path) {
            paths.push(path);
        }
    }
    ensure!(
        !paths.is_empty(),
        "{}: found no picture, expected {} files, one per view; for a folder with folders of wells, give --plate",
        folder.display(),
        ENDINGS.join(", ")
    );
    if folder.join("../recording.json").is_file() {
        bail!(
            "{}: is the frames' folder of a recording, which `carved measure` measures as it is; to import views of it, name their files",
            folder.display()
        );
    }
    Ok(paths)
}

/// Width and height of a picture as its first bytes say, px.
pub(super) fn size(path: &Path) -> anyhow::Result<(u32, u32)> {
    Ok(decode::read(path).and_then(|bytes| decode::size(&bytes, FRAMES))?)
}

/// Reads every picture, and refuses pictures that cannot be views of one turn.
pub(super) fn look(sources: &[Source], mosaic: Option<PixelFormat>, warn: &mut dyn FnMut(String)) -> anyhow::Result<(Vec<Looked>, Kind)> {
    let looks: Vec<anyhow::Result<Looked>> = sources.par_iter().map(|source| look_at(source, mosaic)).collect();
    let broken: Vec<String> = looks.iter().filter_map(|l| l.as_ref().err()).map(|e| format!("{e:#}")).collect();
    ensure!(broken.is_empty(), "{} of {} pictures cannot be used:\n{}", broken.len(), sources.len(), broken.join("\n"));
    let looks: Vec<Looked> = looks.into_iter().collect::<anyhow::Result<_>>()?;
    let first = looks.first().context("no picture was named")?;
    let kind = first.kind;
    let unlike: Vec<String> = looks.iter().filter(|l| l.kind != kind).map(|l| format!("{} is {}", l.name(), l.kind)).collect();
    ensure!(
        unlike.is_empty(),
        "{} of {} pictures are unlike the first, {}, which is {kind}; frames of one camera are expected (the bits of a 16 bit file are told \
         from its largest count: where those differ, save them all as 8 bit):\n{}",
        unlike.len(),
        looks.len(),
        first.name(),
        unlike.join("\n")
    );
    doubts(&looks, warn);
    Ok((looks, kind))
}

fn look_at(source: &Source, mosaic: Option<PixelFormat>) -> anyhow::Result<Looked> {
    let input = source.read(mosaic)?;
    let frame = &input.frame;
    let kind = input.kind();
    let picture = Picture::from_frame(frame);
    let blocky = picture.planes().first().is_some_and(|plane| carved_offline::picture::too_blocky(plane, picture.width()).is_some());
    Ok(Looked { source: source.clone(), pixels_sha256: sha256_hex(frame.bytes()), file_sha256: input.sha256, kind, blocky })
}

fn doubts(looks: &[Looked], warn: &mut dyn FnMut(String)) {
    let blocky: Vec<String> = looks.iter().filter(|l| l.blocky).map(Looked::name).collect();
    if let Some(first) = blocky.first() {
        warn(format!(
            "{} of {} pictures, {first} the first, were compressed until their noise was gone: outlines may be wrong and look sure",
            blocky.len(),
            looks.len()
        ));
    }
    let mut by_pixels: Vec<&Looked> = looks.iter().collect();
    by_pixels.sort_by(|a, b| a.pixels_sha256.cmp(&b.pixels_sha256));
    for pair in by_pixels.windows(2).filter(|p| p[0].pixels_sha256 == p[1].pixels_sha256) {
        warn(format!("{} and {} hold the same pixels: no camera takes the same noise twice", pair[0].name(), pair[1].name()));
    }
}

/// Reads the empty-capillary picture, which must have the format of the frames.
pub(super) fn empty(path: &Path, mosaic: Option<PixelFormat>, expected: Kind) -> anyhow::Result<RawFrame> {
    let place = || format!("--empty {}", path.display());
    let looked = look_at(&Source::file(path.to_owned()), mosaic).with_context(place)?;
    ensure!(
        looked.kind == expected,
        "{}: found {}, expected {expected} as the frames are: take it with the same camera settings",
        place(),
        looked.kind
    );
    looked.frame()
}

/// Describes a name that does not continue the sequence: if a frame is missing in an even turn, all later angles are wrong.
pub(super) fn gap(names: &[String]) -> Option<String> {
    let split: Vec<Vec<&str>> = names.iter().map(|n| chunks(n)).collect();
    let length = split.first()?.len();
    if split.iter().any(|s| s.len() != length) {
        return None;
    }
    let varies: Vec<usize> = (0..length).filter(|&at| split.iter().any(|s| s[at] != split[0][at])).collect();
    let [at] = varies[..] else { return None };
    let numbers: Vec<i64> = split.iter().map(|s| s[at].parse().ok()).collect::<Option<_>>()?;
    let steps: Vec<i64> = numbers.windows(2).map(|w| w[1] - w[0]).collect();
    let least = *steps.iter().min()?;
    let wide = steps.iter().position(|&s| s > least)?;
    Some(format!(
        "{} follows {}: is a frame missing there? The angles are even over the frames that are there",
        names[wide + 1],
        names[wide]
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_number_is_seen_where_one_number_counts() {
        let names = |numbers: &[u32]| numbers.iter().map(|n| format!("d3_{n:02}.png")).collect::<Vec<_>>();
        assert_eq!(gap(&names(&[0, 4, 8, 12])), None);
        assert!(gap(&names(&[1, 2, 4])).unwrap().starts_with("d3_04.png follows d3_02.png"));
        assert_eq!(gap(&["a.png".into(), "b1.png".into()]), None);
    }
}
