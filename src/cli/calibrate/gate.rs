//! `carved calibrate gate`: checks with a few beads that the instrument has not changed; stored as a dated file.
//!
//! ```text
//!  runs of beads ── numbers ── limits of their method, earlier gates of this rig ── verdict ── gate-DAY-ID.json
//! ```
//! The daemon stores a gate after every run with enough beads. This command combines beads of several runs, or repeats a gate.

use crate::cli::measure::expand;
use anyhow::{Context, ensure};
use carved_store::gates;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Recordings (`runs/RUN/A01`) or whole runs (`runs/RUN`) of one rig; recordings of other specimens are skipped. The same well in two
    /// runs counts as one bead that was measured twice
    #[arg(required = true, value_name = "RECORDING_OR_RUN")]
    recordings: Vec<PathBuf>,
    /// Folder of the rig's calibrations: earlier gates are read from it, and this one is stored in it
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
    /// Print only, store nothing
    #[arg(long)]
    dry_run: bool,
    /// The rig was changed on purpose: ignore earlier gates
    #[arg(long)]
    begin_history: bool,
}

/// Reads the beads, judges them, stores the gate and prints it.
///
/// # Errors
/// Files that cannot be read, and a gate that did not pass. Such a gate is stored and printed before the error is returned.
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
