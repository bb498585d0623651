//! `carved reference show`: reference larvae as a table.

use crate::config::references;
use carved_core::measure::references::{Group, Moments, References};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The references to print [default: the paper's, which are built in].
    file: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<()> {
    let all = match &args.file {
        Some(file) => vec![references::load(file)?],
        None => references::embedded()?.to_vec(),
    };
    say!("{}", all.iter().map(table).collect::<Vec<_>>().join("\n").trim_end());
    Ok(())
}

const HEADINGS: [&str; 9] = ["dpf", "larvae", "n", "ASD", "SD um", "epsilon", "estimator", "volume um^3", "area um^2"];

/// Headings behind them, where a group has eyes.
const OF_EYES: [&str; 2] = ["eye um^3", "eyes apart um"];

/// One line per group, with columns as wide as their contents, followed by what is missing.
pub fn table(references: &References) -> String {
    let has_eyes = references.groups.iter().any(|g| g.eye_volume_um3.is_some() || g.eye_distance_um.is_some());
    let shown = HEADINGS.len() + if has_eyes { OF_EYES.len() } else { 0 };
    let mut rows: Vec<Vec<String>> = vec![HEADINGS.iter().chain(&OF_EYES).take(shown).map(|&name| name.to_owned()).collect()];
    rows.extend(references.groups.iter().map(|group| row(group).into_iter().take(shown).collect()));
    let widths: Vec<usize> = (0..shown).map(|at| rows.iter().map(|r| r[at].chars().count()).max().unwrap_or(0)).collect();
    let mut text = format!("{}\n", references.name);
    for row in rows {
        let cells: Vec<_> = row.iter().zip(&widths).map(|(cell, width)| format!("{cell:<width$}", width = *width)).collect();
        text += &format!("  {}\n", cells.join("  ").trim_end());
    }
    for gap in &references.gaps {
        let age = gap.dpf.map_or_else(String::new, |dpf| format!(" of {dpf} dpf"));
        text += &format!("  missing: {}{age}: {}\n", gap.quantity, gap.why);
    }
    text
}

fn row(g: &Group) -> [String; 11] {
    let words = [&g.treatment, &g.strain, &g.cohort];
    let mut larvae = words.iter().filter_map(|w| w.as_deref()).collect::<Vec<_>>().join(" ");
    if g.simulated {
        larvae += " (simulated)";
    }
    let known = |x: Option<String>| x.unwrap_or_else(|| "-".into());
    let moments = |m: Option<Moments>| known(m.map(|m| format!("{:.3e} +- {:.2e}", m.mean, m.sd)));
    [
        g.dpf.to_string(),
        larvae.trim().to_owned(),
        g.n.to_string(),
        known(g.asd.map(|x| x.to_string())),
        known(g.voxel_um.map(|x| x.to_string())),
        known(g.epsilon.map(|x| x.to_string())),
        g.estimator.clone(),
        moments(g.volume_um3),
        moments(g.area_um2),
        moments(g.eye_volume_um3),
        moments(g.eye_distance_um),
    ]
}
