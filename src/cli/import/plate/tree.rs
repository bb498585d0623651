//! All pictures below the named folders.

use super::sort::{Labelled, first_of};
use crate::cli::import::natural::natural;
use anyhow::{Context, bail, ensure};
use carved_records::picture_name::{self, Pattern, is_picture};
use std::path::{Path, PathBuf};

/// A plate is a folder of wells, perhaps with one folder per fish, perhaps in a folder of plates.
const DEEPEST: usize = 5;

/// What was found.
pub(super) struct Tree {
    pub labelled: Vec<Labelled>,
    /// Pictures whose names do not say what they are.
    pub others: Vec<PathBuf>,
}

impl Tree {
    pub fn others_named(&self) -> String {
        first_of(&self.others.iter().map(|p| p.display().to_string()).collect::<Vec<_>>())
    }
}

/// The pictures, each with what its name says.
pub(super) fn read(named: &[PathBuf], pattern: Option<&Pattern>) -> anyhow::Result<Tree> {
    let mut found: Vec<(PathBuf, PathBuf)> = Vec::new();
    for root in named {
        if root.is_dir() {
            let first = found.len();
            below(root, Path::new(""), DEEPEST, &mut found)?;
            // Of several folders, each one's name says which wells or which plate it has.
            if let (true, Some(name)) = (named.len() > 1, root.file_name()) {
                found[first..].iter_mut().for_each(|(_, within)| *within = Path::new(name).join(&within));
            }
        } else {
            ensure!(root.is_file(), "{}: found no such file, expected folders of pictures, or their files", root.display());
            found.push((root.clone(), root.clone()));
        }
    }
    found.sort_by(|(a, _), (b, _)| natural(&a.to_string_lossy(), &b.to_string_lossy()));
    found.dedup_by(|(a, _), (b, _)| a == b);
    let mut tree = Tree { labelled: Vec::new(), others: Vec::new() };
    for (path, within) in found {
        match picture_name::read(&within, pattern) {
            Some(label) => tree.labelled.push((path, label)),
            None => tree.others.push(path),
        }
    }
    if tree.labelled.is_empty() {
        let of = named.iter().map(|p| p.display().to_string()).collect::<Vec<_>>().join(", ");
        let unplaced = tree.others.iter().filter(|path| without_well(path).is_some()).count();
        ensure!(
            unplaced == 0 || pattern.is_some(),
            "{of}: the names of {unplaced} pictures say fish and view, but no well: {}. Put the pictures of each well into a folder that is named \
             after it, as A02/VAST_1_4.tiff, and name the folder above it. Pictures of one specimen are imported without --plate",
            tree.others_named()
        );
        let expected = if pattern.is_some() {
            "--pattern fits none of them. It must name every part of a name up to the extension, as in {date}_{age}dpf_{_}_W_{well}_{fish}_{view}"
        } else {
            "expected names as W_A02_1_4.tiff (well, fish, view), or A02/VAST_1_4.tiff; give a --pattern for other names"
        };
        match tree.others.len() {
            0 => bail!("{of}: found no picture; {expected}"),
            n => bail!("{of}: found {n} pictures and no name that is understood, as {}; {expected}", tree.others_named()),
        }
    }
    Ok(tree)
}

/// The fish of a name as `VAST_1_4.tiff`, which says fish and view and no well.
pub(super) fn without_well(path: &Path) -> Option<u32> {
    let name = path.file_stem()?.to_str()?;
    let [word, fish, view, ..] = name.split('_').collect::<Vec<_>>()[..] else { return None };
    view.parse::<u32>().ok()?;
    word.eq_ignore_ascii_case("vast").then(|| fish.parse().ok())?
}

/// Pictures below a folder with their paths below the root. Names that begin with a dot are left out.
fn below(root: &Path, within: &Path, deeper: usize, found: &mut Vec<(PathBuf, PathBuf)>) -> anyhow::Result<()> {
    let folder = root.join(within);
    let place = || format!("{}: cannot be read as a folder", folder.display());
    for entry in std::fs::read_dir(&folder).with_context(place)? {
        let entry = entry.with_context(place)?;
        let name = within.join(entry.file_name());
        // A link to a folder could lead around in a circle, so it is not followed.
        if entry.file_type().with_context(place)?.is_dir() {
            if entry.file_name().to_string_lossy().starts_with('.') {
                continue;
            }
            ensure!(
                deeper > 0,
                "{}: found more than {DEEPEST} folders in one another, expected those of one plate",
                root.join(&name).display()
            );
            below(root, &name, deeper - 1, found)?;
        } else if is_picture(&name) {
            found.push((root.join(&name), name));
        }
    }
    Ok(())
}
