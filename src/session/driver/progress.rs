//! How the worker's progress appears in the status.

use super::super::{OutputStatus, RotationStatus, RunStatus, SpecimenStatus, Status, TranslationStatus};
use crate::api::{VolumeEstimate, VolumeWait};
use carved_devices::StreamCounters;
use carved_records::Light;
use carved_records::{LiveEstimate, Phase};

/// A view, as the status shows it.
pub(super) struct View {
    pub achieved_steps: i64,
    pub position_deg: f64,
    /// `None` if the view is not part of the model.
    pub hull_volume_um3: Option<f64>,
    pub estimate: LiveEstimate,
    /// Why there is no estimate yet.
    pub wait: Option<VolumeWait>,
    pub light: Option<Light>,
}

fn specimen<'a>(s: &'a mut Status, well: &str) -> Option<&'a mut SpecimenStatus> {
    s.specimen.as_mut().filter(|specimen| specimen.well == well)
}

/// Shows a view of the current specimen. A late view of another specimen changes nothing.
pub(super) fn show_view(s: &mut Status, well: &str, view: &View) {
    let Some(specimen) = specimen(s, well) else { return };
    specimen.volume_wait = view.wait;
    specimen.set_estimate(view.estimate);
    VolumeEstimate::take(&mut specimen.estimates, view.estimate);
    if let Some(hull_volume_um3) = view.hull_volume_um3 {
        specimen.view += 1;
        specimen.hull_volumes_um3.push(hull_volume_um3);
    }
    s.hardware.rotation.position_steps = Some(view.achieved_steps);
    s.hardware.rotation.position_deg = Some(view.position_deg);
    s.hardware.camera.light = view.light;
}

/// Shows the numbers of a specimen, unless the status shows another specimen by now.
pub(super) fn show_estimate(s: &mut Status, well: &str, estimate: LiveEstimate) {
    if let Some(specimen) = specimen(s, well) {
        specimen.set_estimate(estimate);
    }
}

/// Shows the phase of a specimen. A load starts a new attempt and clears what an earlier attempt has shown.
pub(super) fn show_phase(s: &mut Status, well: &str, phase: Phase, views_planned: u32) {
    match specimen(s, well).filter(|_| phase != Phase::Load) {
        Some(specimen) => specimen.phase = phase,
        None => s.specimen = Some(SpecimenStatus::new(well, phase, views_planned)),
    }
}

/// Shows the run after a well is done, and the next specimen. If another specimen is shown already, it arrived while the numbers of this
/// one were computed.
pub(super) fn show_done(s: &mut Status, run: RunStatus, well: &str, next: Option<SpecimenStatus>) {
    s.run = Some(run);
    if let Some(next) = next.filter(|_| s.specimen.as_ref().is_none_or(|shown| shown.well == well)) {
        s.specimen = Some(next);
    }
}

/// What a worker reports about the devices.
pub(super) struct Hardware {
    pub rotation: RotationStatus,
    pub translation: Option<TranslationStatus>,
    pub outputs: Vec<OutputStatus>,
    pub counters: StreamCounters,
    /// Counters of the second camera. `None` without one.
    pub second: Option<StreamCounters>,
    pub disk_free_bytes: Option<u64>,
}

/// Shows the state of the devices.
pub(super) fn show_hardware(s: &mut Status, found: Hardware) {
    s.hardware.rotation = found.rotation;
    s.hardware.translation = found.translation;
    s.hardware.outputs = found.outputs;
    s.hardware.disk_free_bytes = found.disk_free_bytes;
    s.hardware.camera.count(&found.counters);
    if let (Some(camera), Some(counters)) = (&mut s.hardware.camera_second, found.second) {
        camera.count(&counters);
    }
}

#[cfg(test)]
mod tests {
    use super::super::run::tests::run;
    use super::super::snapshot::run_status;
    use super::*;
    use crate::session::Driver;
    use carved_records::Mode;

    fn shows(well: &str) -> Status {
        let mut s = Driver::first_status(Mode::Simulated, "b".into());
        s.specimen = Some(SpecimenStatus::new(well, Phase::Revolve, 21));
        s
    }

    fn view() -> View {
        View {
            achieved_steps: 7,
            position_deg: 1.5,
            hull_volume_um3: Some(3e8),
            estimate: LiveEstimate { volume_um3: Some(2e8), volume_views: Some(7), ..LiveEstimate::default() },
            wait: None,
            light: None,
        }
    }

    #[test]
    fn a_view_counts_for_the_specimen_that_is_shown_and_no_other() {
        let mut s = shows("A02");
        let before = s.clone();
        show_view(&mut s, "A01", &view());
        show_estimate(&mut s, "A01", view().estimate);
        assert_eq!(s, before);
        show_view(&mut s, "A02", &view());
        assert_eq!(s.specimen.as_ref().map(|x| (x.estimates.len(), x.volume_wait)), Some((1, None)));
        show_view(
            &mut s,
            "A02",
            &View { hull_volume_um3: None, estimate: LiveEstimate::default(), wait: Some(VolumeWait::Slices), ..view() },
        );
        assert_eq!(s.specimen.as_ref().map(|x| (x.estimates.len(), x.volume_wait)), Some((1, Some(VolumeWait::Slices))));
        show_view(&mut s, "A02", &View { hull_volume_um3: None, ..view() });
        let specimen = s.specimen.unwrap();
        assert_eq!((specimen.view, specimen.hull_volumes_um3, specimen.volume_um3), (1, vec![3e8], Some(2e8)));
        assert_eq!(s.hardware.rotation.position_steps, Some(7));
    }

    #[test]
    fn a_specimen_that_is_loaded_again_is_shown_from_its_first_view_on() {
        let mut s = shows("A01");
        show_view(&mut s, "A01", &view());
        show_phase(&mut s, "A01", Phase::Measure, 21);
        assert_eq!(s.specimen.as_ref().map(|x| (x.phase, x.view)), Some((Phase::Measure, 1)));
        show_phase(&mut s, "A01", Phase::Load, 21);
        assert_eq!(s.specimen.as_ref().map(|x| (x.phase, x.view)), Some((Phase::Load, 0)));
        show_phase(&mut s, "A02", Phase::Load, 21);
        assert_eq!(s.specimen.unwrap().well, "A02");
    }

    #[test]
    fn the_next_specimen_takes_the_place_of_the_one_that_is_done() {
        let run = run_status(run(&["A01", "A02", "A03"]).record());
        let next = || Some(SpecimenStatus::new("A03", Phase::Load, 21));
        let shown = |mut s: Status, next| {
            show_done(&mut s, run.clone(), "A01", next);
            s.specimen.unwrap().well
        };
        assert_eq!(shown(shows("A01"), next()), "A03");
        assert_eq!(shown(shows("A02"), next()), "A02", "it was brought meanwhile");
        assert_eq!(shown(shows("A01"), None), "A01");
    }
}
