//! The specimen in the capillary, as far as events say.
//!
//! ```text
//!  asked for ──► brought ──► worked on ──► taken out
//!                  ▲ └ inside ─────────┘
//!                  └ left inside by a fault of the instrument: the run goes on with it
//! ```

use std::collections::BTreeSet;

/// What is inside, by well; of the newest run, or left by the one before it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Capillary {
    inside: Option<String>,
    asked_for: Option<String>,
    brought: Option<String>,
    been_inside: BTreeSet<String>,
}

impl Capillary {
    /// Nothing is known to be inside, and nothing was asked for.
    pub const fn empty() -> Self {
        Self { inside: None, asked_for: None, brought: None, been_inside: BTreeSet::new() }
    }

    /// Of a run that begins while a specimen of an earlier one may still be inside.
    pub(super) fn with(left: Option<String>) -> Self {
        Self { been_inside: left.iter().cloned().collect(), inside: left, ..Self::empty() }
    }

    /// The well whose specimen is inside; `None` where nothing is, as far as is known.
    pub fn inside(&self) -> Option<&str> {
        self.inside.as_deref()
    }

    /// The well whose specimen the loader was asked for and has not brought.
    pub fn asked_for(&self) -> Option<&str> {
        self.asked_for.as_deref()
    }

    /// The well whose specimen is inside for the run to go on with: the loader has brought it and nothing was done with it since, or a
    /// fault of the instrument has left it there.
    pub fn brought(&self) -> Option<&str> {
        self.brought.as_deref()
    }

    /// Whether the specimen of a well was inside at any time of this run.
    pub fn has_held(&self, well: &str) -> bool {
        self.been_inside.contains(well)
    }

    pub(super) fn ask(&mut self, well: &str) {
        self.asked_for = Some(well.to_owned());
    }

    /// The loader's word: the specimen is inside, and what was inside before it is out.
    pub(super) fn bring(&mut self, well: &str) {
        self.asked_for = None;
        self.put(well);
        self.brought = Some(well.to_owned());
    }

    /// The loader's word: the specimen is out.
    pub(super) fn take_out(&mut self, well: &str) {
        self.inside.take_if(|inside| inside == well);
        self.brought.take_if(|brought| brought == well);
        self.been_inside.insert(well.to_owned());
    }

    /// Work on the specimen begins: it is not one that was only brought any more.
    pub(super) fn begin(&mut self, well: &str) {
        self.brought.take_if(|brought| brought == well);
    }

    /// The specimen is inside.
    pub(super) fn put(&mut self, well: &str) {
        self.inside = Some(well.to_owned());
        self.been_inside.insert(well.to_owned());
    }

    /// The specimen is not inside. One that was brought before it was asked for again stays: while it is awaited, another's may be inside.
    pub(super) fn lacks(&mut self, well: &str) {
        if self.brought.as_deref() != Some(well) {
            self.inside.take_if(|inside| inside == well);
        }
    }

    /// A fault of the instrument has left it inside, and the run goes on with it.
    pub(super) fn keep(&mut self, well: &str) {
        self.brought = Some(well.to_owned());
    }

    /// A start of the daemon does not know whether a driven sampler had brought the specimen that was begun last. It is taken to be inside.
    pub(super) fn assume(&mut self, begun: Option<&String>) {
        if self.brought.is_none() || self.brought != self.inside {
            self.inside = begun.cloned().or(self.inside.take());
        }
    }
}
