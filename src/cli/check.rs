//! `carved config check`.

use crate::config::Config;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The configuration to check.
    file: PathBuf,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let config = Config::load(&args.file)?;
    for doubt in &config.doubts {
        say!("{}: look again: {doubt}", args.file.display());
    }
    say!(
        "{}: sound; instrument {:?}, methods: {}",
        args.file.display(),
        config.rig_name,
        config.methods.keys().cloned().collect::<Vec<_>>().join(", ")
    );
    Ok(())
}
