//! `--compare`: finds the annotation of each picture by its name, and reads it.
//!
//! ```text
//!   picture STEM.tif     STEM__SHAPES.json   FishInspector            the first of these that is in a folder
//!                        STEM.truth.png      mask                     or was named counts
//!                        STEM.mask.png       mask
//!                        STEM.png            mask
//!                        STEM.body.png       mask of the body without fins, beside any of them
//! ```

use super::shapes;
use anyhow::{Context, anyhow, bail};
use carved_core::profile::{Annotation, Mask};
use carved_pictures::decode;
use image::ColorType;
use std::collections::{HashMap, HashSet};
use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Path, PathBuf};

/// How the names of annotations end, the most certain kind first.
const SUFFIXES: [&str; 4] = [shapes::SUFFIX, ".truth.png", ".mask.png", ".png"];
const BODY: &str = ".body.png";

/// The annotations of all pictures of a call.
#[derive(Debug, Default)]
pub(super) struct Annotations {
    by_stem: HashMap<OsString, AnnotationFiles>,
}

/// Files that belong to pictures of one name.
#[derive(Debug, Default)]
struct AnnotationFiles {
    outlines: [Option<PathBuf>; SUFFIXES.len()],
    body: Option<PathBuf>,
}

/// The files of the annotation of one picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Files<'a> {
    pub outline: &'a Path,
    body: Option<&'a Path>,
}

/// An annotation that was read.
pub(super) struct Annotated {
    pub annotation: Annotation,
    /// `mask`, or the feature of FishInspector that the outline is from.
    pub from: &'static str,
    pub body: Option<Mask>,
}

impl Annotations {
    /// Finds the annotations in folders and files.
    pub fn find(paths: &[PathBuf]) -> anyhow::Result<Self> {
        let mut found = Self::default();
        for path in paths {
            let name = || format!("--compare {}", path.display());
            if std::fs::metadata(path).with_context(name)?.is_dir() {
                for entry in std::fs::read_dir(path).with_context(name)? {
                    // A folder may have other files too.
                    found.add(&entry.with_context(name)?.path())?;
                }
            } else if !found.add(path)? {
                bail!("{}: expected the name STEM{}, STEM.truth.png, STEM.mask.png, STEM.png or STEM{BODY}", name(), shapes::SUFFIX);
            }
        }
        Ok(found)
    }

    /// Adds a file if its name is that of an annotation.
    fn add(&mut self, file: &Path) -> anyhow::Result<bool> {
        let name = file.file_name().unwrap_or_default();
        let stem = |suffix: &str| name.as_bytes().strip_suffix(suffix.as_bytes()).map(|stem| OsString::from_vec(stem.to_vec()));
        let replaced = if let Some(stem) = stem(BODY) {
            self.by_stem.entry(stem).or_default().body.replace(file.to_owned())
        } else if let Some((rank, stem)) = SUFFIXES.into_iter().enumerate().find_map(|(rank, suffix)| Some((rank, stem(suffix)?))) {
            self.by_stem.entry(stem).or_default().outlines[rank].replace(file.to_owned())
        } else {
            return Ok(false);
        };
        match replaced.filter(|other| other != file) {
            Some(other) => bail!("--compare: {} and {} have the same name; leave one of them out", other.display(), file.display()),
            None => Ok(true),
        }
    }

    /// The names that an annotation of a picture may have.
    pub fn names(picture: &Path) -> String {
        let stem = picture.file_stem().unwrap_or_default().to_string_lossy();
        SUFFIXES.map(|suffix| format!("{stem}{suffix}")).join(", ")
    }

