//! What the worker tells, as journal and status.

use super::super::state::Trigger;
use super::super::worker::Progress;
use super::super::{Live, Shown, SpecimenStatus, State, gate};
use super::Running;
use super::active::Request;
use super::publish::run_status;
use carved_records::{AttemptFailed, EventData, Phase, PhaseEntered, SpecimenDone, ViewTaken, WellStatus, WellTimes};

impl Running {
    pub(super) fn progress(&mut self, progress: Progress) {
        match progress {
            Progress::Ready => self.ready(),
            Progress::WaitingForLoader { well } => self.waits_for_loader(&well),
            Progress::Phase { well, phase, in_capillary } => self.phase(&well, phase, in_capillary),
            Progress::Detected { well, found, live } => {
                self.show(&well, 0, live);
                self.publish(|_| ());
                self.event(Some(&well), EventData::SpecimenDetected(found));
            }
            Progress::TriedAgain { well, attempt, why } => {
                let views_planned = self.active.as_ref().map_or(0, |active| active.record.method.asd);
                self.publish(|s| s.specimen = Some(SpecimenStatus::new(&well, Phase::Position, views_planned)));
                self.event(Some(&well), EventData::SpecimenTriedAgain(AttemptFailed { attempt, why }));
            }
            Progress::View { well, index, closure, achieved_steps, hull_volume_um3, estimate, light, live } => {
                let shown = self.publisher.status().specimen.as_ref().filter(|s| s.well == well).map(|s| s.view);
                // One that comes late belongs to a specimen that has made room for the next: it is journalled, and that is all.
                if let Some(before) = shown {
                    self.show(&well, before + u32::from(hull_volume_um3.is_some()), live);
                }
                let position_deg = self.config.steps_per_revolution.angle(carved_core::units::Steps(achieved_steps)).to_degrees();
                self.publish(|s| {
                    let Some(specimen) = s.specimen.as_mut().filter(|s| s.well == well) else { return };
                    s.hardware.rotation.position_steps = Some(achieved_steps);
                    s.hardware.rotation.position_deg = Some(position_deg);
                    s.hardware.camera.light = light;
                    specimen.tell(estimate);
                    if let Some(hull_volume_um3) = hull_volume_um3 {
                        specimen.view += 1;
                        specimen.hull_volumes_um3.push(hull_volume_um3);
                    }
                });
                let view = ViewTaken { index, closure, achieved_steps, hull_volume_um3, estimate };
                self.event(Some(&well), EventData::ViewTaken(view));
            }
            Progress::Measured { well, glb, end } => {
                // Once the next specimen is looked at, the pictures are that one's.
                self.publisher.set_live(|l| {
                    if l.shown.as_ref().is_some_and(|shown| shown.well == well) {
                        l.mesh_glb = glb.or(l.mesh_glb.take());
                    }
                });
                self.publish(|s| {
                    if let Some(specimen) = s.specimen.as_mut().filter(|s| s.well == well) {
                        specimen.tell(end);
                    }
                });
            }
            Progress::Hardware { rotation, translation, counters, second } => {
                let disk_free_bytes = self.store.free_bytes();
                self.publish(|s| {
                    s.hardware.rotation = rotation;
                    s.hardware.translation = translation;
                    s.hardware.disk_free_bytes = disk_free_bytes;
                    s.hardware.camera.count(&counters);
                    if let (Some(camera), Some(counters)) = (&mut s.hardware.camera_second, second) {
                        camera.count(&counters);
                    }
                });
            }
            Progress::WellDone { result, seconds, times } => self.well_done(result, seconds, times),
        }
    }

    /// The newest pictures, and whose they are.
    fn show(&self, well: &str, views: u32, live: Live) {
        let run = self.active.as_ref().map(|active| active.record.id.clone());
        let shown = run.map(|run| Shown { run, well: well.to_owned(), views });
        self.publisher.set_live(|l| *l = Live { shown, ..live });
    }

    fn ready(&mut self) {
        if matches!(self.publisher.status().state, State::Starting | State::Unholding) {
            self.go_with(Trigger::Ready, |s| {
                s.hardware.camera.connected = true;
                s.hardware.rotation.connected = true;
            });
        }
        self.event(None, EventData::RunStarted);
    }

    fn waits_for_loader(&mut self, well: &str) {
        if self.capillary().brought() == Some(well) {
            // Brought before the run went on. Not over a hold's word to the one who waits: it then stays until the run goes on again.
            if self.active.as_ref().is_some_and(|a| a.request == Request::Nothing) {
                self.gate.say_loaded(well);
            }
            return;
        }
        if let Some(active) = &mut self.active {
            active.waiting_for = Some(well.to_owned());
        }
        self.event_shown(Some(well), EventData::WellAwaited, |d| {
            if d.publisher.status().state == State::Execute {
                d.go(Trigger::WaitForLoader);
            } else {
                d.publish(|_| ());
            }
        });
    }

    fn phase(&mut self, well: &str, phase: Phase, in_capillary: bool) {
        let Some(active) = &self.active else { return };
        let views_planned = active.record.method.asd;
        self.event_shown(Some(well), EventData::SpecimenPhase(PhaseEntered { phase, in_capillary }), |d| {
            d.publish(|s| match &mut s.specimen {
                // Loaded, it begins anew: what an earlier attempt has shown is over.
                Some(specimen) if specimen.well == well && phase != Phase::Load => specimen.phase = phase,
                _ => s.specimen = Some(SpecimenStatus::new(well, phase, views_planned)),
            });
        });
    }

    /// All of a well is on disk; the next may be under way.
    fn well_done(&mut self, mut result: WellStatus, seconds: f64, times: WellTimes) {
        let Some(active) = &mut self.active else { return };
        gate::flag(&mut result, active.lacks_gate);
        if let Some(slot) = active.record.wells.iter_mut().find(|w| w.well == result.well) {
            slot.clone_from(&result);
        }
        let record = active.record.clone();
        let status = run_status(&record);
        // One revision: counters and phase change together, so that no reader sees a gap between two wells.
        let views_planned = active.record.method.asd;
        // A loader takes it out before it brings the next; where that is a sampler's work, one that is still there could not be taken out.
        let next = active.record.wells.iter().find(|w| w.outcome.is_none()).map(|w| w.well.clone());
        let stuck = self.capillary().inside() == Some(&result.well) && !self.loaded_from_outside;
        self.save(record);
        let well = result.well.clone();
        let done = SpecimenDone { result, times: Some(times), seconds: Some(seconds) };
        self.event_shown(Some(&well), EventData::SpecimenDone(Box::new(done)), |d| {
            d.publish(|s| {
                s.run = Some(status);
                // Where another is shown, it is brought already while the numbers of this one were made.
                if let Some(next) = next.filter(|_| !stuck && s.specimen.as_ref().is_none_or(|x| x.well == well)) {
                    s.specimen = Some(SpecimenStatus::new(&next, Phase::Load, views_planned));
                }
            });
        });
    }
}
