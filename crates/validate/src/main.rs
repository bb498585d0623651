//! `carved-validate`: the paper's tables and the method's goals, on simulated specimens of known size.
//!
//! ```text
//!   theory ─┐  beads, larvae, fins by frames and segmentation ─┐
//!   paper ──┼─ beside ─ larvae, solids by exact outlines ──────┼─ goals, tables ── validation.md, validation/*.svg
//!           └────────── calibration, faults, ablation, ────────┘
//!                       orders, coverage, early stop, live estimates over many seeds
//! ```
//! Every number depends only on the seed: the same command writes the same document, on any number of threads.

mod ablation;
mod beads;
mod calibration;
// The emulated rig and the science share no code, so what converts between them is outside of both.
#[path = "../../../src/cli/emulated.rs"]
#[allow(dead_code)] // one of the two directions
mod camera;
mod coverage;
mod document;
mod early;
mod effort;
mod faults;
mod fins;
mod frames;
mod larvae;
mod live;
mod look;
mod orders;
mod plot;
mod published;
mod solids;
mod statistics;
mod theory;
mod turn;

use document::Section;
use effort::{Effort, Work};
use std::path::PathBuf;

/// Measure simulated specimens of known size in many ways, and write the document of the accuracy.
#[derive(Debug, clap::Parser)]
#[command(name = "carved-validate", version)]
struct Args {
    /// Folder of the document; its plots go into `validation` beside it.
    #[arg(long, default_value = "validation")]
    out: PathBuf,
    /// Use few phantoms, to check that every part works, not how accurate it is.
    #[arg(long)]
    quick: bool,
    /// Number of phantoms in every part that draws phantoms; the paper's 25 beads and 60 larvae do not change.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    seeds: Option<u32>,
    /// Number that is added to every phantom's seed.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Run only this part; may be repeated.
    #[arg(long, value_enum, value_name = "PART")]
    only: Vec<Part>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Part {
    Beads,
    Larvae,
    Solids,
    Calibration,
    Faults,
    Ablation,
    Orders,
    Coverage,
    Early,
    Live,
    Fins,
    Look,
}

type Run = fn(&Work) -> anyhow::Result<Section>;

const PARTS: [(Part, Run); 12] = [
    (Part::Beads, beads::run),
    (Part::Larvae, larvae::run),
    (Part::Solids, solids::run),
    (Part::Calibration, calibration::run),
    (Part::Faults, faults::run),
    (Part::Ablation, ablation::run),
    (Part::Orders, orders::run),
    (Part::Coverage, coverage::run),
    (Part::Early, early::run),
    (Part::Live, live::run),
    (Part::Fins, fins::run),
    (Part::Look, look::run),
];

fn main() -> anyhow::Result<()> {
    let args = <Args as clap::Parser>::parse();
    let effort = if args.quick { Effort::QUICK } else { Effort::FULL };
    let effort = args.seeds.map_or(effort, |seeds| effort.with_seeds(seeds as usize));
    let work = Work::new(effort, args.seed)?;
    let asked = PARTS.iter().filter(|(part, _)| args.only.is_empty() || args.only.contains(part));
    let sections = asked.map(|(_, run)| run(&work)).collect::<anyhow::Result<Vec<Section>>>()?;
    work.end();
    let path = document::write(&args.out, &head(&args), &sections)?;
    let goals = || sections.iter().flat_map(|s| &s.goals);
    for goal in goals().filter(|g| !g.passed) {
        println!("missed: {}: {}", goal.asked, goal.found);
    }
    println!("{} of {} goals met: {}", goals().filter(|g| g.passed).count(), goals().count(), path.display());
    Ok(())
}

fn head(args: &Args) -> String {
    let mut command = "carved-validate".to_owned();
    if args.quick {
        command += " --quick";
    }
    if let Some(seeds) = args.seeds {
        command += &format!(" --seeds {seeds}");
    }
    if args.seed != 0 {
        command += &format!(" --seed {}", args.seed);
    }
    for part in &args.only {
        command += &format!(" --only {}", format!("{part:?}").to_lowercase());
    }
    format!(
        "# Validation\n\nWritten by `{command}`.\n**Everything here is a simulation**: no number was measured on an instrument.\n\
         The same command gives the same numbers, to the last digit.\n\n\
         The tables compare two estimators. *Voxels* is the paper's (voxels x SD^3, Heron's formula over the faired surface,\n\
         epsilon 0.05). *Support* is carved's own (a support function per slice of the capillary). The true value for larvae is\n\
         the ideal visual hull. For finless larvae this is the body. The paper is Guo, Veneman, Spaink and Verbeek, Biomed. Opt.\n\
         Express 8(5), 2611 (2017). Its numbers come from real beads and larvae, ours do not.\n\n"
    )
}
