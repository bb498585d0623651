//! The checks before a run. Every failed check is reported, with what to do.
//!
//! ```text
//! blocking thread: look ──► check the axis, take and judge one frame ──► DeviceReport
//! driver: checks(plan, DeviceReport, Known) ──► [code, passed, blocks, detail, what to do]
//! ```

use super::Instrument;
use super::{Check, gate, live};
use crate::api::NoticesStatus;
use crate::config::Config;
use carved_core::frame::RawFrame;
use carved_core::profile::Picture;
use carved_core::statistics::upper_median;
use carved_devices::acquisition::{AcquisitionError, SweepPlan, grab};
use carved_devices::cancel::CancelToken;
use carved_devices::outputs::{self, OutputUse};
use carved_devices::{DeviceError, Position};
use carved_records::{BeadGate, Fault, GateStatus, Light, Method, Mode, PlannedWell, RunPlan, SpecimenKind};
use carved_store::{Budget, bytes_per_specimen, size};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// The state of the devices.
pub struct DeviceReport {
    axis: Result<(), DeviceError>,
    /// The axis has found its reference.
    is_referenced: bool,
    /// `None` if the pictures need no output.
    outputs: Option<Result<(), DeviceError>>,
    /// `None` if another program takes the pictures.
    light: Result<Option<Light>, DeviceError>,
    /// Whether axis and camera can do the sweep of the method. `None` for a method with stops, or if one of them does not answer.
    sweep: Option<Result<SweepPlan, AcquisitionError>>,
    /// The frame that the light was judged by.
    frame: Option<RawFrame>,
}

impl DeviceReport {
    /// The frame as JPEG.
    ///
    /// # Errors
    /// Why there is none.
    pub fn picture(&self) -> Result<Arc<Vec<u8>>, String> {
        if let Some(Err(error)) = &self.outputs {
            return Err(error.to_string());
        }
        match (&self.frame, &self.light) {
            (Some(frame), _) => live::jpeg(&Picture::from_frame(frame)).ok_or_else(|| "the frame could not be encoded".to_owned()),
            (None, Err(error)) => Err(error.to_string()),
            (None, Ok(_)) => Err("another program takes the pictures of this instrument".to_owned()),
        }
    }

    /// An intervention of a person or a safety circuit. Some controllers report it only once.
    pub fn intervention(&self) -> Option<&DeviceError> {
        self.axis.as_ref().err().filter(|error| error.is_in_a_persons_hands())
    }
}

/// Checks the axis and takes a frame. Nothing moves. `cancel` ends the wait for a steady light and for the frame.
pub fn look(mut instrument: Instrument, sweep: Option<SweepPlan>, deadline: Duration, cancel: &CancelToken) -> (Instrument, DeviceReport) {
    let rig = &mut instrument.rig;
    let axis = rig.rotation.check();
    let is_referenced = matches!(rig.rotation.position(), Position::Referenced { .. });
    if rig.rotation.capabilities().outside {
        return (instrument, DeviceReport { axis, is_referenced, outputs: None, light: Ok(None), sweep: None, frame: None });
    }
    let for_views = |outputs: &mut dyn outputs::Outputs| outputs.statuses().iter().any(|output| output.on == OutputUse::Views);
    let switches = rig.rotation.outputs().is_some_and(for_views);
    let outputs = switches.then(|| outputs::views_on(rig.rotation.as_mut(), cancel));
    let camera = rig.camera.as_mut();
    let seen = camera.arm().and_then(|()| grab(camera, deadline, cancel)).map(|seen| seen.frame);
    let (light, frame) = match seen {
        Ok(frame) => (Ok(Some(Light::of(&frame))), Some(frame)),
        Err(error) => (Err(error), None),
    };
    // A device that is lost cannot say what it can do.
    let sweep = sweep.filter(|_| axis.is_ok() && light.is_ok()).map(|plan| plan.check(rig.rotation.as_ref(), camera).map(|()| plan));
    if !camera.is_lost()
        && let Err(error) = camera.disarm()
    {
        tracing::warn!(%error, "the camera did not disarm");
    }
    outputs::views_off(rig.rotation.as_mut());
    (instrument, DeviceReport { axis, is_referenced, outputs, light, sweep, frame })
}

/// Background level (0 to 255) below which the sensor noise hides a profile.
pub const DARK: f64 = 40.0;
/// Background level from which the sensor saturates. The edge of a specimen is judged by its darkness relative to the background.
const BRIGHT: f64 = 250.0;
/// Largest allowed share of saturated pixels. Glare on the glass causes a few percent.
const SATURATED: f64 = 0.25;

