//! Which specimens the plate-loader or the sampler moves for the current run.
//!
//! ```text
//! await_specimen ──► the loader brings it ──► brought
//! remove ──► the loader takes it out, before the run continues ──► taken_out
//!        └─► the sampler ejects it, before the first well ──────► hand_to_worker
//! ```

use carved_records::Capillary;

/// Open requests to move specimens. Each names a well.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Handling {
    /// The specimen that the loader brings next.
    awaited: Option<String>,
    /// The specimen that the loader takes out before the run continues.
    take_out: Option<String>,
    /// The specimen that a driven sampler ejects before the run continues.
    eject_first: Option<String>,
}

/// What the run was waiting for when a specimen arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Waited {
    /// For this specimen.
    ForIt,
    /// For the removal of the previous specimen.
    ForRemoval,
    /// For nothing.
    No,
}

impl Handling {
    /// The specimen that the loader brings next.
    pub fn awaited(&self) -> Option<&str> {
        self.awaited.as_deref()
    }

    /// The specimen that the loader takes out before the run continues.
    pub fn take_out(&self) -> Option<&str> {
        self.take_out.as_deref()
    }

    /// The specimen that the sampler ejects before the run continues.
    pub fn eject_first(&self) -> Option<&str> {
        self.eject_first.as_deref()
    }

    /// Asks the loader to bring a specimen.
    pub fn await_specimen(&mut self, well: &str) {
        self.awaited = Some(well.to_owned());
    }

    /// Asks the loader or the sampler to remove a specimen before the run continues.
    pub fn remove(&mut self, well: &str, by_loader: bool) {
        *(if by_loader { &mut self.take_out } else { &mut self.eject_first }) = Some(well.to_owned());
    }

    /// Asks the sampler to eject a specimen that it could not eject before.
    pub fn remove_what_is_stuck(&mut self, capillary: &Capillary) {
        if let Some(stuck) = capillary.in_the_way() {
            self.eject_first.get_or_insert_with(|| stuck.to_owned());
        }
    }

    /// The loader has brought a specimen. It replaces whatever was in the capillary.
    pub fn brought(&mut self) -> Waited {
        self.eject_first = None;
        match (self.awaited.take(), self.take_out.take()) {
            (Some(_), _) => Waited::ForIt,
            (None, Some(_)) => Waited::ForRemoval,
            (None, None) => Waited::No,
        }
    }

    /// The specimen was taken out. Returns whether the loader was asked to do so.
    pub fn taken_out(&mut self, well: &str) -> bool {
        self.eject_first.take_if(|asked| asked == well);
        self.take_out.take_if(|asked| asked == well).is_some()
    }

    /// The specimen that a new worker ejects first. The worker takes over this request.
    pub fn hand_to_worker(&mut self) -> Option<String> {
        self.eject_first.take()
    }

    /// The worker ended. It no longer waits for a specimen.
    pub fn worker_ended(&mut self) {
        self.awaited = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_specimen_that_is_brought_ends_every_wait() {
        let mut handling = Handling::default();
        assert_eq!(handling.brought(), Waited::No);
        handling.remove("A01", true);
        handling.await_specimen("A02");
        assert_eq!((handling.brought(), handling.awaited(), handling.take_out()), (Waited::ForIt, None, None));
        handling.remove("A01", true);
        assert_eq!((handling.brought(), handling.take_out()), (Waited::ForRemoval, None));
        handling.remove("A01", false);
        assert_eq!((handling.brought(), handling.eject_first()), (Waited::No, None), "the new specimen would be ejected");
    }

    #[test]
    fn only_the_specimen_that_is_asked_for_ends_the_wait_for_its_removal() {
        let mut handling = Handling::default();
        handling.remove("A01", true);
        assert!(!handling.taken_out("A02") && handling.take_out() == Some("A01"));
        assert!(handling.taken_out("A01") && handling.take_out().is_none());
        handling.remove("A01", false);
        assert!(!handling.taken_out("A01"), "the loader was not asked");
        assert_eq!(handling.hand_to_worker(), None, "the sampler has nothing to take out any more");
    }

    #[test]
    fn an_end_of_the_worker_ends_the_wait_for_a_specimen_and_no_other() {
        let mut handling = Handling::default();
        handling.await_specimen("A02");
        handling.remove("A01", true);
        handling.worker_ended();
        assert_eq!((handling.awaited(), handling.take_out()), (None, Some("A01")));
    }
}
