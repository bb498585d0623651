//! The shipped configurations, and the messages of `carved config check` about wrong ones.

use crate::common::{run, stderr};
use carved::config::Config;
use std::path::{Path, PathBuf};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config")
}

#[test]
fn every_shipped_configuration_is_sound() {
    let mut seen = 0;
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "toml") {
            Config::load(&path).unwrap();
            let output = run(&["config", "check", path.to_str().unwrap()]);
            assert!(output.status.success(), "{}", stderr(&output));
            seen += 1;
        }
    }
    assert!(seen >= 6, "config/ has a file for the emulated rig and one for each make of controller; found {seen}");
}

/// The method of docs/sweep.md fits the shipped rig.
#[test]
fn a_sweep_is_checked_against_exposure_rate_and_second_camera() {
    let text = std::fs::read_to_string(folder().join("vast-grbl.toml")).unwrap();
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/sweep.md")).unwrap();
    let method = page.split("```toml\n").nth(1).unwrap().split("```").next().unwrap();
    let parse = |exposure: &str, method: &str| {
        assert!(text.contains("exposure_us = 5000.0"));
        Config::parse(&format!("{}\n{method}", text.replace("exposure_us = 5000.0", exposure)), Path::new("x.toml"))
    };
    let refused = |exposure: &str, method: &str| parse(exposure, method).map(|_| ()).unwrap_err().to_string();
    parse("exposure_us = 5000.0", method).unwrap();
    let said = refused("exposure_us = 9000.0", method);
    assert!(said.contains("moves 1.10 px during an exposure of 9000 us at 30.0 frames/s and 84 views"), "{said}");
    parse("exposure_us = 9000.0", &method.replace("blur_px = 1.0", "blur_px = 1.2")).unwrap();
    let said = refused("exposure_us = 5000.0", &method.replace("frame_rate_hz = 30", "frame_rate_hz = 30\nturn_s = 2.8"));
    assert!(said.contains("sweep.frame_rate_hz = 30 and sweep.turn_s = 2.8; expected one of them"), "{said}");
    let said = refused("exposure_us = 5000.0", &method.replace("frame_rate_hz = 30", "turn_s = 500"));
    assert!(said.contains("84 views in this time are 0.17 frames/s"), "{said}");
    let said =
        refused("exposure_us = 5000.0", &method.replace("[methods.sweep.sweep]", "early_stop = { enabled = true }\n[methods.sweep.sweep]"));
    assert!(said.contains("order = \"sweep\"; expected order = \"coarse_to_fine\""), "{said}");
}

#[test]
fn an_unknown_driver_and_a_missing_table_are_named() {
    let text = std::fs::read_to_string(folder().join("vast-grbl.toml")).unwrap();
    let refused = |from: &str, to: &str| {
        assert!(text.contains(from), "{from}");
        Config::parse(&text.replacen(from, to, 1), Path::new("x.toml")).map(|_| ()).unwrap_err().to_string()
    };
    let said = refused("driver = \"grbl\"", "driver = \"grlb\"");
    assert!(said.contains("rotation.driver: unknown variant `grlb`") && said.contains("`zaber`"), "{said}");
    let said = refused("driver = \"loader\"", "driver = 3");
    assert!(said.contains("sampler.driver = 3; expected a name in quotation marks"), "{said}");
    let said = refused("[rig]", "[riig]");
    assert!(said.contains("riig") && !said.contains(".: "), "{said}");
    let said = refused(
        "[rig]\nname = \"vast-1\"                # stamped into every recording\nsteps_per_revolution = [500, 1]   # motor steps per turn of the capillary, an exact ratio\n",
        "",
    );
    assert!(said.contains("missing field `rig`") && !said.contains(".: "), "{said}");
}

