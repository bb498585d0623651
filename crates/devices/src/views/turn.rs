//! One well as another program stores it: which picture is whose view, and when it can be used.
//!
//! ```text
//! view k ──► there? ── one picture ── quiet ── decodes, last row not empty ──► its frame
//!              │           └ two: the well fails                └ not yet: wait
//!              └ no ──┬─ pictures of another well are newer: the well fails
//!                     └─ wait, next_picture_s at most ──► the run is held
//! a picture that was used and is written again with other pixels ──► the turn begins again
//! ```

use super::error::ViewsError;
use super::inbox::{Inbox, Picture, Stamp};
use super::settings::FolderSettings;
use crate::clock::Clock;
use crate::{DeviceError, Position};
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::units::Steps;
use carved_records::sha256_hex;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A file that has not changed for so many times of quiet is not being written, where later pictures are.
const GONE_ON: u32 = 10;

/// Reads a picture file; the error is a sentence.
pub type Decode = Box<dyn Fn(&Path) -> Result<RawFrame, String> + Send>;

/// Size and format that every picture must have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureKind {
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Layout of the pixels.
    pub format: PixelFormat,
}

impl PictureKind {
    fn of(frame: &RawFrame) -> Self {
        Self { width: frame.width(), height: frame.height(), format: frame.format() }
    }
}

impl std::fmt::Display for PictureKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} x {} px {}", self.width, self.height, self.format.name())
    }
}

/// A picture that was used.
struct Used {
    stamp: Stamp,
    pixels_sha256: String,
}

/// What axis, camera and sampler share.
pub(super) struct Turn {
    pub inbox: Inbox,
    pub settings: FolderSettings,
    pub clock: Clock,
    /// Set by the stop handle.
    pub stopped: Arc<AtomicBool>,
    kind: PictureKind,
    decode: Decode,
    well: Option<String>,
    /// In the order of the views.
    stops: Vec<Steps>,
    position: Position,
    epoch: u32,
    used: BTreeMap<PathBuf, Used>,
    frame: Option<(u32, RawFrame)>,
}

impl Turn {
    pub fn new(settings: FolderSettings, kind: PictureKind, decode: Decode, clock: Clock) -> Result<Self, DeviceError> {
        settings.check()?;
        let pattern = settings.read_pattern().unwrap_or_default();
        Ok(Self {
            inbox: Inbox::new(settings.clone(), pattern, clock),
            settings,
            clock,
            stopped: Arc::default(),
            kind,
            decode,
            well: None,
            stops: Vec::new(),
            position: Position::Unknown,
            epoch: 0,
            used: BTreeMap::new(),
            frame: None,
        })
    }

    /// The pictures of this well are read next, or those of none.
    pub fn begin(&mut self, well: Option<&str>) {
        self.well = well.map(str::to_owned);
        self.forget();
    }

    pub fn announce(&mut self, stops: &[Steps]) {
        self.stops = stops.to_vec();
    }

    /// The first view is the reference. Pictures are read again from there.
    pub fn reference(&mut self) -> u32 {
        self.epoch += 1;
        self.position = Position::Referenced { steps: Steps(0), epoch: self.epoch };
        self.forget();
        self.epoch
    }

    pub fn position(&self) -> Position {
        if self.is_stopped() && self.epoch > 0 { Position::Suspect { epoch: self.epoch + 1 } } else { self.position }
    }

    /// Waits for the picture of a stop.
    pub fn go_to(&mut self, target: Steps) -> Result<u32, DeviceError> {
        let Position::Referenced { epoch, .. } = self.position() else { return Err(DeviceError::NotReferenced) };
        let Some(at) = self.stops.iter().position(|stop| *stop == target) else {
            return Err(DeviceError::NotNext { target, next: self.stops.first().copied() });
        };
        self.position = Position::Referenced { steps: target, epoch };
        self.wait_for(self.settings.first_view + at as u32)?;
        Ok(epoch)
    }

    /// The picture of the current stop and the number of its view.
    pub fn picture(&mut self) -> Result<(u32, RawFrame), DeviceError> {
        let Position::Referenced { steps, .. } = self.position() else { return Err(DeviceError::NotReferenced) };
        let at = self.stops.iter().position(|stop| *stop == steps).unwrap_or(0);
        let view = self.settings.first_view + at as u32;
        Ok((view, self.wait_for(view)?))
    }

    fn forget(&mut self) {
        self.stops.clear();
        self.used.clear();
        self.frame = None;
    }

    fn is_stopped(&self) -> bool {
        self.stopped.load(Ordering::Acquire)
    }

