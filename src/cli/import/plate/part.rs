//! The run while it is made: a hidden folder beside its place, with a note for each well that is done.
//!
//! ```text
//!  runs/.P-017.part/ ── A02/ .. and done/A02.json ── interrupted: stays, and is gone on with ── complete: renamed to runs/P-017
//!                       done/A03.begun.json: an import ended in the midst of this well
//! ```
//! A file can end the program: by all memory, or by a fault of a decoder that is no panic. A well that two imports ended in is set aside.

use anyhow::{Context, ensure};
use carved_records::WellStatus;
use carved_store::durable;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::path::{Path, PathBuf};

/// A well that is done.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DoneWell {
    /// Hash of everything that the numbers depend on.
    pub key: String,
    pub status: WellStatus,
    pub warnings: Vec<String>,
}

/// How often a well was begun from the same pictures and not done.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct BegunWell {
    key: String,
    times: u32,
}

/// So many imports may end in the midst of a well. One may have ended by a person or by a power cut.
const MOST_ENDED: u32 = 2;

/// The folder. It is locked, because two imports of one run would mix.
pub(super) struct Part {
    path: PathBuf,
    _lock: File,
}

const DONE: &str = "done";

impl Part {
    /// Makes the folder of a run, or takes that of an interrupted import.
    ///
    /// # Errors
    /// A folder that cannot be made, and another import of this run that is at work.
    pub fn of(out: &Path) -> anyhow::Result<Self> {
        let name = out.file_name().unwrap_or_default().to_string_lossy();
        let path = durable::folder_of(out).join(format!(".{name}.part"));
        let place = || format!("{}: cannot be made", path.display());
        std::fs::create_dir_all(path.join(DONE)).with_context(place)?;
        let lock = File::open(&path).with_context(place)?;
        ensure!(lock.try_lock().is_ok(), "{}: another import of this run is at work; wait until it has ended", path.display());
        Ok(Self { path, _lock: lock })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    fn note(&self, well: &str) -> PathBuf {
        self.path.join(DONE).join(format!("{well}.json"))
    }

    /// What is known of a well that is done with this key. A well that is not done, or was done from other pictures, is removed.
    ///
    /// # Errors
    /// A folder that cannot be removed.
    pub fn done(&self, folder: &Path, key: &str) -> anyhow::Result<Option<DoneWell>> {
        let well = folder.file_name().unwrap_or_default().to_string_lossy();
        let note = self.note(&well);
        if note.is_file() {
            let done: Option<DoneWell> = durable::read_json(&note, "a well that is imported").ok();
            if let Some(done) = done.filter(|done| done.key == key) {
                return Ok(Some(done));
            }
            std::fs::remove_file(&note).with_context(|| format!("{}: cannot be removed", note.display()))?;
        }
        if folder.is_dir() {
            std::fs::remove_dir_all(folder).with_context(|| format!("{}: cannot be removed", folder.display()))?;
        }
        Ok(None)
    }

    fn note_of_begin(&self, well: &str) -> PathBuf {
        self.path.join(DONE).join(format!("{well}.begun.json"))
    }

    /// Notes that a well is begun. The reason to set it aside, if imports ended in the midst of it before.
    ///
    /// # Errors
    /// A disk that does not take the note.
    pub fn begin(&self, well: &str, key: &str) -> anyhow::Result<Option<String>> {
        let note = self.note_of_begin(well);
        let before: Option<BegunWell> = if note.is_file() { durable::read_json(&note, "a well that was begun").ok() } else { None };
        let times = before.filter(|begun| begun.key == key).map_or(0, |begun| begun.times);
        if times >= MOST_ENDED {
            return Ok(Some(format!(
                "set aside: {times} imports ended while they read or measured the pictures of {well}. Look for a damaged picture, and save its \
                 pictures again with another program. To try the same pictures once more, remove {}",
                note.display()
            )));
        }
        durable::write_json(&note, &BegunWell { key: key.to_owned(), times: times + 1 })?;
        Ok(None)
    }

    /// Notes that a well is done. Its files are on the disk.
    ///
    /// # Errors
    /// A disk that does not take the note.
    pub fn keep(&self, well: &str, done: &DoneWell) -> anyhow::Result<()> {
        durable::write_json(&self.note(well), done)?;
        let begun = self.note_of_begin(well);
        if begun.is_file() {
            std::fs::remove_file(&begun).with_context(|| format!("{}: cannot be removed", begun.display()))?;
        }
        Ok(())
    }

    /// Puts the run in its place, without the notes.
    ///
    /// # Errors
    /// A place that was taken meanwhile, and a disk that does not take the change.
    pub fn put(&self, out: &Path) -> anyhow::Result<()> {
        ensure!(out.symlink_metadata().is_err(), "{}: was made by somebody else meanwhile; nothing is overwritten", out.display());
        let notes = self.path.join(DONE);
        std::fs::remove_dir_all(&notes).with_context(|| format!("{}: cannot be removed", notes.display()))?;
        std::fs::rename(&self.path, out).with_context(|| format!("{}: cannot be put in place", out.display()))?;
        durable::sync_folder(durable::folder_of(out))?;
        Ok(())
    }

    /// Removes everything, where there is nothing to go on with.
    pub fn remove(&self) {
        // The error that led here is the one to report.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // A folder without a single well that is done or begun is of no use. After `put` there is none.
        if std::fs::read_dir(self.path.join(DONE)).is_ok_and(|mut notes| notes.next().is_none()) {
            self.remove();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::{PlannedWell, SpecimenKind};

    #[test]
    fn a_well_that_two_imports_ended_in_is_set_aside_until_its_pictures_change() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("P-017");
        // Each import ends in the midst of the well: nothing is kept.
        let begin = |key: &str| Part::of(&out).unwrap().begin("A03", key).unwrap();
        assert_eq!((begin("one"), begin("one")), (None, None));
        let why = begin("one").unwrap();
        assert!(why.contains("set aside: 2 imports ended") && why.contains("A03"), "{why}");
        assert!(begin("one").is_some());
        assert_eq!(begin("other pictures"), None);
        // A well that was done begins again from nothing.
        let part = Part::of(&out).unwrap();
        let status = WellStatus::pending(&PlannedWell::new("A03", SpecimenKind::Larva, None));
        part.keep("A03", &DoneWell { key: "other pictures".into(), status, warnings: Vec::new() }).unwrap();
        assert_eq!(part.begin("A03", "other pictures").unwrap(), None);
        assert_eq!(part.begin("A03", "other pictures").unwrap(), None);
    }
}
