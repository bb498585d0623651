//! The pictures of a plate, sorted into wells and views.
//!
//! ```text
//!  labels ── one plate? ── one fish per well ── wells ── views ──┬─ usual: those of most wells, or --views
//!                                                                └─ per well: missing, double, unknown
//! ```

use crate::cli::import::frames;
use anyhow::{bail, ensure};
use carved_records::picture_name::{Group, Label};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

/// The pictures of one well.
#[derive(Debug, Clone, PartialEq, Default)]
pub(in crate::cli) struct WellPictures {
    /// Age in the names, days post fertilisation.
    pub dpf: Option<f64>,
    /// The pictures of each view. More than one is a mistake.
    pub views: BTreeMap<u32, Vec<PathBuf>>,
}

/// A plate as the names describe it.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::cli) struct Plate {
    pub wells: BTreeMap<String, WellPictures>,
    /// What the operator should know.
    pub warnings: Vec<String>,
}

/// One picture and what its name says.
pub(in crate::cli) type Labelled = (PathBuf, Label);

const MOST_NAMED: usize = 5;

/// The first of a list, and how many more there are.
pub(super) fn first_of<T: ToString>(all: &[T]) -> String {
    let more = all.len().saturating_sub(MOST_NAMED);
    let first = all.iter().take(MOST_NAMED).map(ToString::to_string).collect::<Vec<_>>().join(", ");
    if more == 0 { first } else { format!("{first} and {more} more") }
}

/// Sorts the pictures. `fish`: the one of each well that is meant, where wells have several.
pub(in crate::cli) fn sort(labelled: Vec<Labelled>, fish: Option<u32>) -> anyhow::Result<Plate> {
    let without: Vec<String> = labelled.iter().filter(|(_, l)| l.well.is_none()).map(|(path, _)| path.display().to_string()).collect();
    ensure!(
        without.is_empty(),
        "{} pictures name no well, neither in their name nor in that of a folder: {}; expected one of A01 to AF48. Give a --pattern with {{well}}, \
         or put the pictures of each well into a folder named after it",
        without.len(),
        first_of(&without)
    );
    let mut warnings = check_one_plate(&labelled)?;
    let labelled = of_one_fish(labelled, fish, &mut warnings)?;
    let mut wells: BTreeMap<String, WellPictures> = BTreeMap::new();
    for (path, label) in labelled {
        let Some(name) = label.well else { continue };
        let well = wells.entry(name.clone()).or_default();
        if let (Some(known), Some(dpf)) = (well.dpf, label.dpf)
            && known.total_cmp(&dpf).is_ne()
        {
            bail!("well {name}: names say {known} dpf and {dpf} dpf, expected one age; is this one plate?");
        }
        well.dpf = well.dpf.or(label.dpf);
        well.views.entry(label.view).or_default().push(path);
    }
    Ok(Plate { wells, warnings })
}

/// Refuses pictures of two plates, and names what may be two.
fn check_one_plate(labelled: &[Labelled]) -> anyhow::Result<Vec<String>> {
    let way_out = "Import each plate with its own folder, or with a --pattern that has its date or name as text";
    let plates: BTreeSet<&String> = labelled.iter().filter_map(|(_, l)| l.group.plate.as_ref()).collect();
    if plates.len() > 1 {
        let plates: Vec<_> = plates.into_iter().collect();
        bail!("the names say {} plates, {}; expected one. {way_out}", plates.len(), first_of(&plates));
    }
    let mut seen: BTreeMap<(&Option<String>, u32, u32), &Group> = BTreeMap::new();
    for (path, label) in labelled {
        let key = (&label.well, label.fish.unwrap_or(1), label.view);
        if let Some(other) = seen.insert(key, &label.group)
            && *other != label.group
        {
            bail!(
                "{}: well {}, view {} is in {other} and in {}: this looks like two plates. {way_out}",
                path.display(),
                label.well.as_deref().unwrap_or_default(),
                label.view,
                label.group
            );
        }
    }
    let mut groups: Vec<&Group> = labelled.iter().map(|(_, l)| &l.group).collect();
    groups.sort();
    groups.dedup();
    Ok(match &groups[..] {
        [] | [_] => Vec::new(),
        many => vec![format!("the pictures are in {} groups: {}. They are taken for one plate", many.len(), {
            let named: Vec<String> = many.iter().map(|g| format!("({g})")).collect();
            first_of(&named)
        })],
    })
}

/// The numbers of all fish.
pub(super) fn all_fish(labelled: &[Labelled]) -> BTreeSet<u32> {
    labelled.iter().map(|(_, label)| label.fish.unwrap_or(1)).collect()
}

