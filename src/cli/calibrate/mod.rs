//! `carved calibrate`: where the views looked from, found from what they show.

mod specimen;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Axis, roll and what else one turn's profiles tell, by the objective of choice
    Specimen(specimen::Args),
}

/// Runs the calibration that the arguments name.
pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Specimen(args) => specimen::run(args),
    }
}
