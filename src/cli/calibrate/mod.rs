//! `carved calibrate`: where the views looked from, found from what they show, and the rig's scale from what is known in um.

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
    /// Axis, roll and what else one turn's profiles tell, by the objective of choice
    Specimen(specimen::Args),
    /// The rig's scale with its standard deviation, from a stage micrometer, certified beads or the capillary's bore
    Scale(scale::Args),
    /// What measured beads say of the rig: diameter, refraction, axis; kept as a dated file
    Beads(beads::Args),
    /// Whether a few beads say that the instrument is today what it was; kept as a dated file
    Gate(gate::Args),
    /// What the dated files of `beads` say over days
    History(history::Args),
    /// Which way the capillary turns and whether the picture is mirrored, from a dot of ink on the glass; kept as a dated file
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