#[test]
fn breaches_name_file_key_value_and_expectation_all_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("broken.toml");
    let text = std::fs::read_to_string(folder().join("simulated.toml")).unwrap();
    let check = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let output = run(&["config", "check", path.to_str().unwrap()]);
        assert!(!output.status.success());
        stderr(&output)
    };
    let said = check(
        &text.replace("asd = 21", "asd = 2").replace("voxel_um = 6.93", "voxel_um = -1.0").replace("width_px = 1024", "width_px = 512"),
    );
    for word in ["broken.toml", "asd = 2", "voxel_um = -1", "1024 x 1024", "512 x 1024"] {
        assert!(said.contains(word), "{word} is not in: {said}");
    }
    let said = check(&text.replace("settle_ms", "setle_ms"));
    assert!(said.contains("setle_ms") && said.contains("broken.toml"), "{said}");
    let said = check(&text.replace("sense = 1 ", "sense = 0 "));
    assert!(said.contains("sense is 0"), "{said}");
    // Each fault has a line of its own, with key, value, range and unit.
    let mut broken = text.replace("\"127.0.0.1:8420\"", "\"0.0.0.0:8420\"\nmax_connections = 0\nallowed_hosts = [\"http://x\"]");
    broken += "[methods.standard.surface]\nfairing_lambda = -1.0\n";
    broken += "[methods.standard.segment]\nclosing_px = 100000\nfaint_sigma = 0.0\nlow_sigma = 1.3\n";
    broken += "[methods.standard.segment.fringe]\nalong_px = 0.0\n[methods.standard.segment.walls]\nmin_depth = -2.0\n";
    broken += "[methods.standard.segment.edge]\nblur_px = 0.0\nalong_px = nan\nsearch_inside_px = 8.0\n";
    let said = check(&broken);
    for line in [
        "  http.max_connections = 0; expected 1 to 65536 connections",
        "methods.standard.surface.fairing_lambda = -1; expected 0 to 100 (weight)",
        "methods.standard.segment.fringe.along_px = 0; expected 0.3 to 30 px",
        "methods.standard.segment.closing_px = 100000; expected 0 to 30 px",
        "methods.standard.segment.faint_sigma = 0; expected 0.1 to 100 standard deviations of the noise",
        "methods.standard.segment.low_sigma is no longer a setting and has no effect; remove it",
        "methods.standard.segment.walls.min_depth = -2; expected 0.5 to 100 grey values",
        "methods.standard.segment.edge.blur_px = 0; expected 0.3 to 4 px",
        "methods.standard.segment.edge.along_px = NaN; expected 0.3 to 10 px",
        "methods.standard.segment.edge.search_inside_px = 8; expected 0.5 to 7 px",
    ] {
        assert!(said.lines().any(|l| l.trim() == line.trim()), "{line} is not in: {said}");
    }
    assert!(said.contains("refuses to listen on 0.0.0.0:8420") && said.contains("\"http://x\" in allowed_hosts"), "{said}");
    assert!(said.contains("12 value(s)"), "{said}");
    let said = check(&text.replace("[store]", "token_file = \"/no/such/token\"\n[store]"));
    assert!(said.contains("token_file: cannot read /no/such/token") && said.contains("1 value(s)"), "{said}");
    let said = stderr(&run(&["config", "check", "/no/such/file.toml"]));
    assert!(said.contains("/no/such/file.toml"), "{said}");
}

