//! A start: the devices' first word, and what an earlier life of the daemon left.

use super::super::status::{CameraStatus, TranslationStatus};
use super::{Running, recall};

impl Running {
    /// Puts the first word into the status. A disk that takes nothing is a fault, not the end of the daemon.
    pub(super) fn first_words(&mut self) {
        let second = self.instrument.as_ref().and_then(|i| i.second.as_ref()).map(|second| second.identity().to_owned());
        let identities = self.instrument.as_ref().map(|i| (i.rig.rotation.identity().to_owned(), i.rig.camera.identity().to_owned()));
        let has_translation = self.config.translation.is_some();
        let disk_free_bytes = self.store.free_bytes();
        let calibration = self.calibration();
        let tail = self.publisher.tail();
        let events = || tail.iter().map(AsRef::as_ref);
        let standing = recall::standing_faults(events());
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
        let told = self.event("daemon.started", None, started);
        self.keep(told);
        self.starting = false;
        if let Some(record) = open {
            let memory = recall::run(events(), &record.id);
            self.take_up(record, memory);
        } else {
            self.publish(|_| ());
        }
    }

    /// The newest run that was left open; an older one, or one of another kind of rig, is ended: it cannot go on here.
    fn open_runs(&mut self) -> Option<crate::store::RunRecord> {
        let mut open = match self.store.open_runs() {
            Ok(open) => open,
            Err(error) => {
                self.keep(Err(error));
                return None;
            }
        };
        let newest = open.pop_if(|run| run.mode == self.mode);
        for run in &mut open {
            let told = self.store.close_interrupted(run).and_then(|()| {
                let event = self.journal.append("run.interrupted", Some(&run.id), None, serde_json::json!({"found": "at start"}))?;
                self.publisher.announce(event);
                Ok(())
            });
            self.keep(told);
        }
        newest
    }
}
