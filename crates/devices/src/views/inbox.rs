//! The pictures in the folder of a plate, by well and view.
//!
//! ```text
//! scan ── every poll_ms ──► path, size, time of each picture ──┬─ changed: its time of quiet begins again
//!                                                               └─ the same for quiet_ms: perhaps complete; the decoder decides
//! ```
//! The time of a file orders files of one server. It is never compared with the clock of this computer.

use super::error::ViewsError;
use super::settings::FolderSettings;
use crate::clock::Clock;
use carved_records::picture_name::{self, Pattern, is_picture};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// A plate is a folder of wells, perhaps with one folder per fish.
const DEEPEST: usize = 4;

/// Size and time of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Stamp {
    bytes: u64,
    modified: Option<SystemTime>,
}

/// A picture of a view.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    pub well: String,
    fish: Option<u32>,
    pub view: u32,
    pub stamp: Stamp,
    /// When it was noticed or has changed last.
    since: Instant,
}

pub(super) struct Inbox {
    settings: FolderSettings,
    pattern: Option<Pattern>,
    clock: Clock,
    folder: PathBuf,
    pictures: BTreeMap<PathBuf, Picture>,
    /// When a picture came or has changed last.
    changed: Option<Instant>,
    /// Wells with pictures of other fish, which were logged.
    other_fish: BTreeSet<String>,
}

impl Inbox {
    pub fn new(settings: FolderSettings, pattern: Option<Pattern>, clock: Clock) -> Self {
        let folder = settings.root();
        Self { settings, pattern, clock, folder, pictures: BTreeMap::new(), changed: None, other_fish: BTreeSet::new() }
    }

    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// From now on the folder of this plate is read.
    pub fn enter(&mut self, run: &str, plate: &str) {
        let folder = self.settings.of_plate(run, plate);
        if folder != self.folder {
            tracing::info!(folder = %folder.display(), "pictures are read from this folder");
            (self.folder, self.changed) = (folder, None);
            self.pictures.clear();
            self.other_fish.clear();
        }
    }

    /// Looks whether the folder that holds all plates can be read.
    pub fn check(&self) -> Result<(), ViewsError> {
        let root = self.settings.root();
        fs::read_dir(&root).map(drop).map_err(|e| ViewsError::FolderLost { path: root, why: e.to_string() })
    }

    /// Brings the list of pictures up to date. A plate's folder that does not exist yet has none.
    pub fn scan(&mut self) -> Result<(), ViewsError> {
        self.check()?;
        let mut files = BTreeMap::new();
        files_below(&self.folder, DEEPEST, &mut files).map_err(|(path, why)| ViewsError::FolderLost { path, why })?;
        self.pictures.retain(|path, _| files.contains_key(path));
        let now = (self.clock.now)();
        for (path, stamp) in files {
            if let Some(known) = self.pictures.get_mut(&path) {
                if known.stamp != stamp {
                    (known.stamp, known.since) = (stamp, now);
                    self.changed = Some(now);
                }
                continue;
            }
            let within = path.strip_prefix(&self.folder).unwrap_or(&path);
            let Some((label, well)) = picture_name::read(within, self.pattern.as_ref()).and_then(|l| l.well.clone().map(|well| (l, well)))
            else {
                continue;
            };
            let picture = Picture { well, fish: label.fish, view: label.view, stamp, since: now };
            if !self.is_read(&picture) && self.other_fish.insert(picture.well.clone()) {
                tracing::warn!(well = picture.well, picture = %path.display(), fish = self.settings.fish, "pictures of another fish are ignored");
            }
            self.pictures.insert(path, picture);
            self.changed = Some(now);
        }
        Ok(())
    }

    /// Whether it is of the fish that is measured.
    fn is_read(&self, picture: &Picture) -> bool {
        picture.fish.is_none_or(|fish| fish == self.settings.fish)
    }

    pub fn count(&self) -> usize {
        self.pictures.len()
    }

    pub fn first(&self) -> Option<&Path> {
        self.pictures.keys().next().map(PathBuf::as_path)
    }

