//! The specimen in the capillary, as far as the events show.
//!
//! ```text
//!  asked for ──► brought ──► in progress ──► taken out
//!                  ▲ └ inside ───────────┘
//!                  └ left inside by a fault of the instrument: the run continues with it
//! ```

use std::collections::BTreeSet;

/// The content of the capillary, by well, from the events of the newest run. A specimen may be left from the run before it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Capillary {
    inside: Option<String>,
    asked_for: Option<String>,
    brought: Option<String>,
    asked_before: Option<String>,
    been_inside: BTreeSet<String>,
}

impl Capillary {
    /// A capillary without a known specimen or request.
    pub const fn empty() -> Self {
        Self { inside: None, asked_for: None, brought: None, asked_before: None, been_inside: BTreeSet::new() }
    }

    /// The capillary of a run that begins while the specimen `left` of an earlier run is still inside.
    pub(super) fn with(left: Option<String>) -> Self {
        Self { been_inside: left.iter().cloned().collect(), inside: left, ..Self::empty() }
    }

    /// The well whose specimen is inside. `None` if the capillary is empty as far as is known.
    pub fn inside(&self) -> Option<&str> {
        self.inside.as_deref()
    }

    /// The well whose specimen was requested from the loader and is not brought yet.
    pub fn asked_for(&self) -> Option<&str> {
        self.asked_for.as_deref()
    }

    /// The well of a specimen that the run can continue with: the loader has just brought it, or a fault of the instrument has left it
    /// inside.
    pub fn brought(&self) -> Option<&str> {
        self.brought.as_deref()
    }

    /// The well for which a driven sampler was asked before a restart. Its specimen is inside or still on its way.
    pub fn asked_before(&self) -> Option<&str> {
        self.asked_before.as_deref()
    }

    /// The well of a specimen that is inside and that the run cannot continue with. It must be taken out.
    pub fn in_the_way(&self) -> Option<&str> {
        self.inside().filter(|inside| self.brought() != Some(inside) && self.asked_before() != Some(inside))
    }

    /// Whether the specimen of a well was inside at any time of this run.
    pub fn has_held(&self, well: &str) -> bool {
        self.been_inside.contains(well)
    }

    pub(super) fn ask(&mut self, well: &str) {
        self.asked_for = Some(well.to_owned());
    }

    /// The loader reports that the specimen is inside. The previous specimen is out.
    pub(super) fn bring(&mut self, well: &str) {
        self.asked_for = None;
        self.put(well);
        self.brought = Some(well.to_owned());
    }

    /// The loader reports that the specimen is out.
    pub(super) fn take_out(&mut self, well: &str) {
        self.inside.take_if(|inside| inside == well);
        self.brought.take_if(|brought| brought == well);
        self.asked_before.take_if(|asked| asked == well);
        self.been_inside.insert(well.to_owned());
    }

    /// Work on the specimen begins. From now on it no longer counts as just brought.
    pub(super) fn begin(&mut self, well: &str) {
        self.brought.take_if(|brought| brought == well);
    }

    /// The specimen is inside.
    pub(super) fn put(&mut self, well: &str) {
        self.asked_before = None;
        self.inside = Some(well.to_owned());
        self.been_inside.insert(well.to_owned());
    }

    /// The specimen is not inside. A specimen that was brought earlier stays: while it is awaited, another one may be inside.
    pub(super) fn lacks(&mut self, well: &str) {
        // The sampler is asked again, or has ejected it.
        self.asked_before.take_if(|asked| asked == well);
        if self.brought.as_deref() != Some(well) {
            self.inside.take_if(|inside| inside == well);
        }
    }

    /// A fault of the instrument has left the specimen inside, and the run continues with it.
    pub(super) fn keep(&mut self, well: &str) {
        self.brought = Some(well.to_owned());
    }

    /// After a restart it is unknown whether a driven sampler has brought the specimen that it was asked for. It is assumed to be inside,
    /// and may still come.
    pub(super) fn assume(&mut self, asked: Option<&String>) {
        if self.brought.is_none() || self.brought != self.inside {
            self.asked_before = asked.cloned();
            self.inside = asked.cloned().or(self.inside.take());
        }
    }
}
