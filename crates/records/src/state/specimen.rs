//! Where one specimen is: a state machine that events drive.
//!
//! ```text
//!            ┌► Awaited ─ loader reports it ─► Untouched ─┐
//! Absent ─► Loading ───── sampler brings it ──────────────┴─► WorkedOn ─► Leaving ─► Released ─► Gone
//!            │ cut short                                        │ │         │ well done
//!            ├► Coming ─ restart ─► Unknown     fault: Kept ◄───┘ └► Left   └► Measured ─► Gone
//!            └► Late                            it stays inside       it must leave first
//! ```
//! The table has every transition. An event that it does not list for a state changes nothing. `docs/specimens.md` prints it.

use std::fmt::Write;

/// Defines an enum with the meaning of each value and the list of all values.
macro_rules! described {
    ($(#[$doc:meta])* $name:ident { $($(#[$default:meta])* $value:ident = $meaning:literal,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum $name {
            $($(#[$default])* #[doc = $meaning] $value,)*
        }

        impl $name {
            /// All values.
            pub const ALL: &[Self] = &[$(Self::$value,)*];

            /// What it means.
            pub fn meaning(self) -> &'static str {
                match self {
                    $(Self::$value => $meaning,)*
                }
            }
        }
    };
}

described! {
    /// Where the specimen of a well is, and whether an attempt at it is in progress.
    #[derive(Default)]
    SpecimenState {
        #[default]
        Absent = "It is on the plate. Nobody asked for it.",
        Loading = "Its load has begun. A driven sampler brings it.",
        Awaited = "The loader is asked for it, and a worker waits for it.",
        Asked = "The loader was asked for it. No worker waits for it. It is accepted when it comes.",
        Coming = "Its load was cut short. The sampler may still bring it, and then it belongs to this well.",
        Late = "The sampler did not bring it in time. It may still come, and then nobody knows its well.",
        Unknown = "Its load was cut short by a restart or by the run's end. It is inside or may still come. A run that goes on asks for it again.",
        Unasked = "A specimen of no known well is inside. No run asked for it.",
        Untouched = "It is inside. Work on it is about to begin.",
        Kept = "It is inside, and no attempt is in progress. The run continues with it.",
        WorkedOn = "It is inside and worked on.",
        Leaving = "The turn has ended. It is being ejected, or the loader may take it out.",
        Measured = "Its well is done. It is still inside.",
        OfEarlierRun = "It is inside, and is that of an earlier run. It must leave before this run begins with its own specimen of this well.",
        Left = "It is inside. The run does not continue with it, so it must leave.",
        Released = "It has left the capillary. Its well is not done.",
        Gone = "It was inside, or was reported as out. It has left the capillary.",
    }
}

described! {
    /// What happens to a specimen.
    SpecimenEvent {
        RunBegins = "A run begins or goes on. Its sampler looks for itself.",
        LeftBefore = "A run begins, and the specimen of an earlier run is still inside.",
        LoadBegun = "A worker begins to load it.",
        AskedFor = "The loader is asked for it.",
        AnotherAskedFor = "The loader or the sampler is asked for another one.",
        ReportedIn = "The loader reports that it is inside.",
        AnotherCameIn = "Another one is inside.",
        WorkBegun = "A worker positions it, detects it, turns it or measures it.",
        EjectBegun = "A worker begins to eject it.",
        Out = "A worker finds that it is not inside: it was ejected, or the capillary is empty.",
        ReportedOut = "The loader, or whoever took it out by hand, reports that it is out.",
        Done = "Its well has an outcome.",
        StaysInside = "A fault of the instrument interrupts the work on it. The run continues with it.",
        Interrupted = "The work on it is interrupted, or its well is skipped. It is begun again, or its well ends.",
        NumbersFollow = "It was accepted before an interruption. Its numbers are computed from its frames.",
        Held = "The run is held. No worker waits for a specimen.",
        Ended = "The run has ended.",
        EndedWhileAsked = "The run has ended, and a driven sampler was asked for it.",
        SamplerFailed = "The sampler fails: no specimen came in time, or one that nobody asked for.",
        RestartedWithLoader = "The daemon was restarted. A loader fills the capillary.",
        RestartedWithSampler = "The daemon was restarted. A driven sampler fills the capillary.",
        SeenUnasked = "The sampler's sensor shows a specimen that no run asked for.",
        SeenEmpty = "The sampler's sensor shows that this specimen is gone.",
    }
}

use SpecimenEvent as On;
use SpecimenState as S;

/// The transitions of each state, in the order of [`SpecimenState::ALL`].
pub const TRANSITIONS: &[(SpecimenState, &[(SpecimenEvent, SpecimenState)])] = &[
    (
        S::Absent,
        &[
            (On::LeftBefore, S::OfEarlierRun),
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::ReportedIn, S::Kept),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Left),
            (On::ReportedOut, S::Gone),
            (On::SeenUnasked, S::Unasked),
        ],
    ),
    (
        S::Loading,
        &[
            (On::AskedFor, S::Awaited),
            (On::AnotherAskedFor, S::Late),
            (On::ReportedIn, S::Untouched),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Leaving),
            (On::Out, S::Released),
            (On::ReportedOut, S::Gone),
            (On::Interrupted, S::Coming),
            (On::Held, S::Coming),
            (On::Ended, S::Coming),
            (On::SamplerFailed, S::Late),
            (On::RestartedWithLoader, S::Absent),
            (On::RestartedWithSampler, S::Unknown),
        ],
    ),
    (
        S::Awaited,
        &[
            (On::AnotherAskedFor, S::Absent),
            (On::ReportedIn, S::Untouched),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Leaving),
            (On::Interrupted, S::Asked),
            (On::Held, S::Asked),
            (On::Ended, S::Asked),
            (On::RestartedWithLoader, S::Asked),
        ],
    ),
    (
        S::Asked,
        &[
            (On::LoadBegun, S::Awaited),
            (On::AskedFor, S::Awaited),
            (On::AnotherAskedFor, S::Absent),
            (On::ReportedIn, S::Kept),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Left),
            (On::Interrupted, S::Absent),
        ],
    ),
    (
        S::Coming,
        &[
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::AnotherAskedFor, S::Late),
            (On::ReportedIn, S::Kept),
            (On::AnotherCameIn, S::Late),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Left),
            (On::ReportedOut, S::Gone),
            (On::EndedWhileAsked, S::Unknown),
            (On::SamplerFailed, S::Late),
            (On::RestartedWithLoader, S::Absent),
            (On::RestartedWithSampler, S::Unknown),
        ],
    ),
    (
        S::Late,
        &[
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::ReportedIn, S::Kept),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Left),
            (On::ReportedOut, S::Gone),
            (On::EndedWhileAsked, S::Unknown),
        ],
    ),
    (
        S::Unknown,
        &[
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::ReportedIn, S::Kept),
            (On::AnotherCameIn, S::Late),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Left),
            (On::ReportedOut, S::Gone),
            (On::RestartedWithLoader, S::Left),
        ],
    ),
    (S::Unasked, &[(On::RunBegins, S::Absent), (On::SeenEmpty, S::Absent)]),
    (
        S::Untouched,
        &[
            (On::AnotherCameIn, S::Gone),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Leaving),
            (On::ReportedOut, S::Gone),
            (On::Held, S::Kept),
            (On::Ended, S::Kept),
            (On::RestartedWithLoader, S::Kept),
            (On::RestartedWithSampler, S::Kept),
        ],
    ),
    (
        S::Kept,
        &[
            (On::LoadBegun, S::Untouched),
            (On::AnotherCameIn, S::Gone),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Left),
            (On::ReportedOut, S::Gone),
            (On::Interrupted, S::Left),
        ],
    ),
    (
        S::WorkedOn,
        &[
            (On::LoadBegun, S::Loading),
            (On::AnotherCameIn, S::Released),
            (On::EjectBegun, S::Leaving),
            (On::Out, S::Released),
            (On::ReportedOut, S::Released),
            (On::Done, S::Measured),
            (On::StaysInside, S::Kept),
            (On::Interrupted, S::Left),
            (On::NumbersFollow, S::Left),
            (On::Ended, S::Left),
        ],
    ),
    (
        S::Leaving,
        &[
            (On::LoadBegun, S::Loading),
            (On::AnotherCameIn, S::Released),
            (On::WorkBegun, S::WorkedOn),
            (On::Out, S::Released),
            (On::ReportedOut, S::Released),
            (On::Done, S::Measured),
            (On::StaysInside, S::Kept),
            (On::Interrupted, S::Left),
            (On::NumbersFollow, S::Left),
            (On::Ended, S::Left),
        ],
    ),
    (
        S::Measured,
        &[
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::AnotherCameIn, S::Gone),
            (On::WorkBegun, S::WorkedOn),
            (On::Out, S::Gone),
            (On::ReportedOut, S::Gone),
            (On::RestartedWithLoader, S::Left),
            (On::RestartedWithSampler, S::Left),
        ],
    ),
    (
        S::OfEarlierRun,
        &[
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::AnotherCameIn, S::Absent),
            (On::WorkBegun, S::WorkedOn),
            (On::Out, S::Absent),
            (On::ReportedOut, S::Absent),
        ],
    ),
    (
        S::Left,
        &[
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::AnotherCameIn, S::Gone),
            (On::WorkBegun, S::WorkedOn),
            (On::Out, S::Gone),
            (On::ReportedOut, S::Gone),
        ],
    ),
    (
        S::Released,
        &[
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::ReportedIn, S::Kept),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Leaving),
            (On::Done, S::Gone),
            (On::Interrupted, S::Gone),
            (On::Ended, S::Gone),
        ],
    ),
    (
        S::Gone,
        &[
            (On::LoadBegun, S::Loading),
            (On::AskedFor, S::Awaited),
            (On::ReportedIn, S::Kept),
            (On::WorkBegun, S::WorkedOn),
            (On::EjectBegun, S::Left),
        ],
    ),
];

