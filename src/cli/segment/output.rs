//! The results of a picture: names without conflicts, and the files.

use super::input::Input;
use super::{overlay, shapes};
use anyhow::{Context, bail};
use carved_core::profile::{EdgePoint, Picture, Polygon, Profile, ProfileError, SegmentSettings};
use carved_offline::picture::{ProfileReport, too_blocky};
use carved_store::{Software, StoreError, durable};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use serde::Serialize;
use std::collections::{HashMap, HashSet};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

const SCHEMA: &str = "carved.segment/1";
const EDGE_SCHEMA: &str = "carved.edge/1";
const CONVENTION: &str = "px; pixel centres at integers, u to the right, v down; [u, v]; the last vertex is joined to the first";

/// A picture and the paths of its results.
#[derive(Debug)]
pub(super) struct Names {
    pub image: PathBuf,
    mask: PathBuf,
    edge: PathBuf,
    overlay: PathBuf,
    report: PathBuf,
    /// Where and as which feature the outline is written for FishInspector, if it is.
    shapes: Option<(PathBuf, shapes::Feature)>,
}

impl Names {
    /// Chooses all names. Refuses names by which a result would replace another result, a picture, or outlines that may have been corrected.
    pub fn choose(images: &[PathBuf], out: &Path, shapes: Option<shapes::Feature>) -> anyhow::Result<Vec<Self>> {
        let chosen: Vec<Self> = images.iter().map(|image| Self::of(image, out, shapes)).collect::<anyhow::Result<_>>()?;
        let mut taken: HashMap<&Path, &Path> = HashMap::new();
        for names in &chosen {
            for file in names.files() {
                if let Some(other) = taken.insert(file, &names.image) {
                    bail!(
                        "{} and {} would both leave {}; give them other names, or another --out in a second call",
                        other.display(),
                        names.image.display(),
                        file.display()
                    );
                }
            }
        }
        let there: HashMap<PathBuf, &Path> = images.iter().filter_map(|i| Some((i.canonicalize().ok()?, i.as_path()))).collect();
        for file in taken.keys() {
            if let Some(image) = file.canonicalize().ok().and_then(|f| there.get(&f)) {
                bail!("--out {}: a result would replace the picture {}; give another folder", out.display(), image.display());
            }
        }
        if let Some(file) = chosen.iter().filter_map(Self::shapes).find(|file| file.symlink_metadata().is_ok()) {
            bail!("--shapes: {} is there already and may have been corrected by hand; move it, or give another --out", file.display());
        }
        Ok(chosen)
    }

    fn of(image: &Path, out: &Path, shapes: Option<shapes::Feature>) -> anyhow::Result<Self> {
        let stem = image.file_stem().with_context(|| format!("{}: found no name of a file", image.display()))?;
        let name = |suffix: &str| {
            let mut name = OsString::from(stem);
            name.push(suffix);
            out.join(name)
        };
        Ok(Self {
            image: image.to_owned(),
            mask: name(".mask.png"),
            edge: name(".edge.json"),
            overlay: name(".overlay.png"),
            report: name(".json"),
            shapes: shapes.map(|feature| (name(shapes::SUFFIX), feature)),
        })
    }

    fn files(&self) -> impl Iterator<Item = &Path> {
        [&self.mask, &self.edge, &self.overlay, &self.report].into_iter().map(PathBuf::as_path).chain(self.shapes())
    }

    fn shapes(&self) -> Option<&Path> {
        self.shapes.as_ref().map(|(file, _)| file.as_path())
    }

    /// The results that are in the folder already.
    pub fn there(all: &[Self]) -> HashSet<PathBuf> {
        all.iter().flat_map(Self::files).filter_map(|file| file.canonicalize().ok()).collect()
    }
}

/// Contents of `STEM.json`. It has no time stamp, so that the same picture and settings give the same bytes.
#[derive(Serialize)]
pub(super) struct Report<'a> {
    schema: &'static str,
    software: Software,
    input: InputReport,
    settings: &'a SegmentSettings,
    /// SHA-256 of the file of the empty-capillary picture.
    reference: Option<&'a str>,
    /// Why there is no profile. `None` if there is one.
    error: Option<String>,
    /// Why the profile may be wrong in spite of its numbers.
    warning: Option<String>,
    profile: Option<ProfileReport>,
    #[serde(skip)]
    drawn: Option<(Picture, Profile)>,
}

#[derive(Serialize)]
struct InputReport {
    name: String,
    sha256: Option<String>,
    width_px: Option<u32>,
    height_px: Option<u32>,
    pixel_format: Option<&'static str>,
    bits: Option<u32>,
}

/// Contents of `STEM.edge.json`.
#[derive(Serialize)]
struct EdgeFile<'a> {
    schema: &'static str,
    convention: &'static str,
    input: &'a str,
    width_px: usize,
    height_px: usize,
    polygons: Vec<EdgePolygon>,
}

/// One outline. The lists have one entry per vertex.
#[derive(Serialize)]
struct EdgePolygon {
    vertices: Vec<[f64; 2]>,
    /// Height of the step, in standard deviations of a pixel's noise.
    contrast_sigma: Vec<f64>,
    /// Standard error of the position, px; `null` if no edge could be fitted.
    error_px: Vec<f64>,
    /// On a wall or on the border of the picture, where the specimen's own edge cannot be seen.
    bounded: Vec<bool>,
}

