//! `carved archive` and `carved prune`: runs kept elsewhere, and room made for new ones.

use super::told;
use crate::store;
use anyhow::ensure;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct ArchiveArgs {
    /// Folders of runs that have ended (`DATA/runs/RUN`).
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Where to; each run gets a folder of its name there.
    #[arg(long, value_name = "DIR")]
    to: PathBuf,
}

#[derive(Debug, clap::Args)]
pub struct PruneArgs {
    /// The data folder (`data_dir` of the configuration's [store]).
    data: PathBuf,
    /// Names of runs [default: all]
    runs: Vec<String>,
    /// Take whole runs away, not the raw frames only.
    #[arg(long)]
    all: bool,
    /// Do it; without, it is only said what would be done.
    #[arg(long)]
    yes: bool,
}

/// # Errors
/// At the end, every run that was not archived, with the reason.
pub fn archive(args: &ArchiveArgs) -> anyhow::Result<()> {
    let mut refused = Vec::new();
    for run in &args.runs {
        match store::archive(run, &args.to) {
            Ok(receipt) => println!(
                "{}: {} files, {:.3} GB, every hash verified at {}",
                receipt.run,
                receipt.files.len(),
                receipt.bytes as f64 / 1e9,
                receipt.destination.display()
            ),
            Err(error) => refused.push(told(&error.into())),
        }
    }
    ensure!(refused.is_empty(), "{} of {} run(s) not archived:\n{}", refused.len(), args.runs.len(), refused.join("\n"));
    Ok(())
}

/// # Errors
/// Named runs that cannot be pruned, with the reason; of a whole data folder such runs are told and passed over.
pub fn prune(args: &PruneArgs) -> anyhow::Result<()> {
    ensure!(args.data.join("runs").is_dir(), "{}: no data folder: it has no folder runs", args.data.display());
    let named = !args.runs.is_empty();
    let runs = if named { args.runs.clone() } else { store::run_names(&args.data)? };
    let (mut refused, mut total) = (Vec::new(), 0);
    for run in &runs {
        ensure!(crate::session::is_plain_name(run), "{run:?} is no run's name");
        match store::prune(&args.data, run, args.all, args.yes) {
            Ok(pruned) => {
                total += pruned.bytes;
                let what = if args.yes { "removed" } else { "would remove" };
                let gb = pruned.bytes as f64 / 1e9;
                println!("{}: {what} {} files, {gb:.3} GB; they are in {}", pruned.run, pruned.files, pruned.archived.display());
                // The files are gone all the same, and the next start of the daemon brings its index up to them.
                if let Some(error) = pruned.index {
                    println!("{}: {}", pruned.run, told(&error.into()));
                }
            }
            Err(error) => refused.push(format!("{run}: left alone: {}", told(&error.into()))),
        }
    }
    let done = if args.yes { "freed" } else { "would be freed; --yes does it" };
    println!("{:.3} GB {done}", total as f64 / 1e9);
    if named {
        ensure!(refused.is_empty(), "{}", refused.join("\n"));
    }
    for line in refused {
        println!("{line}");
    }
    Ok(())
}
