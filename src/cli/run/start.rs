//! `carved run start`: makes a run's plan from a plate map's file and the command line.

use super::client::{Client, Daemon, segment};
use super::watch;
use crate::cli::plate;
use anyhow::bail;
use carved_records::RunPlan;
use std::path::PathBuf;
use std::process::ExitCode;
use ureq::http::StatusCode;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    daemon: Daemon,
    /// The plate map, a CSV or a JSON file (`.json`). If it has several plates, --barcode selects one.
    #[arg(long)]
    plate_map: PathBuf,
    /// Number of wells of the plate: 6, 12, 24, 48, 96, 384 or 1536 [default: that of the plate map, or a plate that holds the wells]
    #[arg(long, value_name = "WELLS")]
    plate_format: Option<u32>,
    /// What each column of the plate map is: the corrected output of `carved plate columns` [default: by the headings]
    #[arg(long, value_name = "JSON")]
    columns: Option<PathBuf>,
    /// The plate's barcode.
    #[arg(long)]
    barcode: String,
    /// A method of the instrument's configuration (`GET /v1/methods`).
    #[arg(long)]
    method: String,
    /// The version that the method must have [default: any]
    #[arg(long)]
    method_version: Option<String>,
    /// Name of the operator.
    #[arg(long)]
    operator: String,
    /// Name of the run [default: up to 40 characters of the barcode, and the time]. A repeated start with the same name and plan starts no
    /// second run, and fails if that run has ended.
    #[arg(long)]
    id: Option<String>,
    /// The lab's own name for the run, stored with it.
    #[arg(long)]
    external_id: Option<String>,
    /// Follow the run until it ends, as `carved run watch` does.
    #[arg(long)]
    watch: bool,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let client = Client::new(&args.daemon)?;
    let map = match plate::read(&args.plate_map, Some(&args.barcode), args.plate_format, args.columns.as_deref())? {
        Ok(map) => map,
        Err(mistakes) => {
            plate::print(&args.plate_map, &mistakes);
            return Ok(ExitCode::from(plate::MISTAKES));
        }
    };
    let now = jiff::Timestamp::now().strftime("%Y%m%dT%H%M%SZ");
    // The name of a run has at most 64 characters.
    let named: String = args.barcode.chars().take(40).collect();
    let id = args.id.clone().unwrap_or_else(|| format!("{named}-{now}"));
    let wells = map.plate_map.len();
    let plan = RunPlan {
        method_version: args.method_version.clone(),
        external_id: args.external_id.clone(),
        plate_format: map.plate_format,
        metadata: map.metadata,
        ..RunPlan::new(&args.barcode, &args.method, &args.operator, map.plate_map)
    };
    let (answer, _) = client.answer("PUT", &format!("/v1/runs/{}", segment(&id)), Some(&serde_json::to_value(plan)?))?;
    let is_known = answer == StatusCode::OK;
    if is_known && let Some(outcome) = watch::outcome(&client, &id)? {
        bail!("run {id} of the same plan has ended already: {outcome}. Nothing was started. Choose a new --id to measure the plate again");
    }
    for note in map.notes.iter().chain(&map.confirm) {
        say!("{}: {note}", args.plate_map.display());
    }
    if is_known {
        say!("run {id} of {wells} well(s) was started before and is under way, no second run was started; `carved run watch` follows it");
    } else {
        say!("run {id} of {wells} well(s) is on the instrument's disk; `carved run watch` follows it");
    }
    if args.watch { watch::follow(&client, &id) } else { Ok(ExitCode::SUCCESS) }
}