impl SpecimenState {
    /// The state after an event.
    #[must_use]
    pub fn after(self, event: SpecimenEvent) -> Self {
        let row = TRANSITIONS.iter().find(|(state, _)| *state == self);
        let listed = row.and_then(|(_, row)| row.iter().find(|(on, _)| *on == event));
        listed.map_or(self, |(_, next)| *next)
    }

    /// Whether it is in the capillary as far as is known. It may be there in the state `Unknown`.
    pub fn is_inside(self) -> bool {
        use SpecimenState::{Kept, Leaving, Left, Measured, OfEarlierRun, Unasked, Untouched, WorkedOn};
        matches!(self, Unasked | Untouched | Kept | WorkedOn | Leaving | Measured | OfEarlierRun | Left)
    }

    /// Whether the loader was asked for it and has not brought it yet.
    pub fn is_asked_for(self) -> bool {
        matches!(self, Self::Awaited | Self::Asked)
    }

    /// Whether it is inside and the run continues with it.
    pub fn is_continued_with(self) -> bool {
        matches!(self, Self::Untouched | Self::Kept)
    }

    /// Whether an attempt at it is in progress.
    pub fn is_begun(self) -> bool {
        self.is_worked_on() || matches!(self, Self::Loading | Self::Awaited | Self::Untouched)
    }

