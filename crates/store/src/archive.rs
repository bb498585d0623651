//! Archives and prunes runs. Each file of a copy is verified by its hash. A run is pruned only while its copy is still good.
//!
//! ```text
//! archive: runs/RUN ── each file ──> DIR/RUN, written and synced ── read again, hashed ──> receipt in both
//!          packed: the files of A01 ──> DIR/RUN/A01.tar (see `pack`)
//!          s3://BUCKET/PREFIX instead of DIR: each object written, read again, hashed ──> receipt in both
//! prune:   receipt ── each file of the copy is a separate file, hashed again ── the run equals its copy ──> frames removed
//!          --all: runs/RUN ── renamed ──> runs/.RUN.pruned ── all but the receipts removed ── receipts and folder removed
//! ```
//! A crash during `--all` leaves `.RUN.pruned`. A start of the daemon reports it. The next prune verifies the copy again and removes the
//! rest.

use super::index;
use super::lines::EVENTS;
use super::objects::{self, Objects, Reach};
use super::pack::{self, Pack, RecordingFiles};
use super::receipt::{RECEIPT, RECEIPTS, Receipt, SCHEMA, receipts};
use super::{RunClaim, RunRecord, Software, StoreError, disk, durable, is_own_folder, run, sums};
use carved_files::Tree;
use carved_records::{is_plain_name, sha256_hex};
use nix::fcntl::{PosixFadviseAdvice, posix_fadvise};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The files that a remark about a well changes after the end of its run.
const REMARKED: [&str; 2] = [run::FILE, EVENTS];

/// The metadata that make a run's folder an RO-Crate. They list single files, so a packed copy does not have them.
pub const CRATE: &str = "ro-crate-metadata.json";

/// How a copy keeps the files of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    /// As they are.
    Files,
    /// All in one tar.
    PerWell,
}

/// The result of a prune.
#[derive(Debug)]
pub struct Pruned {
    pub run: String,
    pub files: usize,
    pub bytes: u64,
    /// The folder or address of the copy. `None` if no file was left to remove.
    pub archived: Option<PathBuf>,
    /// Why the index was not updated. `None` if it was.
    pub index: Option<StoreError>,
}

/// Reads the record of a run that has ended. Nobody writes to its folder any more.
fn ended(folder: &Path) -> Result<RunRecord, StoreError> {
    let record = RunRecord::read(&folder.join(run::FILE))?;
    if record.outcome.is_none() { Err(StoreError::Unended { path: folder.to_owned() }) } else { Ok(record) }
}

/// All that is in a run's folder, which nobody has put links, pipes or devices into.
fn tree_of(folder: &Path) -> Result<Tree, StoreError> {
    Tree::of(folder).and_then(Tree::regular).map_err(StoreError::io("list", folder))
}

/// The files of a run with their hashes, without the receipts.
fn contents(folder: &Path) -> Result<BTreeMap<PathBuf, String>, StoreError> {
    let mut files = sums::of_folder(folder)?;
    files.retain(|name, _| !name.starts_with(RECEIPTS));
    Ok(files)
}

/// Compares a run with the checksums of its recordings. Returns the files that they list and that are not there.
fn compared(folder: &Path, files: &BTreeMap<PathBuf, String>) -> Result<Vec<PathBuf>, StoreError> {
    let mut missing = Vec::new();
    for list in files.keys().filter(|name| name.file_name().is_some_and(|n| n == sums::FILE)) {
        let at = list.parent().unwrap_or(Path::new(""));
        for (name, expected) in sums::read(&folder.join(list))? {
            let name = at.join(name);
            match files.get(&name) {
                Some(found) => sums::same(&folder.join(&name), &expected, found)?,
                None => missing.push(name),
            }
        }
    }
    Ok(missing)
}

/// Verifies a run against the checksums of its recordings.
fn unaltered(folder: &Path, files: &BTreeMap<PathBuf, String>) -> Result<(), StoreError> {
    match compared(folder, files)?.first() {
        Some(name) => Err(StoreError::Vanished { path: folder.join(name) }),
        None => Ok(()),
    }
}

/// The files of a run that are there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunContents {
    /// SHA-256 of each file, by its name in the run's folder. The receipts of copies are not among them, because a copy has others.
    pub files: BTreeMap<PathBuf, String>,
    /// Files that the checksums of a recording list, that are not there, and that no receipt of a copy has.
    pub missing: Vec<PathBuf>,
}

