//! The files of a recording, wherever they are: in a folder, or in one file for an archive.
//!
//! ```text
//! runs/RUN/A01/recording.json  frames/...  SHA256SUMS       a folder
//! runs/RUN/A01.tar  =  A01/recording.json  A01/frames/...   the same files, byte for byte, one after the other
//! ```
//! The archive is a plain tar: the hashes of `SHA256SUMS` and of the ledger hold for what is in it, `tar -xf` makes the folder again, and a
//! file is read at its place without unpacking the others. It is not compressed, because frames are PNG. An OME-Zarr archive (`.ozx`) would
//! hold the pixels in another form, which these hashes do not prove, and would need the recording's other files beside it.

use super::{StoreError, attempts, sums};
use carved_records::{is_well, sha256_hex};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Cursor, Read, Seek};
use std::os::unix::fs::FileExt;
use std::path::{Component, Path, PathBuf};
use std::time::UNIX_EPOCH;

const ENDING: &str = "tar";

/// Where the files of a recording are.
#[derive(Debug)]
pub enum RecordingFiles {
    /// In this folder.
    Folder(PathBuf),
    /// In one file.
    Pack(Pack),
}

impl RecordingFiles {
    /// The files of a recording. `path` is its folder, its `recording.json`, its pack, or the folder that its pack stands for.
    ///
    /// # Errors
    /// A pack that cannot be read.
    pub fn of(path: &Path) -> Result<Self, StoreError> {
        if path.extension().is_some_and(|e| e == ENDING) && path.is_file() {
            return Pack::open(path).map(Self::Pack);
        }
        let folder = if path.is_file() { super::durable::folder_of(path).to_owned() } else { path.to_owned() };
        let pack = pack_of(&folder);
        // Results of a replay may lie in a folder beside the pack.
        if !folder.join(super::RECORDING).exists() && pack.is_file() {
            return Pack::open(&pack).map(Self::Pack);
        }
        Ok(Self::Folder(folder))
    }

    /// The recording's folder, which a pack stands for.
    pub fn folder(&self) -> PathBuf {
        match self {
            Self::Folder(folder) => folder.clone(),
            Self::Pack(pack) => pack.path.with_extension(""),
        }
    }

    /// Where a file is, for a message. In a pack: the path that it would have in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder().join(name)
    }

    /// Whether there is a file of this name.
    pub fn has(&self, name: &str) -> bool {
        match self {
            Self::Folder(folder) => folder.join(name).is_file(),
            Self::Pack(pack) => pack.members.contains_key(Path::new(name)),
        }
    }

    /// The bytes of a file. `None` if it is not there. No link below the folder is followed.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let folder = match self {
            Self::Pack(pack) => return pack.read(Path::new(name)),
            Self::Folder(folder) => folder,
        };
        match carved_files::read_below(folder, Path::new(name)) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(StoreError::io("read", &folder.join(name))(e)),
        }
    }

    /// The bytes of a file that must be there.
    ///
    /// # Errors
    /// It is not there, or cannot be read.
    pub fn require(&self, name: &str) -> Result<Vec<u8>, StoreError> {
        let missing = || StoreError::io("read", &self.path(name))(std::io::ErrorKind::NotFound.into());
        self.read(name)?.ok_or_else(missing)
    }

    /// Names and hashes of the checksums. `None` if there are none, as in an interrupted recording.
    ///
    /// # Errors
    /// They cannot be read.
    pub fn sums(&self) -> Result<Option<Vec<(String, String)>>, StoreError> {
        Ok(self.read(sums::FILE)?.map(|text| sums::parse(&String::from_utf8_lossy(&text))))
    }

    /// The bytes of a file, verified against the checksums, if there are any. `None` if it is not there.
    ///
    /// # Errors
    /// It cannot be read, was altered, or is not in the checksums.
    pub fn verified(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        let Some(bytes) = self.read(name)? else { return Ok(None) };
        if let Some(all) = self.sums()? {
            let listed = all.into_iter().find(|(listed, _)| listed == name);
            let unlisted = || StoreError::Format {
                path: self.path(sums::FILE),
                expected: "a line for every file of the recording",
                found: format!("none for {name}"),
            };
            let (_, expected) = listed.ok_or_else(unlisted)?;
            sums::same(&self.path(name), &expected, &sha256_hex(&bytes))?;
        }
        Ok(Some(bytes))
    }
}

/// The pack that a recording's folder may have.
pub fn pack_of(folder: &Path) -> PathBuf {
    let mut name = folder.as_os_str().to_owned();
    name.push(".");
    name.push(ENDING);
    name.into()
}

/// The recording that a file of a run belongs to: the first part of its name, if it is in the folder of a well or of an attempt.
pub fn recording_of(name: &Path) -> Option<&str> {
    let mut parts = name.components();
    let Some(Component::Normal(first)) = parts.next() else { return None };
    let first = first.to_str()?;
    (parts.next().is_some() && is_well(attempts::well_of(first))).then_some(first)
}

/// The recording whose files this file of a run holds, if it is a pack.
pub fn packed_in(name: &Path) -> Option<&str> {
    let recording = name.to_str()?.strip_suffix(ENDING)?.strip_suffix('.')?;
    is_well(attempts::well_of(recording)).then_some(recording)
}

#[derive(Debug)]
enum Source {
    File(File),
    Bytes(Vec<u8>),
}

