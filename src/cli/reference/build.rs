//! `carved reference build`: makes a file of reference larvae from control larvae.

use super::controls::{self, Words};
use super::show;
use crate::cli::measure::expand;
use anyhow::{Context, bail, ensure};
use carved_core::measure::references::{Control, References, SCHEMA, Summaries, summarise};
use carved_store::{RecordingReader, StoreError, durable};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Recordings (`runs/RUN/A01`), whole runs (`runs/RUN`), or CSV with the columns dpf, `volume_um3`, `area_um2`, `eye_volume_um3`,
    /// `eye_distance_um` and, where known, treatment, strain, cohort (or group), asd, `voxel_um`, epsilon, estimator (default: voxel).
    #[arg(required = true)]
    controls: Vec<PathBuf>,
    /// The file to write; a configuration names it in `references`.
    #[arg(long)]
    out: PathBuf,
    /// Name of these references [default: that of the file].
    #[arg(long)]
    name: Option<String>,
    /// Origin of the larvae, for readers of the file.
    #[arg(long, default_value = "own controls")]
    source: String,
    #[command(flatten)]
    words: Words,
    /// Include recordings with flags.
    #[arg(long)]
    with_flagged: bool,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    if args.out.exists() {
        return Err(StoreError::Exists { path: args.out.clone() }.into());
    }
    let controls = read(args)?;
    let Summaries { groups, refusals, warnings } = summarise(&controls, &args.source);
    for warning in warnings {
        note!("warning: {warning}");
    }
    let refused = refusals.iter().map(|r| format!("  {r}")).collect::<Vec<_>>();
    ensure!(refused.is_empty(), "{} group(s) cannot be made, nothing is written:\n{}", refused.len(), refused.join("\n"));
    let stem = || args.out.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let name = args.name.clone().unwrap_or_else(stem);
    let references = References { schema: SCHEMA.into(), name, gaps: Vec::new(), groups };
    let breaches = references.check();
    ensure!(breaches.is_empty(), "{}", breaches.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"));
    let text = toml::to_string(&references).context("the references as TOML")?;
    durable::write(&args.out, format!("# Made by carved {} reference build.\n\n{text}", env!("CARGO_PKG_VERSION")).as_bytes())?;
    say!("{}", show::table(&references).trim_end());
    say!("Written: {}", args.out.display());
    Ok(())
}

/// Every control that the arguments name. Controls that are left out are reported.
fn read(args: &Args) -> anyhow::Result<Vec<Control>> {
    let mut all = Vec::new();
    for path in expand(&args.controls)? {
        if is_table(&path) {
            all.extend(controls::of_table(&path, &args.words)?);
            continue;
        }
        match controls::of_recording(&RecordingReader::open(&path)?, &args.words, args.with_flagged)? {
            Ok(controls) => all.extend(controls),
            Err(reason) => note!("left out: {}: {reason}", path.display()),
        }
    }
    if all.is_empty() {
        bail!("no control larva was found; name recordings or runs of larvae whose plate map gives their age, or a CSV table");
    }
    Ok(all)
}

fn is_table(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"))
}
