//! The plate inside. The instrument does not see plates: it relies on the loader that hands one over, and on the run of a person who put
//! one in by hand.

use crate::{EventData, Handoff, HandoffEnd};

/// The plate inside, the open handover, and how the newest handover ended.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct PlateHandover {
    inside: Option<String>,
    /// Whether the plate inside was handed over. A plate that was put in by hand is replaced without a message.
    is_handed_over: bool,
    open: Option<Handoff>,
    ended: Option<HandoffEnd>,
}

impl PlateHandover {
    /// Barcode of the plate inside: the newest one that was handed over or that a run was accepted for. `None` if it was taken away, or no
    /// plate is known.
    pub fn inside(&self) -> Option<&str> {
        self.inside.as_deref()
    }

    /// Barcode of the plate inside, if a loader handed it over. A run of another plate must then wait until it is taken away.
    pub fn handed_over(&self) -> Option<&str> {
        self.inside().filter(|_| self.is_handed_over)
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
                (self.inside, self.is_handed_over) = (Some(plate.barcode.clone()), true);
                self.end(HandoffEnd::Completed);
            }
            EventData::PlateUnloaded(_) => {
                (self.inside, self.is_handed_over) = (None, false);
                self.end(HandoffEnd::Completed);
            }
            EventData::PlateHandoffAborted(_) => self.end(HandoffEnd::Aborted),
            EventData::RunAccepted(run) => {
                // If a plate was handed over, a run is accepted only for this plate.
                if self.inside() != Some(&run.plate_barcode) {
                    (self.inside, self.is_handed_over) = (Some(run.plate_barcode.clone()), false);
                }
                // Early journals may lack the end of the handover.
                if self.open.is_some() {
                    (self.open, self.ended) = (None, None);
                }
            }
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
        let ended = Some(HandoffEnd::Completed);
        assert_eq!(after(&loaded), PlateHandover { inside: Some("P-1".into()), is_handed_over: true, open: None, ended });
        let unload = [&loaded[..], &[announced(HandoffIntent::Unload)]].concat();
        assert_eq!((after(&unload).inside(), after(&unload).ended()), (Some("P-1"), None));
        let kept = [&unload[..], &[EventData::PlateHandoffAborted(named())]].concat();
        assert_eq!((after(&kept).inside(), after(&kept).ended()), (Some("P-1"), Some(HandoffEnd::Aborted)));
        let gone = [&unload[..], &[EventData::PlateUnloaded(named())]].concat();
        assert_eq!(after(&gone), PlateHandover { ended: Some(HandoffEnd::Completed), ..PlateHandover::default() });
    }

    fn accepted(barcode: &str) -> EventData {
        EventData::RunAccepted(RunAccepted { plate_barcode: barcode.into(), method: "m".into(), ..RunAccepted::default() })
    }

    #[test]
    fn a_run_ends_a_handover_whose_end_is_missing() {
        let plate = after(&[announced(HandoffIntent::Load), accepted("P-1")]);
        assert_eq!((plate.inside(), plate.open(), plate.ended()), (Some("P-1"), None, None));
    }

    #[test]
    fn the_plate_of_a_run_is_inside_until_it_is_unloaded_or_a_run_of_another_plate_is_accepted() {
        let known = |events: &[EventData]| {
            let plate = after(events);
            (plate.inside().map(str::to_owned), plate.handed_over().map(str::to_owned))
        };
        let p = |barcode: &str| Some(barcode.to_owned());
        assert_eq!(known(&[accepted("P-1")]), (p("P-1"), None), "a person put it in");
        assert_eq!(known(&[accepted("P-1"), accepted("P-2")]), (p("P-2"), None), "and replaced it");
        assert_eq!(known(&[accepted("P-1"), EventData::PlateUnloaded(named())]), (None, None));
        assert_eq!(known(&[EventData::PlateLoaded(named()), accepted("P-1")]), (p("P-1"), p("P-1")), "it is still the loader's");
    }
}