    /// Whether it has come in this attempt, was worked on or ejected, and its well is not done.
    pub fn is_worked_on(self) -> bool {
        matches!(self, Self::WorkedOn | Self::Leaving | Self::Released)
    }

    /// Whether a worker may begin to work on it: it was loaded for its well, or the run continues with it.
    pub fn may_be_worked_on(self) -> bool {
        matches!(self, Self::Loading | Self::Awaited | Self::Untouched | Self::Kept | Self::WorkedOn)
    }

    /// Whether a driven sampler may bring it, or has brought it, and nobody knows.
    pub fn may_come(self) -> bool {
        matches!(self, Self::Coming | Self::Late | Self::Unknown)
    }

    /// Whether it shows that the specimen has been in the capillary during this run. That of an earlier run counts, so that a repeated report
    /// about it is known.
    fn has_come(self) -> bool {
        self == Self::Gone || self.is_worked_on() || self.is_inside()
    }
}

/// A specimen of a run: its state, and whether it has been in the capillary during this run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Specimen {
    state: SpecimenState,
    has_come: bool,
}

impl Specimen {
    /// A specimen that nothing has happened to.
    pub const ABSENT: Self = Self { state: SpecimenState::Absent, has_come: false };

    /// Its state.
    pub fn state(self) -> SpecimenState {
        self.state
    }

