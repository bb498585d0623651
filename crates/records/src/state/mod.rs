//! The state of the instrument: a fold over the events of the journal.
//!
//! ```text
//!                     ┌─► OpenFaults      raised, acknowledged, cleared
//!  Event ──► apply ───┼─► PlateHandover   the plate inside, and the open handover
//!                     ├─► Paces           durations of specimens, by method
//!                     ├─► SpecimenState   of a specimen that no run asked for
//!                     └─► RunState        of the newest run: cause of a hold, requested end
//!                          └─► Specimens  where each specimen of the run is
//! ```
//! The live driver applies each event when it happens. A restart of the daemon applies the same events from the journal. Both therefore
//! have the same state, which a property test of the driver checks field by field.

mod faults;
mod pace;
mod plate;
mod run;
mod specimen;
mod specimens;

pub use faults::OpenFaults;
pub use pace::{Eta, Paces};
pub use plate::PlateHandover;
pub use run::{EndRequest, HoldCause, RunState};
pub use specimen::{Specimen, SpecimenEvent, SpecimenState, TRANSITIONS as SPECIMEN_TRANSITIONS, as_markdown as specimens_as_markdown};
pub use specimens::{NotNow, Report, Requests, Situation, Specimens, Work};

use crate::{Event, EventBody, EventData};

/// The state that follows from the events.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InstrumentState {
    /// The newest run. `None` if no run is known.
    pub run: Option<RunState>,
    /// A specimen in the capillary that no run asked for. It belongs to no well.
    pub stranger: SpecimenState,
    /// The plate and its handover.
    pub plate: PlateHandover,
    /// The open faults.
    pub faults: OpenFaults,
    /// Durations of the specimens of each method.
    pub paces: Paces,
}

impl InstrumentState {
    /// The state after `events`, oldest first.
    pub fn after<'a>(events: impl IntoIterator<Item = &'a Event>) -> Self {
        let mut state = Self::default();
        for event in events {
            state.apply(&event.body);
        }
        state
    }

    /// Applies an event.
    pub fn apply(&mut self, event: &EventBody) {
        self.plate.apply(&event.data);
        self.faults.apply(&event.data);
        self.paces.apply(event);
        match &event.data {
            EventData::RunAccepted(_) | EventData::RunResumed(_) => self.stranger = self.stranger.after(SpecimenEvent::RunBegins),
            EventData::SpecimenUnasked(reading) => {
                let seen = if reading.there { SpecimenEvent::SeenUnasked } else { SpecimenEvent::SeenEmpty };
                self.stranger = self.stranger.after(seen);
            }
            _ => {}
        }
        match (&event.data, &event.run) {
            (EventData::RunAccepted(accepted), Some(id)) => {
                let mut run = RunState::accepted(id, accepted.left_in_capillary.as_deref());
                run.apply(event);
                self.run = Some(run);
            }
            (_, Some(id)) => self.run.iter_mut().filter(|run| run.id() == id).for_each(|run| run.apply(event)),
            // If the run was removed from the disk, the loader's message has no run, but it is still valid.
            (EventData::WellLoaded(_) | EventData::WellUnloaded, None) => self.run.iter_mut().for_each(|run| run.apply(event)),
            _ => {}
        }
    }
}
