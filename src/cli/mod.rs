//! The commands of `carved`, one file each.

pub mod notify;
pub mod reconstruct;

use clap::{Parser, Subcommand};

#[derive(Debug, Parser)]
#[command(name = "carved", version, about)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Reconstruct(reconstruct::Args),
}

impl Cli {
    /// # Errors
    /// Those of the command.
    pub fn run(&self) -> anyhow::Result<()> {
        match &self.command {
            Command::Reconstruct(args) => reconstruct::run(args),
        }
    }
}