/// A run has one specimen per well.
fn of_one_fish(labelled: Vec<Labelled>, fish: Option<u32>, warnings: &mut Vec<String>) -> anyhow::Result<Vec<Labelled>> {
    let mut of_well: BTreeMap<String, BTreeSet<u32>> = BTreeMap::new();
    for (_, label) in &labelled {
        of_well.entry(label.well.clone().unwrap_or_default()).or_default().insert(label.fish.unwrap_or(1));
    }
    let numbers = |fish: &BTreeSet<u32>| fish.iter().map(u32::to_string).collect::<Vec<_>>().join(", ");
    let Some(fish) = fish else {
        let several: Vec<String> =
            of_well.iter().filter(|(_, f)| f.len() > 1).map(|(well, f)| format!("{well} has fish {}", numbers(f))).collect();
        ensure!(
            several.is_empty(),
            "{} of {} wells have several fish, a run has one specimen per well: {}. --fish all imports each into a run of its own, \
             --fish 1 only the first",
            several.len(),
            of_well.len(),
            first_of(&several)
        );
        return Ok(labelled);
    };
    let without: Vec<String> =
        of_well.iter().filter(|(_, f)| !f.contains(&fish)).map(|(well, f)| format!("{well} has fish {}", numbers(f))).collect();
    ensure!(without.len() < of_well.len(), "--fish {fish}: no well has it: {}", first_of(&without));
    if !without.is_empty() {
        warnings.push(format!("--fish {fish}: {} of {} wells do not have it: {}", without.len(), of_well.len(), first_of(&without)));
    }
    Ok(labelled.into_iter().filter(|(_, label)| label.fish.unwrap_or(1) == fish).collect())
}

impl Plate {
    /// The numbers of the views in the order of the turn. With `views` they are so many, from 0 or 1 on.
    pub fn views(&self, views: Option<u32>) -> anyhow::Result<Vec<u32>> {
        let first = u32::from(self.wells.values().all(|w| !w.views.contains_key(&0)));
        if let Some(views) = views {
            return Ok((first..first + views).collect());
        }
        let mut sets: BTreeMap<Vec<u32>, usize> = BTreeMap::new();
        for well in self.wells.values() {
            *sets.entry(well.views.keys().copied().collect()).or_default() += 1;
        }
        // Of two sets of as many wells, the larger: a view is missing more often than there is one too many.
        let usual = sets.into_iter().max_by_key(|(views, wells)| (*wells, views.len())).map(|(views, _)| views).unwrap_or_default();
        let steps: BTreeSet<u32> = usual.windows(2).map(|w| w[1] - w[0]).collect();
        ensure!(
            steps.len() < 2,
            "most wells have the views {}, which leave gaps; say with --views how many views a whole turn has",
            first_of(&usual)
        );
        if let (Some(step), Some(last)) = (steps.first(), usual.last()) {
            // A name may hold the largest number.
            let next = last.saturating_add(*step);
            let longer: Vec<&String> =
                self.wells.iter().filter(|(_, w)| next > *last && w.views.contains_key(&next)).map(|(name, _)| name).collect();
            ensure!(
                longer.is_empty(),
                "most wells have {} views, to view {last}, and {} has view {}, too; say with --views how many views a whole turn has",
                usual.len(),
                first_of(&longer),
                next
            );
        }
        Ok(usual)
    }
}

impl WellPictures {
    /// One picture per view, in the order of the views.
    ///
    /// # Errors
    /// Views that are double, or that the plate does not have.
    pub fn in_order(&self, expected: &[u32]) -> anyhow::Result<Vec<(u32, PathBuf)>> {
        let double = self.double();
        ensure!(double.is_empty(), "found {}; expected one picture per view: leave the wrong ones out", double.join("; "));
        let unknown: Vec<u32> = self.views.keys().copied().filter(|view| !expected.contains(view)).collect();
        ensure!(
            unknown.is_empty(),
            "found view {}, expected the {} views {} of this plate; is it a picture of another specimen? --views says how many there are",
            first_of(&unknown),
            expected.len(),
            first_of(expected)
        );
        Ok(expected.iter().filter_map(|view| Some((*view, self.views.get(view)?.first()?.clone()))).collect())
    }

    pub fn missing(&self, expected: &[u32]) -> Vec<u32> {
        expected.iter().copied().filter(|view| !self.views.contains_key(view)).collect()
    }

