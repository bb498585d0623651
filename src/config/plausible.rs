//! Checks for values that are in their range but cannot be meant: a wrong unit, a missing digit, or two keys that contradict each other.
//!
//! ```text
//! Raw, Drivers ─┬─> breaches   cannot work: the configuration is refused
//!               └─> doubts     unlikely: reported by `carved config check` and by each start
//! ```
//! A range limits a single number. These rules know the instrument: a camera that looks at a capillary.

use super::raw::{CameraDriver, Drivers, Raw};
use carved_devices::camera::{AravisSettings, Trigger};
use carved_devices::rotation::Port;
use std::path::Path;

/// Range of scales, um per px: from a twentieth of the resolution of VAST's cameras to a sixth of a capillary per pixel.
const UM_PER_PX: [f64; 2] = [0.25, 100.0];
/// Maximum ratio of the two scales of a camera. The refraction of the glass changes the scale by a third.
const MOST_RATIO: f64 = 2.0;
/// Maximum tilt and roll of a capillary, deg.
const MOST_TILT_DEG: f64 = 30.0;
/// Tilt and roll above this value, deg, do not happen by inaccurate mounting.
const DOUBTFUL_TILT_DEG: f64 = 3.0;
/// Maximum backlash, in turns. A larger value is not backlash.
const MOST_BACKLASH_TURNS: f64 = 0.125;
/// Usual bores of capillaries for larvae, um.
const USUAL_BORE_UM: [f64; 2] = [300.0, 1500.0];
/// Maximum columns or rows of most sensors.
const USUAL_SENSOR_PX: u32 = 4096;
/// Baud rates that serial adapters and controllers share.
const USUAL_BAUD: [u32; 14] =
    [1200, 2400, 4800, 9600, 14_400, 19_200, 38_400, 57_600, 115_200, 230_400, 250_000, 460_800, 500_000, 921_600];
/// Virtual folders of the kernel. They cannot store runs.
const KERNEL: [&str; 3] = ["/proc", "/sys", "/dev"];

/// Errors and unlikely values. Each line has the key, the numbers and what to do.
#[derive(Debug, Default)]
pub(super) struct Implausible {
    pub breaches: Vec<String>,
    pub doubts: Vec<String>,
}

/// Checks all keys together. `in_range` says whether every number of a table is in its range. Otherwise the range is reported already.
pub(super) fn implausible(raw: &Raw, drivers: &Drivers, in_range: impl Fn(&str) -> bool) -> Implausible {
    let mut found = Implausible::default();
    found.store(&raw.store.data_dir);
    found.label("rig.name", Some(&raw.rig.name));
    found.label("rig.serial", raw.rig.serial.as_deref());
    found.label("rig.location", raw.rig.location.as_deref());
    if in_range("rig") {
        let [steps, turns] = <[u32; 2]>::from(raw.rig.steps_per_revolution);
        found.backlash(raw.rig.backlash_steps, f64::from(steps) / f64::from(turns));
    }
    let o = &raw.optics;
    if in_range("optics") {
        let view = View {
            k: [o.kx_px_per_um, o.ky_px_per_um],
            axis: [o.ux_px, o.uy_px],
            tilt: [o.alpha_deg, o.gamma_deg],
            size: [o.width_px, o.height_px],
        };
        found.optics("optics", &view);
        if let Some(bore_um) = o.bore_um {
            found.bore(bore_um);
        }
    }
    let second = drivers.camera_second.as_ref().and_then(CameraDriver::aravis);
    if let (Some(o), Some(camera), true) = (&raw.optics_second, second, in_range("optics_second")) {
        let size = [camera.width, camera.height];
        let view = View { k: [o.kx_px_per_um, o.ky_px_per_um], axis: [o.ux_px, o.uy_px], tilt: [o.alpha_deg, o.gamma_deg], size };
        found.optics("optics_second", &view);
    }
    for (table, camera) in [("camera", drivers.camera.aravis()), ("camera_second", second)] {
        if let Some(camera) = camera.filter(|_| in_range(table) && in_range("acquisition")) {
            found.camera(table, camera, raw.acquisition.grab_deadline_ms);
        }
    }
    let serial = drivers.rotation.serial();
    let fixed = drivers.rotation.entry().and_then(|entry| entry.fixed_steps);
    if fixed.is_some_and(|fixed| fixed != <[u32; 2]>::from(raw.rig.steps_per_revolution)) {
        found.doubts.push(
            "rig.steps_per_revolution is not [500, 1]: VAST's motors make 500 steps of 0.72 deg in a turn. Other values give wrong angles"
                .into(),
        );
    }
    found.port(serial.map(|(port, _)| port));
    found.baud(serial.map(|(_, baud)| baud).filter(|_| in_range("rotation")));
    found
}

