//! What `--dry-run` prints.
//!
//! ```text
//!  run      carved-data/runs/P-017, new
//!  names    P-017/2021.10.11_5dpf_tail_W_A02_1_1_rot.tiff: well A02, fish 1, view 1, 5 dpf, date 2021.10.11
//!  angles   --even, sense 1: 12 views, 0.00 to 330.00 deg
//!  A02      12 pictures, larva, 5 dpf
//!  A03      11 pictures, larva, 5 dpf; missing: view 7
//! ```

use super::plan::Plan;
use super::sort::{Labelled, Plate, WellPictures, first_of};
use crate::cli::import::frames;
use crate::cli::with_causes;
use carved_records::{PlannedWell, SpecimenKind};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

pub(super) fn print(out: &Path, example: Option<&Labelled>, plate: &Plate, plan: &Plan) -> anyhow::Result<()> {
    say!("run      {}, new", out.display());
    if let Some((path, label)) = example {
        let fish = label.fish.map_or_else(|| "no fish".into(), |fish| format!("fish {fish}"));
        let dpf = label.dpf.map(|dpf| format!(", {dpf} dpf")).unwrap_or_default();
        let well = label.well.as_deref().unwrap_or("no well");
        say!("names    {}: well {well}, {fish}, view {}{dpf}; {}", path.display(), label.view, label.group);
    }
    let (first, last) = (plan.omega_deg.first().unwrap_or(&0.0), plan.omega_deg.last().unwrap_or(&0.0));
    let closure = if plan.closure { ", the last repeats the first" } else { "" };
    say!("angles   {}: {} views, {first:.2} to {last:.2} deg{closure}", plan.angles_from, plan.views.len());
    let mut wrong = 0;
    for planned in &plan.run.plate_map {
        let (line, is_whole) = well(planned, plate.wells.get(&planned.well), plan);
        wrong += usize::from(!is_whole);
        say!("{:<8} {line}", planned.well);
    }
    say!("{} wells, {wrong} of them not whole; nothing was written", plan.run.plate_map.len());
    Ok(())
}

/// The line of a well, and whether all its pictures are there once and can be opened.
fn well(planned: &PlannedWell, pictures: Option<&WellPictures>, plan: &Plan) -> (String, bool) {
    let Some(pictures) = pictures else { return ("no picture; it will be skipped".into(), false) };
    let paths: Vec<&PathBuf> = pictures.views.values().flatten().collect();
    let specimen = if planned.specimen == SpecimenKind::Bead { "bead" } else { "larva" };
    let age = planned.dpf.map(|dpf| format!(", {dpf} dpf")).unwrap_or_default();
    let mut said = vec![format!("{} pictures, {specimen}{age}", paths.len())];
    let missing = pictures.missing(&plan.views);
    if !missing.is_empty() {
        said.push(format!("missing: view {}", first_of(&missing)));
    }
    let ordered = pictures.in_order(&plan.views);
    let turn = ordered.as_ref().map(|views| plan.turn(&views.iter().map(|(view, _)| *view).collect::<Vec<_>>()));
    match turn {
        Err(error) => said.push(format!("will fail: {}", with_causes(error))),
        Ok(Err(error)) => said.push(format!("will fail: {}", with_causes(&error))),
        Ok(Ok(_)) => {}
    }
    let unread: Vec<String> = paths
        .iter()
        .filter_map(|path| frames::size(path).err().map(|e| format!("{}: {}", frames::file_name(path), with_causes(&e))))
        .collect();
    if !unread.is_empty() {
        said.push(format!("will fail: {}", first_of(&unread)));
    }
    let sizes: BTreeSet<(u32, u32)> = paths.iter().filter_map(|path| frames::size(path).ok()).collect();
    if sizes.len() > 1 {
        let sizes: Vec<String> = sizes.iter().map(|(width, height)| format!("{width} x {height} px")).collect();
        said.push(format!("will fail: pictures of {}", first_of(&sizes)));
    }
    let is_whole = said.len() == 1;
    (said.join("; "), is_whole)
}
