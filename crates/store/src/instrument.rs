//! `instrument.json`: the uuid by which the runs of a data folder belong to one instrument, whatever its name is later.

use super::{RunRecord, StoreError, durable, is_own_folder, schema};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::Path;

const SCHEMA: &str = "carved.instrument/1";
const FILE: &str = "instrument.json";
/// The kernel's source of random (version 4) uuids.
const KERNEL: &str = "/proc/sys/kernel/random/uuid";

/// Content of the file.
#[derive(Serialize, Deserialize)]
struct InstrumentFile {
    schema: String,
    uuid: String,
}

/// The uuid of the instrument that has this data folder. `None` before the first start of a daemon on it.
///
/// # Errors
/// The file of the uuid is damaged, or it cannot be read.
pub fn instrument_uuid(root: &Path) -> Result<Option<String>, StoreError> {
    let path = root.join(FILE);
    match carved_files::read_own(&path) {
        Ok(text) => read(&path, &text).map(Some),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(StoreError::io("read", &path)(e)),
    }
}

/// Reads the uuid of the folder. Makes and stores one if there is none. That of a damaged file is taken from the runs of the folder, if they
/// agree, and the damaged file is kept beside the new one.
pub(super) fn found_or_made(root: &Path) -> Result<String, StoreError> {
    let path = root.join(FILE);
    let uuid = match instrument_uuid(root) {
        Ok(Some(uuid)) => return Ok(uuid),
        Ok(None) => {
            let uuid = random()?;
            tracing::info!(uuid, "the instrument got a uuid");
            uuid
        }
        Err(error @ StoreError::Identity { .. }) => {
            let Some(uuid) = of_runs(root) else { return Err(error) };
            let kept = root.join(format!("{FILE}.damaged"));
            // At every moment there is a file of this name: without one a new uuid would be made.
            durable::write(&kept, &carved_files::read_own(&path).map_err(StoreError::io("read", &path))?)?;
            tracing::error!(%error, uuid, kept = %kept.display(), "the uuid of the instrument was taken from the records of its runs");
            uuid
        }
        Err(error) => return Err(error),
    };
    durable::write_json(&path, &InstrumentFile { schema: SCHEMA.into(), uuid: uuid.clone() })?;
    Ok(uuid)
}

/// The uuid that the runs of the folder name. `None` if none names one, or if they name several. A run that cannot be read names none.
fn of_runs(root: &Path) -> Option<String> {
    let folders = std::fs::read_dir(root.join("runs")).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let records = folders.filter(|folder| is_own_folder(folder)).filter_map(|folder| RunRecord::of_folder(&folder).ok());
    let named: BTreeSet<String> = records.filter_map(|run| Some(run.instrument?.uuid)).filter(|uuid| is_uuid(uuid)).collect();
    named.first().filter(|_| named.len() == 1).cloned()
}

fn read(path: &Path, text: &[u8]) -> Result<String, StoreError> {
    let damaged = |why: String| StoreError::Identity { path: path.to_owned(), why };
    let InstrumentFile { uuid, .. } = schema::parse(path, text, SCHEMA).map_err(|error| match error {
        StoreError::Format { found, .. } => damaged(found),
        other => other,
    })?;
    if is_uuid(&uuid) { Ok(uuid) } else { Err(damaged(format!("{uuid:?} is no uuid"))) }
}

fn random() -> Result<String, StoreError> {
    let path = Path::new(KERNEL);
    let text = std::fs::read_to_string(path).map_err(StoreError::io("read", path))?;
    let uuid = text.trim();
    let wrong = || StoreError::Format { path: path.to_owned(), expected: "a uuid", found: format!("{uuid:?}") };
    if is_uuid(uuid) { Ok(uuid.to_owned()) } else { Err(wrong()) }
}

/// Whether the text is a uuid in lower case with hyphens.
fn is_uuid(text: &str) -> bool {
    let groups: Vec<&str> = text.split('-').collect();
    groups.iter().map(|group| group.len()).eq([8, 4, 4, 4, 12])
        && groups.concat().bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))
}

#[cfg(test)]
mod tests {
    use super::super::Claim;
    use super::*;