    /// Whether it has been in the capillary during this run, or was reported as out. A repeated report is then known.
    pub fn has_come(self) -> bool {
        self.has_come
    }

    /// The specimen after an event.
    #[must_use]
    pub fn after(self, event: SpecimenEvent) -> Self {
        let state = self.state.after(event);
        Self { state, has_come: self.has_come || state.has_come() }
    }
}

/// The states, events and transitions as tables of a page.
pub fn as_markdown() -> String {
    let mut page = String::from("| state | meaning |\n|---|---|\n");
    for state in SpecimenState::ALL {
        let _infallible = writeln!(page, "| {state:?} | {} |", state.meaning());
    }
    page.push_str("\n| event | meaning |\n|---|---|\n");
    for event in SpecimenEvent::ALL {
        let _infallible = writeln!(page, "| {event:?} | {} |", event.meaning());
    }
    page.push_str("\n| state | event: next state |\n|---|---|\n");
    for (state, row) in TRANSITIONS {
        let row: Vec<String> = row.iter().map(|(event, next)| format!("{event:?}: **{next:?}**")).collect();
        let _infallible = writeln!(page, "| {state:?} | {} |", row.join(", "));
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn the_table_has_one_row_per_state_and_one_transition_per_event() {
        let states: Vec<SpecimenState> = TRANSITIONS.iter().map(|(state, _)| *state).collect();
        assert_eq!(states, SpecimenState::ALL);
        for (state, row) in TRANSITIONS {
            let events: BTreeSet<SpecimenEvent> = row.iter().map(|(event, _)| *event).collect();
            assert_eq!(events.len(), row.len(), "{state:?}");
            assert!(row.iter().all(|(_, next)| next != state), "{state:?}: what changes nothing is not listed");
        }
        for event in SpecimenEvent::ALL {
            assert!(TRANSITIONS.iter().any(|(_, row)| row.iter().any(|(on, _)| on == event)), "{event:?} changes nothing");
        }
    }

    #[test]
    fn every_state_can_be_reached_and_led_out_of() {
        let step = |from: &BTreeSet<SpecimenState>| -> BTreeSet<SpecimenState> {
            from.iter().flat_map(|state| SpecimenEvent::ALL.iter().map(|event| state.after(*event))).collect()
        };
        let mut reached = BTreeSet::from([SpecimenState::Absent]);
        for _ in SpecimenState::ALL {
            reached.extend(step(&reached.clone()));
        }
        assert_eq!(reached.len(), SpecimenState::ALL.len());
        for state in SpecimenState::ALL.iter().filter(|state| state.is_inside()) {
            let leaves = [SpecimenEvent::ReportedOut, SpecimenEvent::SeenEmpty].iter().any(|event| !state.after(*event).is_inside());
            assert!(leaves, "{state:?}: nobody can report it as out");
        }
    }
}
