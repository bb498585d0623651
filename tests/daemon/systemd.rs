//! The unit, its drop-in and the udev rule pass the checks of systemd, and the unit stays as restricted as intended.

use std::process::Command;

#[test]
#[cfg_attr(not(has_systemd_analyze), ignore = "no systemd-analyze: apt-get install systemd")]
fn the_unit_passes_systemds_own_checks() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/systemd/verify.sh");
    let ran = Command::new(script).output().unwrap();
    let said = format!("{}{}", String::from_utf8_lossy(&ran.stdout), String::from_utf8_lossy(&ran.stderr));
    assert!(ran.status.success(), "{said}");
    assert!(said.contains("exposure level"), "{said}");
}