/// Difference between the blur of the newest specimen and that of the rig from which on the focus is off, px. From specimen to
/// specimen the blur varies by 0.07 px. No number is wrong then, because each edge is placed with the blur of its own frame.
const FOCUS_OFF_PX: f64 = 0.15;

/// Maximum disk space of a plate, bytes.
pub fn needed_bytes(config: &Config, method: &Method, wells: usize) -> u64 {
    let second = config.second.as_ref().map(|second| &second.optics.camera);
    wells as u64 * bytes_per_specimen(method, &config.optics, config.camera.pixel_format(), second)
}

fn check(code: &str, blocks: bool, found: Result<String, (String, &str)>) -> Check {
    let (passed, detail, what_to_do) = match found {
        Ok(detail) => (true, detail, None),
        Err((detail, what_to_do)) => (false, detail, Some(what_to_do.to_owned())),
    };
    Check { code: code.into(), passed, blocks, detail, what_to_do }
}

/// Checks light and exposure.
///
/// # Errors
/// The measured and the required values, and what to do.
pub fn light(seen: &Light) -> Result<String, (String, &'static str)> {
    let found = format!("background at {:.0} of 255, {:.1} % of the pixels saturated", seen.background, 100.0 * seen.saturated);
    if seen.background < DARK {
        Err((
            format!("{found}: too dark, at least {DARK:.0} is needed"),
            "raise the lamp or the exposure time; look for what stands in the light",
        ))
    } else if seen.background > BRIGHT || seen.saturated > SATURATED {
        Err((format!("{found}: at most {BRIGHT:.0} and {:.0} % are taken", 100.0 * SATURATED), "lower the lamp or the exposure time"))
    } else {
        Ok(found)
    }
}

/// Blurs of the newest specimens that were measured since the start, px. The newest one is the last.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Blurs(VecDeque<f64>);

impl Blurs {
    /// Specimens that are remembered.
    const KEPT: usize = 10;
    /// Earlier specimens that show how a rig usually is, at least.
    const LEAST: usize = 3;

    pub fn add(&mut self, blur_px: f64) {
        if self.0.len() == Self::KEPT {
            self.0.pop_front();
        }
        self.0.push_back(blur_px);
    }

    /// The median of those before the newest. `None` where too few are known.
    fn usual_px(&self) -> Option<f64> {
        let earlier: Vec<f64> = self.0.iter().copied().take(self.0.len().saturating_sub(1)).collect();
        (earlier.len() >= Self::LEAST).then(|| upper_median(earlier))
    }

    /// Compares the newest blur with that of the specimens before it, or with the method's where too few are known. `None` before the
    /// first specimen.
    fn focus(&self, configured_px: f64) -> Option<Result<String, (String, &'static str)>> {
        let newest_px = *self.0.back()?;
        let (usual_px, whose) = match self.usual_px() {
            Some(usual_px) => (usual_px, "that of the specimens before it"),
            None => (configured_px, "that of the method"),
        };
        let is_usual = (newest_px - usual_px).abs() <= FOCUS_OFF_PX;
        let is = if is_usual { "is" } else { "differs from" };
        let found = format!(
            "the sharpness of the newest specimen {is} {whose}: its edges are blurred over {newest_px:.2} px, {usual_px:.2} px are usual"
        );
        Some(if is_usual {
            Ok(found)
        } else if self.usual_px().is_some() {
            Err((found, "look whether the lens, the camera or the capillary has moved, and focus the camera"))
        } else {
            Err((found, "focus the camera; if it is in focus, write the blur that was found into the method"))
        })
    }
}

/// The state that is known without asking the devices.
pub struct Known<'a> {
    /// The open faults.
    pub faults: &'a [Fault],
    /// `None` if the configuration names no receiver of notices.
    pub notices: Option<NoticesStatus>,
    pub mode: Mode,
    /// The rig's newest bead gate.
    pub gate: Option<&'a GateStatus>,
    /// Blur of the newest specimen, px. `None` if none was measured since the daemon's start.
    pub blurs: &'a Blurs,
    /// Barcode of the plate inside, if it was handed over.
    pub plate_handed_over: Option<&'a str>,
    /// The specimen of an ended run that keeps a new one from starting: what is the matter, and what a person does. `None` if none does.
    pub left: Option<(String, &'static str)>,
    pub free_bytes: Option<u64>,
    pub budget: Option<Budget>,
}

