//! Plate handovers. The instrument does not see plates. It checks that the loader does what it announced.

use super::super::state::STARTABLE;
use super::super::{Refusal, State};
use carved_records::{EventData, FieldError, Handoff, HandoffEnd, HandoffIntent, PlateHandover, PlateNamed, Specimens, is_plain_name};

/// The state that decides about a handover, beside the handover itself.
pub(super) struct Surroundings<'a> {
    pub state: State,
    /// A run exists that has no outcome yet.
    pub has_run: bool,
    pub specimens: &'a Specimens,
    /// A specimen that no run requested is in the capillary.
    pub has_unexpected: bool,
    /// Some events or records are not on disk yet.
    pub is_failing: bool,
}

impl Surroundings<'_> {
    /// What must happen before the plate is moved. `None` if nothing. The plate is removable by this rule and no other.
    pub fn needs(&self) -> Option<String> {
        if self.has_run {
            return Some("the run to end".into());
        }
        if self.is_failing {
            return Some("the disk to take what is not written yet".into());
        }
        if let Some(unexpected) = self.unexpected() {
            return Some(unexpected);
        }
        match self.specimens.unknown() {
            Some(well) => Some(format!("{}, or the report that it does not come", to_be_taken_out(well))),
            None => self.specimens.inside().map(to_be_taken_out),
        }
    }

    /// The request to take out a specimen that no run asked for, if one is in the capillary.
    pub fn unexpected(&self) -> Option<String> {
        self.has_unexpected.then(|| "the specimen that no run asked for to be taken out of the capillary".into())
    }

    /// Whether this announcement is a new one.
    ///
    /// # Errors
    /// The barcode is not a valid name, another plate is inside, or a run is in progress.
    pub fn announce(&self, known: &PlateHandover, plate: &Handoff) -> Result<bool, Refusal> {
        if !is_plain_name(&plate.barcode) {
            let detail = format!("{:?} is not a barcode: use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'", plate.barcode);
            return Err(Refusal::InvalidHandoff(vec![FieldError { pointer: "/barcode".into(), detail }]));
        }
        if let Some(inside) = known.inside().filter(|inside| *inside != plate.barcode) {
            return Err(Refusal::PlateInside { intent: plate.intent, inside: inside.to_owned(), found: plate.barcode.clone() });
        }
        if plate.intent == HandoffIntent::Load && (self.has_run || !STARTABLE.contains(&self.state)) {
            return Err(Refusal::WrongState { state: self.state, accepted_in: STARTABLE.to_vec() });
        }
        Ok(known.open() != Some(plate))
    }

    /// The event that ends the open handover. `None` if it has ended in this way already.
    ///
    /// # Errors
    /// No handover is open, or something must happen before the plate is moved.
    pub fn end(&self, known: &PlateHandover, end: HandoffEnd) -> Result<Option<EventData>, Refusal> {
        let Some(plate) = known.open() else {
            return if known.ended() == Some(end) { Ok(None) } else { Err(Refusal::NoHandoff) };
        };
        if let Some(needs) = self.needs().filter(|_| end == HandoffEnd::Completed) {
            return Err(Refusal::PlateNeeded { needs });
        }
        let named = PlateNamed { barcode: plate.barcode.clone() };
        Ok(Some(match (end, plate.intent) {
            (HandoffEnd::Aborted, _) => EventData::PlateHandoffAborted(named),
            (HandoffEnd::Completed, HandoffIntent::Load) => EventData::PlateLoaded(named),
            (HandoffEnd::Completed, HandoffIntent::Unload) => EventData::PlateUnloaded(named),
        }))
    }
}

/// A request to the loader, as text.
pub(super) fn to_be_taken_out(well: &str) -> String {
    format!("the specimen of well {well} to be taken out of the capillary")
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_records::{EventBody, InstrumentState};

    const EMPTY: &Specimens = &Specimens::none();
    const AT_REST: Surroundings =
        Surroundings { state: State::Idle, has_run: false, specimens: EMPTY, has_unexpected: false, is_failing: false };

    fn handoff(intent: HandoffIntent, barcode: &str) -> Handoff {
        Handoff { intent, barcode: barcode.into() }
    }

    fn after(events: &[EventData]) -> PlateHandover {
        let mut state = InstrumentState::default();
        for data in events {
            state.apply(&EventBody { time: String::new(), run: None, well: None, data: data.clone() });
        }
        state.plate
    }

    #[test]
    fn a_plate_is_announced_once_and_not_while_another_one_is_inside_or_a_run_is_under_way() {
        let load = handoff(HandoffIntent::Load, "P-1");
        let announced = after(&[EventData::PlateAnnounced(load.clone())]);
        assert_eq!(AT_REST.announce(&PlateHandover::default(), &load), Ok(true));
        assert_eq!(AT_REST.announce(&announced, &load), Ok(false));
        assert!(matches!(AT_REST.announce(&announced, &handoff(HandoffIntent::Load, "P/1")), Err(Refusal::InvalidHandoff(_))));
        let other = after(&[EventData::PlateLoaded(PlateNamed { barcode: "P-2".into() })]);
        let refused = AT_REST.announce(&other, &load).unwrap_err().to_string();
        assert_eq!(refused, "plate P-2 is still inside: hand it over with intent unload and its barcode P-2, then load P-1");
        let refused = AT_REST.announce(&other, &handoff(HandoffIntent::Unload, "P-1")).unwrap_err().to_string();
        assert!(refused.ends_with("barcode P-2, not P-1"), "{refused}");
        let runs = Surroundings { state: State::Execute, has_run: true, ..AT_REST };
        assert!(matches!(runs.announce(&announced, &load), Err(Refusal::WrongState { .. })));
        assert_eq!(runs.announce(&announced, &handoff(HandoffIntent::Unload, "P-1")), Ok(true), "it waits for the end of the run");
    }

    #[test]
    fn a_plate_is_moved_once_nothing_needs_it_and_a_handover_may_be_called_off_at_any_time() {
        let open = after(&[EventData::PlateAnnounced(handoff(HandoffIntent::Unload, "P-1"))]);
        for (waits, word) in [
            (Surroundings { has_run: true, ..AT_REST }, "run"),
            (Surroundings { is_failing: true, ..AT_REST }, "disk"),
            (Surroundings { has_unexpected: true, ..AT_REST }, "no run asked for"),
        ] {
            assert!(matches!(waits.end(&open, HandoffEnd::Completed), Err(Refusal::PlateNeeded { needs }) if needs.contains(word)));
            assert!(matches!(waits.end(&open, HandoffEnd::Aborted), Ok(Some(EventData::PlateHandoffAborted(_)))));
        }
        let gone = AT_REST.end(&open, HandoffEnd::Completed).unwrap().unwrap();
        assert!(matches!(gone, EventData::PlateUnloaded(_)));
        let ended = after(&[EventData::PlateAnnounced(handoff(HandoffIntent::Unload, "P-1")), gone]);
        assert_eq!(AT_REST.end(&ended, HandoffEnd::Completed), Ok(None));
        assert_eq!(AT_REST.end(&ended, HandoffEnd::Aborted), Err(Refusal::NoHandoff));
    }
}
