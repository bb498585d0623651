//! Plates handed over by the loader. The instrument does not see them; it holds the loader to its word.

use super::super::state::STARTABLE;
use super::super::{Plate, Refusal};
use super::Running;
use super::publish::to_be_taken_out;
use carved_records::{EventData, FieldError, Handoff, HandoffEnd, HandoffIntent, HandoffNeeds, PlateNamed, is_plain_name};

impl Running {
    /// Announces that a plate is to be moved, and says what has to happen first.
    pub(super) fn handoff(&mut self, plate: Handoff) -> Result<HandoffNeeds, Refusal> {
        if !is_plain_name(&plate.barcode) {
            let detail = format!("{:?} is not a barcode: use 1 to 64 letters, digits, '-', '_' or '.', the first not a '.'", plate.barcode);
            return Err(Refusal::InvalidHandoff(vec![FieldError { pointer: "/barcode".into(), detail }]));
        }
        let status = self.publisher.status();
        let inside = status.plate.barcode.clone().filter(|_| status.plate.present);
        if let Some(inside) = inside.filter(|inside| *inside != plate.barcode) {
            return Err(Refusal::OtherBarcode { expected: inside, found: plate.barcode });
        }
        if plate.intent == HandoffIntent::Load && (self.active.is_some() || !STARTABLE.contains(&status.state)) {
            return Err(Refusal::WrongState { state: status.state, accepted_in: STARTABLE.to_vec() });
        }
        if self.state().plate.open() != Some(&plate) {
            self.promise(None, EventData::PlateAnnounced(plate.clone()))?;
            self.publish(|_| ());
        }
        Ok(HandoffNeeds { intent: plate.intent, needs: self.before_the_plate(), barcode: plate.barcode })
    }

    /// What has to happen before a plate is moved.
    fn before_the_plate(&self) -> Option<String> {
        if self.active.is_some() {
            return Some("the run to end".into());
        }
        if self.outbox.is_failing() {
            return Some("the disk to take what is not written yet".into());
        }
        self.capillary().inside().map(to_be_taken_out)
    }

    pub(super) fn end_handoff(&mut self, end: HandoffEnd) -> Result<(), Refusal> {
        let Some(plate) = self.state().plate.open().cloned() else {
            return if self.state().plate.ended() == Some(end) { Ok(()) } else { Err(Refusal::NoHandoff) };
        };
        let moved = end == HandoffEnd::Completed;
        if let Some(needs) = self.before_the_plate().filter(|_| moved) {
            return Err(Refusal::PlateNeeded { needs });
        }
        let named = PlateNamed { barcode: plate.barcode };
        let data = match (end, plate.intent) {
            (HandoffEnd::Aborted, _) => EventData::PlateHandoffAborted(named),
            (HandoffEnd::Completed, HandoffIntent::Load) => EventData::PlateLoaded(named),
            (HandoffEnd::Completed, HandoffIntent::Unload) => EventData::PlateUnloaded(named),
        };
        self.promise(None, data)?;
        if moved {
            let inside = self.state().plate.inside().map(str::to_owned);
            self.publish(|s| s.plate = Plate { present: inside.is_some(), barcode: inside, ..Plate::default() });
        } else {
            self.publish(|_| ());
        }
        Ok(())
    }
}
