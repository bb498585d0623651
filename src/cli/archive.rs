//! `carved archive` and `carved prune`: copy runs to another disk, and free space for new ones.

#[cfg(feature = "s3")]
mod s3;

use super::with_causes;
use anyhow::{bail, ensure};
use carved_store::{self, CRATE, Objects, Packing, Pruned, StoreError};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct ArchiveArgs {
    /// Folders of runs that have ended (`DATA/runs/RUN`).
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// Destination; each run gets a folder of its own name in it. `s3://BUCKET/PREFIX` where carved was built with the feature s3.
    #[arg(long, value_name = "DIR")]
    to: String,
    /// Put the files of each well into one file, `A01.tar`. `measure`, `replay`, `export` and `report` read it as they read the folder.
    #[arg(long)]
    pack: bool,
}

#[derive(Debug, clap::Args)]
pub struct PruneArgs {
    /// The data folder (`data_dir` of the configuration's [store]).
    data: PathBuf,
    /// Names of runs [default: all]
    runs: Vec<String>,
    /// Remove whole runs, not only the raw frames.
    #[arg(long)]
    all: bool,
    /// Remove the files. Without this option the command only says what it would remove.
    #[arg(long)]
    yes: bool,
}

/// Opens the object store of an address.
#[cfg(feature = "s3")]
pub(super) fn reach(address: &str) -> Result<Box<dyn Objects>, StoreError> {
    Ok(Box::new(s3::Bucket::of(address)?))
}

/// Refuses an object store.
#[cfg(not(feature = "s3"))]
pub(super) fn reach(address: &str) -> Result<Box<dyn Objects>, StoreError> {
    let why = "this carved was built without the feature s3. Build it with cargo install --locked --path . --features s3";
    Err(StoreError::Remote { address: address.to_owned(), why: why.into() })
}

/// Copies each run and verifies the copy. A run that cannot be archived does not stop the others.
///
/// # Errors
/// At the end, every run that was not archived, with the reason.
pub fn archive(args: &ArchiveArgs) -> anyhow::Result<()> {
    let packing = if args.pack { Packing::PerWell } else { Packing::Files };
    let mut refused = Vec::new();
    let objects = carved_store::is_address(&args.to).then(|| reach(&args.to)).transpose()?;
    for run in &args.runs {
        let archived = match &objects {
            Some(objects) => carved_store::archive_to_objects(run, &args.to, packing, objects.as_ref()),
            None => carved_store::archive(run, Path::new(&args.to), packing),
        };
        match archived {
            Ok(receipt) => {
                say!(
                    "{}: {} files{}, {:.3} GB, every hash verified at {}",
                    receipt.run,
                    receipt.files.len(),
                    if args.pack { format!(", those of {} recordings packed", receipt.packed.len()) } else { String::new() },
                    receipt.bytes as f64 / 1e9,
                    receipt.destination.display()
                );
                if args.pack && run.join(CRATE).is_file() {
                    note!(
                        "carved: {}: {CRATE} is not copied, because it lists single files. carved export rocrate makes one of the packed copy",
                        receipt.run
                    );
                }
            }
            Err(error) => refused.push(with_causes(&error.into())),
        }
    }
    ensure!(refused.is_empty(), "{} of {} run(s) not archived:\n{}", refused.len(), args.runs.len(), refused.join("\n"));
    Ok(())
}

/// Prunes the named runs, or every run of the data folder. A run that cannot be pruned does not stop the others.
///
/// # Errors
/// Every run that should have been pruned and was not: a named run, and any run whose copy is damaged. Without names, runs that have not
/// ended or were never archived are skipped without an error.
pub fn prune(args: &PruneArgs) -> anyhow::Result<()> {
    ensure!(args.data.join("runs").is_dir(), "{}: no data folder: it has no folder runs", args.data.display());
    let named = !args.runs.is_empty();
    if let Some(run) = args.runs.iter().find(|run| !carved_records::is_plain_name(run)) {
        bail!("{run:?} is no run's name");
    }
    let mut pruning = Pruning { args, named, failed: Vec::new(), passed_over: Vec::new(), bytes: 0 };
    let cut_short: Vec<String> = carved_store::cut_short(&args.data)?.into_iter().filter(|run| !named || args.runs.contains(run)).collect();
    for run in &cut_short {
        pruning.take(run, carved_store::end_prune(&args.data, run, args.yes, &reach), " of an earlier prune that was cut short")?;
    }
    let runs = if named { args.runs.clone() } else { carved_store::run_names(&args.data)? };
    for run in &runs {
        // The earlier prune of this run removed its folder, so nothing is left to prune.
        if cut_short.contains(run) && !args.data.join("runs").join(run).exists() {
            continue;
        }
        pruning.take(run, carved_store::prune(&args.data, run, args.all, args.yes, &reach), "")?;
    }
    let Pruning { failed, passed_over, bytes, .. } = pruning;
    let done = if args.yes { "freed" } else { "would be freed; --yes does it" };
    say!("{:.3} GB {done}", bytes as f64 / 1e9);
    for line in passed_over {
        say!("{line}");
    }
    ensure!(failed.is_empty(), "{} run(s) not pruned:\n{}", failed.len(), failed.join("\n"));
    Ok(())
}

/// Intermediate result of a prune of several runs.
struct Pruning<'a> {
    args: &'a PruneArgs,
    named: bool,
    failed: Vec<String>,
    passed_over: Vec<String>,
    bytes: u64,
}

impl Pruning<'_> {
    fn take(&mut self, run: &str, found: Result<Pruned, StoreError>, of: &str) -> anyhow::Result<()> {
        let pruned = match found {
            Ok(pruned) => pruned,
            Err(error) => {
                let passed_over = !self.named && matches!(error, StoreError::NeverArchived { .. } | StoreError::Unended { .. });
                let line = format!("{run}: left alone: {}", with_causes(&error.into()));
                if passed_over {
                    self.passed_over.push(line);
                } else {
                    self.failed.push(line);
                }
                return Ok(());
            }
        };
        self.bytes += pruned.bytes;
        let what = if self.args.yes { "removed" } else { "would remove" };
        let gb = pruned.bytes as f64 / 1e9;
        let copy = pruned.archived.map_or_else(String::new, |copy| format!("; they are in {}", copy.display()));
        if pruned.files == 0 && of.is_empty() {
            say!("{run}: nothing to remove{}", copy.replace("they are in", "its raw frames were archived to"));
        } else {
            say!("{run}: {what} {} files{of}, {gb:.3} GB{copy}", pruned.files);
        }
        // The files are removed in any case. The next start of the daemon updates its index.
        if let Some(error) = pruned.index {
            say!("{run}: {}", with_causes(&error.into()));
        }
        Ok(())
    }
}
