//! A notice, and its form for each kind of receiver.

use crate::api::{Fault, Hold, InstrumentIdentity, Mode, RunOutcome, State, Status, WellCounts};
use crate::config::NotifyFormat;
use serde::Serialize;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

const SCHEMA: &str = "carved.notice/1";

/// What has happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum EventName {
    /// A run is held.
    #[serde(rename = "run.held")]
    RunHeld,
    /// A run has ended.
    #[serde(rename = "run.ended")]
    RunEnded,
    /// A person has to do something.
    #[serde(rename = "person.needed")]
    PersonNeeded,
    /// `carved notify test`.
    #[serde(rename = "test")]
    Test,
}

/// A message to a person. It is the body of a request in the format `json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Notice {
    schema: &'static str,
    /// Differs between any two notices. A repeated delivery has the same.
    pub id: String,
    pub event: EventName,
    /// RFC 3339, UTC.
    time: String,
    instrument: InstrumentIdentity,
    mode: Mode,
    state: State,
    needs_person: bool,
    title: String,
    text: String,
    run: Option<NoticeRun>,
    faults: Vec<Fault>,
    #[serde(skip)]
    made: Instant,
}

/// The run of a notice.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct NoticeRun {
    id: String,
    external_id: Option<String>,
    plate_barcode: Option<String>,
    method: String,
    operator: String,
    wells: WellCounts,
    outcome: Option<RunOutcome>,
    hold: Option<Hold>,
    goes_on_by_itself: bool,
}

impl Notice {
    /// What the status says of this event. `number` differs between the notices of a boot.
    pub fn new(event: EventName, status: &Status, needs_person: bool, number: u64) -> Self {
        let name = &status.instrument.name;
        let simulated = if status.mode == Mode::Hardware { "" } else { " (simulated)" };
        let run = status.run.as_ref();
        let what = match event {
            EventName::RunHeld => "the run is held".to_owned(),
            EventName::RunEnded => {
                let outcome = run.and_then(|run| run.outcome).map(word).unwrap_or_default();
                format!("the run has ended: {outcome}")
            }
            EventName::PersonNeeded => "somebody is needed".to_owned(),
            EventName::Test => "test of the notices".to_owned(),
        };
        let of_run = run.map(|run| NoticeRun {
            id: run.id.clone(),
            external_id: run.external_id.clone(),
            plate_barcode: status.plate.barcode.clone(),
            method: run.method.clone(),
            operator: run.operator.clone(),
            wells: run.wells,
            outcome: run.outcome,
            hold: run.hold.clone(),
            goes_on_by_itself: run.goes_on_by_itself,
        });
        Self {
            schema: SCHEMA,
            id: format!("{}-{number}", status.boot_id),
            event,
            time: jiff::Timestamp::now().to_string(),
            instrument: status.instrument.clone(),
            mode: status.mode,
            state: status.state,
            needs_person,
            title: format!("{name}{simulated}: {what}"),
            text: text(status),
            run: of_run,
            faults: status.faults.clone(),
            made: Instant::now(),
        }
    }

    /// Time since it was made.
    pub(super) fn age(&self) -> Duration {
        self.made.elapsed()
    }

    /// The body of a request. `topic` is the topic of ntfy, `page` the address of the instrument's page.
    pub fn body(&self, format: NotifyFormat, topic: &str, page: Option<&str>) -> Value {
        match format {
            NotifyFormat::Json => {
                let mut body = serde_json::to_value(self).unwrap_or_default();
                body["page"] = json!(page);
                body
            }
            NotifyFormat::Ntfy => {
                // 3 is the default of ntfy. From 4 on, phones make a longer sound.
                let priority = if self.needs_person { 4 } else { 3 };
                let mut body =
                    json!({ "topic": topic, "title": self.title, "message": self.text, "priority": priority, "tags": [self.tag()] });
                if let Some(page) = page {
                    body["click"] = json!(page);
                }
                body
            }
            NotifyFormat::Slack => {
                let link = page.map(|page| format!("\n<{}|Open the page of the instrument>", escaped(page))).unwrap_or_default();
                json!({ "text": format!("*{}*\n{}{link}", escaped(&self.title), escaped(&self.text)) })
            }
        }
    }

