//! Processor time of the daemon between runs, with its rotation axis and without: `cargo bench --bench idle`. Monitoring the devices must
//! cost almost nothing, and the search for a lost axis must not be a busy loop.
#![allow(clippy::unwrap_used, clippy::expect_used)] // a benchmark may panic; the tests' harness is part of it

#[path = "../tests/common/mod.rs"]
mod common;

use common::{Instrument, QUICK};
use std::time::Duration;

const SECONDS: f64 = 10.0;

fn main() {
    let instrument = Instrument::start(&QUICK, "", |scene| scene);
    let daemon = &instrument.daemon;
    let share = || {
        let before = daemon.cpu_s();
        std::thread::sleep(Duration::from_secs_f64(SECONDS));
        100.0 * (daemon.cpu_s() - before) / SECONDS
    };
    daemon.wait("readiness", |s| s["ready"] == true);
    let idle = share();
    instrument.rig.faults().unplug_serial();
    daemon.wait("the fault", |s| s["ready"] == false);
    println!("processor time over {SECONDS:.0} s: idle {idle:.1} %, unplugged {:.1} %", share());
}
