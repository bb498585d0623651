//! A start: the devices' first word, and what an earlier life of the daemon left.

use super::super::status::{CameraStatus, TranslationStatus};
use super::{Event, Running, kind, recall};
use crate::store::RunRecord;

impl Running {
    /// Puts the first word into the status. A disk that takes nothing is a fault, not the end of the daemon.
    pub(super) fn first_words(&mut self) {
        let second = self.instrument.as_ref().and_then(|i| i.second.as_ref()).map(|second| second.identity().to_owned());
        let identities = self.instrument.as_ref().map(|i| (i.rig.rotation.identity().to_owned(), i.rig.camera.identity().to_owned()));
        let has_translation = self.config.translation.is_some();
        let disk_free_bytes = self.store.free_bytes();
        let calibration = self.calibration();
        let standing = std::mem::take(&mut self.standing);
        let inside = self.plate_inside.clone();
        let open = self.open_runs();
        self.publish(|s| {
            s.calibration = calibration;
            if let Some((rotation, camera)) = identities {
                s.hardware.translation = has_translation.then(TranslationStatus::default);
                s.hardware.find_axes(&rotation);
                s.hardware.camera.identity = Some(camera);
                s.hardware.camera.connected = true;
            }
            s.hardware.camera_second =
                second.map(|identity| CameraStatus { identity: Some(identity), connected: true, ..CameraStatus::default() });
            s.hardware.disk_free_bytes = disk_free_bytes;
            s.faults = standing;
            s.plate.present = inside.is_some();
            s.plate.barcode = inside;
        });
        let started = serde_json::json!({"version": env!("CARGO_PKG_VERSION"), "mode": self.mode});
        self.event(kind::DAEMON_STARTED, None, started);
        self.starting = false;
        if let Some(record) = open {
            let memory = recall::run(self.events_of(&record.id).iter(), &record.id);
            self.take_up(record, memory);
        } else if let Some(record) = self.ended_run() {
            self.show_again(&record);
        } else {
            self.publish(|_| ());
        }
    }

    fn events_of(&self, run: &str) -> Vec<Event> {
        self.store.events_of(run).unwrap_or_else(|error| {
            tracing::error!(%error, run, "what happened in the run cannot be read");
            self.publisher.tail().iter().map(|event| Event::clone(event)).collect()
        })
    }

    /// The newest run, where it is over: what it has left in the capillary is there still.
    fn ended_run(&self) -> Option<RunRecord> {
        let newest = self.store.newest_run(self.mode).unwrap_or_else(|error| {
            tracing::warn!(%error, "the newest run is not shown");
            None
        });
        newest.filter(|run| run.outcome.is_some())
    }

    /// An ended run as it was shown before the daemon ended: until the next one starts.
    fn show_again(&mut self, record: &RunRecord) {
        let events = self.events_of(&record.id);
        let memory = recall::run(events.iter(), &record.id);
        // No plate is taken away while a run goes on; the loader's word may come after both.
        let accepted = events.first().map_or(0, |event| event.id);
        let tail = self.publisher.tail();
        let plate_is_away = tail.iter().any(|event| event.kind == kind::PLATE_UNLOADED && event.id > accepted);
        let state = memory.rests_in(record.outcome);
        self.occupant = memory.in_capillary;
        (self.asked_for, self.brought, self.been_inside) = (memory.asked_for, memory.brought, memory.been_inside);
        let barcode = record.plan.plate_barcode.clone();
        let change = self.over(record);
        self.publish(|s| {
            change(s);
            s.state = state;
            if !s.plate.present && !plate_is_away {
                s.plate.present = true;
                s.plate.barcode = Some(barcode);
            }
        });
    }

    /// The newest run that was left open; an older one, or one of another kind of rig, is ended: it cannot go on here.
    fn open_runs(&mut self) -> Option<RunRecord> {
        let mut open = match self.store.open_runs() {
            Ok(open) => open,
            Err(error) => {
                self.keep(Err(error));
                return None;
            }
        };
        let newest = open.pop_if(|run| run.mode == self.mode);
        for mut run in open {
            self.seal_run(&run.id);
            run.end_interrupted();
            let id = run.id.clone();
            self.save(run);
            self.event_of(Some(&id), kind::RUN_INTERRUPTED, None, serde_json::json!({"found": "at start"}));
        }
        newest
    }
}
