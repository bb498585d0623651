//! The work of `simulate` once the daemon runs, as its client: the demo plate, a replayed recording, or nothing.

use crate::api::{self, RunStatus};
use crate::session::SessionHandle;
use carved_records::{PlannedWell, RunPlan, SpecimenKind};

use carved_core::pipeline::SpecimenRecord;
use carved_store::{MEASUREMENT, MeasurementFile, RecordingReader, durable};
use std::path::Path;

/// The work after the start, as a client of the daemon.
pub enum Job {
    Serve,
    Demo,
    /// The replayed recording's plan and numbers, and their origin.
    Replay {
        plan: Box<RunPlan>,
        recorded: Box<SpecimenRecord>,
        name: String,
    },
}

impl Job {
    pub async fn run(self, handle: SessionHandle, data: &Path) -> anyhow::Result<()> {
        if let (Self::Demo, Some(open)) = (&self, left_open(&handle).await) {
            announce!("Run {} was left open by an earlier daemon; it continues before any other run starts.", open.id);
            let Some(run) = finished(&handle, &open.id).await else { return Ok(()) };
            announce!("{}", table(&run, &data.join("runs").join(&run.id)).trim_end());
            announce!("Serving on. Ctrl-C ends it.");
            return Ok(());
        }
        let (prefix, plan) = match &self {
            Self::Serve => return Ok(()),
            Self::Demo => ("demo", demo_plan()),
            Self::Replay { plan, .. } => ("replay", RunPlan::clone(plan)),
        };
        let id = format!("{prefix}-{}", jiff::Timestamp::now().strftime("%Y%m%dT%H%M%S"));
        let well = plan.plate_map[0].well.clone();
        handle.put_run(id.clone(), plan).await?;
        let run = finished(&handle, &id).await;
        let Some(run) = run else { return Ok(()) };
        if let Self::Replay { recorded, name, .. } = &self {
            let replayed = data.join("runs").join(&id).join(&well).join(MEASUREMENT);
            announce!("{}", compare(recorded, name, &replayed)?);
        } else {
            announce!("{}", table(&run, &data.join("runs").join(&id)).trim_end());
        }
        announce!("Serving on. Ctrl-C ends it.");
        Ok(())
    }
}

/// The run that an earlier daemon left unfinished, after this one has looked for it.
async fn left_open(handle: &SessionHandle) -> Option<RunStatus> {
    let mut status = handle.status();
    while status.not_ready_reason.as_deref() == Some("starting") {
        status = handle.status_after(status.revision).await;
    }
    status.run.filter(|run| run.outcome.is_none())
}

/// Waits for the end of a run. `None` if another run has taken its place.
async fn finished(handle: &SessionHandle, id: &str) -> Option<RunStatus> {
    let mut revision = 0;
    loop {
        let status = handle.status_after(revision).await;
        revision = status.revision;
        let run = status.run.filter(|r| r.id == id)?;
        if run.outcome.is_some() {
            return Some(run);
        }
    }
}

fn demo_plan() -> RunPlan {
    let wells = vec![
        PlannedWell::new("A01", SpecimenKind::Larva, Some(3.0)),
        PlannedWell::new("A02", SpecimenKind::Larva, Some(5.0)),
        PlannedWell::new("A03", SpecimenKind::Bead, None),
        PlannedWell::new("A04", SpecimenKind::Larva, Some(4.0)),
    ];
    RunPlan::new("DEMO", "standard", "demo", wells)
}

/// The numbers of the demo compared with the truth of the phantoms.
fn table(run: &RunStatus, folder: &Path) -> String {
    let row = |w: &api::WellStatus| {
        let hull = RecordingReader::open(&folder.join(&w.well))
            .ok()
            .and_then(|r| r.recording().truth.as_ref().and_then(|t| t.get("hull_volume_um3")).and_then(serde_json::Value::as_f64));
        let number = |x: Option<f64>| x.map_or_else(|| "-".into(), |x| format!("{x:.4e}"));
        let difference = w.volume_um3.zip(hull).map_or_else(|| "-".into(), |(v, h)| format!("{:+.2} %", (v / h - 1.0) * 100.0));
        let kind = match (w.specimen, w.dpf) {
            (api::SpecimenKind::Bead, _) => "bead".to_owned(),
            (api::SpecimenKind::Larva, Some(dpf)) => format!("{dpf} dpf"),
            (api::SpecimenKind::Larva, None) => "larva".to_owned(),
        };
        let outcome = match (&w.outcome, &w.reason) {
            (Some(o), Some(reason)) => format!("{o:?}: {reason}"),
            (Some(o), None) => format!("{o:?}"),
            (None, _) => "-".into(),
        };
        format!(
            "{:<5} {kind:<10} {outcome:<10} {:<13} {:<13} {difference:<11} {}\n",
            w.well,
            number(w.volume_um3),
            number(hull),
            number(w.area_um2)
        )
    };
    format!(
        "Run {} has ended: {}. Numbers of a simulation:\n\
         well  specimen   outcome    volume um^3   ideal hull    difference  area um^2\n{}",
        run.id,
        run.outcome.map_or_else(String::new, |o| format!("{o:?}").to_lowercase()),
        run.results.iter().map(row).collect::<String>()
    )
}

/// Compares only the numbers, because a replay has the mode of a simulation whatever the recording has.
fn compare(recorded: &SpecimenRecord, name: &str, replayed: &Path) -> anyhow::Result<String> {
    let found: MeasurementFile = durable::read_json(replayed, "the replay's measurement")?;
    let verdict = if found.record == *recorded { "identical, bit for bit" } else { "NOT the same" };
    Ok(format!("Replayed numbers are {verdict}: {name} and {}", replayed.display()))
}
