//! `carved index`: rebuilds the index over the run folders.

use carved_store as store;
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Rebuild the index of a data folder from its run folders and journal; stop the daemon that uses it first.
    Rebuild(Args),
}

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The data folder (`data_dir` of the configuration's [store]).
    data: PathBuf,
}

/// Rebuilds the index.
///
/// # Errors
/// A folder that a daemon uses, that cannot be written, or that is no data folder; at the end, runs that cannot be read.
pub fn run(command: &Command) -> anyhow::Result<()> {
    let Command::Rebuild(Args { data }) = command;
    anyhow::ensure!(data.join("runs").is_dir(), "{}: no data folder: it has no folder runs", data.display());
    let found = store::rebuild_index(data)?;
    say!("{}: {} run(s), {} of them without an outcome", data.display(), found.runs - found.unreadable.len(), found.open.len());
    let unreadable: Vec<String> = found.unreadable.into_iter().map(|u| u.why).collect();
    anyhow::ensure!(
        unreadable.is_empty(),
        "{} run(s) cannot be read and are not in the index:\n{}",
        unreadable.len(),
        unreadable.join("\n")
    );
    Ok(())
}