    fn wait_for(&mut self, view: u32) -> Result<RawFrame, DeviceError> {
        if let Some((_, frame)) = self.frame.as_ref().filter(|(known, _)| *known == view) {
            return Ok(frame.clone());
        }
        let well = self.well.clone().ok_or(ViewsError::NoWell)?;
        let began = (self.clock.now)();
        // No later wait looks at the last picture again, so this one does, for as long as a picture must be quiet.
        let is_last = self.stops.len().checked_sub(1).is_some_and(|last| view == self.settings.first_view + last as u32);
        let mut read = None;
        loop {
            if self.is_stopped() {
                return Err(DeviceError::Suspect { why: "the wait for a picture was stopped".into() });
            }
            self.inbox.scan()?;
            let is_settled = self.used_are_the_same()?;
            if let Some(frame) = self.read(&well, view)?.filter(|_| is_settled) {
                let since = *read.get_or_insert_with(self.clock.now);
                if !is_last || self.clock.since(since) >= self.settings.quiet() {
                    self.frame = Some((view, frame.clone()));
                    return Ok(frame);
                }
            }
            let waited = self.inbox.silent_since(began).unwrap_or_else(|| self.clock.since(began));
            if read.is_none() && waited >= self.settings.next_picture() {
                let folder = self.inbox.folder().to_owned();
                return Err(ViewsError::Late { well, view, waited_s: waited.as_secs(), folder }.into());
            }
            (self.clock.pause)(self.settings.poll());
        }
    }

    /// The frame of a view, if its picture is complete.
    fn read(&mut self, well: &str, view: u32) -> Result<Option<RawFrame>, ViewsError> {
        let (path, picture) = match self.inbox.of_view(well, view)[..] {
            [] => {
                return match self.inbox.stored_since(well) {
                    Some(next) => Err(ViewsError::Missing { view, next }),
                    None => Ok(None),
                };
            }
            [(path, picture)] => (path.to_owned(), picture.clone()),
            [(first, _), (second, _), ..] => {
                let why = format!("view {view} of well {well} is also in {}; one picture per view is expected", second.display());
                return Err(ViewsError::Unusable { path: first.to_owned(), why });
            }
        };
        if !self.inbox.is_quiet(&picture) {
            return Ok(None);
        }
        match self.complete(&path) {
            Ok(frame) => {
                let found = PictureKind::of(&frame);
                if found != self.kind {
                    return Err(ViewsError::Unfit { path, found: found.to_string(), expected: self.kind.to_string() });
                }
                self.used.insert(path, Used { stamp: picture.stamp, pixels_sha256: sha256_hex(frame.bytes()) });
                Ok(Some(frame))
            }
            Err(why) => self.incomplete(path, &picture, &why),
        }
    }

    /// A file that cannot be decoded may still be written to, with pauses. Once the other program has stored later pictures, it has long
    /// finished this one.
    fn incomplete(&self, path: PathBuf, picture: &Picture, why: &str) -> Result<Option<RawFrame>, ViewsError> {
        let waited = self.inbox.quiet_for(picture);
        let (longest, since) = match self.inbox.later_than(picture) {
            Some(later) => (self.settings.next_picture().min(GONE_ON * self.settings.quiet()), format!(", and {later} was stored since")),
            None => (self.settings.next_picture(), String::new()),
        };
        if waited < longest {
            return Ok(None);
        }
        Err(ViewsError::Unusable { path, why: format!("{why}; it has not changed for {} s{since}", waited.as_secs()) })
    }

    /// Some programs reserve the whole file before they write it. No camera gives a last row of zeros in a picture that is not black.
    fn complete(&self, path: &Path) -> Result<RawFrame, String> {
        let frame = (self.decode)(path)?;
        let row = frame.width() as usize * frame.format().bytes_per_pixel();
        let last = &frame.bytes()[frame.bytes().len().saturating_sub(row)..];
        let is_unwritten = last.iter().all(|b| *b == 0) && frame.bytes().iter().any(|b| *b > 0);
        if is_unwritten { Err("its last row of pixels is zero, as in a file that is not written to its end".into()) } else { Ok(frame) }
    }

    /// Whether the pictures that were used are as they were. False while one of them is being written again.
    fn used_are_the_same(&mut self) -> Result<bool, ViewsError> {
        let mut is_settled = true;
        let mut same = Vec::new();
        for (path, used) in &self.used {
            let Some(picture) = self.inbox.get(path).filter(|picture| picture.stamp != used.stamp) else { continue };
            if !self.inbox.is_quiet(picture) {
                is_settled = false;
                continue;
            }
            match self.complete(path) {
                Ok(frame) if sha256_hex(frame.bytes()) == used.pixels_sha256 => same.push((path.clone(), picture.stamp)),
                Ok(_) => return Err(ViewsError::Replaced { path: path.clone() }),
                Err(why) => {
                    self.incomplete(path.clone(), picture, &why)?;
                    is_settled = false;
                }
            }
        }
        for (path, stamp) in same {
            self.used.entry(path).and_modify(|used| used.stamp = stamp);
        }
        Ok(is_settled)
    }
}
