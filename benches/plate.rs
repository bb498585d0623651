//! Time per well on the emulated rig, phase by phase: `cargo bench --bench plate -- --wells 12`.
//!
//! ```text
//! carved simulate (child) <── plan of larvae of 3, 4 and 5 dpf at ASD 21, SD 6.93
//!        └── events.jsonl: the times of each specimen.done ──> median and 95th percentile per phase, and the program's own time
//! ```
//! The rig's motors and exposures take their own time. The rest of the time per well is the program's own.

use anyhow::{Context, bail, ensure};
use clap::Parser;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

#[derive(Parser)]
struct Options {
    #[arg(long, default_value_t = 12)]
    wells: u32,
    /// Speed-up of motor and shutter over real time.
    #[arg(long, default_value_t = 1.0)]
    time_scale: f64,
    /// Passed on by `cargo bench`.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A child process that is killed when this program ends, however it ends.
struct Simulator(Child);

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ended_already = self.0.kill();
        let _ended_already = self.0.wait();
    }
}

fn main() -> anyhow::Result<()> {
    let options = Options::parse();
    ensure!((1..=96).contains(&options.wells), "--wells is {}; a plate has 1 to 96", options.wells);
    let data = tempfile::tempdir()?;
    let mut command = Command::new(env!("CARGO_BIN_EXE_carved"));
    command.args(["simulate", "--no-demo", "--empty", "P24", "--listen", "127.0.0.1:0", "--data"]).arg(data.path());
    command.args(["--time-scale", &options.time_scale.to_string()]).env("CARVED_LOG", "warn").stdout(Stdio::piped());
    let mut daemon = Simulator(command.spawn().context("carved simulate")?);
    let mut line = String::new();
    BufReader::new(daemon.0.stdout.take().context("its output")?).read_line(&mut line)?;
    let url = line.split_whitespace().find(|word| word.starts_with("http://")).context("no address in its first line")?.to_owned();

    let well = |i: u32| json!({"well": format!("{}{:02}", char::from(b'A' + (i / 12) as u8), i % 12 + 1), "dpf": 3 + i % 3});
    let wells: Vec<Value> = (0..options.wells).map(well).collect();
    let plan = json!({"plate_barcode": "BENCH", "method": "standard", "operator": "bench", "plate_map": wells});
    ureq::put(format!("{url}/v1/runs/bench")).send_json(&plan)?;
    loop {
        let status: Value = ureq::get(format!("{url}/v1/status")).call()?.body_mut().read_json()?;
        if let Some(outcome) = status["run"]["outcome"].as_str() {
            println!("{} wells: {outcome}, {}", options.wells, status["run"]["wells"]);
            break;
        }
        if status["faults"].as_array().is_some_and(|faults| !faults.is_empty()) {
            bail!("{}", status["faults"]);
        }
        std::thread::sleep(Duration::from_millis(500));
    }
    let events = std::fs::read_to_string(data.path().join("events.jsonl"))?;
    let mut table: BTreeMap<String, Vec<f64>> = BTreeMap::new();
    for event in events.lines().map(serde_json::from_str::<Value>) {
        let event = event?;
        let times = &event["data"]["times"];
        if event["kind"] != "specimen.done" || event["data"]["outcome"] != "succeeded" {
            continue;
        }
        for (phase, seconds) in times["phases_s"].as_object().context("no phases in specimen.done")? {
            table.entry(format!("  {phase}")).or_default().extend(seconds.as_f64());
        }
        for name in ["devices_s", "own_s"] {
            table.entry(name.into()).or_default().extend(times[name].as_f64());
        }
    }
    println!("{:<14} {:>9} {:>9}", "s per well", "median", "95 %");
    for (name, mut seconds) in table {
        seconds.sort_by(f64::total_cmp);
        let at = |q: f64| seconds[((seconds.len() - 1) as f64 * q).round() as usize];
        println!("{name:<14} {:>9.3} {:>9.3}", at(0.5), at(0.95));
    }
    Ok(())
}
