//! `carved manual`: man pages and shell completions of all commands, made from what clap knows of them. The package of a distribution
//! installs these files.
//!
//! It is a hidden command and not a program of its own: the pages always are those of the program beside them, and no build links the
//! daemon twice.

use super::{Cli, LOG};
use anyhow::Context;
use clap::{Command, CommandFactory};
use clap_complete::{Shell, generate_to};
use clap_mangen::Man;
use std::io;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder that gets `man1` and `completions`
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// What follows the help of a command, as `clap_mangen` writes it, and as a section of a man page (man-pages(7)).
const SECTIONS: [(&str, &str); 2] =
    [(".SH EXTRA\nExit codes: ", ".SH \"EXIT STATUS\"\n"), (".SH EXTRA\nEnvironment:\n", ".SH ENVIRONMENT\n")];

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
    let mut command = documented().disable_help_subcommand(true);
    command.build();
    write_pages(&command, &pages).with_context(|| format!("cannot write the man pages into {}", pages.display()))
}

/// Writes the pages of a command and of its subcommands.
fn write_pages(command: &Command, folder: &Path) -> io::Result<()> {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        write_pages(below, folder)?;
    }
    // The synopsis of `clap_mangen` has no values of options.
    let usage = command.clone().render_usage().to_string();
    let man = Man::new(command.clone().override_usage(usage.trim_start_matches("Usage: ").to_owned()));
    let mut page = Vec::new();
    man.render(&mut page)?;
    let mut page = String::from_utf8_lossy(&page).into_owned();
    for (extra, section) in SECTIONS {
        page = page.replace(extra, section);
    }
    std::fs::write(folder.join(man.get_filename()), page)
}

/// The commands without the hidden ones, which completions would offer. The version is that of the release: that of the program has a
/// commit, and a page would change with each.
fn documented() -> Command {
    let all = Cli::command();
    let shown: Vec<Command> = all.get_subcommands().filter(|command| !command.is_hide_set()).cloned().collect();
    let about = all.get_about().cloned().unwrap_or_default();
    Command::new("carved").version(env!("CARGO_PKG_VERSION")).about(about).after_help(LOG).subcommands(shown)
}
