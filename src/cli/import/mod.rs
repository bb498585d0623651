//! `carved import`: makes a recording of a lab's own frames of one turn, for `measure` and `simulate --replay`; or a run of a plate.
//!
//! ```text
//!  FRAMES ───────────────────────── frames ── looked at, natural order ──┐
//!  --cameras, --config, defaults ── rig ───── camera, method ────────────┼── write ── recording, whole or not at all
//!  --angles, --cameras, --even ──── angles ── turn: steps of a ledger ───┘
//! ```
//! Everything is read and checked before anything is written. With --plate, `plate` does this for each well.

pub(super) mod angles;
mod frames;
pub(super) mod natural;
pub(super) mod plate;
pub(super) mod rig;
mod turn;
mod write;

use crate::cli::segment::input::{self, Kind};
use angles::{Angles, PlatePictures};
use anyhow::{Context, bail, ensure};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::measure::references::References;
use carved_core::pipeline::Pipeline;
use carved_records::{Mode, PlannedWell, RunPlan, SpecimenKind};
use carved_store::{Recording, RigRecord};
use frames::{Looked, Source};
use rig::{Rig, Sources};
use serde_json::json;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use turn::Turn;

/// Make a recording of a lab's own frames of one turn, or with --plate a run of the pictures of a plate
///
/// The frames are those of one specimen, one per view, sorted by their names in NATURAL order: view2 comes before view10. Their angles
/// come from one of --cameras (with omega), --angles and --even. The recording says `imported` as its mode.
///
/// With --plate the pictures are those of a plate: their names say well, fish and view. The wells become one run, which is measured.
#[derive(Debug, clap::Args)]
#[allow(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub struct Args {
    /// One folder of frames, or the frames' files: PNG, JPEG, BMP or TIFF, sorted by name in natural order (view2 before view10); or one
    /// TIFF with a page per view; with --plate, folders with all that is below them
    #[arg(required = true, value_name = "FRAMES")]
    frames: Vec<PathBuf>,
    /// camera.json: f, kx, ky, ux, uy, width, height, and the angles omega in rad (omit omega with --angles or --even)
    #[arg(long, value_name = "FILE")]
    cameras: Option<PathBuf>,
    /// Angles of the frames: VAST's external.txt, a CSV with a header (`view` or `file`; `angle_deg` or `omega_rad`), or degrees, one per line or as a JSON list
    #[arg(long, value_name = "FILE", conflicts_with = "even")]
    angles: Option<PathBuf>,
    /// The degrees of --angles are turns since the previous view, made before its frame, not positions of the axis
    #[arg(long, requires = "angles")]
    relative: bool,
    /// Time of a turn, s: --angles has the times of a film (`time_s`) of an axis that turns at a constant speed
    #[arg(long, value_name = "SECONDS", requires = "angles", conflicts_with = "relative")]
    turn_s: Option<f64>,
    /// The frames are evenly spaced over one turn
    #[arg(long)]
    even: bool,
    /// The last frame repeats the first at 360 deg: it is compared, never carved
    #[arg(long)]
    closure: bool,
    /// Sense of the axis: with 1 positive degrees move the near wall to larger v, with -1 to smaller [default: the configuration's, else 1]
    #[arg(long, value_name = "1|-1", value_parser = clap::builder::PossibleValuesParser::new(["1", "-1"]))]
    sense: Option<String>,
    /// Configuration whose [optics], sense, method and empty capillary are used; --cameras replaces its [optics] [default: the published
    /// rig's 5.5 um per px, axis in the picture's middle, camera 60 mm away]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Method of the configuration [default: its only one]
    #[arg(long, value_name = "NAME")]
    method: Option<String>,
    /// Well that the specimen came from
    #[arg(long, default_value = "A01", conflicts_with = "plate")]
    well: String,
    /// Type of the specimen
    #[arg(long, value_enum, default_value_t = Specimen::Larva)]
    specimen: Specimen,
    /// Days post fertilisation
    #[arg(long)]
    dpf: Option<f64>,
    /// Share of the views that may miss a voxel [default: the method's, else 0.05]
    #[arg(long, value_name = "E")]
    epsilon: Option<f64>,
    /// Edge of a voxel, um [default: the method's, else 6.93]
    #[arg(long, value_name = "UM")]
    voxel: Option<f64>,
    /// TOML with the keys of a method's `segment` table; omitted keys have their defaults [default: the method's]
    #[arg(long, value_name = "FILE")]
    settings: Option<PathBuf>,
    /// Picture of the empty capillary, taken like the frames; they are compared with it [default: the configuration's]
    #[arg(long, value_name = "FILE")]
    empty: Option<PathBuf>,
    /// Grey pictures are Bayer mosaics; ORDER is that of the first four pixels, row by row [default: rggb]
    #[arg(long, value_name = "ORDER", num_args = 0..=1, require_equals = true, default_missing_value = "rggb", value_parser = input::mosaics())]
    bayer: Option<PixelFormat>,
    /// New folder for the recording; nothing is overwritten [default: FRAMES-recording in the current folder, numbered if taken]
    #[arg(long, value_name = "DIR", conflicts_with = "plate")]
    out: Option<PathBuf>,
    #[command(flatten)]
    of_plate: plate::PlateArgs,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Specimen {
    Larva,
    Bead,
}