impl RunContents {
    /// Hashes the files of a run or of its copy, also those inside of packs, and compares them with the checksums of their recordings.
    ///
    /// # Errors
    /// A file cannot be read, or was altered.
    pub fn of(folder: &Path) -> Result<Self, StoreError> {
        let mut files = contents(folder)?;
        files.remove(Path::new(RECEIPT));
        let mut missing = compared(folder, &files)?;
        for name in files.keys() {
            let Some(recording) = pack::packed_in(name) else { continue };
            let packed = RecordingFiles::of(&folder.join(name))?;
            for (name, expected) in packed.sums()?.unwrap_or_default() {
                match packed.read(&name)? {
                    Some(bytes) => sums::same(&packed.path(&name), &expected, &sha256_hex(&bytes))?,
                    None => missing.push(Path::new(recording).join(name)),
                }
            }
        }
        if !missing.is_empty() {
            let receipts = receipts(folder)?;
            missing.retain(|name| !receipts.iter().any(|receipt| receipt.files.contains_key(name)));
        }
        Ok(Self { files, missing })
    }
}

/// The hash of a file as read from the disk, not from the page cache.
fn hash_on_disk(path: &Path) -> Result<String, StoreError> {
    let io = |what| StoreError::io(what, path);
    let mut file = carved_files::open(path).map_err(io("open"))?;
    posix_fadvise(&file, 0, 0, PosixFadviseAdvice::POSIX_FADV_DONTNEED).map_err(|e| io("read")(e.into()))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(io("read"))?;
    Ok(sha256_hex(&bytes))
}

/// All files and folders of a run by device and inode. These are the same for every path to a file: through a link, a mount or `..`.
struct Own {
    folder: PathBuf,
    ids: BTreeSet<(u64, u64)>,
}

/// Device and inode of the target of a path.
fn id(path: &Path) -> Result<(u64, u64), StoreError> {
    std::fs::metadata(path).map(|m| (m.dev(), m.ino())).map_err(StoreError::io("look at", path))
}

impl Own {
    fn of(folder: &Path) -> Result<Self, StoreError> {
        let tree = tree_of(folder)?;
        let all = tree.folders.iter().chain(&tree.files).map(|name| id(&folder.join(name)));
        Ok(Self { folder: folder.to_owned(), ids: std::iter::once(id(folder)).chain(all).collect::<Result<_, _>>()? })
    }

    /// Checks that a path does not lead into the run's folder or to one of its files. Checks the existing part of the path.
    fn check_apart(&self, path: &Path) -> Result<(), StoreError> {
        let mut there = path;
        while !there.exists() {
            there = durable::folder_of(there);
        }
        let whole = there.canonicalize().map_err(StoreError::io("find", there))?;
        for above in whole.ancestors() {
            if self.ids.contains(&id(above)?) {
                return Err(StoreError::NoCopy { path: path.to_owned(), run: self.folder.clone() });
            }
        }
        Ok(())
    }
}

impl Receipt {
    /// The receipt of a copy that is to be made of a run whose files are as they were recorded.
    fn new(from: &Path, record: RunRecord, destination: PathBuf, packing: Packing) -> Result<Self, StoreError> {
        let mut files = contents(from)?;
        unaltered(from, &files)?;
        if packing == Packing::PerWell {
            files.remove(Path::new(CRATE));
        }
        let packed = match packing {
            Packing::Files => BTreeSet::new(),
            Packing::PerWell => files.keys().filter_map(|name| pack::recording_of(name)).map(str::to_owned).collect(),
        };
        let (archived, bytes) = (jiff::Timestamp::now().to_string(), bytes_of(from, &files));
        Ok(Self { schema: SCHEMA.into(), software: Software::this(), run: record.id, archived, destination, bytes, files, packed })
    }

    /// Writes the receipt into the run's folder.
    fn keep_in(&self, run: &Path) -> Result<(), StoreError> {
        durable::create_folder(&run.join(RECEIPTS))?;
        durable::write_json(&run.join(RECEIPTS).join(format!("{}.json", jiff::Timestamp::now().as_microsecond())), self)
    }

