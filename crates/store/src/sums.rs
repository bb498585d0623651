//! `SHA256SUMS` files in the format of `sha256sum -c`.

use super::{StoreError, durable, is_own_folder};
use carved_files::Tree;
use carved_records::sha256_hex;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub const FILE: &str = "SHA256SUMS";

/// Whether an interrupted write leaves a file of this name.
pub fn is_part(name: &Path) -> bool {
    name.extension().is_some_and(|e| e == "part")
}

/// Names of the files of the folder, also of those in folders below it; `SHA256SUMS` of the folder itself is left out.
///
/// # Errors
/// A folder cannot be listed, or has something else than regular files and folders.
pub fn names(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let tree = Tree::of(folder).and_then(Tree::regular).map_err(StoreError::io("list", folder))?;
    Ok(listed(tree))
}

fn listed(tree: Tree) -> Vec<PathBuf> {
    let mut names = tree.files;
    names.retain(|name| name != Path::new(FILE) && !is_part(name));
    names
}

/// SHA-256 of every file of the folder, by its name in it.
///
/// # Errors
/// As [`names`], and a file that cannot be read.
pub fn of_folder(folder: &Path) -> Result<BTreeMap<PathBuf, String>, StoreError> {
    hashed(folder, names(folder)?)
}

/// The same of a recording that is being closed. A link or a pipe that somebody has put into it has no hash, and holds up no run.
///
/// # Errors
/// As [`of_folder`].
pub fn of_recording(folder: &Path) -> Result<BTreeMap<PathBuf, String>, StoreError> {
    let tree = Tree::of(folder).map_err(StoreError::io("list", folder))?;
    for name in tree.others() {
        tracing::warn!(folder = %folder.display(), name = %name.display(), "neither a file nor a folder: it is left out of the checksums");
    }
    hashed(folder, listed(tree))
}

fn hashed(folder: &Path, names: Vec<PathBuf>) -> Result<BTreeMap<PathBuf, String>, StoreError> {
    let hash = |name: PathBuf| {
        let bytes = carved_files::read_below(folder, &name).map_err(StoreError::io("read", &folder.join(&name)))?;
        Ok((name, sha256_hex(&bytes)))
    };
    names.into_iter().map(hash).collect()
}

/// Writes the checksums of a recording that has none, because it was not closed.
///
/// # Errors
/// A file cannot be read, or the checksums cannot be written.
pub fn seal(folder: &Path) -> Result<(), StoreError> {
    let sums = folder.join(FILE);
    if !is_own_folder(folder) || sums.exists() {
        return Ok(());
    }
    durable::write(&sums, text(&of_recording(folder)?).as_bytes())
}

/// One line per file, as `sha256sum` writes it.
pub fn text(sums: &BTreeMap<PathBuf, String>) -> String {
    sums.iter().map(|(name, hash)| format!("{hash}  {}\n", name.display())).collect()
}

/// The names and hashes of a `SHA256SUMS`.
pub fn read(sums: &Path) -> Result<Vec<(String, String)>, StoreError> {
    Ok(parse(&carved_files::read_to_string(sums).map_err(StoreError::io("read", sums))?))
}

/// The names and hashes of the text of a `SHA256SUMS`.
pub fn parse(text: &str) -> Vec<(String, String)> {
    text.lines().filter_map(|l| l.split_once("  ")).map(|(hash, name)| (name.to_owned(), hash.to_owned())).collect()
}

/// The recorded hash of a file. `None` if the folder has no checksums, as in an interrupted recording.
pub fn expected(folder: &Path, name: &str) -> Result<Option<String>, StoreError> {
    let sums = folder.join(FILE);
    if !sums.exists() {
        return Ok(None);
    }
    match read(&sums)?.into_iter().find(|(n, _)| n == name) {
        Some((_, hash)) => Ok(Some(hash)),
        None => {
            Err(StoreError::Format { path: sums, expected: "a line for every file of the recording", found: format!("none for {name}") })
        }
    }
}

/// Verifies one file against the checksums of its folder, if there are any.
pub fn check_one(folder: &Path, name: &str) -> Result<(), StoreError> {
    let Some(expected) = expected(folder, name)? else { return Ok(()) };
    let path = folder.join(name);
    let bytes = carved_files::read(&path).map_err(StoreError::io("read", &path))?;
    same(&path, &expected, &sha256_hex(&bytes))
}

/// Returns an error unless both hashes are equal.
pub fn same(path: &Path, expected: &str, found: &str) -> Result<(), StoreError> {
    if found == expected {
        return Ok(());
    }
    Err(StoreError::Altered { path: path.to_owned(), expected: expected.to_owned(), found: found.to_owned() })
}