/// Optics of a camera: scales (px/um), principal point (px), angles of the capillary (deg), size (px).
struct View {
    k: [f64; 2],
    axis: [f64; 2],
    tilt: [f64; 2],
    size: [u32; 2],
}

impl Implausible {
    fn wrong(&mut self, text: &str) {
        self.breaches.push(format!("  {text}"));
    }

    /// Checks a text that becomes a cell of tables and a label of metrics.
    fn label(&mut self, key: &str, text: Option<&str>) {
        const LONGEST: usize = 100;
        let Some(text) = text else { return };
        let is_printable = !text.trim().is_empty() && !text.chars().any(char::is_control);
        if !is_printable || text.chars().count() > LONGEST {
            self.breaches.push(format!("  {key} = {text:?}; expected one line of 1 to {LONGEST} characters"));
        }
    }

    fn store(&mut self, data_dir: &Path) {
        if data_dir.as_os_str().is_empty() {
            self.wrong("store.data_dir = \"\"; expected a folder for the runs, as /var/lib/carved");
        }
        if let Some(kernel) = KERNEL.iter().find(|kernel| data_dir.starts_with(kernel) && !data_dir.starts_with("/dev/shm")) {
            let found = data_dir.display();
            self.wrong(&format!(
                "store.data_dir = \"{found}\"; {kernel} is the kernel's and keeps no files; name a folder of a disk, as /var/lib/carved"
            ));
        }
    }

    fn backlash(&mut self, steps: u32, per_turn: f64) {
        let turns = f64::from(steps) / per_turn;
        if turns > MOST_BACKLASH_TURNS {
            let most = (per_turn * MOST_BACKLASH_TURNS).floor();
            self.wrong(&format!(
                "rig.backlash_steps = {steps}, which are {:.0} deg of {per_turn} steps per turn; expected {most} steps ({:.0} deg) at most: \
                 measure the play of the gear, or write 0",
                turns * 360.0,
                MOST_BACKLASH_TURNS * 360.0
            ));
        }
    }

    fn optics(&mut self, table: &str, view: &View) {
        let [least, most] = UM_PER_PX;
        let mut scales_fit = true;
        for (key, k) in [("kx_px_per_um", view.k[0]), ("ky_px_per_um", view.k[1])] {
            let um_per_px = 1.0 / k;
            if !(least..=most).contains(&um_per_px) {
                scales_fit = false;
                let hint =
                    if (least..=most).contains(&k) { format!(". If {k} is in um per px, write {um_per_px:.6}") } else { String::new() };
                self.wrong(&format!("{table}.{key} = {k}, so that a pixel is {um_per_px:.3} um; expected {least} to {most} um{hint}"));
            }
        }
        let [kx, ky] = view.k;
        if scales_fit && !(1.0 / MOST_RATIO..=MOST_RATIO).contains(&(kx / ky)) {
            self.wrong(&format!(
                "{table}.kx_px_per_um = {kx} and ky_px_per_um = {ky}; expected scales that differ by less than a factor of {MOST_RATIO}: \
                 measure both with `carved calibrate scale`"
            ));
        }
        let [width, height] = view.size.map(f64::from);
        let [ux, uy] = view.axis;
        if !(0.0..height).contains(&uy) {
            self.wrong(&format!(
                "{table}.uy_px = {uy}; expected a row of the picture, 0 to {}: the axis of the capillary is in view, near {}",
                height - 1.0,
                (height - 1.0) / 2.0
            ));
        }
        if !(-width..2.0 * width).contains(&ux) {
            self.wrong(&format!(
                "{table}.ux_px = {ux}; expected {} to {}, at most one width beside the picture: the middle is {}",
                -width,
                2.0 * width - 1.0,
                (width - 1.0) / 2.0
            ));
        }
        for (key, deg) in [("alpha_deg", view.tilt[0]), ("gamma_deg", view.tilt[1])] {
            if deg.abs() > MOST_TILT_DEG {
                self.wrong(&format!(
                    "{table}.{key} = {deg}; expected -{MOST_TILT_DEG} to {MOST_TILT_DEG} deg: the capillary is along the rows of the picture. \
                     Turn the camera, or write 0"
                ));
            } else if deg.abs() > DOUBTFUL_TILT_DEG {
                self.doubts.push(format!(
                    "{table}.{key} = {deg} deg; a capillary is within {DOUBTFUL_TILT_DEG} deg of the rows of the picture on most rigs. Look at \
                     a picture; if it is in another unit, convert it"
                ));
            }
        }
    }