    /// Reads the whole copy again. Each file must exist, must not be the run's own file, and must have its recorded hash.
    ///
    /// # Errors
    /// The first file that fails.
    fn verify(&self, own: &Own, reach: Reach) -> Result<(), StoreError> {
        if let Some(address) = self.address() {
            let objects = reach(address)?;
            return self.each_object(address, |object, verify| {
                verify(objects.get(object)?.ok_or_else(|| StoreError::Vanished { path: object.into() })?)
            });
        }
        for recording in &self.packed {
            let path = pack::pack_of(&self.destination.join(recording));
            own.check_apart(&path)?;
            self.verify_pack(recording, &path)?;
        }
        for (name, expected) in self.files.iter().filter(|(name, _)| !self.is_packed(name)) {
            let path = self.destination.join(name);
            let found = hash_on_disk(&path)?;
            own.check_apart(&path)?;
            sums::same(&path, expected, &found)?;
        }
        Ok(())
    }

    /// Writes the files that the copy does not have yet.
    fn copy(&self, from: &Path, own: &Own) -> Result<(), StoreError> {
        durable::create_folder(&self.destination)?;
        for recording in &self.packed {
            let copy = pack::pack_of(&self.destination.join(recording));
            if copy.exists() {
                own.check_apart(&copy)?;
                self.verify_pack(recording, &copy).map_err(|error| match error {
                    StoreError::Altered { .. } | StoreError::Vanished { .. } | StoreError::Format { .. } => {
                        StoreError::Exists { path: copy }
                    }
                    error => error,
                })?;
            } else {
                let files = self.files.iter().filter(|(name, _)| pack::recording_of(name) == Some(recording.as_str()));
                durable::write(&copy, &pack::pack(from, files)?)?;
            }
        }
        for (name, expected) in self.files.iter().filter(|(name, _)| !self.is_packed(name)) {
            let (path, copy) = (from.join(name), self.destination.join(name));
            if copy.exists() {
                own.check_apart(&copy)?;
                let found = hash_on_disk(&copy)?;
                if found == *expected {
                    continue;
                }
                if !self.is_from_before_a_remark(from, name, &found)? {
                    return Err(StoreError::Exists { path: copy });
                }
            }
            let bytes = carved_files::read_below(from, name).map_err(StoreError::io("read", &path))?;
            sums::same(&path, expected, &sha256_hex(&bytes))?;
            durable::create_folder(durable::folder_of(&copy))?;
            durable::write(&copy, &bytes)?;
        }
        Ok(())
    }

    /// Whether the copy has a file as an earlier receipt says, and a remark about a well has changed it in the run since.
    fn is_from_before_a_remark(&self, from: &Path, name: &Path, found: &str) -> Result<bool, StoreError> {
        let is_of_this_copy =
            |earlier: &Receipt| earlier.destination == self.destination && earlier.files.get(name).is_some_and(|h| h == found);
        let is_changed = REMARKED.iter().any(|file| name == Path::new(file)) && self.files.get(name).is_some_and(|now| now != found);
        Ok(is_changed && receipts(from)?.iter().any(is_of_this_copy))
    }

    /// Calls `with` for each object of a copy: with its address, and with what verifies its bytes.
    fn each_object(
        &self,
        address: &str,
        mut with: impl FnMut(&str, &dyn Fn(Vec<u8>) -> Result<(), StoreError>) -> Result<(), StoreError>,
    ) -> Result<(), StoreError> {
        for recording in &self.packed {
            let object = pack::pack_of(Path::new(&format!("{address}/{recording}"))).display().to_string();
            with(&object, &|bytes| self.verify_files(recording, &Pack::of_bytes(Path::new(&object), bytes)?))?;
        }
        for (name, expected) in self.files.iter().filter(|(name, _)| !self.is_packed(name)) {
            let object = format!("{address}/{}", name.display());
            with(&object, &|bytes| sums::same(Path::new(&object), expected, &sha256_hex(&bytes)))?;
        }
        Ok(())
    }

    /// The bytes of an object of the copy, from the run's folder.
    fn object_of(&self, from: &Path, address: &str, object: &str) -> Result<Vec<u8>, StoreError> {
        let name = Path::new(object.strip_prefix(address).unwrap_or(object).trim_start_matches('/'));
        if let Some(expected) = self.files.get(name) {
            let path = from.join(name);
            let bytes = carved_files::read_below(from, name).map_err(StoreError::io("read", &path))?;
            return sums::same(&path, expected, &sha256_hex(&bytes)).map(|()| bytes);
        }
        let recording = name.file_stem().and_then(|stem| stem.to_str());
        pack::pack(from, self.files.iter().filter(|(name, _)| pack::recording_of(name) == recording))
    }