impl From<Specimen> for SpecimenKind {
    fn from(specimen: Specimen) -> Self {
        match specimen {
            Specimen::Larva => Self::Larva,
            Specimen::Bead => Self::Bead,
        }
    }
}

/// Everything that was read and checked.
struct Imported {
    looks: Vec<Looked>,
    turn: Turn,
    /// Origin of the angles, in words.
    angles_from: String,
    camera_from: String,
    empty: Option<Arc<RawFrame>>,
    /// The reference larvae for larvae of known age.
    references: Arc<[References]>,
    warnings: Vec<String>,
}

impl Imported {
    /// Pictures with the turn that they show. The picture of the empty capillary must be of their kind.
    fn new(
        args: &Args,
        rig: &Rig,
        (looks, kind): (Vec<Looked>, Kind),
        turn: Turn,
        angles_from: String,
        warnings: Vec<String>,
    ) -> anyhow::Result<Self> {
        let empty = match &args.empty {
            Some(file) => Some(Arc::new(frames::empty(file, args.bayer, kind)?)),
            None => rig.empty.clone(),
        };
        if let Some(empty) = &empty {
            ensure!(
                (empty.width(), empty.height(), empty.format()) == (kind.width, kind.height, kind.format),
                "the configuration's picture of the empty capillary is {} x {} px {}, the frames are {kind}; give one of their kind with --empty",
                empty.width(),
                empty.height(),
                empty.format().name()
            );
        }
        Ok(Self { looks, turn, angles_from, camera_from: rig.camera_from.clone(), empty, references: rig.references.clone(), warnings })
    }

    /// The contents of `import.json`: which file became which view.
    fn origin(&self) -> serde_json::Value {
        let views = self.looks.iter().zip(&self.turn.stops).map(
            |(looked, stop)| json!({"view": stop.view, "closure": stop.closure, "file": looked.name(), "file_sha256": looked.file_sha256}),
        );
        json!({
            "schema": "carved.import/1",
            "angles": self.angles_from,
            "angle_error_deg": self.turn.error_deg,
            "camera": self.camera_from,
            "warnings": self.warnings,
            "views": views.collect::<Vec<_>>(),
        })
    }
}

/// Reads and checks everything, then writes the recording and prints its path.
///
/// # Errors
/// Names the wrong file or option, the value found and the value expected. No files are left then.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match &args.of_plate.plate {
        Some(barcode) => plate::run(args, barcode),
        None => one_turn(args).map(|()| ExitCode::SUCCESS),
    }
}