/// The checks of the devices.
fn devices(seen: &DeviceReport) -> Vec<Check> {
    let device = |e: &DeviceError, what_to_do: &'static str| (e.to_string(), what_to_do);
    let mut checks = vec![
        check(
            "rotation",
            true,
            match &seen.axis {
                Ok(()) if seen.is_referenced => Ok("the axis answers and is referenced".into()),
                Ok(()) => Ok("the axis answers; its reference is found with the first specimen".into()),
                Err(e) => Err(device(e, "check the controller's power and cable, and its alarm")),
            },
        ),
        check(
            "camera",
            true,
            match &seen.light {
                Ok(Some(_)) => Ok("the camera has sent a whole frame".into()),
                Ok(None) => Ok("another program takes the pictures".into()),
                Err(e) => Err(device(e, "check the camera's power and cable, and that no other program has it")),
            },
        ),
    ];
    checks.extend(seen.outputs.as_ref().map(|switched| {
        let found = switched.as_ref().map(|()| "what the pictures need was switched on".to_owned());
        check("outputs", true, found.map_err(|e| device(e, "check the pin in the configuration, and what is wired to it")))
    }));
    checks.extend(seen.sweep.as_ref().map(|checked| {
        let words = |plan: &SweepPlan| format!("axis and camera can sweep: {} views at {:.1} frames/s", plan.asd(), plan.frame_rate_hz());
        let refused = |e: &AcquisitionError| (e.to_string(), "choose another method, or correct [methods.X.sweep]");
        check("sweep", true, checked.as_ref().map(words).map_err(refused))
    }));
    checks.extend(seen.light.as_ref().ok().and_then(Option::as_ref).map(|seen| check("light", true, light(seen))));
    checks
}

