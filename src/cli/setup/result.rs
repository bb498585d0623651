//! What a set-up ends with: the configuration, and the summary for the person.

use super::bench::SWEEP;
use super::draft::Draft;
use super::judgement::out_of_focus;
use super::question::steps;
use super::state::State;
use super::wording::NO_LIGHT;
use carved_devices::rotation::entry;
use std::f64::consts::PI;

/// Time that a light gets to become steady, ms: a LED and its driver need less than a tenth of this.
const LIGHT_SETTLE_MS: u32 = 100;

/// The configuration, as far as it is known.
pub fn configuration(s: &State) -> String {
    let driver = s.controller.as_ref().map_or("grbl", |c| c.driver.as_str());
    let mut draft = Draft::of(entry(driver).map_or("", |entry| entry.example.text));
    let mut set = |table: &str, key: &str, value: Option<String>| {
        if let Some(value) = value {
            draft.set(table, key, &value);
        }
    };
    let quoted = |id: &str| s.answered(id).map(|text| toml::Value::from(text).to_string());
    set("store", "data_dir", quoted("data_dir"));
    set("rig", "name", quoted("name"));
    let ratio = s.answered("steps").and_then(|typed| steps(typed).ok());
    set("rig", "steps_per_revolution", ratio.map(|ratio| format!("{:?}", <[u32; 2]>::from(ratio))));
    set("acquisition", "sense", s.sense().map(|sense| sense.to_string()));
    let number = |value: f64| format!("{value:?}");
    let scales = s.scales();
    set("optics", "kx_px_per_um", scales.map(|k| number(k[0])));
    set("optics", "ky_px_per_um", scales.map(|k| number(k[1])));
    let middle = |id: &str| s.number(id).map(|size| number((size - 1.0) / 2.0));
    set("optics", "ux_px", middle("width"));
    let axis = s.bead.as_ref().map(|b| [b.uy_px, b.gamma_deg]).or(s.empty.as_ref().map(|e| [e.middle_px, e.tilt_deg]));
    set("optics", "uy_px", axis.map(|a| number((a[0] * 1e3).round() / 1e3)).or_else(|| middle("height")));
    set("optics", "gamma_deg", axis.map(|a| number((a[1] * 1e4).round() / 1e4)));
    set("optics", "bore_um", s.number("bore_um").map(number));
    set("optics", "empty_capillary", s.empty.as_ref().map(|e| toml::Value::from(e.file.as_str()).to_string()));
    for (table, [width, height]) in [("optics", ["width_px", "height_px"]), ("camera", ["width", "height"])] {
        set(table, width, s.answered("width").map(str::to_owned));
        set(table, height, s.answered("height").map(str::to_owned));
    }
    for (key, value) in s.controller.iter().flat_map(|c| &c.keys) {
        set("rotation", key, Some(value.clone()));
    }
    set("rotation", "reference", quoted("reference").filter(|_| s.can_home()));
    if let Some(pin) = s.answered("light").filter(|pin| *pin != NO_LIGHT && s.can_home()) {
        let pin = pin.parse::<u32>().map_or_else(|_| toml::Value::from(pin), toml::Value::from);
        for (key, value) in [("pin", pin.to_string()), ("on", "\"views\"".into()), ("settle_ms", LIGHT_SETTLE_MS.to_string())] {
            set("rotation.outputs.light", key, Some(value));
        }
    }
    set("camera", "select", quoted("camera").map(|address| format!("{{ address = {address} }}")));
    set("camera", "pixel_format", quoted("pixel_format"));
    set("camera", "exposure_us", s.exposure.as_ref().map(|e| number(e.exposure_us)));
    draft.text()
}

/// The last words: what was found, what is not known, and what to do next.
pub fn summary(s: &State) -> String {
    let (Some(written), Some(proof)) = (&s.written, &s.proof) else { return String::new() };
    let stated = s.number("bead_um").unwrap_or(f64::NAN);
    let [kx, ky] = s.scales().unwrap_or([f64::NAN; 2]).map(|k| 1.0 / k);
    let mut text = format!(
        "The bead is right: {:.2} um measured, {stated} um stated ({:+.2} %); its volume is {:.2} nL, that of a sphere of {stated} um {:.2} nL.\n\
             A pixel is {kx:.4} um along the capillary and {ky:.4} um across it.\n",
        proof.diameter_um,
        s.off_percent(Some(proof)).unwrap_or(f64::NAN),
        proof.volume_um3 / 1e6,
        PI / 6e6 * stated.powi(3)
    );
    if proof.can_sweep {
        let (views, rate_hz) = SWEEP;
        text += &format!(
            "Axis and camera can take a turn of {views} views in one sweep of {:.1} s: docs/sweep.md has the method to add.\n",
            f64::from(views) / rate_hz
        );
    }
    if s.answered("sense") == Some("unknown") {
        text += "The sense of rotation is not measured: models may be mirror images. Measure it with carved calibrate marked.\n";
    }
    for word in [out_of_focus(proof)].iter().filter(|word| !word.is_empty()) {
        text += &format!("Look again{word}.\n");
    }
    for doubt in &written.doubts {
        text += &format!("Look again: {doubt}\n");
    }
    text + &format!("Next: carved serve --config {}", written.file)
}
