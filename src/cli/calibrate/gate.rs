//! `carved calibrate gate`: whether a few beads say that the instrument is today what it was, kept as a dated file.
//!
//! ```text
//!  runs of beads ── numbers ── limits of their method, earlier gates of this rig ── verdict ── gate-DAY-ID.json
//! ```
//! The daemon keeps one after every run with enough beads; this is for beads over several runs, and to look at one again.

use crate::cli::measure::expand;
use anyhow::{Context, ensure};
use carved_store::gates;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Recordings (`runs/RUN/A01`) or whole runs (`runs/RUN`) of one rig; those that are no beads are passed over. The same well of
    /// two runs is the same bead, measured twice
    #[arg(required = true, value_name = "RECORDING_OR_RUN")]
    recordings: Vec<PathBuf>,
    /// Folder of the rig's calibrations: earlier gates are read there, and this one is kept there
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Only print
    #[arg(long)]
    dry_run: bool,
    /// The rig was changed on purpose: earlier gates say nothing of it as it is now
    #[arg(long)]
    begin_history: bool,
}

/// Reads, judges, keeps and prints.
///
/// # Errors
/// Beside what cannot be read: a gate that did not pass, after it was kept and printed.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let recordings = expand(&args.recordings)?;
    let file = gates::made(&recordings, &args.out, args.begin_history)?
        .context("0 measured beads among what was named; 3 or more are expected")?;
    if !args.dry_run {
        let path = gates::keep(&args.out, &file).context("this gate is kept already")?;
        note!("carved: {}", path.display());
    }
    say!("{}", serde_json::to_string_pretty(&file)?);
    let gate = &file.found.gate;
    ensure!(gate.verdict.passes(), "{}", gate.words.join("\n"));
    gate.words.iter().for_each(|said| note!("carved: {said}"));
    Ok(())
}