    /// Whether such a copy never has this file.
    fn leaves_out(&self, name: &Path) -> bool {
        !self.packed.is_empty() && name == Path::new(CRATE)
    }

    /// Reads a pack again: it must have every file of the recording, with its hash.
    fn verify_pack(&self, recording: &str, path: &Path) -> Result<(), StoreError> {
        let file = carved_files::open(path).map_err(StoreError::io("open", path))?;
        posix_fadvise(&file, 0, 0, PosixFadviseAdvice::POSIX_FADV_DONTNEED).map_err(|e| StoreError::io("read", path)(e.into()))?;
        self.verify_files(recording, &Pack::open(path)?)
    }

    fn verify_files(&self, recording: &str, pack: &Pack) -> Result<(), StoreError> {
        for (name, expected) in self.files.iter().filter(|(name, _)| pack::recording_of(name) == Some(recording)) {
            let inside = pack.path().with_extension("").join(name.strip_prefix(recording).unwrap_or(name));
            match pack.read(name.strip_prefix(recording).unwrap_or(name))? {
                Some(bytes) => sums::same(&inside, expected, &sha256_hex(&bytes))?,
                None => return Err(StoreError::Vanished { path: inside }),
            }
        }
        Ok(())
    }
}

/// Copies a run that has ended to `to/RUN`, its recordings as they are or packed. Verifies every file of the copy, then writes a receipt in
/// both folders. Completes an interrupted copy, and replaces what a remark about a well has changed since an earlier copy to the same place.
///
/// # Errors
/// The run has not ended, its files are altered, the destination has other files, or the copy reads back differently.
pub fn archive(folder: &Path, to: &Path, packing: Packing) -> Result<Receipt, StoreError> {
    let record = ended(folder)?;
    let from = whole(folder)?;
    let _claim = RunClaim::shared(&from)?;
    let own = Own::of(&from)?;
    // Check this first: no folder may be created inside the run.
    own.check_apart(&to.join(&record.id))?;
    durable::create_folder(to)?;
    let destination = whole(to)?.join(&record.id);
    if from.starts_with(&destination) {
        return Err(StoreError::NoCopy { path: destination, run: from });
    }
    let receipt = Receipt::new(&from, record, destination, packing)?;
    receipt.copy(&from, &own)?;
    receipt.verify(&own, &|address| Err(StoreError::Exists { path: address.into() }))?;
    durable::write_json(&receipt.destination.join(RECEIPT), &receipt)?;
    receipt.keep_in(&from)?;
    Ok(receipt)
}

/// As [`archive`], to `to/RUN` in an object store. `to` is an address such as `s3://BUCKET/PREFIX`. Each object is read back.
///
/// # Errors
/// As [`archive`], and what the object store says.
pub fn archive_to_objects(folder: &Path, to: &str, packing: Packing, objects: &dyn Objects) -> Result<Receipt, StoreError> {
    let record = ended(folder)?;
    let from = whole(folder)?;
    let _claim = RunClaim::shared(&from)?;
    let address = format!("{}/{}", to.trim_end_matches('/'), record.id);
    let receipt = Receipt::new(&from, record, address.clone().into(), packing)?;
    receipt.each_object(&address, |object, verify| {
        let name = Path::new(object.strip_prefix(&address).unwrap_or(object).trim_start_matches('/'));
        let may_replace = |found: &[u8]| receipt.is_from_before_a_remark(&from, name, &sha256_hex(found));
        objects::keep(objects, object, || receipt.object_of(&from, &address, object), verify, may_replace)
    })?;
    objects.put(&format!("{address}/{RECEIPT}"), durable::json_text(Path::new(RECEIPT), &receipt)?)?;
    receipt.keep_in(&from)?;
    Ok(receipt)
}

fn whole(path: &Path) -> Result<PathBuf, StoreError> {
    path.canonicalize().map_err(StoreError::io("find", path))
}

/// Whether a prune without `all` removes this file. These are the raw frames, which no lookup needs.
fn is_raw(name: &Path) -> bool {
    let mut parts = name.components().skip(1).map(std::path::Component::as_os_str);
    parts.next().is_some_and(|part| part == "frames" || part == "second") && parts.next().is_some()
}

