//! The plate that the loader handed over. The instrument does not see plates, and relies on the loader.

use crate::{EventData, Handoff, HandoffEnd};

/// The plate inside, the open handover, and how the newest handover ended.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PlateHandover {
    inside: Option<String>,
    open: Option<Handoff>,
    ended: Option<HandoffEnd>,
}

impl PlateHandover {
    /// Barcode of the plate inside. `None` if it was taken away or never handed over.
    pub fn inside(&self) -> Option<&str> {
        self.inside.as_deref()
    }

    /// The handover that was announced and has not ended.
    pub fn open(&self) -> Option<&Handoff> {
        self.open.as_ref()
    }

    /// How the newest handover ended. `None` while one is open.
    pub fn ended(&self) -> Option<HandoffEnd> {
        self.ended
    }

    fn end(&mut self, end: HandoffEnd) {
        (self.open, self.ended) = (None, Some(end));
    }

    pub(super) fn apply(&mut self, event: &EventData) {
        match event {
            EventData::PlateAnnounced(plate) => (self.open, self.ended) = (Some(plate.clone()), None),
            EventData::PlateLoaded(plate) => {
                self.inside = Some(plate.barcode.clone());
                self.end(HandoffEnd::Completed);
            }
            EventData::PlateUnloaded(_) => {
                self.inside = None;
                self.end(HandoffEnd::Completed);
            }
            EventData::PlateHandoffAborted(_) => self.end(HandoffEnd::Aborted),
            // A run is accepted only for the plate inside. Early journals may lack the end of the handover.
            EventData::RunAccepted(_) if self.open.is_some() => (self.open, self.ended) = (None, None),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HandoffIntent, PlateNamed, RunAccepted};

    fn after(events: &[EventData]) -> PlateHandover {
        let mut plate = PlateHandover::default();
        for event in events {
            plate.apply(event);
        }
        plate
    }

    fn named() -> PlateNamed {
        PlateNamed { barcode: "P-1".into() }
    }

    fn announced(intent: HandoffIntent) -> EventData {
        EventData::PlateAnnounced(Handoff { intent, barcode: "P-1".into() })
    }

    #[test]
    fn a_plate_is_inside_from_the_end_of_one_handover_to_the_end_of_the_next() {
        let load = [announced(HandoffIntent::Load)];
        assert_eq!((after(&load).inside(), after(&load).open().map(|h| h.intent)), (None, Some(HandoffIntent::Load)));
        let loaded = [&load[..], &[EventData::PlateLoaded(named())]].concat();
        assert_eq!(after(&loaded), PlateHandover { inside: Some("P-1".into()), open: None, ended: Some(HandoffEnd::Completed) });
        let unload = [&loaded[..], &[announced(HandoffIntent::Unload)]].concat();
        assert_eq!((after(&unload).inside(), after(&unload).ended()), (Some("P-1"), None));
        let kept = [&unload[..], &[EventData::PlateHandoffAborted(named())]].concat();
        assert_eq!((after(&kept).inside(), after(&kept).ended()), (Some("P-1"), Some(HandoffEnd::Aborted)));
        let gone = [&unload[..], &[EventData::PlateUnloaded(named())]].concat();
        assert_eq!(after(&gone), PlateHandover { ended: Some(HandoffEnd::Completed), ..PlateHandover::default() });
    }

    #[test]
    fn a_run_ends_a_handover_whose_end_is_missing() {
        let accepted = RunAccepted { plate_barcode: "P-1".into(), method: "m".into(), left_in_capillary: None };
        assert_eq!(after(&[announced(HandoffIntent::Load), EventData::RunAccepted(accepted)]), PlateHandover::default());
    }
}
