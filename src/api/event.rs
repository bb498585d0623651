//! Events, as the stream serves them.

use carved_records as records;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Something that happened. Ids rise by one and last across restarts.
// The data are those of the journal, verbatim: a client that reads the journal and one that reads the stream see the same.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Event {
    pub id: u64,
    /// RFC 3339, UTC.
    pub time: String,
    /// One of the kinds that `docs/files.md` lists.
    pub kind: String,
    pub run: Option<String>,
    pub well: Option<String>,
    /// Its data; `docs/files.md` has those of each kind.
    pub data: serde_json::Value,
}

impl From<&records::Event> for Event {
    fn from(event: &records::Event) -> Self {
        let records::Event { id, body: records::EventBody { time, run, well, data } } = event.clone();
        Self { id, time, kind: data.kind().to_owned(), run, well, data: data.to_json() }
    }
}