/// A distance in millimetres: every view of every well would be refused, because the camera would stand inside the box.
#[test]
fn a_camera_inside_the_box_is_refused_with_both_numbers_and_the_unit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rig.toml");
    let text = std::fs::read_to_string(folder().join("vast-grbl.toml")).unwrap();
    let check = |changes: &[(&str, &str)]| {
        let mut text = text.clone();
        for (from, to) in changes {
            assert!(text.contains(from), "{from}");
            text = text.replace(from, to);
        }
        std::fs::write(&path, text).unwrap();
        let output = run(&["config", "check", path.to_str().unwrap()]);
        (output.status.success(), stderr(&output))
    };
    let (sound, said) = check(&[("distance_um = 60000.0", "distance_um = 60.0")]);
    assert!(!sound, "{said}");
    // A box of 1000 um across has half a diagonal of 707 um, the radius that it needs to turn. Its 144 voxels of 6.93 um end 1 um short, so
    // one more is kept.
    for word in ["optics.distance_um = 60;", "\"standard\"", "708 um", "60 mm", "60000"] {
        assert!(said.contains(word), "{word} is not in: {said}");
    }
    assert!(said.contains("1 value(s)"), "{said}");
    // No unit makes this distance right: the box is meant for another rig.
    let wide = "voxel_um = 200.0\nbox_um = { min = [-2500.0, -90000.0, -500.0], max = [2500.0, 90000.0, 500.0] }";
    let (sound, said) = check(&[("voxel_um = 6.93", wide)]);
    assert!(!sound && said.contains("optics.distance_um = 60000;") && said.contains("box_um") && !said.contains(" mm"), "{said}");
    // A tilt moves one end of the box towards the camera: 2500 um at 60 deg by 2165 um.
    let near = ("distance_um = 60000.0", "distance_um = 2000.0");
    let ((still, _), (tilted, said)) = (check(&[near]), check(&[near, ("alpha_deg = 0.0 ", "alpha_deg = 60.0 ")]));
    assert!(still && !tilted, "{said}");
}

/// A data sheet's 0.65 mm, and a value that no capillary has.
#[test]
fn a_bore_that_no_capillary_has_is_refused_with_both_numbers() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rig.toml");
    let text = std::fs::read_to_string(folder().join("simulated.toml")).unwrap();
    let with = |bore: &str| text.replace("height_px = 1024", &format!("height_px = 1024\nbore_um = {bore}"));
    for bore in ["0.65", "99.9", "5001", "-650", "nan", "inf"] {
        std::fs::write(&path, with(bore)).unwrap();
        let output = run(&["config", "check", path.to_str().unwrap()]);
        let said = stderr(&output);
        let value = if bore == "nan" { "NaN" } else { bore };
        let line = format!("optics.bore_um = {value}; expected 100 to 5000 um");
        assert!(!output.status.success() && said.lines().any(|l| l.trim() == line), "{line} is not in: {said}");
        assert!(said.contains("1 value(s)"), "{said}");
    }
    assert_eq!(Config::parse(&with("650.0"), &path).unwrap().bore_um, Some(650.0));
    assert_eq!(Config::parse(&text, &path).unwrap().bore_um, None);
}