    pub fn get(&self, path: &Path) -> Option<&Picture> {
        self.pictures.get(path)
    }

    /// All pictures of a view.
    pub fn of_view(&self, well: &str, view: u32) -> Vec<(&Path, &Picture)> {
        let of = self.of_well(well).filter(|(_, picture)| picture.view == view);
        of.collect()
    }

    fn of_well(&self, well: &str) -> impl Iterator<Item = (&Path, &Picture)> {
        let read = self.pictures.iter().filter(move |(_, picture)| picture.well == well && self.is_read(picture));
        read.map(|(path, picture)| (path.as_path(), picture))
    }

    /// Whether nothing has written to it for long enough.
    pub fn is_quiet(&self, picture: &Picture) -> bool {
        self.clock.since(picture.since) >= self.settings.quiet()
    }

    /// For how long it has not changed.
    pub fn quiet_for(&self, picture: &Picture) -> Duration {
        self.clock.since(picture.since)
    }

    /// The name of a quiet picture that was stored later than this one.
    pub fn later_than(&self, picture: &Picture) -> Option<String> {
        let stored = picture.stamp.modified?;
        let is_later = |(_, other): &(&PathBuf, &Picture)| other.stamp.modified.is_some_and(|at| at > stored) && self.is_quiet(other);
        let (path, _) = self.pictures.iter().find(is_later)?;
        Some(path.file_name()?.to_string_lossy().into_owned())
    }

    /// For how long nothing has come or changed since `began`. `None` before the first picture.
    pub fn silent_since(&self, began: Instant) -> Option<Duration> {
        self.changed.map(|changed| self.clock.since(changed.max(began)))
    }

    /// The position of the well among `wells` whose first quiet picture is the oldest.
    pub fn oldest<'a>(&self, wells: impl Iterator<Item = &'a str>) -> Option<usize> {
        let oldest_of = |well: &str| {
            let quiet = self.of_well(well).filter(|(_, picture)| self.is_quiet(picture));
            quiet.map(|(path, picture)| (picture.stamp.modified, path.to_owned())).min()
        };
        let begun = wells.enumerate().filter_map(|(at, well)| Some((oldest_of(well)?, at)));
        begun.min().map(|(_, at)| at)
    }

    /// A picture of another specimen that was stored after the newest picture of this well, in words.
    pub fn stored_since(&self, well: &str) -> Option<String> {
        let newest = self.of_well(well).map(|(_, picture)| picture.stamp.modified).max()?;
        let is_settled = self.of_well(well).all(|(_, picture)| self.is_quiet(picture));
        let is_other = |picture: &&Picture| picture.well != well || !self.is_read(picture);
        let mut later = self.pictures.values().filter(is_other).filter(|picture| picture.stamp.modified > newest && self.is_quiet(picture));
        let next = later.next().filter(|_| is_settled)?;
        Some(if next.well == well { "another fish of this well".into() } else { format!("well {}", next.well) })
    }
}

/// All pictures below a folder. A folder or file that vanishes meanwhile is left out.
fn files_below(folder: &Path, depth: usize, files: &mut BTreeMap<PathBuf, Stamp>) -> Result<(), (PathBuf, String)> {
    let failed = |e: std::io::Error| (folder.to_owned(), e.to_string());
    let entries = match fs::read_dir(folder) {
        Err(e) if e.kind() == ErrorKind::NotFound => return Ok(()),
        entries => entries.map_err(failed)?,
    };
    for entry in entries {
        let path = entry.map_err(failed)?.path();
        let about = match fs::metadata(&path) {
            // A link to nothing is no picture either.
            Err(e) if e.kind() == ErrorKind::NotFound => continue,
            about => about.map_err(|e| (path.clone(), e.to_string()))?,
        };
        if about.is_dir() && depth > 0 {
            files_below(&path, depth - 1, files)?;
        } else if about.is_file() && is_picture(&path) {
            files.insert(path, Stamp { bytes: about.len(), modified: about.modified().ok() });
        }
    }
    Ok(())
}
