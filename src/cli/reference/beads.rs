//! `carved reference beads`: checks that a set of measured beads has its nominal diameter.

use crate::cli::measure::expand;
use anyhow::Context;
use carved_core::measure::references::bead::BeadScore;
use carved_core::measure::references::limb::BeadMaterial;
use carved_store::RecordingReader;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Recordings (`runs/RUN/A01`) or whole runs (`runs/RUN`); recordings of other specimens are skipped.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Nominal mean diameter of the beads, um.
    #[arg(long, default_value_t = 500.0)]
    nominal_um: f64,
    /// What the beads are made of: polystyrene, pmma, glass, opaque or unknown. Clear beads look smaller than they are.
    #[arg(long, value_name = "NAME", default_value = "unknown")]
    bead_material: BeadMaterial,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let mut diameters_um = Vec::new();
    for path in expand(&args.recordings)? {
        diameters_um.extend(RecordingReader::open(&path)?.measurement()?.record.measurement.sphere.map(|s| s.diameter_um));
    }
    let n = diameters_um.len();
    let score = BeadScore::of(&diameters_um, args.bead_material.apparent_um(args.nominal_um)[0])
        .with_context(|| format!("{n} bead(s) found; a score needs 3 or more, of different diameters"))?;
    say!("{}", serde_json::to_string_pretty(&score)?);
    Ok(())
}
