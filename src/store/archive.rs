//! Runs that are kept elsewhere too: copied with every hash held against the copy, and pruned only when the copy is still good.
//!
//! ```text
//! archive: runs/RUN ── each file ──> DIR/RUN, written and synced ── read again, hashed ──> receipt in both
//! prune:   receipt ── every file of the copy hashed again ── what lies here is what was copied ──> frames (or all) removed
//! ```

use super::index;
use super::{RunRecord, Software, StoreError, disk, durable, run, schema, sums};
use crate::hash::sha256_hex;
use nix::fcntl::{PosixFadviseAdvice, posix_fadvise};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

const SCHEMA: &str = "carved.archive/1";

/// Receipts in the run's folder; one of them in the copy's.
const RECEIPTS: &str = "archives";
const RECEIPT: &str = "archive.json";

/// What was copied, and where to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Receipt {
    pub schema: String,
    pub software: Software,
    pub run: String,
    /// RFC 3339, UTC.
    pub archived: String,
    /// The copy's folder.
    pub destination: PathBuf,
    pub bytes: u64,
    /// SHA-256 by name in the folder.
    pub files: BTreeMap<PathBuf, String>,
}

/// What a prune takes away.
#[derive(Debug)]
pub struct Pruned {
    pub run: String,
    pub files: usize,
    pub bytes: u64,
    /// Where it can be had.
    pub archived: PathBuf,
    /// Why the index does not know of it yet, where it does not.
    pub index: Option<StoreError>,
}

/// A run that has ended: nobody writes in its folder any more.
fn ended(folder: &Path) -> Result<RunRecord, StoreError> {
    let record = RunRecord::read(&folder.join(run::FILE))?;
    if record.outcome.is_none() { Err(StoreError::Unended { path: folder.to_owned() }) } else { Ok(record) }
}

/// Files of a run with their hashes, receipts left out.
fn contents(folder: &Path) -> Result<BTreeMap<PathBuf, String>, StoreError> {
    let mut files = sums::of_folder(folder)?;
    files.retain(|name, _| !name.starts_with(RECEIPTS));
    Ok(files)
}

/// Holds a run against the sums that its recordings were closed with.
fn unaltered(folder: &Path, files: &BTreeMap<PathBuf, String>) -> Result<(), StoreError> {
    for list in files.keys().filter(|name| name.file_name().is_some_and(|n| n == sums::FILE)) {
        let at = list.parent().unwrap_or(Path::new(""));
        for (name, expected) in sums::read(&folder.join(list))? {
            let name = at.join(name);
            let path = folder.join(&name);
            match files.get(&name) {
                Some(found) => sums::same(&path, &expected, found)?,
                None => return Err(StoreError::Vanished { path }),
            }
        }
    }
    Ok(())
}

/// The hash of a file as the disk has it, not as memory does.
fn hash_on_disk(path: &Path) -> Result<String, StoreError> {
    let io = |what| StoreError::io(what, path);
    let mut file = File::open(path).map_err(io("open"))?;
    posix_fadvise(&file, 0, 0, PosixFadviseAdvice::POSIX_FADV_DONTNEED).map_err(|e| io("read")(e.into()))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(io("read"))?;
    Ok(sha256_hex(&bytes))
}

impl Receipt {
    /// Reads the whole copy again.
    ///
    /// # Errors
    /// The first file that is not there or not what was copied.
    pub fn verify(&self) -> Result<(), StoreError> {
        for (name, expected) in &self.files {
            let path = self.destination.join(name);
            sums::same(&path, expected, &hash_on_disk(&path)?)?;
        }
        Ok(())
    }
}

/// Copies a run that has ended to `to/RUN` and leaves a receipt in both, once every file of the copy was read again. A copy that was
/// cut short is finished.
///
/// # Errors
/// A run under way; files that are not what was recorded; other files at the destination; a copy that reads back otherwise.
pub fn archive(folder: &Path, to: &Path) -> Result<Receipt, StoreError> {
    let record = ended(folder)?;
    durable::create_folder(to)?;
    let whole = |path: &Path| path.canonicalize().map_err(StoreError::io("find", path));
    let (from, destination) = (whole(folder)?, whole(to)?.join(&record.id));
    if destination.starts_with(&from) || from.starts_with(&destination) {
        let found = from.display().to_string();
        return Err(StoreError::Format { path: destination, expected: "a folder apart from the run's own", found });
    }
    let files = contents(&from)?;
    unaltered(&from, &files)?;
    let mut total = 0;
    for (name, expected) in &files {
        let (path, copy) = (from.join(name), destination.join(name));
        let bytes = std::fs::read(&path).map_err(StoreError::io("read", &path))?;
        sums::same(&path, expected, &sha256_hex(&bytes))?;
        total += bytes.len() as u64;
        if !copy.exists() {
            durable::create_folder(durable::folder_of(&copy))?;
            durable::write(&copy, &bytes)?;
        } else if hash_on_disk(&copy)? != *expected {
            return Err(StoreError::Exists { path: copy });
        }
    }
    let now = jiff::Timestamp::now();
    let receipt = Receipt {
        schema: SCHEMA.into(),
        software: Software::this(),
        run: record.id,
        archived: now.to_string(),
        destination: destination.clone(),
        bytes: total,
        files,
    };
    receipt.verify()?;
    durable::write_json(&destination.join(RECEIPT), &receipt)?;
    durable::create_folder(&from.join(RECEIPTS))?;
    durable::write_json(&from.join(RECEIPTS).join(format!("{}.json", now.as_microsecond())), &receipt)?;
    Ok(receipt)
}

