//! The records of carved: plans and plate maps, wells and their numbers, faults, events, and the state that follows from the events.
//!
//! ```text
//!  plate map ──► RunPlan ──► a run ──► Event, Event, Event ...   one line each in events.jsonl
//!                                          │
//!                                          ▼  InstrumentState::apply, a pure function
//!              content of the capillary, cause of a hold, open faults, duration of a run
//! ```
//! The driver of a live run, a restart of the daemon and the index all read events through this crate, so they cannot disagree on what
//! an event means. The crate opens no file and reads no clock.

mod calibration;
mod concentration;
mod event;
mod fault;
mod handover;
mod hash;
mod instrument;
mod ledger;
mod light;
mod method;
mod note;
mod outcome;
pub mod picture_name;
mod plan;
mod plate;
pub mod plate_map;
mod policy;
mod reference;
mod same_pictures;
mod state;
mod treatment;
mod well;

pub use calibration::{CalibrationStatus, GateStatus, is_fresh, is_of_the_future};
pub use concentration::ConcentrationUnit;
pub use event::{
    Asked, AttemptFailed, DaemonStarted, DaemonStopping, Event, EventBody, EventData, FaultAcknowledged, FaultsCleared, HeldBy,
    JournalRepaired, LoadedBy, PhaseEntered, PlateNamed, RecoveryBegun, ResumedBy, RunAccepted, RunEnded, RunHeld, RunInterrupted,
    RunResumed, RunUnreadable, SensorReading, SpecimenDone, SpecimenInterrupted, ViewTaken, WellLoaded, kind,
};
pub use fault::table::{self as fault_table, ALL as FAULT_CODES, Category, FaultCode};
pub use fault::{Device, Fault, FaultEnd, RunUnderFault};
pub use handover::{Handoff, HandoffEnd, HandoffIntent};
pub use hash::sha256_hex;
pub use instrument::InstrumentIdentity;
pub use ledger::{Ledger, LedgerEntry, LedgerError, SecondEntry, Swept};
pub use light::Light;
pub use method::{CameraTooNear, Method, SweepSettings, ViewOrder};
pub use note::{SaidBy, WellNote};
pub use outcome::{Mode, Phase, RunOutcome, SchedulerAction, SpecimenOutcome};
pub use plan::{Control, FieldError, Metadata, PlannedWell, RunPlan, SpecimenKind, Versioned, is_plain_name};
pub use plate::{PlateFormat, is_well, name as well_name, place as well_place};
pub use policy::{BeadGate, Clipped, Deadlines, Interrupted, Policy, Resume};
pub use reference::{PlaceStatus, ReferenceStatus};
pub use same_pictures::{PicturesOfWells, SamePictures};
pub use state::{
    EndRequest, Eta, HoldCause, InstrumentState, NotNow, OpenFaults, Paces, PlateHandover, Report, Requests, RunState,
    SPECIMEN_TRANSITIONS, Situation, Specimen, SpecimenEvent, SpecimenState, Specimens, Work, specimens_as_markdown,
};
pub use well::{LiveEstimate, WellCounts, WellStatus, WellTimes};
