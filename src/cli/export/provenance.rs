//! `carved export methods`, `carved export rembi` and `carved export rocrate`.

use super::{left_out, read, write};
use crate::report::methods::Methods;
use crate::report::rembi;
use crate::report::rocrate::{FILE, Given, metadata};
use anyhow::{Context, ensure};
use std::path::PathBuf;
use std::process::ExitCode;

/// Missing files that a message names at most.
const NAMED: usize = 5;

#[derive(Debug, clap::Args)]
pub struct MethodsArgs {
    /// Folders of runs (`DATA/runs/RUN`).
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// File for the Markdown [default: standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub struct RembiArgs {
    /// Folders of runs (`DATA/runs/RUN`). Together they are one study.
    #[arg(required = true)]
    runs: Vec<PathBuf>,
    /// File for the JSON [default: standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub struct CrateArgs {
    /// Folder of a run that has ended (`DATA/runs/RUN`), or of its copy in an archive. `ro-crate-metadata.json` is written into it, and makes it a crate.
    run: PathBuf,
    /// ORCID of the operator, as in <https://orcid.org/0000-0002-1825-0097>
    #[arg(long, value_name = "URL")]
    orcid: Option<String>,
    /// Licence of the data, as in <https://creativecommons.org/licenses/by/4.0/>
    #[arg(long, value_name = "URL")]
    license: Option<String>,
}

/// Writes the methods of each run.
///
/// # Errors
/// A run that cannot be read, or a file that cannot be written.
pub fn methods(args: &MethodsArgs) -> anyhow::Result<ExitCode> {
    let runs = read(&args.runs)?;
    let mut text = String::new();
    for run in &runs {
        text.push_str(&Methods::of(run).markdown());
        text.push('\n');
    }
    match &args.out {
        Some(file) => write(file, text.as_bytes())?,
        None => say!("{}", text.trim_end()),
    }
    Ok(left_out(&runs))
}

/// Writes the study file of runs.
///
/// # Errors
/// A run that is simulated or cannot be read, and a file that cannot be written.
pub fn rembi(args: &RembiArgs) -> anyhow::Result<()> {
    let study = rembi::study(&read(&args.runs)?)?;
    let text = serde_json::to_vec_pretty(&study).context("the study cannot be written as JSON")?;
    let Some(file) = &args.out else {
        say!("{}", String::from_utf8_lossy(&text));
        return Ok(());
    };
    write(file, &text)?;
    let missing = study["to_fill_in"].as_array().map_or(0, Vec::len);
    note!("carved: {}: fill in the {missing} place(s) that `to_fill_in` names", file.display());
    Ok(())
}

/// Makes a run's folder a crate.
///
/// # Errors
/// A run that has not ended or cannot be read, a file that was altered, and a file that cannot be written.
pub fn rocrate(args: &CrateArgs) -> anyhow::Result<()> {
    for (option, value) in [("--orcid", &args.orcid), ("--license", &args.license)] {
        if let Some(value) = value {
            ensure!(value.starts_with("https://"), "{option} is {value}; expected an address that begins with https://");
        }
    }
    let runs = read(std::slice::from_ref(&args.run))?;
    let run = runs.first().context("one run is named")?;
    ensure!(run.record().outcome.is_some(), "{}: the run has not ended; wait for its end", args.run.display());
    let given = Given { orcid: args.orcid.clone(), license: args.license.clone() };
    let path = args.run.join(FILE);
    let (metadata, missing) = metadata(run, &given)?;
    write(&path, &serde_json::to_vec_pretty(&metadata).context("the metadata cannot be written as JSON")?)?;
    if !missing.is_empty() {
        let some: Vec<String> = missing.iter().take(NAMED).map(|name| name.display().to_string()).collect();
        let more = if missing.len() > NAMED { ", ..." } else { "" };
        note!(
            "carved: {} file(s) that SHA256SUMS lists are missing, and no receipt of an archive has them. The crate does not list them: {}{more}",
            missing.len(),
            some.join(", ")
        );
    }
    note!("carved: {}", path.display());
    Ok(())
}