fn one_turn(args: &Args) -> anyhow::Result<()> {
    let out = write::choose(args.out.as_deref(), &args.frames)?;
    let mut warnings = Vec::new();
    let mut warn = |doubt: String| {
        note!("carved: {doubt}");
        warnings.push(doubt);
    };
    let paths = frames::list(&args.frames)?;
    plate::check_one_specimen(&paths)?;
    let (looks, kind) = frames::look(&Source::of_turn(paths)?, args.bayer, &mut warn)?;
    let sources = rig::load(args, &mut warn)?;
    let rig = sources.rig(args, kind, &mut warn)?;
    let names: Vec<String> = looks.iter().map(Looked::name).collect();
    let (omega_deg, angles_from) = omega_deg(args, &sources, &names, None, &mut warn)?;
    let turn = turn::turn(omega_deg, args.closure).with_context(|| angles_from.clone())?;
    let imported = Imported::new(args, &rig, (looks, kind), turn, angles_from, warnings)?;
    let specimen = PlannedWell::new(&args.well, args.specimen.into(), args.dpf);
    let recording = recording(rig, "imported", specimen, kind, &imported)?;
    write::write(&out, recording, &imported)?;
    let [steps, _] = imported.turn.steps_per_revolution.into();
    let report = json!({
        "recording": out,
        "views": imported.turn.asd,
        "closure": imported.turn.stops.iter().any(|s| s.closure),
        "first": names.first(),
        "last": names.last(),
        "angles": imported.angles_from,
        "camera": imported.camera_from,
        "steps_per_revolution": steps,
        "angle_error_deg": imported.turn.error_deg,
    });
    say!("{report}");
    Ok(())
}

/// omega of every picture, deg, and the origin of the angles in words.
fn omega_deg(
    args: &Args,
    sources: &Sources,
    names: &[String],
    plate: Option<&PlatePictures>,
    warn: &mut dyn FnMut(String),
) -> anyhow::Result<(Vec<f64>, String)> {
    let asked = match &args.sense {
        Some(sense) => Some(if sense == "-1" { -1.0 } else { 1.0 }),
        None => sources.sense,
    };
    let sense = asked.unwrap_or(1.0);
    let of_axis = |deg: Vec<f64>| deg.into_iter().map(|a| sense * a).collect::<Vec<_>>();
    let of_rad = |rad: Vec<f64>, from: String| -> anyhow::Result<_> {
        ensure!(args.sense.is_none(), "--sense: {from} has omega, which has its sign already; leave --sense out");
        ensure!(!args.relative, "--relative: {from} has omega, which are positions; leave --relative out");
        Ok((rad.into_iter().map(f64::to_degrees).collect(), from))
    };
    let of_rad = |rad: Vec<f64>, from: String| {
        ensure!(args.turn_s.is_none(), "--turn-s: {from} has angles; leave --turn-s out, or give the time of each picture (time_s)");
        of_rad(rad, from)
    };
    match (sources.omega(), &args.angles, args.even) {
        (Some(_), Some(_), _) | (Some(_), _, true) => {
            bail!("--cameras gives omega and {} other angles; leave one of them out", if args.even { "--even" } else { "--angles" })
        }
        (Some(omega), None, false) => {
            let from = format!("omega of --cameras {}", args.cameras.as_deref().unwrap_or(Path::new("")).display());
            ensure!(
                omega.len() == names.len(),
                "{from}: found {} angles for {} pictures; one per picture is expected",
                omega.len(),
                names.len()
            );
            of_rad(omega.to_vec(), from)
        }
        (None, Some(file), _) => match angles::read(file, names, plate)? {
            Angles::Rad(rad) => of_rad(rad, format!("omega_rad of --angles {}", file.display())),
            Angles::Seconds(seconds) => {
                let turn_s = args
                    .turn_s
                    .with_context(|| format!("--angles {}: found times; say with --turn-s how long a turn takes", file.display()))?;
                let from = format!("time_s of --angles {}, a turn in {turn_s} s, sense {sense}", file.display());
                let deg = swept(&seconds, turn_s, names).with_context(|| from.clone())?;
                Ok((of_axis(deg), from))
            }
            Angles::Degrees(_) if args.turn_s.is_some() => {
                bail!("--turn-s: --angles {} has no column time_s; leave --turn-s out, or give the time of each picture", file.display())
            }
            Angles::Degrees(deg) => {
                let from =
                    format!("degrees of --angles {}{}, sense {sense}", file.display(), if args.relative { ", relative" } else { "" });
                let all_alike = deg.len() > 1 && deg.iter().skip(1).all(|d| (d - deg[1]).abs() < 1e-9) && deg[1] != 0.0;
                ensure!(
                    args.relative || !all_alike,
                    "{from}: found {} again and again; if these are turns from view to view, say --relative",
                    deg[1]
                );
                Ok((of_axis(if args.relative { summed(&deg) } else { deg }), from))
            }
        },
        (None, None, true) => {
            frames::gap(names).into_iter().for_each(&mut *warn);
            Ok((of_axis(turn::even(names.len(), args.closure)), format!("--even, sense {sense}")))
        }
        (None, None, false) => {
            bail!("no angles: give --cameras with omega, --angles, or --even if the frames stand evenly around one turn")
        }
    }
}

