//! `carved calibrate`: the geometry of the views from their profiles, and the rig's scale from known lengths.

mod beads;
mod gate;
mod history;
mod keep;
mod marked;
mod measured;
mod scale;
mod specimen;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Axis, roll and other parameters from the profiles of one turn, by a choice of objectives
    Specimen(specimen::Args),
    /// The rig's scale with its standard deviation, from a stage micrometer, certified beads or the capillary's bore
    Scale(scale::Args),
    /// What measured beads show about the rig: diameter, refraction, axis; stored as a dated file
    Beads(beads::Args),
    /// Check with a few beads that the instrument has not changed; stored as a dated file
    Gate(gate::Args),
    /// Show the dated files of `beads` over several days
    History(history::Args),
    /// Rotation sense of the capillary and mirroring of the picture, from a dot of ink on the glass; stored as a dated file
    Marked(marked::Args),
}

/// Runs the calibration that the arguments name.
pub fn run(command: &Command) -> anyhow::Result<()> {
    match command {
        Command::Specimen(args) => specimen::run(args),
        Command::Scale(args) => scale::run(args),
        Command::Beads(args) => beads::run(args),
        Command::Gate(args) => gate::run(args),
        Command::History(args) => history::run(args),
        Command::Marked(args) => marked::run(args),
    }
}
