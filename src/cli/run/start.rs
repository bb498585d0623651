//! `carved run start`: a plate map's file and a few words become a run's plan.

use super::client::{Client, Daemon, segment};
use super::watch;
use crate::cli::plate;
use carved_records::RunPlan;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    daemon: Daemon,
    /// The plate map, a CSV or a JSON file (`.json`); of several plates in it the one named by --barcode is taken.
    #[arg(long)]
    plate_map: PathBuf,
    /// The plate's barcode.
    #[arg(long)]
    barcode: String,
    /// A method of the instrument's configuration (`GET /v1/methods`).
    #[arg(long)]
    method: String,
    /// The version that the method must have; any where none is given.
    #[arg(long)]
    method_version: Option<String>,
    /// Who starts it.
    #[arg(long)]
    operator: String,
    /// Name of the run; the barcode, 40 characters of it at most, and the time where none is given. The same name with the same plan starts nothing twice.
    #[arg(long)]
    id: Option<String>,
    /// The lab's own name for the run, kept with it.
    #[arg(long)]
    external_id: Option<String>,
    /// Follow the run until it ends, as `carved run watch` does.
    #[arg(long)]
    watch: bool,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let client = Client::new(&args.daemon)?;
    let map = match plate::read(&args.plate_map, Some(&args.barcode))? {
        Ok(map) => map,
        Err(mistakes) => {
            plate::print(&args.plate_map, &mistakes);
            return Ok(ExitCode::from(plate::MISTAKES));
        }
    };
    let now = jiff::Timestamp::now().strftime("%Y%m%dT%H%M%SZ");
    // A run's name has 64 characters at most.
    let named: String = args.barcode.chars().take(40).collect();
    let id = args.id.clone().unwrap_or_else(|| format!("{named}-{now}"));
    let wells = map.plate_map.len();
    let plan = RunPlan {
        method_version: args.method_version.clone(),
        external_id: args.external_id.clone(),
        metadata: map.metadata,
        ..RunPlan::new(&args.barcode, &args.method, &args.operator, map.plate_map)
    };
    client.send("PUT", &format!("/v1/runs/{}", segment(&id)), Some(&serde_json::to_value(plan)?))?;
    for note in &map.notes {
        say!("{}: {note}", args.plate_map.display());
    }
    say!("run {id} of {wells} well(s) is on the instrument's disk; `carved run watch` follows it");
    if args.watch { watch::follow(&client, &id) } else { Ok(ExitCode::SUCCESS) }
}