    #[test]
    fn the_uuid_is_made_once_per_folder() {
        let [one, other] = [(), ()].map(|()| tempfile::tempdir().unwrap());
        let first = Claim::on(one.path()).unwrap().instrument_uuid().unwrap();
        assert!(is_uuid(&first), "{first}");
        assert_eq!(Claim::on(one.path()).unwrap().instrument_uuid().unwrap(), first);
        assert_ne!(Claim::on(other.path()).unwrap().instrument_uuid().unwrap(), first);
    }

    #[test]
    fn a_damaged_file_is_written_again_from_the_records_of_the_runs_that_agree() {
        use carved_records::{InstrumentIdentity, Method, Mode, PlannedWell, RunPlan, SpecimenKind};
        let dir = tempfile::tempdir().unwrap();
        let uuids = ["0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11", "1fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11"];
        let run = |id: &str, uuid: Option<&str>| {
            let plan = RunPlan::new("P-1", "standard", "kim", vec![PlannedWell::new("A01", SpecimenKind::Bead, None)]);
            let method: Method = serde_json::from_str(r#"{"asd": 21, "order": "sequential", "epsilon": 0.05, "voxel_um": 6.93}"#).unwrap();
            let instrument = uuid.map(|uuid| InstrumentIdentity { uuid: uuid.into(), ..InstrumentIdentity::default() });
            let record = RunRecord { instrument, ..RunRecord::new(id, plan, method, Mode::Simulated, None) };
            let folder = dir.path().join("runs").join(id);
            std::fs::create_dir(&folder).unwrap();
            durable::write_json(&folder.join("run.json"), &record).unwrap();
        };
        let claim = Claim::on(dir.path()).unwrap();
        let path = dir.path().join(FILE);
        std::fs::write(&path, "{\"schema\": \"carved.instrumenu/1\"}").unwrap();
        run("imported", None);
        assert!(claim.instrument_uuid().is_err(), "no run names one");
        run("r1", Some(uuids[0]));
        run("r2", Some(uuids[0]));
        assert_eq!(claim.instrument_uuid().unwrap(), uuids[0]);
        assert_eq!(instrument_uuid(dir.path()).unwrap().as_deref(), Some(uuids[0]), "it is written again");
        assert!(std::fs::read_to_string(dir.path().join("instrument.json.damaged")).unwrap().contains("instrumenu"));
        // Once more: the newest damaged file is kept.
        std::fs::write(&path, "{").unwrap();
        assert_eq!(claim.instrument_uuid().unwrap(), uuids[0]);
        assert_eq!(std::fs::read_to_string(dir.path().join("instrument.json.damaged")).unwrap(), "{");
        std::fs::write(&path, "").unwrap();
        run("r3", Some(uuids[1]));
        assert!(claim.instrument_uuid().is_err(), "two instruments");
    }

    #[test]
    fn a_damaged_file_is_reported_with_the_way_out_and_stays_as_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let claim = Claim::on(dir.path()).unwrap();
        let path = dir.path().join(FILE);
        let good = format!(r#"{{"schema": "{SCHEMA}", "uuid": "0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11"}}"#);
        for damaged in ["", "{", &good[..30], &good.replace("0fb2c0de", "0fb2"), &good.replace("fb", "FB"), &good.replace(SCHEMA, "x")] {
            std::fs::write(&path, damaged).unwrap();
            let error = claim.instrument_uuid().unwrap_err();
            assert!(matches!(error, StoreError::Identity { .. }), "{damaged:?}: {error}");
            for part in ["instrument.json", "Nothing was changed", "run.json", SCHEMA] {
                assert!(error.to_string().contains(part), "{error}");
            }
            assert_eq!(std::fs::read_to_string(&path).unwrap(), damaged);
        }
        std::fs::write(&path, good.replace("/1", "/2")).unwrap();
        assert!(matches!(claim.instrument_uuid(), Err(StoreError::Newer { .. })));
        std::fs::write(&path, good).unwrap();
        assert_eq!(claim.instrument_uuid().unwrap(), "0fb2c0de-93b2-4ed9-8f27-0a4f3f2a9c11");
    }
}