    /// The files of the annotation of a picture. The picture itself is none.
    pub fn of(&self, picture: &Path) -> Option<Files<'_>> {
        let found = self.by_stem.get(picture.file_stem()?)?;
        let itself = picture.canonicalize().ok();
        let is_another = |file: &&PathBuf| itself.is_none() || file.canonicalize().ok() != itself;
        let outline = found.outlines.iter().flatten().find(is_another)?;
        Some(Files { outline, body: found.body.as_deref() })
    }

    /// Checks that no annotation is a result of the call, which would be compared with itself.
    pub fn check_results<'a>(&self, pictures: impl Iterator<Item = &'a Path>, results: &HashSet<PathBuf>) -> anyhow::Result<()> {
        for files in pictures.filter_map(|picture| self.of(picture)) {
            for file in std::iter::once(files.outline).chain(files.body) {
                if file.canonicalize().is_ok_and(|file| results.contains(&file)) {
                    bail!("--compare: {} is a result of this call and would be replaced; give another --out", file.display());
                }
            }
        }
        Ok(())
    }
}

impl Files<'_> {
    /// Reads the annotation of a picture of that size.
    pub fn read(&self, size: [usize; 2]) -> anyhow::Result<Annotated> {
        let name = |file: &Path| format!("{}", file.display());
        let body = self.body.map(|file| read_mask(file, size).with_context(|| name(file))).transpose()?;
        let is_shapes = self.outline.file_name().is_some_and(|name: &OsStr| name.as_bytes().ends_with(shapes::SUFFIX.as_bytes()));
        if !is_shapes {
            let annotation = Annotation::from_mask(read_mask(self.outline, size).with_context(|| name(self.outline))?);
            return Ok(Annotated { annotation, from: "mask", body });
        }
        let text = carved_files::read(self.outline).with_context(|| format!("{}: cannot be read", name(self.outline)))?;
        let outline = shapes::read(&text, size).with_context(|| name(self.outline))?;
        let filled = |polygon| Annotation::from_polygons(size[0], size[1], &[polygon]);
        let larva = filled(outline.polygon);
        if outline.fins.is_empty() {
            return Ok(Annotated { annotation: larva, from: outline.feature, body });
        }
        // The fins may overlap the body, or leave a gap of less than a pixel.
        let mut whole = larva.mask().data().to_vec();
        for fin in outline.fins {
            whole.iter_mut().zip(filled(fin).mask().data()).for_each(|(inside, of_fin)| *inside |= of_fin);
        }
        let annotation = Annotation::from_mask(Mask::from_coverage(size[0], size[1], whole)?);
        let from = if outline.feature == "contour_net" { "contour_net and fins" } else { "contourDV_net and fins" };
        Ok(Annotated { annotation, from, body: body.or_else(|| Some(larva.mask().clone())) })
    }
}

fn read_mask(file: &Path, expected: [usize; 2]) -> anyhow::Result<Mask> {
    decode_mask(&decode::read(file)?, expected)
}

/// The mask in the bytes of a file, of a picture of that size.
pub(in crate::cli) fn decode_mask(bytes: &[u8], expected: [usize; 2]) -> anyhow::Result<Mask> {
    let image = decode::decode(bytes, decode::PNG).map_err(|error| anyhow!("{error}; save the mask again"))?;
    if !matches!(image.color(), ColorType::L8 | ColorType::La8) {
        let found = image.color();
        bail!(
            "found {} bits in {} channels, expected a grey mask of 8 bits",
            found.bits_per_pixel() / u16::from(found.channel_count()),
            found.channel_count()
        );
    }
    let found = [image.width() as usize, image.height() as usize];
    if found != expected {
        bail!(
            "it is {} x {} px, the picture is {} x {} px; annotate the picture that is segmented",
            found[0],
            found[1],
            expected[0],
            expected[1]
        );
    }
    let pixels = image.into_luma8().into_raw();
    let largest = pixels.iter().copied().max().unwrap_or(0);
    if (1..128).contains(&largest) {
        bail!("its largest value is {largest}, and pixels are inside from 128 on; save the mask with 0 outside and 255 inside");
    }
    Ok(Mask::from_coverage(found[0], found[1], pixels)?)
}