    fn bore(&mut self, bore_um: f64) {
        let [least, most] = USUAL_BORE_UM;
        if !(least..=most).contains(&bore_um) {
            self.doubts.push(format!(
                "optics.bore_um = {bore_um} um; {least} to {most} um are usual for a larva. If it is in mm or a radius, convert it"
            ));
        }
    }

    fn camera(&mut self, table: &str, camera: &AravisSettings, grab_deadline_ms: u32) {
        let (timeout_ms, exposure_ms) = (camera.frame_timeout_ms, camera.exposure_us / 1e3);
        if exposure_ms >= f64::from(timeout_ms) {
            self.wrong(&format!(
                "{table}.exposure_us = {} ({exposure_ms} ms); expected less than {table}.frame_timeout_ms = {timeout_ms}, in which the frame \
                 must arrive: shorten the exposure, or wait longer",
                camera.exposure_us
            ));
        }
        if grab_deadline_ms < timeout_ms {
            self.wrong(&format!(
                "acquisition.grab_deadline_ms = {grab_deadline_ms}; expected at least {table}.frame_timeout_ms = {timeout_ms}, the wait for one \
                 trigger: a lost frame could not be triggered again. Raise the deadline to {} or more",
                2 * timeout_ms
            ));
        }
        if let Trigger::FixedRateHz(hz) = camera.trigger {
            let period_ms = 1e3 / hz;
            if period_ms > f64::from(grab_deadline_ms) {
                self.wrong(&format!(
                    "{table}.trigger.fixed_rate_hz = {hz}, a frame each {period_ms} ms; expected one within acquisition.grab_deadline_ms = \
                     {grab_deadline_ms}: raise the rate to {:.3} Hz or more, or the deadline",
                    1e3 / f64::from(grab_deadline_ms)
                ));
            }
        }
        for (offset, size, key) in [(camera.offset_x, camera.width, "offset_x"), (camera.offset_y, camera.height, "offset_y")] {
            let end = offset.saturating_add(size);
            if offset > 0 && end > USUAL_SENSOR_PX {
                self.doubts.push(format!(
                    "{table}.{key} = {offset}: the region of {size} px ends at {end}, and few sensors have more than {USUAL_SENSOR_PX} px. The \
                     camera refuses a region outside of its sensor; its data sheet has the size"
                ));
            }
        }
    }

    fn port(&mut self, port: Option<&Port>) {
        let (key, is_empty) = match port {
            Some(Port::Path(path)) => ("rotation.port", path.trim().is_empty()),
            Some(Port::Usb(usb)) => ("rotation.port.usb_serial", usb.usb_serial.trim().is_empty()),
            None => return,
        };
        if is_empty {
            self.wrong(&format!(
                "{key} = \"\"; expected the controller's serial port, as \"/dev/ttyUSB0\"; `carved doctor` lists the ports"
            ));
        }
    }

    fn baud(&mut self, baud: Option<u32>) {
        let Some(baud) = baud.filter(|baud| *baud < 1_000_000 && !USUAL_BAUD.contains(baud)) else { return };
        let nearest = USUAL_BAUD.iter().min_by_key(|usual| usual.abs_diff(baud)).unwrap_or(&115_200);
        let tenfold = USUAL_BAUD.iter().find(|usual| **usual == baud.saturating_mul(10)).unwrap_or(nearest);
        self.doubts
            .push(format!("rotation.baud = {baud}, which is no usual rate; is {tenfold} meant? The controller's manual has its rate"));
    }
}
