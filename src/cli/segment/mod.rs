//! `carved segment`: finds outlines in pictures of a capillary, one by one.
//!
//! ```text
//!  IMAGES ── input ── RawFrame ── profile::segment ─┬─ STEM.mask.png     8 bit grey, inside 255
//!  --settings, --method, --reference ─────┘         ├─ STEM.edge.json    sub-pixel outlines
//!                                                   ├─ STEM.overlay.png  the picture with outline and walls
//!                                                   ├─ STEM__SHAPES.json outline and walls for FishInspector (--shapes)
//!                                                   ├─ STEM.json         numbers, or why there is no profile; written last
//!  --compare ── annotation of the same name ────────┴─ compare.csv       how far each outline is from its annotation
//! ```
//! Errors of the whole call (settings, names, the empty capillary) are reported before anything is written. A picture that fails does not
//! stop the others.

pub(super) mod annotation;
mod compare;
mod empty;
pub(super) mod input;
mod output;
mod overlay;
pub(super) mod shapes;

use annotation::Annotations;
use anyhow::{Context, bail};
use carved_core::frame::PixelFormat;
use carved_core::profile::{Method, Picture, SegmentSettings, Segmenters};
use carved_offline::picture;
use carved_store::durable;
use empty::Empty;
use output::{Names, Report};
use rayon::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Find the specimen's outline in single pictures
#[derive(Debug, clap::Args)]
pub struct Args {
    /// PNG, JPEG, TIFF or BMP; RGB, RGBA or grey, 8 or 16 bit
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// Folder for the results; created if missing, older results of the same names are replaced
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// How the specimen is separated from the empty bore [default: that of --settings, else hybrid]
    #[arg(long, value_enum)]
    method: Option<MethodName>,
    /// TOML with the keys of a method's `segment` table; omitted keys have their defaults
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Picture of the empty capillary, taken like the others: what it shows (dust, scratches, glass) is not taken for specimen
    #[arg(long, value_name = "EMPTY")]
    reference: Option<PathBuf>,
    /// Grey pictures are Bayer mosaics; ORDER is that of the first four pixels, row by row [default: rggb]
    #[arg(long, value_name = "ORDER", num_args = 0..=1, require_equals = true, default_missing_value = "rggb", value_parser = input::mosaics())]
    bayer: Option<PixelFormat>,
    /// Write `STEM__SHAPES.json` too: the outline as a feature of FishInspector, to be corrected by hand; a file that is there is not replaced
    /// [default: fishContour]
    #[arg(long, value_enum, value_name = "FEATURE", num_args = 0..=1, require_equals = true, default_missing_value = "fishContour")]
    shapes: Option<shapes::Feature>,
    /// Compare each outline with the annotation of its picture in a folder or file, and write a table too (`compare.csv`). Annotations are
    /// `STEM__SHAPES.json` or a mask (8 bit grey, inside from 128 on) `STEM.truth.png`, `STEM.mask.png` or `STEM.png`; `STEM.body.png`
    /// is a mask without fins. Can be repeated
    #[arg(long, value_name = "ANNOTATIONS")]
    compare: Vec<PathBuf>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum MethodName {
    Hybrid,
    LevelSet,
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Hybrid => Self::Hybrid,
            MethodName::LevelSet => Self::LevelSet,
        }
    }
}

/// Segments every picture and writes the results.
///
/// # Errors
/// At the beginning, a wrong call. At the end, pictures without a profile, whose own files have the reason, and pictures that were to be
/// compared and have no annotation that can be used.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let settings = settings(args)?;
    let empty = args.reference.as_deref().map(|file| Empty::read(file, &settings, args.bayer)).transpose()?;
    let segmenters = Segmenters::default();
    let names = Names::choose(&args.images, &args.out, args.shapes)?;
    let annotations = if args.compare.is_empty() { None } else { Some(Annotations::find(&args.compare)?) };
    if let Some(annotations) = &annotations {
        annotations.check_results(args.images.iter().map(PathBuf::as_path), &Names::there(&names))?;
    }
    durable::create_folder(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    let done = AtomicUsize::new(0);
    let outcomes: Vec<Outcome> = names
        .par_iter()
        .map(|names| {
            let report = one(names, &settings, args.bayer, empty.as_ref(), &segmenters);
            let written = report.write(names);
            let summary = match &written {
                Ok(()) => report.summary(names),
                Err(e) => format!("not written: {e}"),
            };
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            // Progress on stderr may have no reader any more. Only the results count.
            let _ = writeln!(std::io::stderr(), "[{count}/{}] {}: {summary}", args.images.len(), names.image.display());
            let compared = annotations.as_ref().map(|annotations| compare::row(&names.image, report.profile(), annotations));
            Outcome { failed: report.failed(), written: written.is_ok(), compared }
        })
        .collect();
    let failures = Failures::count(&outcomes);
    if annotations.is_some() {
        let rows: Vec<compare::Row> = outcomes.into_iter().filter_map(|outcome| outcome.compared).collect();
        // The table is kept without a reader of the output, and printed without room on the disk.
        let written = compare::write(&rows, &args.out);
        for line in compare::lines(&rows) {
            say!("{line}");
        }
        written?;
    }
    failures.summary().map_or(Ok(()), |why| bail!("{why}"))
}