/// Positions of an axis that turns once in `turn_s` seconds, at the times of the pictures, deg from the first.
fn swept(seconds: &[f64], turn_s: f64, names: &[String]) -> anyhow::Result<Vec<f64>> {
    ensure!(turn_s > 0.0 && turn_s.is_finite(), "--turn-s {turn_s}: expected a time above 0 s");
    let first = seconds.first().copied().unwrap_or_default();
    let deg: Vec<f64> = seconds.iter().map(|at| 360.0 * (at - first) / turn_s).collect();
    let back = deg.windows(2).position(|pair| pair[1] <= pair[0]);
    ensure!(back.is_none(), "the time of {} is not after that of the picture before it", names[back.unwrap_or_default() + 1]);
    let beyond = deg.iter().position(|deg| *deg > 361.0);
    ensure!(
        beyond.is_none(),
        "{} was taken {:.1} deg after the first picture: give the pictures of one turn, and that at 360 deg as the closure view",
        names[beyond.unwrap_or_default()],
        deg[beyond.unwrap_or_default()]
    );
    Ok(deg)
}

/// Converts turns between views to positions. The first position is 0.
fn summed(turns: &[f64]) -> Vec<f64> {
    let mut at = 0.0;
    let mut positions = Vec::with_capacity(turns.len());
    for (i, turn) in turns.iter().enumerate() {
        at += if i == 0 { 0.0 } else { *turn };
        positions.push(at);
    }
    positions
}

/// The recording without its views, checked as a run and its measurement check it.
fn recording(rig: Rig, run: &str, specimen: PlannedWell, kind: Kind, imported: &Imported) -> anyhow::Result<Recording> {
    let mut method = rig.method;
    method.asd = imported.turn.asd;
    let plan = RunPlan::new("IMPORT", &rig.method_name, "import", vec![specimen.clone()]);
    if let Err(errors) = plan.check(&BTreeMap::from([(rig.method_name.clone(), &method)])) {
        bail!(
            "{}",
            errors
                .iter()
                .map(|e| format!("--{}: {}", e.pointer.rsplit('/').next().unwrap_or_default(), e.detail))
                .collect::<Vec<_>>()
                .join("\n")
        );
    }
    let settings = method.pipeline(&rig.camera, false).context("--voxel")?.compared_with(imported.empty.as_deref())?;
    Pipeline::new(settings)?;
    let record = RigRecord {
        name: rig.name,
        camera: rig.camera,
        pixel_format: kind.format,
        empty_capillary_sha256: None,
        steps_per_revolution: imported.turn.steps_per_revolution,
        sense: imported.turn.sense,
        rotation_identity: format!("imported: {}", imported.angles_from),
        camera_identity: format!("imported: {}", imported.camera_from),
        camera_features: std::collections::BTreeMap::new(),
        second: None,
    };
    Ok(Recording::new(run, specimen, Mode::Imported, record, &rig.method_name, method))
}
