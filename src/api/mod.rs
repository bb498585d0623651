//! The types of the API: what `docs/openapi.json` describes.
//!
//! ```text
//!  carved-records (run.json, events.jsonl) ──── the same type ────► JSON of an answer, JSON of a request
//!                                           └── From ──► api ──┘   where clients see it in another form
//! ```
//! A type of the records is served as it is written to disk: its JSON is the same in both, and its documentation is that of the contract.
//! This module has only what the records do not have, or what clients see in another form. `session` builds its snapshots of these types,
//! once per revision; `http` serves them. The types that only one route uses stand beside that route.

mod event;
mod instrument;
mod plate_map;
mod status;

pub use carved_records::plate_map::Mistake;
pub use carved_records::{
    CalibrationStatus, Eta, Handoff, HandoffIntent, InstrumentIdentity, Light, Mode, Phase, PlannedWell, RunOutcome, RunPlan,
    SchedulerAction, SpecimenKind, SpecimenOutcome, WellCounts, WellStatus,
};
pub use event::Event;
pub use instrument::{Check, Fault, FaultCode, HandoffNeeds, MethodOffer};
pub use plate_map::PlateMap;
pub use status::{
    CameraStatus, HardwareStatus, Hold, NextCommand, NoticesStatus, OutputState, OutputStatus, Pending, Plate, QueuedPlate, RotationStatus,
    RunStatus, SpecimenStatus, State, Status, TranslationStatus, VolumeEstimate, VolumeWait,
};

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records as records;

    /// Clients that read the journal and clients that read the stream find the same text.
    #[test]
    fn an_event_is_served_as_the_journal_has_it() {
        let fault = records::Fault::new(7, &records::fault_table::DISK_FULL, "found".into(), "now".into());
        let body = records::EventBody { time: "t".into(), run: Some("r".into()), well: None, data: records::EventData::FaultRaised(fault) };
        let event = records::Event { id: 9, body };
        assert_eq!(serde_json::to_string(&Event::from(&event)).unwrap(), serde_json::to_string(&event).unwrap());
    }
}
