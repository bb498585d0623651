//! `carved replay`: computes a stored run again from its frames, with the code of `carved measure`, and compares it bit for bit.
//!
//! ```text
//! RUN ── wells ── measure::compute ─┬─ its own method ── measurement.json and mesh.ply beside what is stored ── identical | same | differs
//!                                   └─ --method ──────── WELL/replays/NAME/, beside; what is stored stays as it is
//! ```

use super::stored::{self, Stored};
use super::{measure, with_causes};
use crate::config::Config;
use crate::session::numbers::{self, MESH};
use crate::session::replays;
use anyhow::{Context, ensure};
use carved_records::{Method, is_plain_name};
use carved_store::{MEASUREMENT, RecordingReader, ReplayWriter, RunClaim, RunRecord};
use std::path::{Component, Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A run's folder (`DATA/runs/RUN`).
    run: PathBuf,
    /// Wells of the run [default: all with numbers, earlier attempts included]
    wells: Vec<String>,
    /// Another method: a TOML file with the keys of a [methods.NAME] table, or a NAME of --config.
    #[arg(long, value_name = "FILE|NAME")]
    method: Option<String>,
    /// Configuration that has the method of that name.
    #[arg(long, value_name = "FILE", requires = "method")]
    config: Option<PathBuf>,
}

/// Computes the run again and prints one line per specimen.
///
/// # Errors
/// At the end, every specimen that could not be computed or gave other bytes than are stored.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let has_record = args.run.join("run.json").symlink_metadata().is_ok();
    ensure!(has_record, "{}: no run's folder: it has no run.json", args.run.display());
    // A recording of a newer carved is not computed, because the same names may have another meaning there.
    RunRecord::of_folder(&args.run)?;
    for well in &args.wells {
        let is_name = matches!(Path::new(well).components().collect::<Vec<_>>()[..], [Component::Normal(_)]);
        ensure!(is_name, "{well:?} is no well of a run; expected the name of a folder in it, as A01 or A01.attempt-1");
    }
    // No prune takes away results that are written meanwhile.
    let _claim = RunClaim::shared(&args.run)?;
    let other = args.method.as_deref().map(|name| method(name, args.config.as_deref())).transpose()?;
    let folders = if args.wells.is_empty() {
        measure::expand(std::slice::from_ref(&args.run))?
    } else {
        args.wells.iter().map(|well| args.run.join(well)).collect()
    };
    let mut wrong = Vec::new();
    for folder in &folders {
        let name = folder.file_name().unwrap_or_default().display();
        let said = match &other {
            None => again(folder),
            Some((as_name, method)) => by(folder, as_name, method),
        };
        match said {
            Ok(word) => {
                say!("{name}: {word}");
                if word.starts_with(DIFFERS) {
                    wrong.push(format!("{name}: {word}"));
                }
            }
            Err(error) => {
                say!("{name}: not computed");
                wrong.push(format!("{name}: {}", with_causes(&error)));
            }
        }
    }
    ensure!(wrong.is_empty(), "{} of {} specimen(s):\n{}", wrong.len(), folders.len(), wrong.join("\n"));
    Ok(())
}

const DIFFERS: &str = "differs";

/// The method, and the name for its results.
pub(super) fn method(name: &str, config: Option<&Path>) -> anyhow::Result<(String, Method)> {
    if let Some(config) = config {
        let methods = Config::load(config)?.methods;
        let known = methods.keys().cloned().collect::<Vec<_>>().join(", ");
        let method = methods.get(name).with_context(|| format!("{}: no method {name:?}; it has: {known}", config.display()))?;
        return Ok((name.to_owned(), method.clone()));
    }
    let file = Path::new(name);
    let text = carved_files::read_to_string(file).with_context(|| format!("{name}: no file of a method; a name needs --config"))?;
    let method = replays::method(&text).with_context(|| name.to_owned())?;
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    ensure!(is_plain_name(&stem), "{name}: its results would be named {stem:?}: use letters, digits, '-', '_' or '.', the first not a '.'");
    Ok((stem, method))
}

/// Computes with the recorded method, and compares with the stored result.
fn again(folder: &Path) -> anyhow::Result<String> {
    let reader = RecordingReader::open(folder)?;
    let (mesh, file) = measure::compute(&reader, &reader.recording().method)?;
    let compared = stored::compare(reader.files(), &file)?;
    let surface = match reader.files().read(MESH)? {
        Some(stored) if stored == numbers::ply(&mesh, file.mode)? => "identical",
        Some(_) => DIFFERS,
        None => "none",
    };
    Ok(match (&compared, surface) {
        (Stored::None, _) => "no numbers are stored to compare with".into(),
        (Stored::Differs { at }, _) => format!("{DIFFERS}: {MEASUREMENT} at {at}"),
        (_, DIFFERS) => format!("{DIFFERS}: {MESH} ({MEASUREMENT} is {compared})"),
        (Stored::Identical, "none") => format!("identical, bit for bit ({MEASUREMENT}; no {MESH} is stored)"),
        (Stored::Identical, _) => format!("identical, bit for bit ({MEASUREMENT}, {MESH})"),
        (Stored::Same { .. }, "none") => format!("{compared} ({MEASUREMENT}; no {MESH} is stored)"),
        (Stored::Same { .. }, _) => format!("{compared} ({MEASUREMENT}; {MESH} is identical)"),
    })
}

/// Computes with another method and writes the result beside the stored one, unless an earlier replay has written the same.
fn by(folder: &Path, name: &str, method: &Method) -> anyhow::Result<String> {
    let reader = RecordingReader::open(folder)?;
    let (mesh, file) = measure::compute(&reader, method)?;
    let found =
        if numbers::write_beside(&reader, name, method, &mesh, &file)? { "written" } else { "identical, bit for bit, to what is there" };
    let folder = ReplayWriter::new(reader.folder(), name);
    let m = &file.record.measurement;
    Ok(format!("{}: {found} (volume {:.4e} um^3, area {:.4e} um^2)", folder.folder().display(), m.volume_um3, m.area_um2))
}