    fn double(&self) -> Vec<String> {
        let names = |paths: &[PathBuf]| paths.iter().map(|p| frames::file_name(p)).collect::<Vec<_>>().join(", ");
        self.views
            .iter()
            .filter(|(_, p)| p.len() > 1)
            .map(|(view, p)| format!("{} pictures of view {view}, {}", p.len(), names(p)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::picture_name::read;
    use std::path::Path;

    fn labelled(paths: &[&str]) -> Vec<Labelled> {
        paths.iter().map(|p| (PathBuf::from(p), read(Path::new(p), None).unwrap())).collect()
    }

    fn plate(paths: &[&str]) -> Plate {
        sort(labelled(paths), None).unwrap()
    }

    #[test]
    fn the_views_of_most_wells_are_the_plates() {
        let all = plate(&[
            "A01_1.png",
            "A01_2.png",
            "A01_3.png",
            "A02_1.png",
            "A02_2.png",
            "A02_3.png",
            "A02_9.png",
            "A03_1.png",
            "A03_2.png",
            "A03_3.png",
        ]);
        let views = all.views(None).unwrap();
        assert_eq!(views, [1, 2, 3]);
        let said = all.wells["A02"].in_order(&views).unwrap_err().to_string();
        assert!(said.contains("found view 9, expected the 3 views 1, 2, 3"), "{said}");
        assert_eq!(all.views(Some(4)).unwrap(), [1, 2, 3, 4]);
        assert_eq!(all.wells["A01"].missing(&[1, 2, 3, 4]), [4]);
        // As many wells have one set as the other: the larger one.
        assert_eq!(plate(&["A01_0.png", "A01_1.png", "A01_2.png", "A02_0.png", "A02_1.png"]).views(None).unwrap(), [0, 1, 2]);
        assert_eq!(plate(&["A01_1.png", "A01_4.png", "A01_7.png", "A01_10.png"]).views(None).unwrap(), [1, 4, 7, 10]);
        let said = plate(&["A01_1.png", "A01_2.png", "A02_1.png", "A02_2.png", "A03_1.png", "A03_2.png", "A03_3.png"]);
        let said = said.views(None).unwrap_err().to_string();
        assert!(said.contains("2 views, to view 2, and A03 has view 3"), "{said}");
        let said = plate(&["A01_1.png", "A01_2.png", "A01_7.png"]).views(None).unwrap_err().to_string();
        assert!(said.contains("1, 2, 7, which leave gaps"), "{said}");
    }

    #[test]
    fn double_views_are_named() {
        let all = plate(&["W_A01_1_1.tiff", "W_A01_1_1_rot.tiff", "W_A01_1_2.tiff"]);
        let said = all.wells["A01"].in_order(&[1, 2]).unwrap_err().to_string();
        assert!(said.contains("2 pictures of view 1, W_A01_1_1.tiff, W_A01_1_1_rot.tiff"), "{said}");
    }

    #[test]
    fn two_plates_are_refused() {
        for paths in [["P1/A01_1.png", "P2/A01_1.png"], ["2021.10.11_W_A01_1_1.tiff", "2021.10.12_W_A01_1_1.tiff"]] {
            let said = sort(labelled(&paths), None).unwrap_err().to_string();
            assert!(said.contains("well A01, view 1") && said.contains("two plates"), "{said}");
        }
        let apart = plate(&["2021.10.11_W_A01_1_1.tiff", "2021.10.12_W_A02_1_1.tiff"]);
        assert!(apart.warnings[0].contains("2 groups"), "{:?}", apart.warnings);
        let said = sort(labelled(&["3dpf_W_A01_1_1.tiff", "5dpf_W_A01_1_2.tiff"]), None).unwrap_err().to_string();
        assert!(said.contains("3 dpf and 5 dpf"), "{said}");
    }

    #[test]
    fn several_fish_need_a_choice() {
        let paths = ["W_A01_1_1.tiff", "W_A01_2_1.tiff", "W_A02_7_1.tiff"];
        let said = sort(labelled(&paths), None).unwrap_err().to_string();
        assert!(said.contains("1 of 2 wells have several fish") && said.contains("A01 has fish 1, 2"), "{said}");
        let second = sort(labelled(&paths), Some(2)).unwrap();
        assert_eq!(second.wells.keys().collect::<Vec<_>>(), ["A01"]);
        assert!(second.warnings[0].contains("A02 has fish 7"), "{:?}", second.warnings);
        assert!(sort(labelled(&paths), Some(3)).unwrap_err().to_string().contains("--fish 3: no well has it"));
    }
}
