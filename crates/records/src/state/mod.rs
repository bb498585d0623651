//! What the events say of the instrument: a fold over the journal, and nothing else.
//!
//! ```text
//!                     ┌─► OpenFaults      raised, acknowledged, over
//!  Event ──► apply ───┼─► PlateHandover   the plate that is inside, and the one that is on its way
//!                     ├─► Paces           how long specimens take, by method
//!                     └─► RunState        of the newest run: who holds it, which end was asked for, which specimens are begun
//!                          └─► Capillary  the specimen that is inside, asked for, brought
//! ```
//! The live driver applies each event as it tells it. A restart of the daemon applies the same events as it reads them. Both therefore
//! believe the same, which a property test of the driver checks field by field.

mod capillary;
mod faults;
mod pace;
mod plate;
mod run;

pub use capillary::Capillary;
pub use faults::OpenFaults;
pub use pace::{Eta, Paces};
pub use plate::PlateHandover;
pub use run::{EndRequest, HoldCause, RunState};

use crate::{Event, EventBody, EventData};

/// What the events say of the instrument.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InstrumentState {
    /// The newest run; none where no run is known.
    pub run: Option<RunState>,
    /// The plate and its handover.
    pub plate: PlateHandover,
    /// The faults that are not over.
    pub faults: OpenFaults,
    /// What the specimens of each method took.
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

    /// Takes in what happened.
    pub fn apply(&mut self, event: &EventBody) {
        self.plate.apply(&event.data);
        self.faults.apply(&event.data);
        self.paces.apply(event);
        match (&event.data, &event.run) {
            (EventData::RunAccepted(accepted), Some(id)) => self.run = Some(RunState::accepted(id, accepted.left_in_capillary.clone())),
            (_, Some(id)) => self.run.iter_mut().filter(|run| run.id() == id).for_each(|run| run.apply(event)),
            // What a loader says of a specimen whose run was removed from the disk belongs to no run there, but it is still so.
            (EventData::WellLoaded(_) | EventData::WellUnloaded, None) => self.run.iter_mut().for_each(|run| run.apply(event)),
            _ => {}
        }
    }
}
