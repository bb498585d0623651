//! `instrument.json`: the uuid by which the runs of a data folder belong to one instrument, whatever its name is later.

use super::{StoreError, durable, schema};
use serde::{Deserialize, Serialize};
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
    match carved_files::read(&path) {
        Ok(text) => read(&path, &text).map(Some),
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(StoreError::io("read", &path)(e)),
    }
}

/// Reads the uuid of the folder. Makes and stores one if there is none.
pub(super) fn found_or_made(root: &Path) -> Result<String, StoreError> {
    if let Some(uuid) = instrument_uuid(root)? {
        return Ok(uuid);
    }
    let uuid = random()?;
    durable::write_json(&root.join(FILE), &InstrumentFile { schema: SCHEMA.into(), uuid: uuid.clone() })?;
    tracing::info!(uuid, "the instrument got a uuid");
    Ok(uuid)
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