/// The newest receipt whose copy contains all files in `taken`. The copy is read again now.
fn good_copy(folder: &Path, id: &str, taken: &BTreeMap<PathBuf, String>, reach: Reach) -> Result<Receipt, StoreError> {
    let path = || folder.to_owned();
    let mut why = None;
    for receipt in receipts(folder)? {
        if receipt.run != id {
            why = Some(format!("a receipt in it is of the run {:?}", receipt.run));
            continue;
        }
        // If there is nothing to remove, the copy does not have to be reachable.
        if taken.is_empty() {
            return Ok(receipt);
        }
        if let Some((name, _)) = taken.iter().find(|(name, hash)| receipt.files.get(*name) != Some(hash) && !receipt.leaves_out(name)) {
            why = Some(format!("{} is not in its copy as it is here; archive it again", name.display()));
            continue;
        }
        match Own::of(folder).and_then(|own| receipt.verify(&own, reach)) {
            Ok(()) => return Ok(receipt),
            Err(error) => why = Some(format!("its copy is not good: {error}")),
        }
    }
    Err(why.map_or_else(|| StoreError::NeverArchived { path: path() }, |why| StoreError::NoGoodCopy { path: path(), why }))
}

/// All files of a run, by what tells that one was changed.
#[derive(PartialEq, Eq)]
struct Stamps(BTreeMap<PathBuf, (u64, u64, u64, i64, i64)>);

impl Stamps {
    fn of(folder: &Path) -> Result<Self, StoreError> {
        let stamp = |name: PathBuf| {
            let path = folder.join(&name);
            let found = path.symlink_metadata().map_err(StoreError::io("look at", &path))?;
            Ok((name, (found.dev(), found.ino(), found.len(), found.mtime_nsec() + found.mtime() * 1_000_000_000, found.ctime())))
        };
        tree_of(folder)?.files.into_iter().map(stamp).collect::<Result<_, _>>().map(Self)
    }

    /// Checks that the folder, which may have another name now, has these files and no others.
    fn are_of(&self, folder: &Path) -> Result<(), StoreError> {
        let Self(now) = Self::of(folder)?;
        let changed = self.0.iter().find(|(name, stamp)| now.get(*name) != Some(stamp)).map(|(name, _)| name);
        match changed.or_else(|| now.keys().find(|name| !self.0.contains_key(*name))) {
            Some(name) => Err(StoreError::NoGoodCopy {
                path: folder.to_owned(),
                why: format!("{} was added or changed while the copy was read. Archive the run again, then prune it", name.display()),
            }),
            None => Ok(()),
        }
    }
}

/// Removes the raw frames of a run, or the whole run, from the data folder. The copy is read again first and must contain every removed
/// file. Meanwhile nobody else of carved adds files to the run, and what another program adds or changes stops the removal. Without
/// `really` nothing is removed. `reach` opens the object store of a copy that is in one.
///
/// # Errors
/// The run has not ended, has no receipt, its copy differs from the receipt, the copy lacks a file, or somebody works on the run.
pub fn prune(root: &Path, id: &str, all: bool, really: bool, reach: Reach) -> Result<Pruned, StoreError> {
    let folder = root.join("runs").join(id);
    if folder.exists() && !is_own_folder(&folder) {
        return Err(StoreError::NoGoodCopy { path: folder, why: "it is a link, and what it leads to is not of this data folder".into() });
    }
    let _claim = RunClaim::alone(&folder)?;
    ended(&folder)?;
    let seen = Stamps::of(&folder)?;
    let mut taken = contents(&folder)?;
    taken.retain(|name, _| all || is_raw(name));
    let receipt = good_copy(&folder, id, &taken, reach)?;
    let bytes = bytes_of(&folder, &taken);
    if really {
        seen.are_of(&folder)?;
        if all {
            // Rename first, so that a partly removed run does not look like a run.
            let gone = left(root, id);
            durable::rename(&folder, &gone)?;
            if let Err(error) = seen.are_of(&gone) {
                durable::rename(&gone, &folder)?;
                return Err(error);
            }
            remove(&gone, &taken)?;
        } else {
            for name in taken.keys() {
                let path = folder.join(name);
                disk::remove(&path).map_err(StoreError::io("remove", &path))?;
            }
        }
    }
    Ok(pruned(root, id, &taken, bytes, Some(receipt), really))
}