/// The lines that `carved config check` says of a shipped file with one change, and whether it accepts the file.
fn checked(file: &str, from: &str, to: &str) -> (bool, String) {
    let text = std::fs::read_to_string(folder().join(file)).unwrap();
    assert!(text.contains(from), "{file}: {from}");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("rig.toml");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    let output = run(&["config", "check", path.to_str().unwrap()]);
    (output.status.success(), format!("{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output)))
}

/// Each value is a number of the right kind, and no instrument has it. The message has what was found, what is expected and what to do.
#[test]
fn values_that_no_instrument_has_are_refused_with_both_numbers_and_the_way_out() {
    let camera = "exposure_us = 5000.0";
    for (from, to, expected) in [
        ("distance_um = 60000.0", "distance_um = 60.0", &["optics.distance_um = 60;", "708 um", "60 mm"][..]),
        ("distance_um = 60000.0", "distance_um = 0.06", &["optics.distance_um = 0.06; expected 1 to 1000000000 um"]),
        (
            "kx_px_per_um = 0.18181818181818182",
            "kx_px_per_um = 5.5",
            &["optics.kx_px_per_um = 5.5", "a pixel is 0.182 um; expected 0.25 to 100 um", "write 0.181818"],
        ),
        ("ky_px_per_um = 0.18181818181818182", "ky_px_per_um = 181.8", &["optics.ky_px_per_um = 181.8; expected 0.0001 to 100 px/um"]),
        (
            "ky_px_per_um = 0.18181818181818182",
            "ky_px_per_um = 0.5",
            &["optics.kx_px_per_um = 0.18", "ky_px_per_um = 0.5", "factor of 2", "calibrate scale"],
        ),
        (camera, "exposure_us = 0.005", &["camera.exposure_us = 0.005; expected 0.1 to 60000000 us"]),
        (
            camera,
            "exposure_us = 5e6",
            &["camera.exposure_us = 5000000 (5000 ms); expected less than camera.frame_timeout_ms = 500", "shorten the exposure"],
        ),
        ("gamma_deg = 0.0", "gamma_deg = 100.0", &["optics.gamma_deg = 100; expected -30 to 30 deg", "or write 0"]),
        ("uy_px = 511.5", "uy_px = 5115.0", &["optics.uy_px = 5115; expected a row of the picture, 0 to 1023", "near 511.5"]),
        ("ux_px = 511.5", "ux_px = 5115.0", &["optics.ux_px = 5115; expected -1024 to 2047", "the middle is 511.5"]),
        ("reference = \"home\"", "reference = \"home\"\nbaud = 0", &["rotation.baud = 0; expected 300 to 4000000 baud"]),
        ("port = \"/dev/carved-rotation\"", "port = \"\"", &["rotation.port = \"\"; expected", "/dev/ttyUSB0", "carved doctor"]),
        ("port = \"/dev/carved-rotation\"", "port = { usb_serial = \" \" }", &["rotation.port.usb_serial = \"\"; expected"]),
        (
            "data_dir = \"/var/lib/carved\"",
            "data_dir = \"/proc/carved\"",
            &["store.data_dir = \"/proc/carved\"; /proc is the kernel's", "as /var/lib/carved"],
        ),
        ("data_dir = \"/var/lib/carved\"", "data_dir = \"\"", &["store.data_dir = \"\"; expected a folder"]),
        (
            "name = \"vast-1\"",
            "name = \"vast-1\"\nbacklash_steps = 5000",
            &["rig.backlash_steps = 5000, which are 3600 deg of 500 steps per turn; expected 62 steps (45 deg) at most", "or write 0"],
        ),
        (
            "grab_deadline_ms = 3000",
            "grab_deadline_ms = 100",
            &["acquisition.grab_deadline_ms = 100; expected at least camera.frame_timeout_ms = 500", "to 1000 or more"],
        ),
        (
            camera,
            "exposure_us = 5000.0\ntrigger = { fixed_rate_hz = 0.1 }",
            &[
                "camera.trigger.fixed_rate_hz = 0.1, a frame each 10000 ms; expected one within acquisition.grab_deadline_ms = 3000",
                "0.333 Hz",
            ],
        ),
    ] {
        let (sound, said) = checked("vast-grbl.toml", from, to);
        assert!(!sound, "{to}: {said}");
        for part in expected {
            assert!(said.contains(part), "{to}: {part:?} is not in: {said}");
        }
    }
}

/// What an instrument may have and hardly ever has is accepted, with a remark.
#[test]
fn doubtful_values_are_accepted_and_named() {
    for (from, to, expected) in [
        ("gamma_deg = 0.0", "gamma_deg = 3.14", &["optics.gamma_deg = 3.14 deg", "within 3 deg"][..]),
        ("reference = \"home\"", "reference = \"home\"\nbaud = 11520", &["rotation.baud = 11520", "is 115200 meant?"]),
        ("width = 1024 ", "offset_x = 4000\nwidth = 1024 ", &["camera.offset_x = 4000: the region of 1024 px ends at 5024", "4096 px"]),
    ] {
        let (sound, said) = checked("vast-grbl.toml", from, to);
        assert!(sound && said.contains("look again: ") && said.contains("sound; instrument"), "{to}: {said}");
        for part in expected {
            assert!(said.contains(part), "{to}: {part:?} is not in: {said}");
        }
    }
    let (sound, said) = checked("vast-grbl.toml", "gamma_deg = 0.0", "gamma_deg = 0.5");
    assert!(sound && !said.contains("look again"), "{said}");
}

/// A value of another type, in a table whose `driver` says which keys it has.
#[test]
fn type_errors_of_the_drivers_tables_name_their_key() {
    for (file, from, to, expected) in [
        ("vast-grbl.toml", "exposure_us = 5000.0", "exposure_us = \"5 ms\"", "camera.exposure_us: invalid type: string \"5 ms\""),
        ("vast-grbl.toml", "width = 1024 ", "width = -1024 ", "camera.width: invalid value: integer `-1024`"),
        ("vast-grbl.toml", "width = 1024 ", "width = 1024.5 ", "camera.width: invalid type: floating point `1024.5`"),
        ("vast-grbl.toml", "\"192.168.10.2\"", "\"192.168.10\"", "camera.select.address: invalid IPv4"),
        ("vast-grbl.toml", "\"BayerRG8\"", "\"Bayer\"", "camera.pixel_format: unknown variant `Bayer`"),
        (
            "vast-grbl.toml",
            "exposure_us = 5000.0",
            "exposure_us = 1.0\ntrigger = { fixed_rate_hz = \"a\" }",
            "camera.trigger.fixed_rate_hz: invalid type",
        ),
        ("vast-grbl.toml", "exposure_us = 5000.0", "exposure = 5000.0", "camera.exposure: unknown field `exposure`"),
        (
            "vast-grbl.toml",
            "steps_per_unit = [100, 1]",
            "steps_per_unit = [100, \"1\"]",
            "rotation.steps_per_unit[1]: invalid type: string \"1\"",
        ),
        ("vast-grbl.toml", "reference = \"home\"", "reference = 1", "rotation.reference: "),
        ("vast-grbl.toml", "port = \"/dev/carved-rotation\"", "port = 3", "rotation.port: a path such as"),
        ("vast-tmcl.toml", "driver = \"tmcl\"", "driver = \"tmcl\"\nbaud = true", "rotation.baud: invalid type: boolean `true`"),
        ("vast-zaber.toml", "driver = \"zaber\"", "driver = \"zaber\"\nbaud = \"fast\"", "rotation.baud: invalid type: string \"fast\""),
    ] {
        let (sound, said) = checked(file, from, to);
        assert!(!sound && said.contains(expected), "{to}: {said}");
    }
}

#[test]
fn outputs_that_a_controller_does_not_have_are_refused_with_those_that_it_has() {
    let refused = |file: &str, outputs: &str, from: &str, to: &str| {
        let text = std::fs::read_to_string(folder().join(file)).unwrap();
        assert!(text.contains(from), "{from}");
        let text = text.replacen(from, to, 1) + outputs;
        Config::parse(&text, Path::new("x.toml")).map(|_| ()).unwrap_err().to_string()
    };
    let output = |name: &str, pin: &str| format!("\n[rotation.outputs.{name}]\npin = {pin}\non = \"views\"\n");
    let said = refused("vast-grbl.toml", &output("light", "\"coolant\""), "", "");
    assert!(said.contains("rotation.outputs.light.pin") && said.contains("`mist_coolant`, `flood_coolant`, `spindle`"), "{said}");
    let two = output("light", "\"spindle\"") + &output("valve", "\"spindle\"");
    assert!(refused("vast-grbl.toml", &two, "", "").contains("another output has this pin"));
    let said =
        refused("vast-grbl.toml", &output("light", "\"flood_coolant\""), "driver = \"loader\"", "driver = \"trigger\"\ndone_output = true");
    assert!(said.contains("rotation.outputs.light.pin") && said.contains("the specimen is done"), "{said}");
    let said = refused("vast-grbl.toml", &output("\"Light 1\"", "\"spindle\""), "", "");
    assert!(said.contains("lower-case letters, digits and _"), "{said}");
    for (file, pin, range) in [("vast-tmcl.toml", "8", "0 to 7"), ("vast-zaber.toml", "0", "1 to 4")] {
        let said = refused(file, &output("light", pin), "", "");
        assert!(said.contains("rotation.outputs.light.pin") && said.contains(range), "{said}");
    }
    for file in ["vast-bridge.toml", "vast-relay.toml"] {
        let said = refused(file, &output("light", "1"), "", "");
        assert!(said.contains("rotation.outputs") && said.contains("unknown field"), "{said}");
    }
    let said = refused("vast-folder.toml", &output("light", "1"), "", "");
    assert!(said.contains("[rotation]"), "{said}");
}
