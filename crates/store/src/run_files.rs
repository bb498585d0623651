//! All files of a run in one stream, for a download.
//!
//! ```text
//!  runs/RUN/* ── sorted by name ──> tar: RUN/run.json, RUN/A01/..., and RUN/SHA256SUMS last
//!                    └── hashed while it is read; a file with a recorded hash keeps that one
//! ```
//! Memory does not grow with the run: each file is copied through a small buffer. `sha256sum -c SHA256SUMS` in the unpacked folder shows
//! every file that is not what was recorded.

use super::{RunRecord, StoreError, run, sums};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// The files of a run that has ended.
#[derive(Debug)]
pub struct RunFiles {
    folder: PathBuf,
    run: String,
    /// By name in the folder, with the recorded SHA-256 if there is one.
    files: BTreeMap<PathBuf, Option<String>>,
}

impl RunFiles {
    /// Lists the files of a run's folder.
    ///
    /// # Errors
    /// A run under way, and a folder that cannot be read.
    pub(super) fn of(folder: &Path) -> Result<Self, StoreError> {
        let record = RunRecord::read(&folder.join(run::FILE))?;
        if record.outcome.is_none() {
            return Err(StoreError::Unended { path: folder.to_owned() });
        }
        let mut files: BTreeMap<PathBuf, Option<String>> = sums::names(folder)?.into_iter().map(|name| (name, None)).collect();
        let lists: Vec<PathBuf> = files.keys().filter(|name| name.ends_with(sums::FILE)).cloned().collect();
        for list in lists {
            let at = list.parent().unwrap_or(Path::new("")).to_owned();
            for (name, hash) in sums::read(&folder.join(&list))? {
                if let Some(recorded) = files.get_mut(&at.join(name)) {
                    *recorded = Some(hash);
                }
            }
        }
        Ok(Self { folder: folder.to_owned(), run: record.id, files })
    }

    /// Writes the files as a tar archive, in a folder with the name of the run.
    ///
    /// # Errors
    /// A file that cannot be read or that changes its size, and errors of the writer. The archive is then cut short.
    pub fn write_tar(&self, out: &mut impl Write) -> Result<(), StoreError> {
        let mut tar = tar::Builder::new(out);
        let mut list = BTreeMap::new();
        for (name, recorded) in &self.files {
            let hash = self.append(&mut tar, name)?;
            list.insert(name.clone(), recorded.clone().unwrap_or(hash));
        }
        let text = sums::text(&list);
        let mut header = header(text.len() as u64, jiff::Timestamp::now().as_second() as u64);
        let name = Path::new(&self.run).join(sums::FILE);
        let sent = tar.append_data(&mut header, name, text.as_bytes()).and_then(|()| tar.finish());
        sent.map_err(StoreError::io("send", &self.folder))
    }

    /// Appends one file and returns its SHA-256.
    fn append<W: Write>(&self, tar: &mut tar::Builder<W>, name: &Path) -> Result<String, StoreError> {
        let path = self.folder.join(name);
        let io = |what| StoreError::io(what, &path);
        let file = carved_files::open_below(&self.folder, name).map_err(io("open"))?;
        let found = file.metadata().map_err(io("look at"))?;
        let changed = found.modified().ok().and_then(|time| time.duration_since(UNIX_EPOCH).ok());
        let mut header = header(found.len(), changed.map_or(0, |since| since.as_secs()));
        let mut reader = Hashed { inner: file.take(found.len()), hash: Sha256::new(), bytes: 0 };
        tar.append_data(&mut header, Path::new(&self.run).join(name), &mut reader).map_err(io("send"))?;
        if reader.bytes != found.len() {
            let why = format!("{} bytes were read of {}", reader.bytes, found.len());
            return Err(io("send")(io::Error::new(io::ErrorKind::UnexpectedEof, why)));
        }
        Ok(reader.hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

pub(super) fn header(bytes: u64, changed_s: u64) -> tar::Header {
    let mut header = tar::Header::new_gnu();
    header.set_size(bytes);
    header.set_mode(0o644);
    header.set_mtime(changed_s);
    header
}

/// A reader that hashes what passes.
struct Hashed<R> {
    inner: R,
    hash: Sha256,
    bytes: u64,
}

impl<R: Read> Read for Hashed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.inner.read(buffer)?;
        self.hash.update(&buffer[..read]);
        self.bytes += read as u64;
        Ok(read)
    }
}
