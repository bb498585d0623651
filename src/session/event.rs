//! One line of the event journal.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Something that happened. Ids rise by one and last across restarts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Event {
    pub id: u64,
    /// RFC 3339, UTC.
    pub time: String,
    /// One of [`kind::ALL`].
    pub kind: String,
    pub run: Option<String>,
    pub well: Option<String>,
    pub data: serde_json::Value,
}

/// Every kind of event, once; `docs/files.md` lists them.
pub mod kind {
    macro_rules! kinds {
        ($($name:ident = $word:literal;)*) => {
            $(pub const $name: &str = $word;)*
            /// All of them.
            pub const ALL: &[&str] = &[$($name),*];
        };
    }

    kinds! {
        DAEMON_STARTED = "daemon.started";
        DAEMON_STOPPING = "daemon.stopping";
        DAEMON_STOPPED = "daemon.stopped";
        RUN_ACCEPTED = "run.accepted";
        RUN_STARTED = "run.started";
        RUN_HOLD_REQUESTED = "run.hold_requested";
        RUN_STOP_REQUESTED = "run.stop_requested";
        RUN_ABORT_REQUESTED = "run.abort_requested";
        RUN_HELD = "run.held";
        RUN_RESUMED = "run.resumed";
        RUN_INTERRUPTED = "run.interrupted";
        RUN_ENDED = "run.ended";
        RUN_UNREADABLE = "run.unreadable";
        WELL_AWAITED = "well.awaited";
        WELL_LOADED = "well.loaded";
        WELL_UNLOADED = "well.unloaded";
        SPECIMEN_PHASE = "specimen.phase";
        SPECIMEN_DETECTED = "specimen.detected";
        SPECIMEN_TRIED_AGAIN = "specimen.tried_again";
        SPECIMEN_INTERRUPTED = "specimen.interrupted";
        SPECIMEN_RECOVERING = "specimen.recovering";
        SPECIMEN_RECOVERED = "specimen.recovered";
        SPECIMEN_DONE = "specimen.done";
        VIEW_TAKEN = "view.taken";
        FAULT_RAISED = "fault.raised";
        FAULT_ACKNOWLEDGED = "fault.acknowledged";
        FAULT_CLEARED = "fault.cleared";
        STORE_REGAINED = "store.regained";
        JOURNAL_REPAIRED = "journal.repaired";
        PLATE_ANNOUNCED = "plate.announced";
        PLATE_LOADED = "plate.loaded";
        PLATE_UNLOADED = "plate.unloaded";
        PLATE_HANDOFF_ABORTED = "plate.handoff_aborted";
    }
}

#[cfg(test)]
mod tests {
    use super::kind;

    #[test]
    fn the_documents_list_every_kind_of_event_and_no_other() {
        let documents = include_str!("../../docs/files.md");
        let list = documents.split("* `events.jsonl`:").nth(1).expect("docs/files.md lists the events").split("\n* ").next().unwrap();
        let words = list.split('`').skip(1).step_by(2);
        let mut listed: Vec<&str> = words.filter(|w| w.contains('.') && !w.contains(".json")).collect();
        let mut known = kind::ALL.to_vec();
        listed.sort_unstable();
        known.sort_unstable();
        assert_eq!(listed, known);
    }
}
