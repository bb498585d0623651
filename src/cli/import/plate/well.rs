//! One well: its pictures become a recording with numbers.

use super::plan::Plan;
use super::sort::{WellPictures, first_of};
use crate::cli::import::frames::Source;
use crate::cli::import::rig::Sources;
use crate::cli::import::write::{self, Failure};
use crate::cli::import::{Args, Imported, frames, recording};
use crate::cli::with_causes;
use crate::session::numbers;
use anyhow::Context;
use carved_core::frame::RawFrame;
use carved_core::pipeline::SegmentedFrame;
use carved_core::profile::Mask;
use carved_core::quality::UsualOpacity;
use carved_offline::recording::{Computed, NumbersError, compute};
use carved_records::{LedgerEntry, PlannedWell, SpecimenOutcome, WellStatus, sha256_hex};
use carved_store::{Recording, RecordingReader};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

pub(super) struct Well<'a> {
    pub args: &'a Args,
    pub sources: &'a Sources,
    pub plan: &'a Plan,
    pub run: &'a str,
    pub planned: &'a PlannedWell,
    /// Folder of the recording.
    pub folder: PathBuf,
    /// How opaque the larvae of the wells before it were.
    pub usual_opacity: Option<UsualOpacity>,
}

impl Well<'_> {
    /// A well of the plate map that nobody took pictures of.
    pub fn without_pictures(&self) -> WellStatus {
        let mut status = WellStatus::pending(self.planned);
        status.end(SpecimenOutcome::Skipped, Some("no picture of this well was found"));
        status
    }

    /// A well that ended the program before.
    pub fn set_aside(&self, why: &str) -> WellStatus {
        note!("carved: {}: {why}", self.planned.well);
        let mut status = WellStatus::pending(self.planned);
        status.end(SpecimenOutcome::Failed, Some(why));
        status
    }

    /// Hash of everything that the numbers of this well depend on: program, options, the contents of the named files, plan and pictures.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn key(&self, pictures: &WellPictures) -> anyhow::Result<String> {
        let Args { config, cameras, angles, settings, empty, .. } = self.args;
        let mut files = Vec::new();
        for file in [config, cameras, angles, settings, empty].into_iter().flatten() {
            let bytes = carved_files::read(file).with_context(|| format!("{}: cannot be read", file.display()))?;
            files.push((file, sha256_hex(&bytes)));
        }
        let mut seen = Vec::new();
        for path in pictures.views.values().flatten() {
            let place = || format!("{}: cannot be read", path.display());
            let found = std::fs::metadata(path).with_context(place)?;
            let changed = found.modified().with_context(place)?.duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
            seen.push((path, found.len(), changed.as_nanos()));
        }
        let options = format!("{:?}", self.args);
        let (plan, version) = (self.plan, env!("CARGO_PKG_VERSION"));
        let key = serde_json::to_vec(&(
            version,
            options,
            files,
            self.planned,
            (&plan.method, &plan.views, &plan.omega_deg),
            seen,
            self.usual_opacity,
        ))?;
        Ok(sha256_hex(&key))
    }

    /// Takes the picture of the empty capillary of a well that is done.
    ///
    /// # Errors
    /// A recording that cannot be read.
    pub fn take_empty(&self, empty: &mut Option<Arc<RawFrame>>) -> anyhow::Result<()> {
        if empty.is_none() && self.folder.is_dir() {
            *empty = RecordingReader::open(&self.folder)?.empty_capillary()?.map(Arc::new);
        }
        Ok(())
    }

    /// Writes the recording and measures it. What is wrong with its pictures ends the well, not the import.
    ///
    /// # Errors
    /// The disk does not take the recording.
    pub fn import(
        &self,
        pictures: &WellPictures,
        empty: &mut Option<Arc<RawFrame>>,
        warn: &mut dyn FnMut(String),
    ) -> anyhow::Result<WellStatus> {
        let mut status = WellStatus::pending(self.planned);
        let read = self.read(pictures, warn).map_err(Failure::Pictures);
        let written = read.and_then(|(imported, recording)| {
            *empty = empty.take().or_else(|| imported.empty.clone());
            write::fill(&self.folder, recording, &imported)
        });
        let mut writer = match written {
            Ok(writer) => writer,
            Err(Failure::Disk(error)) => return Err(error.context(format!("well {}", self.planned.well))),
            Err(Failure::Pictures(error)) => {
                // A picture that was changed meanwhile leaves a part of the recording.
                if self.folder.is_dir() {
                    std::fs::remove_dir_all(&self.folder).with_context(|| format!("{}: cannot be removed", self.folder.display()))?;
                }
                let why = with_causes(&error);
                note!("carved: {}: {why}", self.planned.well);
                status.end(SpecimenOutcome::Failed, Some(&why));
                return Ok(status);
            }
        };
        let reader = RecordingReader::open(&self.folder)?;
        let stored = reader.recording();
        let entries: Vec<&LedgerEntry> = stored.ledger.counted().collect();
        let masks: Mutex<BTreeMap<u32, Mask>> = Mutex::default();
        let keep_mask = |entry: &LedgerEntry, seen: &SegmentedFrame| {
            if let (Ok(profile), false) = (&seen.profile, entry.closure)
                && profile.mask.area_px() > 0
            {
                masks.lock().unwrap_or_else(PoisonError::into_inner).insert(entry.view, profile.mask.clone());
            }
            Ok(())
        };
        let numbers = compute(&reader, &stored.method, &entries, keep_mask);
        for (view, mask) in masks.into_inner().unwrap_or_else(PoisonError::into_inner) {
            writer.add_profile(view, &mask)?;
        }
        match numbers {
            Ok(Computed { mesh, file, .. }) => {
                numbers::write(&mut writer, &mesh, &file)?;
                numbers::end_well(&mut status, &file, self.plan.method.asd);
            }
            Err(NumbersError::Store(error)) => return Err(error.into()),
            Err(error) => {
                note!("carved: {}: {error}", self.planned.well);
                status.end(SpecimenOutcome::Failed, Some(&error.to_string()));
            }
        }
        writer.close()?;
        Ok(status)
    }

    fn read(&self, pictures: &WellPictures, warn: &mut dyn FnMut(String)) -> anyhow::Result<(Imported, Recording)> {
        let mut warnings = Vec::new();
        let mut of_well = |doubt: String| {
            warn(format!("{}: {doubt}", self.planned.well));
            warnings.push(doubt);
        };
        let plan = self.plan;
        let pictures_in_order = pictures.in_order(&plan.views)?.into_iter();
        let (views, sources): (Vec<u32>, Vec<Source>) = pictures_in_order.map(|(view, path)| (view, Source::file(path))).unzip();
        let missing = pictures.missing(&plan.views);
        if !missing.is_empty() {
            of_well(format!("{} of {} pictures are missing, those of view {}", missing.len(), plan.views.len(), first_of(&missing)));
        }
        let turn = plan.turn(&views).with_context(|| plan.angles_from.clone())?;
        let (looks, kind) = frames::look(&sources, self.args.bayer, &mut of_well)?;
        let rig = self.sources.rig(self.args, kind, &mut |doubt| {
            warn(doubt.clone());
            warnings.push(doubt);
        })?;
        let imported = Imported::new(self.args, &rig, (looks, kind), turn, plan.angles_from.clone(), warnings)?;
        let usual_opacity = self.usual_opacity;
        let recording =
            Recording { missing_views: missing, usual_opacity, ..recording(rig, self.run, self.planned.clone(), kind, &imported)? };
        Ok((imported, recording))
    }
}
