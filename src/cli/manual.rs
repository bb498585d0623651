//! `carved manual`: man pages and shell completions of all commands, made from what clap knows of them. The package of a distribution
//! installs these files.
//!
//! It is a hidden command and not a program of its own: the pages always are those of the program beside them, and no build links the
//! daemon twice.

use super::{Cli, LOG};
use anyhow::Context;
use clap::{Command, CommandFactory};
use clap_complete::{Shell, generate_to};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder that gets `man1` and `completions`
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

const SHELLS: [Shell; 3] = [Shell::Bash, Shell::Zsh, Shell::Fish];

/// Writes `man1/carved.1`, one page for each subcommand, and the completions.
///
/// # Errors
/// The folder cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let [pages, completions] = ["man1", "completions"].map(|name| args.out.join(name));
    for folder in [&pages, &completions] {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    }
    let mut command = documented();
    for shell in SHELLS {
        generate_to(shell, &mut command, "carved", &completions)
            .with_context(|| format!("cannot write the completions of {shell} into {}", completions.display()))?;
    }
    clap_mangen::generate_to(documented(), &pages).with_context(|| format!("cannot write the man pages into {}", pages.display()))
}

/// The commands without the hidden ones, which completions would offer. The version is that of the release: that of the program has a
/// commit, and a page would change with each.
fn documented() -> Command {
    let all = Cli::command();
    let shown: Vec<Command> = all.get_subcommands().filter(|command| !command.is_hide_set()).cloned().collect();
    let about = all.get_about().cloned().unwrap_or_default();
    Command::new("carved").version(env!("CARGO_PKG_VERSION")).about(about).after_help(LOG).subcommands(shown)
}