/// All checks of this plan, passed or failed.
pub fn checks(config: &Config, plan: &RunPlan, seen: &DeviceReport, known: &Known) -> Vec<Check> {
    let mut checks = devices(seen);
    let stands: Vec<String> = known.faults.iter().filter(|f| f.operator_required).map(|f| f.plainly().to_owned()).collect();
    checks.push(check(
        "faults",
        true,
        if stands.is_empty() {
            Ok("no fault waits for somebody".into())
        } else {
            Err((format!("faults stand: {}", stands.join(" ")), "mend their cause, then acknowledge them"))
        },
    ));
    let plate = known.plate_handed_over.filter(|inside| *inside != plan.plate_barcode);
    checks.push(check(
        "plate",
        true,
        match plate {
            None => Ok("no other plate was handed over".into()),
            Some(inside) => Err((
                format!("the plate {inside} was handed over, and the plan is for {}", plan.plate_barcode),
                "hand the plate inside over, or mend the plan's barcode",
            )),
        },
    ));
    checks.push(check(
        "capillary",
        true,
        match &known.left {
            None => Ok("nothing has to be taken out of the capillary".into()),
            Some((what, remedy)) => Err((what.clone(), *remedy)),
        },
    ));
    if let Some(method) = config.methods.get(&plan.method) {
        let larvae = plan.plate_map.iter().any(|w| w.specimen == SpecimenKind::Larva);
        // Beads need no gate, because they make it.
        let lacking = larvae.then(|| gate::lacking(known.gate, method, known.mode)).flatten();
        let refuses = method.policy.bead_gate == BeadGate::Refuse;
        checks.push(check(
            "calibration",
            refuses,
            match lacking {
                None if larvae && method.policy.bead_gate != BeadGate::Off && known.gate.is_some() => {
                    Ok("bead check: the newest one stands".into())
                }
                None => Ok("bead check: not required".into()),
                Some(why) => Err((why, "run beads before larvae; what is measured without is flagged")),
            },
        ));
        checks.extend(known.blurs.focus(method.segment.edge.blur_px).map(|focus| check("focus", false, focus)));
        let needed = needed_bytes(config, method, plan.plate_map.len());
        let found = |free: u64| format!("{} are needed at most, {} are free", size(needed), size(free));
        checks.push(check(
            "disk",
            true,
            match known.free_bytes {
                Some(free) if free >= needed => Ok(found(free)),
                Some(free) => Err((found(free), "archive and remove runs, or split the plate")),
                None => Err(("the free space of the data folder is not known".into(), "check that the disk is mounted")),
            },
        ));
        checks.extend(known.budget.as_ref().map(|budget| {
            let refused = budget.refuses(needed).map_or_else(|| Ok("the plate fits the disk budget".into()), Err);
            check("disk_budget", true, refused.map_err(|why| (why, "archive runs and prune them, or raise [store] budget_gb")))
        }));
    }
    checks.extend(known.notices.as_ref().map(|notices| {
        let found = notices.trouble.clone().map_or_else(|| Ok(format!("nothing is known to be wrong with {}", notices.receiver)), Err);
        check("notices", false, found.map_err(|why| (why, "nobody is told if the run is held: see to the receiver, or watch the run")))
    }));
    let aged = |w: &&PlannedWell| w.specimen == SpecimenKind::Larva && w.dpf.is_some();
    if plan.plate_map.iter().any(|w| aged(&w)) {
        let sets = config.references.len();
        checks.push(check(
            "references",
            false,
            if sets > 0 {
                Ok(format!("{sets} sets of reference larvae"))
            } else {
                Err((
                    "larvae of known age are planned, and the configuration names no reference larvae".into(),
                    "name some under [references]",
                ))
            },
        ));
    }
    checks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// If larvae are refused without a gate, a plate of beads must be accepted.
    #[test]
    fn beads_need_no_gate_of_beads() {
        let mut config = Config::parse(include_str!("../../config/simulated.toml"), std::path::Path::new("simulated.toml")).unwrap();
        config.methods.get_mut("standard").unwrap().policy.bead_gate = BeadGate::Refuse;
        let calibration = |specimen| {
            let plan = RunPlan::new("P-1", "standard", "kim", vec![PlannedWell::new("A01", specimen, None)]);
            let seen = DeviceReport {
                axis: Ok(()),
                is_referenced: false,
                outputs: None,
                light: Ok(Some(Light { background: 200.0, saturated: 0.0, focus: 1.0 })),
                sweep: None,
                frame: None,
            };
            let known = Known {
                faults: &[],
                notices: None,
                mode: Mode::Hardware,
                gate: None,
                blurs: &Blurs::default(),
                plate_handed_over: None,
                left: None,
                free_bytes: Some(u64::MAX),
                budget: None,
            };
            let checks = checks(&config, &plan, &seen, &known);
            checks.into_iter().find(|c| c.code == "calibration").unwrap()
        };
        let (larva, bead) = (calibration(SpecimenKind::Larva), calibration(SpecimenKind::Bead));
        assert!(!larva.passed && larva.blocks && larva.detail.contains("no bead gate"), "{larva:?}");
        assert!(bead.passed && bead.detail.contains("not required"), "{bead:?}");
    }

    /// A wrong focus is a fact of the rig. It is reported once before a run, not with every specimen.
    #[test]
    fn a_focus_that_is_not_the_configured_one_is_named_and_blocks_nothing() {
        let focus = |px: f64| Blurs([px].into()).focus(1.1).unwrap();
        assert_eq!(Blurs::default().focus(1.1), None);
        assert!(focus(1.0).is_ok() && focus(1.24).is_ok());
        for found_px in [0.9, 1.3] {
            let (found, what_to_do) = focus(found_px).unwrap_err();
            assert!(found.contains(&format!("{found_px:.2} px")) && found.contains("1.10 px") && what_to_do.contains("focus"), "{found}");
        }
    }

    /// A rig that is always blurred otherwise than the method says is as it always is. A rig whose blur changes is not.
    #[test]
    fn the_focus_is_compared_with_that_of_the_rig_s_own_specimens() {
        let mut blurs = Blurs::default();
        for px in [1.41, 1.46, 1.38, 1.44] {
            blurs.add(px);
        }
        assert!(blurs.focus(1.1).unwrap().unwrap().contains("1.41 px"));
        blurs.add(1.62);
        let (found, what_to_do) = blurs.focus(1.1).unwrap().unwrap_err();
        assert!(found.contains("1.62 px") && what_to_do.contains("moved"), "{found}");
        // Later specimens are as blurred: this is how the rig is now.
        for _ in 0..2 * Blurs::KEPT {
            blurs.add(1.62);
        }
        assert!(blurs.focus(1.1).unwrap().is_ok() && blurs.0.len() == Blurs::KEPT);
    }

    fn lit(background: f64, saturated: f64) -> bool {
        light(&Light { background, saturated, focus: 1.0 }).is_ok()
    }

    #[test]
    fn light_is_taken_between_noise_and_the_sensors_top() {
        assert!(lit(200.0, 0.0) && lit(DARK, 0.0) && lit(BRIGHT, SATURATED));
        assert!(!lit(DARK - 1.0, 0.0) && !lit(255.0, 0.0) && !lit(200.0, 0.5));
        let (found, way_out) = light(&Light { background: 12.0, saturated: 0.0, focus: 1.0 }).unwrap_err();
        assert!(found.contains("12 of 255") && found.contains("40") && way_out.contains("lamp"), "{found}");
    }
}
