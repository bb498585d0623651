//! The types of the API: what `docs/openapi.json` describes, and nothing that is written to disk.
//!
//! ```text
//!  carved-records (run.json, events.jsonl) ──► From ──► api ──► JSON of an answer
//!                                           ◄── From ◄──     ◄── JSON of a request
//! ```
//! Each conversion names every field, so a field that the records gain does not compile before somebody decides whether clients see
//! it. A field that clients gain changes no file. Recordings, measurements and the data of events are served as the files have them. `session` builds its snapshots of these types, once per revision; `http` serves
//! them. The types that only one route uses stand beside that route.

mod event;
mod instrument;
mod run;
mod status;
mod words;

pub use event::Event;
pub use instrument::{
    CalibrationStatus, Check, Fault, FaultCode, GateStatus, Handoff, HandoffNeeds, InstrumentIdentity, Light, MethodOffer,
};
pub use run::{Eta, Mistake, PlaceStatus, PlannedWell, PlateMap, ReferenceStatus, RunPlan, WellCounts, WellStatus};
pub use status::{
    CameraStatus, HardwareStatus, Hold, NextCommand, NoticesStatus, OutputState, OutputStatus, Pending, Plate, RotationStatus, RunStatus,
    SpecimenStatus, State, Status, TranslationStatus, VolumeEstimate, VolumeWait,
};
pub use words::{
    Category, ConcentrationUnit, Control, HandoffIntent, Mode, Phase, RunOutcome, SchedulerAction, SpecimenKind, SpecimenOutcome,
};

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records as records;
    use serde::Serialize;
    use serde_json::json;

    fn same<A: Serialize>(served: impl Serialize, recorded: &A) {
        assert_eq!(serde_json::to_string(&served).unwrap(), serde_json::to_string(recorded).unwrap());
    }

    /// Clients that read a run's files and clients that read the API find the same text.
    #[test]
    fn what_is_served_has_the_form_of_what_is_written() {
        let place = json!({"words": "w", "group": "g", "n": 24, "z": -0.8, "percentile": 21.5, "mismatches": ["age"]});
        let well = json!({
            "well": "A01", "specimen": "bead", "dpf": 3.0, "outcome": "succeeded", "reason": "r", "flags": ["bead_gate"],
            "estimator": "support", "volume_um3": 2e8, "volume_sd_um3": 1e6, "area_um2": 3e6, "area_sd_um2": 2e4,
            "field_volume_um3": 2.1e8, "field_area_um2": 3.1e6, "diameter_um": 600.0, "views": 20, "views_planned": 21,
            "residual_px": 0.2, "signal_per_nl": 4.5, "reference": {"volume": place, "area": place},
        });
        let well: records::WellStatus = serde_json::from_value(well).unwrap();
        same(WellStatus::from(well.clone()), &well);
        let counts = records::WellCounts { succeeded: 1, flagged: 2, failed: 3, skipped: 4, interrupted: 5, pending: 6, total: 21 };
        same(WellCounts::from(counts), &counts);
        let gate =
            json!({"id": "g", "verdict": "passed", "measured": "m", "max_age_s": 1.0, "stands": true, "summary": "s", "words": ["w"]});
        let calibration = json!({
            "id": "c", "kind": "beads", "measured": "m", "age_s": 2.0, "max_age_s": 3.0, "bead_bias_percent": 0.1, "valid": true, "gate": gate,
        });
        let calibration: records::CalibrationStatus = serde_json::from_value(calibration).unwrap();
        same(CalibrationStatus::from(calibration.clone()), &calibration);
        let fault = records::Fault::new(7, &records::fault_table::DISK_FULL, "found".into(), "now".into());
        let body = records::EventBody { time: "t".into(), run: Some("r".into()), well: None, data: records::EventData::FaultRaised(fault) };
        let event = records::Event { id: 9, body };
        same(Event::from(&event), &event);
    }

    #[test]
    fn a_plan_is_stored_as_it_was_sent() {
        let sent = json!({
            "plate_barcode": "P-1", "method": "standard", "method_version": "3", "operator": "kim", "external_id": "x",
            "plate_map": [{
                "well": "A01", "specimen": "larva", "dpf": 3.0, "compound": "c", "concentration": 1.5, "concentration_unit": "ug/mL",
                "strain": "s", "treatment": "t", "control": "negative", "replicate": 2,
            }],
            "metadata": {"Investigation": {"title": "t"}},
        });
        let plan: RunPlan = serde_json::from_value(sent.clone()).unwrap();
        let stored = records::RunPlan::from(plan.clone());
        assert_eq!(serde_json::to_value(&stored).unwrap(), sent);
        assert_eq!(RunPlan::from(stored), plan);
    }

    #[test]
    fn a_word_is_the_same_in_a_request_a_record_and_an_answer() {
        for unit in records::ConcentrationUnit::ALL {
            let served = ConcentrationUnit::from(unit);
            same(served, &unit);
            assert_eq!(records::ConcentrationUnit::from(served), unit);
        }
    }
}