    /// The name of an emoji of ntfy.
    fn tag(&self) -> &'static str {
        match self.event {
            EventName::PersonNeeded => "raising_hand",
            EventName::RunHeld if self.needs_person => "raising_hand",
            EventName::RunHeld => "hourglass_flowing_sand",
            EventName::RunEnded => "checkered_flag",
            EventName::Test => "bell",
        }
    }
}

/// What the instrument does, the next action, and the faults with what to do.
fn text(status: &Status) -> String {
    let mut lines = vec![status.doing.clone()];
    if let Some(run) = &status.run {
        let plate = status.plate.barcode.as_ref().map(|barcode| format!(", plate {barcode}")).unwrap_or_default();
        let w = &run.wells;
        lines.push(format!(
            "Run {}{plate}: {} wells, {} succeeded, {} flagged, {} failed, {} skipped, {} interrupted, {} to come.",
            run.id, w.total, w.succeeded, w.flagged, w.failed, w.skipped, w.interrupted, w.pending
        ));
        lines.extend(run.hold.as_ref().and_then(|hold| hold.next_action.clone()));
    }
    for fault in &status.faults {
        lines.push(format!("Fault {} ({}): {} {}", fault.seq, fault.code, fault.message, fault.what_to_do));
    }
    lines.join("\n")
}

fn word(value: impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

/// Slack reads these three characters as markup.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::api::{Pending, Plate};

    pub fn status() -> Status {
        Status {
            schema: String::new(),
            revision: 1,
            boot_id: "b".into(),
            server_time: String::new(),
            uptime_s: 0.0,
            version: String::new(),
            instrument: InstrumentIdentity { name: "vast-1".into(), ..InstrumentIdentity::default() },
            mode: Mode::Hardware,
            ready: false,
            not_ready_reason: None,
            state: State::Held,
            doing: "Held: 1 < 2 & so on.".into(),
            pending: Pending::default(),
            plate: Plate::default(),
            queue: Vec::new(),
            run: None,
            specimen: None,
            hardware: crate::api::HardwareStatus::default(),
            notices: None,
            calibration: None,
            faults: Vec::new(),
        }
    }

    #[test]
    fn each_receiver_gets_its_own_form() {
        let notice = Notice::new(EventName::RunHeld, &status(), true, 7);
        let json = notice.body(NotifyFormat::Json, "", None);
        assert_eq!((&json["id"], &json["event"], &json["needs_person"]), (&json!("b-7"), &json!("run.held"), &json!(true)));
        assert_eq!(json["page"], Value::Null);
        let ntfy = notice.body(NotifyFormat::Ntfy, "topic", None);
        let expected = json!({"topic": "topic", "title": "vast-1: the run is held", "message": "Held: 1 < 2 & so on.", "priority": 4,
            "tags": ["raising_hand"]});
        assert_eq!(ntfy, expected);
        let slack = notice.body(NotifyFormat::Slack, "", None);
        assert_eq!(slack, json!({"text": "*vast-1: the run is held*\nHeld: 1 &lt; 2 &amp; so on."}));
    }

    #[test]
    fn each_form_links_to_the_page_whose_address_is_known() {
        let notice = Notice::new(EventName::RunHeld, &status(), true, 7);
        let body = |format| notice.body(format, "topic", Some("http://vast-1.lab:8420/?a=1&b"));
        assert_eq!(body(NotifyFormat::Json)["page"], "http://vast-1.lab:8420/?a=1&b");
        assert_eq!(body(NotifyFormat::Ntfy)["click"], "http://vast-1.lab:8420/?a=1&b");
        let slack =
            "*vast-1: the run is held*\nHeld: 1 &lt; 2 &amp; so on.\n<http://vast-1.lab:8420/?a=1&amp;b|Open the page of the instrument>";
        assert_eq!(body(NotifyFormat::Slack), json!({ "text": slack }));
    }
}