fn bytes_of(folder: &Path, files: &BTreeMap<PathBuf, String>) -> u64 {
    files.keys().filter_map(|name| folder.join(name).metadata().ok()).map(|m| m.len()).sum()
}

fn pruned(root: &Path, id: &str, taken: &BTreeMap<PathBuf, String>, bytes: u64, receipt: Option<Receipt>, really: bool) -> Pruned {
    let index = if really { index::follow_run(root, id).err() } else { None };
    Pruned { run: id.to_owned(), files: taken.len(), bytes, archived: receipt.map(|r| r.destination), index }
}

/// The name of a run while it is removed.
fn left(root: &Path, id: &str) -> PathBuf {
    root.join("runs").join(format!(".{id}.pruned"))
}

/// Removes a renamed run: the files `taken`, what interrupted writes have left, and the receipts. These go last, so that they say where the
/// copy is until all files are removed. Another file stops it.
fn remove(gone: &Path, taken: &BTreeMap<PathBuf, String>) -> Result<(), StoreError> {
    let mut tree = tree_of(gone)?;
    let is_receipt = |name: &Path| name.parent() == Some(Path::new(RECEIPTS)) && name.extension().is_some_and(|e| e == "json");
    let is_known = |name: &Path| taken.contains_key(name) || is_receipt(name) || sums::is_part(name) || name == Path::new(sums::FILE);
    if let Some(name) = tree.files.iter().find(|name| !is_known(name)) {
        let why = format!("{} is in no copy. Take it out of the run, then repeat the prune", name.display());
        return Err(StoreError::NoGoodCopy { path: gone.to_owned(), why });
    }
    let gone_with = |name: &Path, removed: std::io::Result<()>| removed.map_err(StoreError::io("remove", &gone.join(name)));
    // Folders from the inside to the outside.
    tree.folders.reverse();
    for receipts in [false, true] {
        let part = |name: &&PathBuf| name.starts_with(RECEIPTS) == receipts;
        for name in tree.files.iter().filter(part) {
            gone_with(name, disk::remove(&gone.join(name)))?;
        }
        for name in tree.folders.iter().filter(part) {
            gone_with(name, std::fs::remove_dir(gone.join(name)))?;
        }
        durable::sync_folder(gone)?;
    }
    std::fs::remove_dir(gone).map_err(StoreError::io("remove", gone))?;
    durable::sync_folder(durable::folder_of(gone))
}

/// Names of the runs of which an interrupted prune has left files.
///
/// # Errors
/// The folder cannot be listed.
pub fn cut_short(root: &Path) -> Result<Vec<String>, StoreError> {
    let runs = root.join("runs");
    let mut found = Vec::new();
    for entry in std::fs::read_dir(&runs).map_err(StoreError::io("list", &runs))? {
        let entry = entry.map_err(StoreError::io("list", &runs))?;
        let name = entry.file_name().into_string().unwrap_or_default();
        let run = name.strip_prefix('.').and_then(|name| name.strip_suffix(".pruned")).filter(|run| is_plain_name(run));
        found.extend(run.filter(|_| is_own_folder(&entry.path())).map(str::to_owned));
    }
    found.sort();
    Ok(found)
}

/// Completes an interrupted prune, if the copy of the remaining files is still good.
///
/// # Errors
/// The copy is not good, or lacks a file.
pub fn end_prune(root: &Path, id: &str, really: bool, reach: Reach) -> Result<Pruned, StoreError> {
    let gone = left(root, id);
    let _claim = RunClaim::alone(&gone)?;
    let seen = Stamps::of(&gone)?;
    let taken = contents(&gone)?;
    // Without receipts the rest is empty, because receipts are removed last.
    let receipt = if taken.is_empty() { None } else { Some(good_copy(&gone, id, &taken, reach)?) };
    let bytes = bytes_of(&gone, &taken);
    if really {
        seen.are_of(&gone)?;
        remove(&gone, &taken)?;
    }
    Ok(pruned(root, id, &taken, bytes, receipt, really))
}

/// Names of the runs of a data folder.
///
/// # Errors
/// The folder cannot be listed.
pub fn run_names(root: &Path) -> Result<Vec<String>, StoreError> {
    index::run_names(root)
}
