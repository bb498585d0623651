//! The unit, its drop-in and the udev rule pass systemd's own checks, and the unit stays as closed as it is meant to be.

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
