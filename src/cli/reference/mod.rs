//! `carved reference`: the larvae that specimens are compared with, built in or a lab's own.
//!
//! ```text
//!  recordings, runs, CSV ── controls ──┬── build ── groups ── references TOML ── `references` of a configuration
//!                                      └── beads ── the paper's t score
//!  references TOML, or the built-in ────── show ─── a table
//! ```

mod beads;
mod build;
pub(super) mod controls;
mod show;

use clap::Subcommand;

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Make references of a lab's own control larvae.
    Build(build::Args),
    /// Print reference larvae as a table; without a file, the paper's, which are built in.
    Show(show::Args),
    /// Compare measured beads with their nominal diameter, as the paper does.
    Beads(beads::Args),
}

pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Build(args) => build::run(args),
        Command::Show(args) => show::run(args),
        Command::Beads(args) => beads::run(args),
    }
}
