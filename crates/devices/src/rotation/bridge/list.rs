//! VAST's list of stops, `external.txt`.
//!
//! ```text
//! tomography  x_position  degrees  ctrl_output  trigger_input  adjust_rotation  tray_LED      tabs, CR LF, no header
//! no          0           17,28    1            1              no               on            decimal comma
//! ```
//! This is the form of the only public program that writes such a list (`create_vast_rows` in `external_imaging_implementation.py` of
//! `github.com/JensVanBijs/vast_automation`). Degrees are positions of the axis, from 0 to less than 360: that program writes 360 deg as
//! `0,00`. It writes `off` for the lamp; `on` is its counterpart here.
//!
//! A step must be a whole number of hundredths of a degree; it is 0.72 deg with VAST's 500 steps per revolution. The list is then
//! exact, and the ledger's steps are those that the machine makes.

use super::{DEVICE, VastBridgeSettings};
use crate::DeviceError;
use carved_core::units::{Steps, StepsPerRevolution};
use std::fs;
use std::io::{ErrorKind, Result, Write};
use std::path::Path;

const HUNDREDTHS: u64 = 36_000;

/// Hundredths of a degree per step.
pub(super) fn hundredths_per_step(per_revolution: StepsPerRevolution) -> std::result::Result<i64, DeviceError> {
    let [num, den] = <[u32; 2]>::from(per_revolution).map(u64::from);
    if !(HUNDREDTHS * den).is_multiple_of(num) {
        return Err(DeviceError::Setting {
            device: DEVICE,
            name: "rig.steps_per_revolution".into(),
            found: format!("[{num}, {den}]"),
            rule: "VAST's list has hundredths of a degree, so 36000 * the second number must be a multiple of the first, as with [500, 1]"
                .into(),
        });
    }
    Ok((HUNDREDTHS * den / num) as i64)
}

/// The whole list.
pub(super) fn text(stops: &[Steps], hundredths_per_step: i64, settings: &VastBridgeSettings) -> String {
    let (x_um, lamp) = (settings.x_position_um, if settings.tray_led { "on" } else { "off" });
    let line = |stop: &Steps| {
        let degrees = degrees(stop.0 * hundredths_per_step);
        // ctrl_output and trigger_input: VAST pulses in position and waits for a trigger. adjust_rotation: VAST does not change the
        // angle.
        format!("no\t{x_um}\t{degrees}\t1\t1\tno\t{lamp}\r\n")
    };
    stops.iter().map(line).collect()
}

/// The position within one turn, with two decimals and a comma.
fn degrees(hundredths: i64) -> String {
    let within_turn = hundredths.rem_euclid(HUNDREDTHS as i64);
    format!("{},{:02}", within_turn / 100, within_turn % 100)
}

/// Whether the list has exactly this text. A list that does not exist, or may not be read, has another text.
///
/// # Errors
/// The path leads to something that is not a regular file, or that cannot be read. A pipe is not waited for.
pub(super) fn is(path: &Path, text: &str) -> Result<bool> {
    match carved_files::read(path) {
        Ok(found) => Ok(found == text.as_bytes()),
        // A list that this user may not read can still be replaced.
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::PermissionDenied) => Ok(false),
        Err(e) => Err(e),
    }
}

/// Replaces the list in one step: a reader finds the old list or the new list.
pub(super) fn write(path: &Path, text: &str) -> Result<()> {
    // In the same folder, because a rename does not cross file systems.
    let fresh = path.with_extension("carved-new");
    // An interrupted write may have left one. It is not opened: opening a pipe would wait for a reader.
    match fs::remove_file(&fresh) {
        Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
        _ => {}
    }
    let mut file = fs::File::create_new(&fresh)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()?;
    drop(file);
    fs::rename(&fresh, path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::bridge::tests::settings;

    /// The lines of the public writer, with the same values: its `create_vast_rows(x_position = 0)` gives
    /// `no 0 3,60 1 1 no off` to `no 0 356,40 1 1 no off` and `no 0 0,00 1 1 no off`, separated by tabs.
    #[test]
    fn the_list_is_that_of_the_public_writer() {
        let per_step = hundredths_per_step(StepsPerRevolution::new(500, 1).unwrap()).unwrap();
        let settings = VastBridgeSettings { tray_led: false, ..settings("port", Path::new("external.txt")) };
        let turn: Vec<Steps> = (1..=100).map(|stop| Steps(5 * stop)).collect();
        let written = text(&turn, per_step, &settings);
        let lines: Vec<&str> = written.split_terminator("\r\n").collect();
        assert_eq!(lines.len(), 100);
        assert_eq!(lines[0], "no\t0\t3,60\t1\t1\tno\toff");
        assert_eq!(lines[9], "no\t0\t36,00\t1\t1\tno\toff");
        assert_eq!(lines[98..], ["no\t0\t356,40\t1\t1\tno\toff", "no\t0\t0,00\t1\t1\tno\toff"]);
    }

    #[test]
    fn positions_beyond_a_turn_are_written_within_it() {
        let per_step = hundredths_per_step(StepsPerRevolution::new(500, 1).unwrap()).unwrap();
        let settings = VastBridgeSettings { x_position_um: -120, ..settings("port", Path::new("external.txt")) };
        let written = text(&[Steps(-5), Steps(505)], per_step, &settings);
        assert_eq!(written, "no\t-120\t356,40\t1\t1\tno\ton\r\nno\t-120\t3,60\t1\t1\tno\ton\r\n");
    }

    #[test]
    fn steps_that_hundredths_cannot_say_are_refused() {
        let per_step = |num, den| hundredths_per_step(StepsPerRevolution::new(num, den).unwrap());
        assert_eq!(per_step(1000, 2).unwrap(), 72);
        assert_eq!(per_step(36_000, 1).unwrap(), 1);
        let said = per_step(6400, 1).unwrap_err().to_string();
        assert!(said.contains("[6400, 1]"), "{said}");
    }

    #[test]
    fn the_list_is_replaced_whole_and_nothing_is_left_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("external.txt");
        fs::write(&path, "old").unwrap();
        let half_read = fs::File::open(&path).unwrap();
        write(&path, "new\r\n").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "new\r\n");
        assert_eq!(std::io::read_to_string(half_read).unwrap(), "old", "who had begun to read reads the old list to its end");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_pipe_is_neither_read_nor_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("external.txt");
        assert!(!is(&path, "list").unwrap());
        fs::write(&path, "list").unwrap();
        assert!(is(&path, "list").unwrap() && !is(&path, "lis").unwrap());
        // What an interrupted write has left, or somebody has put there.
        nix::unistd::mkfifo(&folder.path().join("external.carved-new"), nix::sys::stat::Mode::S_IRWXU).unwrap();
        write(&path, "new").unwrap();
        assert!(is(&path, "new").unwrap());
        fs::remove_file(&path).unwrap();
        nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).unwrap();
        let error = is(&path, "new").unwrap_err().to_string();
        assert!(error.contains("a pipe"), "{error}");
    }
}