/// The receipts of a run, newest first.
fn receipts(folder: &Path) -> Result<Vec<Receipt>, StoreError> {
    let of = folder.join(RECEIPTS);
    let Ok(entries) = std::fs::read_dir(&of) else { return Ok(Vec::new()) };
    let mut found: Vec<Receipt> = entries.flatten().map(|e| schema::read(&e.path(), SCHEMA)).collect::<Result<_, _>>()?;
    found.sort_by(|a, b| b.archived.cmp(&a.archived));
    Ok(found)
}

/// Why a raw frame, `name` in a recording's folder, is not there: it was pruned, where a receipt of its run has it.
pub(super) fn gone(recording: &Path, name: &str) -> StoreError {
    let path = recording.join(name);
    let copied = || {
        let whole = recording.canonicalize().ok()?;
        let well = Path::new(whole.file_name()?);
        // Receipts that cannot be read tell nothing.
        let receipt = receipts(whole.parent()?).ok()?.into_iter().find(|receipt| receipt.files.contains_key(&well.join(name)))?;
        let copy = receipt.destination.join(well);
        Some(StoreError::ArchivedFrame { path: path.clone(), is_there: copy.join(name).is_file(), copy, archived: receipt.archived })
    };
    copied().unwrap_or(StoreError::MissingFrame { path })
}

/// Whether a prune without `all` takes it: raw frames, of which nothing is looked up.
fn is_raw(name: &Path) -> bool {
    let mut parts = name.components().skip(1).map(std::path::Component::as_os_str);
    parts.next().is_some_and(|part| part == "frames" || part == "second") && parts.next().is_some()
}

/// Takes the raw frames of a run, or the whole of it, out of the data folder, where a copy that was read again just now has every
/// byte of them. Without `really` it only says what it would take.
///
/// # Errors
/// A run under way, without a receipt, whose copy is not what the receipt says, or with files that are not in the copy.
pub fn prune(root: &Path, id: &str, all: bool, really: bool) -> Result<Pruned, StoreError> {
    let folder = root.join("runs").join(id);
    ended(&folder)?;
    let mut taken = contents(&folder)?;
    taken.retain(|name, _| all || is_raw(name));
    let mut why = "it was never archived (carved archive RUN --to DIR)".to_owned();
    let mut good = None;
    for receipt in receipts(&folder)? {
        let missing = taken.iter().find(|(name, hash)| receipt.files.get(*name) != Some(hash));
        match (missing, receipt.verify()) {
            (_, Err(error)) => why = format!("its copy is not good: {error}"),
            (Some((name, _)), _) => why = format!("{} is not in its copy as it is here; archive it again", name.display()),
            (None, Ok(())) => {
                good = Some(receipt);
                break;
            }
        }
    }
    let Some(receipt) = good else { return Err(StoreError::Unarchived { path: folder, why }) };
    let bytes = taken.keys().filter_map(|name| folder.join(name).metadata().ok()).map(|m| m.len()).sum();
    if really {
        if all {
            // Renamed first: half a run must not look like one.
            let gone = root.join("runs").join(format!(".{id}.pruned"));
            durable::rename(&folder, &gone)?;
            std::fs::remove_dir_all(&gone).map_err(StoreError::io("remove", &gone))?;
        } else {
            for name in taken.keys() {
                let path = folder.join(name);
                disk::remove(&path).map_err(StoreError::io("remove", &path))?;
            }
        }
    }
    let index = if really { index::follow_prune(root, id).err() } else { None };
    Ok(Pruned { run: id.to_owned(), files: taken.len(), bytes, archived: receipt.destination, index })
}

/// Runs of a data folder, by name.
///
/// # Errors
/// A folder that cannot be listed.
pub fn run_names(root: &Path) -> Result<Vec<String>, StoreError> {
    index::run_names(root)
}