/// What became of a picture.
struct Outcome {
    failed: bool,
    written: bool,
    compared: Option<compare::Row>,
}

/// How many pictures went wrong.
struct Failures {
    of: usize,
    /// Without a profile.
    failed: usize,
    unwritten: usize,
    /// With a profile and without an annotation that can be used.
    uncompared: usize,
}

impl Failures {
    fn count(outcomes: &[Outcome]) -> Self {
        let count = |is: fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| is(outcome)).count();
        Self {
            of: outcomes.len(),
            failed: count(|o| o.written && o.failed),
            unwritten: count(|o| !o.written),
            uncompared: count(|o| o.compared.as_ref().is_some_and(compare::Row::lacks_annotation)),
        }
    }

    /// The message at the end. `None` if all pictures succeeded.
    fn summary(&self) -> Option<String> {
        let Self { of, failed, unwritten, uncompared } = self;
        let kinds = [
            (failed, format!("{failed} of {of} pictures have no profile; the lines above and their JSON files say why")),
            (unwritten, format!("the results of {unwritten} of {of} pictures could not be written; the lines above say why")),
            (
                uncompared,
                format!("{uncompared} of {of} pictures have no annotation that can be used; the table and {} say why", compare::TABLE),
            ),
        ];
        let counted: Vec<String> = kinds.into_iter().filter(|(count, _)| **count > 0).map(|(_, why)| why).collect();
        (!counted.is_empty()).then(|| counted.join(". And "))
    }
}

fn one<'a>(
    names: &Names,
    settings: &'a SegmentSettings,
    mosaic: Option<PixelFormat>,
    empty: Option<&'a Empty>,
    segmenters: &Segmenters,
) -> Report<'a> {
    let mut report = Report::new(names, settings, empty.map(|e| e.sha256.as_str()));
    match input::read(&names.image, mosaic) {
        Err(e) => report.fail(format!("{e:#}")),
        Ok(input) => {
            if let Err(e) = empty.map_or(Ok(()), |e| e.check_kind_of(&input)) {
                report.fail(e.to_string());
            } else {
                let picture = Picture::from_frame(&input.frame);
                let profile = segmenters.segment(&picture, settings, empty.map(|e| &e.reference));
                report.found(&input, profile.map(|profile| (picture, profile)));
            }
        }
    }
    report
}

fn settings(args: &Args) -> anyhow::Result<SegmentSettings> {
    let mut settings = match &args.settings {
        Some(file) => single(&settings_text(file)?).with_context(|| format!("--settings {}", file.display()))?,
        None => SegmentSettings::of_single_picture(),
    };
    if let Some(method) = args.method {
        settings.method = method.into();
    }
    Ok(settings)
}

/// The settings of a single picture. What makes a faint piece sure is another default than in a turn.
fn single(text: &str) -> anyhow::Result<SegmentSettings> {
    let settings = parse_settings(text)?;
    let states_faint_sure = toml::from_str::<toml::Table>(text)?.contains_key("faint_sure");
    Ok(picture::of_single_picture(settings, states_faint_sure))
}

/// The settings of a turn in a file.
pub(super) fn read_settings(file: &Path) -> anyhow::Result<SegmentSettings> {
    parse_settings(&settings_text(file)?).with_context(|| format!("--settings {}", file.display()))
}

fn settings_text(file: &Path) -> anyhow::Result<String> {
    carved_files::read_to_string(file).with_context(|| format!("--settings {}: cannot be read", file.display()))
}

pub(super) fn parse_settings(text: &str) -> anyhow::Result<SegmentSettings> {
    let settings: SegmentSettings = toml::from_str(text)?;
    let breaches = picture::breaches(&settings);
    if !breaches.is_empty() {
        bail!("{}", breaches.join("; "));
    }
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No other view tells a faint fin from dust.
    #[test]
    fn a_single_picture_takes_only_faint_pieces_that_are_sure() {
        let of = |text: &str| [single(text), parse_settings(text)].map(|settings| settings.unwrap().faint_sure.to_string());
        // In a turn the other views decide.
        assert_eq!([of(""), of("closing_px = 3")], [["2", "1"]; 2]);
        assert_eq!(of("faint_sure = 1.5"), ["1.5"; 2]);
    }
}