/// A recording in one file.
#[derive(Debug)]
pub struct Pack {
    path: PathBuf,
    source: Source,
    /// Place and length of each file, by its name in the recording's folder.
    members: BTreeMap<PathBuf, (u64, u64)>,
}

impl Pack {
    /// Opens a pack and lists its files.
    ///
    /// # Errors
    /// It cannot be read, is cut short, or has something else than files of one recording.
    pub fn open(path: &Path) -> Result<Self, StoreError> {
        let io = || StoreError::io("read", path);
        let file = carved_files::open(path).map_err(io())?;
        let length = file.metadata().map_err(io())?.len();
        let members = members(path, &file, length)?;
        Ok(Self { path: path.to_owned(), source: Source::File(file), members })
    }

    /// A pack that was read from elsewhere. `path` names it in messages.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub(super) fn of_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self, StoreError> {
        let members = members(path, Cursor::new(&bytes), bytes.len() as u64)?;
        Ok(Self { path: path.to_owned(), source: Source::Bytes(bytes), members })
    }

    /// Where the pack is.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Names of the files.
    pub fn names(&self) -> impl Iterator<Item = &Path> {
        self.members.keys().map(PathBuf::as_path)
    }

    /// The bytes of a file. `None` if it is not there.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn read(&self, name: &Path) -> Result<Option<Vec<u8>>, StoreError> {
        let Some(&(start, size)) = self.members.get(name) else { return Ok(None) };
        let mut bytes = vec![0; size as usize];
        let read = match &self.source {
            Source::File(file) => file.read_exact_at(&mut bytes, start),
            Source::Bytes(all) => (&all[start as usize..]).read_exact(&mut bytes),
        };
        read.map_err(StoreError::io("read", &self.path))?;
        Ok(Some(bytes))
    }
}

/// Place and length of each file of a pack of `length` bytes.
fn members(path: &Path, reader: impl Read + Seek, length: u64) -> Result<BTreeMap<PathBuf, (u64, u64)>, StoreError> {
    let io = || StoreError::io("read", path);
    let wrong = |found: String| StoreError::Format { path: path.to_owned(), expected: "a tar of the files of one recording", found };
    let folder = path.file_stem().unwrap_or_default().to_owned();
    let mut tar = tar::Archive::new(reader);
    let mut members = BTreeMap::new();
    for entry in tar.entries_with_seek().map_err(io())? {
        let entry = entry.map_err(|e| wrong(e.to_string()))?;
        let kind = entry.header().entry_type();
        if kind.is_dir() {
            continue;
        }
        let whole = entry.path().map_err(|e| wrong(e.to_string()))?.into_owned();
        if !kind.is_file() {
            return Err(wrong(format!("{} is no regular file", whole.display())));
        }
        let name = whole.strip_prefix(&folder).ok().filter(|name| is_below(name)).map(Path::to_owned);
        let name = name.ok_or_else(|| wrong(format!("{}, which is not in the folder {}", whole.display(), folder.display())))?;
        let (start, size) = (entry.raw_file_position(), entry.size());
        if start.checked_add(size).is_none_or(|end| end > length) {
            return Err(wrong(format!("{length} bytes, of which {} needs those up to {}", whole.display(), start.saturating_add(size))));
        }
        members.insert(name, (start, size));
    }
    if members.is_empty() {
        return Err(wrong("no file".into()));
    }
    Ok(members)
}

/// The bytes of a pack of these files of a run, which belong to the recording `folder`: its names in the run, with their hashes.
///
/// # Errors
/// A file cannot be read, or is not what its hash says.
pub fn pack<'a>(run: &Path, files: impl Iterator<Item = (&'a PathBuf, &'a String)>) -> Result<Vec<u8>, StoreError> {
    let mut tar = tar::Builder::new(Vec::new());
    for (name, expected) in files {
        let path = run.join(name);
        let io = |what| StoreError::io(what, &path);
        let bytes = carved_files::read_below(run, name).map_err(io("read"))?;
        sums::same(&path, expected, &sha256_hex(&bytes))?;
        let changed = path.metadata().and_then(|found| found.modified()).map_err(io("look at"))?;
        let changed_s = changed.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let mut header = super::run_files::header(bytes.len() as u64, changed_s);
        tar.append_data(&mut header, name, bytes.as_slice()).map_err(io("pack"))?;
    }
    tar.into_inner().map_err(StoreError::io("pack", run))
}

/// Whether a file name stays inside its folder.
pub(super) fn is_below(name: &Path) -> bool {
    name.components().all(|part| matches!(part, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn no_link_below_a_recording_is_followed() {
        let dir = tempfile::tempdir().unwrap();
        let [own, other] = ["A01", "elsewhere"].map(|name| dir.path().join(name));
        for folder in [&own, &other] {
            std::fs::create_dir(folder).unwrap();
        }
        std::fs::write(other.join("000.png"), "pixels").unwrap();
        symlink(&other, own.join("frames")).unwrap();
        symlink(other.join("000.png"), own.join("first.png")).unwrap();
        let files = RecordingFiles::of(&own).unwrap();
        for name in ["frames/000.png", "first.png"] {
            let error = files.read(name).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains("a link"), "{error}");
        }
        assert_eq!(files.read("nothing.png").unwrap(), None);
        assert_eq!(RecordingFiles::of(&other).unwrap().read("000.png").unwrap(), Some(b"pixels".to_vec()));
    }
}
