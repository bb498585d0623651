//! A disk that fills during a run: a file system of a few hundred MB in memory, and a file that fills it. Mounting it needs root, and in a
//! container the right to mount.
#![cfg(feature = "aravis")]

use crate::common::{Daemon, crash, json};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Space for the plate, and for the free space that the daemon requires before it continues.
const SIZE: &str = "size=256m";

struct SmallDisk {
    dir: tempfile::TempDir,
}

impl SmallDisk {
    fn mount() -> Option<Self> {
        let dir = tempfile::tempdir().unwrap();
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", SIZE, "carved-test"]).arg(dir.path()).output();
        let why = match mounted {
            Ok(output) if output.status.success() => return Some(Self { dir }),
            Ok(output) => crate::common::stderr(&output),
            Err(error) => error.to_string(),
        };
        crate::common::strict::cannot_run(&format!("no file system of {SIZE} can be mounted here: {why}"));
        None
    }

    fn data(&self) -> PathBuf {
        self.dir.path().join("data")
    }

    fn ballast(&self) -> std::fs::File {
        std::fs::File::options().create(true).append(true).open(self.dir.path().join("ballast")).unwrap()
    }

    /// Fills all free space.
    fn fill(&self) {
        let mut ballast = self.ballast();
        for block in [1 << 20, 1 << 12, 1] {
            while ballast.write_all(&vec![0; block]).is_ok() {}
        }
    }

    fn make_room(&self) {
        std::fs::remove_file(self.dir.path().join("ballast")).unwrap();
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        // A lazy unmount, because a failed test may have left a daemon that is still ending.
        let _ = Command::new("umount").arg("--lazy").arg(self.dir.path()).status();
    }
}

const SIMULATED: [&str; 3] = ["--time-scale", "10", "--no-demo"];

fn held_by_the_disk(daemon: &Daemon) -> Value {
    // A run that is resumed is held before it writes anything.
    let status = daemon.wait("the fault", |s| s["state"] == "Held" && s["faults"] != json!([]));
    // Both a frame and an event may have met the full disk.
    assert!(status["faults"].as_array().unwrap().iter().all(|f| f["code"] == "disk_full"), "{status}");
    assert_eq!((&status["faults"][0]["category"], &status["run"]["outcome"]), (&json!("storage"), &Value::Null), "{status}");
    assert_eq!((&status["plate"]["removable"], &status["ready"]), (&json!(false), &json!(false)), "{status}");
    status
}

fn sound(data: &Path) {
    let text = std::fs::read_to_string(data.join("events.jsonl")).unwrap();
    for (line, id) in text.lines().zip(1..) {
        assert_eq!(serde_json::from_str::<Value>(line).unwrap()["id"], id, "no event is lost, none is there twice");
    }
    for well in ["A01", "A02"] {
        let mut check = Command::new("sha256sum");
        check.args(["--check", "--strict", "--quiet", "SHA256SUMS"]).current_dir(data.join("runs/r1").join(well));
        assert!(check.status().unwrap().success(), "{well}");
    }
}

/// Both cases in one test, so that only one such file system is in memory at a time.
#[test]
#[cfg_attr(not(has_root), ignore = "mounting a small file system needs root")]
fn a_run_is_held_while_the_disk_is_full_and_goes_on_where_it_was() {
    let Some(disk) = SmallDisk::mount() else { return };
    let data = disk.data();
    // The rest is filled soon, but is more than the estimate for the plate.
    disk.ballast().write_all(&vec![0; 100 << 20]).unwrap();
    let daemon = Daemon::start(&data, &SIMULATED);
    let wells = [json!({"well": "A01", "specimen": "bead"}), json!({"well": "A02", "specimen": "bead"})];
    let plan = json!({"plate_barcode": "P-1", "method": "standard", "operator": "test", "plate_map": wells});
    assert_eq!(daemon.put_run("r1", &plan), 201);

    // During a turn.
    let status = daemon.wait("the first views", |s| s["specimen"]["well"] == "A01" && s["specimen"]["view"].as_u64() >= Some(2));
    let told = status["specimen"]["view"].as_u64().unwrap() as usize;
    disk.fill();
    held_by_the_disk(&daemon);
    disk.make_room();
    let status = daemon.wait("the run's end", |s| s["state"] == "Complete");
    assert_eq!((&status["run"]["outcome"], &status["faults"]), (&json!("succeeded"), &json!([])), "{status}");
    let first = json(&data.join("runs/r1/A01.attempt-1/recording.json"));
    assert!(first["ledger"].as_array().unwrap().len() >= told, "views that were told of are kept: {first}");
    sound(&data);

    // While the numbers of a released specimen are computed.
    daemon.signal("TERM");
    daemon.ended();
    crash::before_the_first_well_was_done(&data, "r1", None);
    let well = data.join("runs/r1/A01");
    let [mesh, numbers] = ["mesh.ply", "measurement.json"].map(|name| std::fs::read(well.join(name)).unwrap());
    crash::without_results(&well);
    disk.fill();
    let daemon = Daemon::start(&data, &SIMULATED);
    let status = held_by_the_disk(&daemon);
    assert_eq!(status["run"]["results"][0]["outcome"], Value::Null, "{status}");
    disk.make_room();
    let status = daemon.wait("the run's end", |s| s["state"] == "Complete");
    assert_eq!((&status["run"]["outcome"], &status["faults"]), (&json!("succeeded"), &json!([])), "{status}");
    assert!(std::fs::read(well.join("mesh.ply")).unwrap() == mesh && std::fs::read(well.join("measurement.json")).unwrap() == numbers);
    assert!(!data.join("runs/r1/A01.attempt-2").exists(), "its larva is gone: there is no other attempt");
    sound(&data);
}