impl EdgePolygon {
    fn new(polygon: &Polygon, points: &[EdgePoint]) -> Self {
        // A ten-thousandth of a pixel is a hundredth of the smallest standard error.
        let short = |x: f64| (x * 1e4).round() / 1e4;
        Self {
            vertices: polygon.vertices.iter().map(|v| v.map(short)).collect(),
            contrast_sigma: points.iter().map(|p| short(p.contrast)).collect(),
            error_px: points.iter().map(|p| short(p.error_px)).collect(),
            bounded: points.iter().map(|p| p.bounded).collect(),
        }
    }
}

impl<'a> Report<'a> {
    pub fn new(names: &Names, settings: &'a SegmentSettings, reference: Option<&'a str>) -> Self {
        let name = names.image.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Self {
            schema: SCHEMA,
            software: Software::this(),
            input: InputReport { name, sha256: None, width_px: None, height_px: None, pixel_format: None, bits: None },
            settings,
            reference,
            error: None,
            warning: None,
            profile: None,
            drawn: None,
        }
    }

    pub fn fail(&mut self, error: String) {
        self.error = Some(error);
    }

    pub fn found(&mut self, input: &Input, found: Result<(Picture, Profile), ProfileError>) {
        self.input.sha256 = Some(input.sha256.clone());
        self.input.width_px = Some(input.frame.width());
        self.input.height_px = Some(input.frame.height());
        self.input.pixel_format = Some(input.frame.format().name());
        self.input.bits = Some(input.bits);
        match found {
            Err(e) => self.fail(e.to_string()),
            Ok((picture, profile)) => {
                self.warning = too_blocky(&picture.planes()[1], picture.width()).map(|ratio| {
                    format!(
                        "lossy compression left steps between its blocks {ratio:.1} times those inside them: the outline may be wrong; save \
                         pictures without loss, or as JPEG of quality 95"
                    )
                });
                self.profile = Some(ProfileReport::of(&profile));
                self.drawn = Some((picture, profile));
            }
        }
    }

    /// The profile, or why there is none.
    pub fn profile(&self) -> Result<&Profile, &str> {
        let why = || self.error.as_deref().unwrap_or("not looked at");
        self.drawn.as_ref().map(|(_, profile)| profile).ok_or_else(why)
    }

    pub fn failed(&self) -> bool {
        self.error.is_some()
    }

    /// A line of text for the user about a picture whose results were written.
    pub fn summary(&self, names: &Names) -> String {
        match (&self.error, &self.profile) {
            (Some(error), _) => error.clone(),
            (None, Some(p)) => {
                let warning = self.warning.as_ref().map(|w| format!("; {w}")).unwrap_or_default();
                let outlines = self.drawn.as_ref().map_or(0, |(_, profile)| profile.edge.len());
                let left_out = match (&names.shapes, outlines) {
                    (Some(_), 2..) => format!("; {} has room for the largest of {outlines} outlines only", shapes::SUFFIX),
                    _ => String::new(),
                };
                format!("{} ({:.2}), {} px{warning}{left_out}", p.detection.kind.name(), p.detection.confidence, p.area_px())
            }
            (None, None) => "not looked at".into(),
        }
    }

    /// Writes the files, the report last. If the picture failed, its older results are removed.
    pub fn write(&self, names: &Names) -> anyhow::Result<()> {
        match &self.drawn {
            Some((picture, profile)) => {
                let (w, h) = (picture.width(), picture.height());
                durable::write(&names.mask, &png(profile.mask.data(), w, h, ExtendedColorType::L8)?)?;
                durable::write(&names.overlay, &png(&overlay::draw(picture, profile), w, h, ExtendedColorType::Rgb8)?)?;
                let edge = EdgeFile {
                    schema: EDGE_SCHEMA,
                    convention: CONVENTION,
                    input: &self.input.name,
                    width_px: w,
                    height_px: h,
                    polygons: profile.edge.iter().zip(&profile.edge_points).map(|(p, q)| EdgePolygon::new(p, q)).collect(),
                };
                let mut text = serde_json::to_vec(&edge)?;
                text.push(b'\n');
                durable::write(&names.edge, &text)?;
                if let Some((file, feature)) = &names.shapes {
                    durable::write(file, &shapes::write(profile, *feature, picture.colours(), &self.input.name)?)?;
                }
            }
            None => [&names.mask, &names.edge, &names.overlay].into_iter().try_for_each(|file| remove(file))?,
        }
        durable::write_json(&names.report, self)?;
        Ok(())
    }
}

fn remove(file: &Path) -> Result<(), StoreError> {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(StoreError::Io { what: "remove the older", path: file.to_owned(), source: e })
        }
        _ => Ok(()),
    }
}

fn png(pixels: &[u8], width: usize, height: usize, colour: ExtendedColorType) -> anyhow::Result<Vec<u8>> {
    let mut out = Vec::new();
    PngEncoder::new(&mut out).write_image(pixels, width as u32, height as u32, colour)?;
    Ok(out)
}
