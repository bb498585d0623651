//! Queries of the index. Each query has its own read-only connection.

use super::{BUSY, FILE, failed};
use crate::StoreError;
use carved_records::{Event, EventBody, EventData, Phase, ViewTaken, WellCounts, kind};
use rusqlite::{Connection, OpenFlags, OptionalExtension, Row, params};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Filter of a list of runs. `None` matches all.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunsQuery {
    pub limit: usize,
    /// Only runs behind this place in the list.
    pub after: Option<Cursor>,
    pub plate_barcode: Option<String>,
    pub method: Option<String>,
    pub operator: Option<String>,
    pub external_id: Option<String>,
    /// Part of the name of a compound of any of its wells.
    pub compound: Option<String>,
    /// `hardware` or `simulated`.
    pub mode: Option<String>,
    /// `open` matches runs without an outcome.
    pub outcome: Option<String>,
}

/// A place in the list of runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cursor {
    pub place_us: i64,
    pub id: String,
}

/// A run in a list of runs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRow {
    pub id: String,
    pub external_id: Option<String>,
    pub mode: String,
    pub software_version: String,
    pub plate_barcode: String,
    pub method: String,
    pub operator: String,
    /// RFC 3339, UTC.
    pub started: String,
    pub ended: Option<String>,
    pub outcome: Option<String>,
    pub wells: WellCounts,
    /// Its place in the order in which the runs were accepted, us.
    #[serde(skip)]
    pub place_us: i64,
}

impl RunRow {
    /// The place in the list behind this run.
    pub fn cursor(&self) -> Cursor {
        Cursor { place_us: self.place_us, id: self.id.clone() }
    }
}

/// The events behind one that a reader has seen.
#[derive(Debug, PartialEq)]
pub enum EventsAfter {
    /// The next events, oldest first, without a gap.
    Events(Vec<Event>),
    /// The event is unknown: it is too old, or of another journal.
    Unknown,
}

fn ask<T>(root: &Path, what: impl FnOnce(&Connection) -> rusqlite::Result<T>) -> Result<T, StoreError> {
    let path = root.join(FILE);
    super::check_own(&path)?;
    let answer = || {
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(&path, flags)?;
        connection.busy_timeout(BUSY)?;
        what(&connection)
    };
    answer().map_err(failed("be read", &path))
}

/// The runs with their place in the order in which they were accepted, us. The journal has this order; the wall clock may be set back. Where
/// the clock was right, `place_us` is the time of the start. A run without events, such as an imported one, has the time of its start.
const PLACED: &str = "
    WITH accepted AS (SELECT *, (SELECT MIN(e.id) FROM events e INDEXED BY events_by_run WHERE e.run = runs.id) AS event FROM runs),
    numbered AS (SELECT *, ROW_NUMBER() OVER (ORDER BY event) AS number FROM accepted WHERE event IS NOT NULL),
    placed AS (
        SELECT *, number + MAX(started_us - number) OVER (ORDER BY event ROWS UNBOUNDED PRECEDING) AS place_us FROM numbered
        UNION ALL SELECT *, 0 AS number, started_us AS place_us FROM accepted WHERE event IS NULL
    )";

/// The runs without an outcome, in the order in which they were accepted.
pub(super) fn open(c: &Connection) -> rusqlite::Result<Vec<String>> {
    let select = format!("{PLACED} SELECT id FROM placed WHERE outcome IS NULL ORDER BY place_us, id");
    c.prepare(&select)?.query_map([], |row| row.get(0))?.collect()
}

pub fn runs(root: &Path, query: &RunsQuery) -> Result<Vec<RunRow>, StoreError> {
    let (us, id) = query.after.as_ref().map_or((i64::MAX, ""), |c| (c.place_us, &c.id));
    ask(root, |c| {
        let mut select = c.prepare(&format!(
            "{PLACED}
             SELECT id, external_id, mode, software, plate_barcode, method, operator, started, ended, outcome, place_us FROM placed
             WHERE (place_us < ?1 OR place_us = ?1 AND id < ?2) AND (?3 IS NULL OR plate_barcode = ?3) AND (?4 IS NULL OR method = ?4)
               AND (?5 IS NULL OR operator = ?5) AND (?6 IS NULL OR external_id = ?6) AND (?7 IS NULL OR mode = ?7)
               AND (?8 IS NULL OR COALESCE(outcome, 'open') = ?8)
               AND (?9 IS NULL OR id IN (SELECT run FROM specimen_table WHERE instr(lower(compound), lower(?9)) > 0))
             ORDER BY place_us DESC, id DESC LIMIT ?10",
        ))?;
        let q = query;
        let found = select.query_map(
            params![us, id, q.plate_barcode, q.method, q.operator, q.external_id, q.mode, q.outcome, q.compound, q.limit],
            run_row,
        )?;
        let mut rows: Vec<RunRow> = found.collect::<Result<_, _>>()?;
        let mut wells = c.prepare("SELECT outcome, flags <> '[]', COUNT(*) FROM specimens WHERE run = ? AND attempt = 0 GROUP BY 1, 2")?;
        for row in &mut rows {
            let mut found = wells.query([&row.id])?;
            while let Some(group) = found.next()? {
                let outcome = group.get::<_, Option<String>>(0)?.and_then(|word| serde_json::from_value(word.into()).ok());
                row.wells.add(outcome, group.get(1)?, group.get(2)?);
            }
        }
        Ok(rows)
    })
}

fn run_row(row: &Row) -> rusqlite::Result<RunRow> {
    Ok(RunRow {
        id: row.get(0)?,
        external_id: row.get(1)?,
        mode: row.get(2)?,
        software_version: row.get(3)?,
        plate_barcode: row.get(4)?,
        method: row.get(5)?,
        operator: row.get(6)?,
        started: row.get(7)?,
        ended: row.get(8)?,
        outcome: row.get(9)?,
        wells: WellCounts::default(),
        place_us: row.get(10)?,
    })
}

pub fn events_after(root: &Path, id: u64, most: usize) -> Result<EventsAfter, StoreError> {
    ask(root, |c| {
        let known: Option<u64> = c.query_row("SELECT id FROM events WHERE id = ?", [id], |row| row.get(0)).optional()?;
        if known.is_none() && id > 0 {
            return Ok(EventsAfter::Unknown);
        }
        let mut select = c.prepare("SELECT id, time, kind, run, well, data FROM events WHERE id > ? ORDER BY id LIMIT ?")?;
        let events: Vec<Event> = select.query_map(params![id, most], event_row)?.collect::<Result<_, _>>()?;
        let whole = events.iter().zip(id + 1..).all(|(event, expected)| event.id == expected);
        Ok(if whole { EventsAfter::Events(events) } else { EventsAfter::Unknown })
    })
}

/// Events of a run after `after`, oldest first. Those of single views are left out: there are some twenty of each well.
pub fn events_of(root: &Path, run: &str, after: u64, most: usize) -> Result<Vec<Event>, StoreError> {
    ask(root, |c| {
        let mut select = c.prepare(
            "SELECT id, time, kind, run, well, data FROM events INDEXED BY events_by_run WHERE run = ?1 AND id > ?2 AND kind <> ?3
             ORDER BY id LIMIT ?4",
        )?;
        select.query_map(params![run, after, kind::VIEW_TAKEN, most], event_row)?.collect()
    })
}

pub fn was_accepted(root: &Path, run: &str) -> Result<bool, StoreError> {
    let known = "SELECT EXISTS (SELECT 1 FROM events WHERE run = ? AND kind = ?)";
    ask(root, |c| c.query_row(known, [run, kind::RUN_ACCEPTED], |row| row.get(0)))
}

/// The views of the newest attempt at a well, oldest first.
pub fn views(root: &Path, run: &str, well: &str) -> Result<Vec<ViewTaken>, StoreError> {
    ask(root, |c| {
        let mut select = c.prepare(
            "SELECT kind, data FROM events INDEXED BY events_by_run WHERE run = ?1 AND well = ?2 AND kind IN (?3, ?4) ORDER BY id",
        )?;
        let mut found = select.query([run, well, kind::SPECIMEN_PHASE, kind::VIEW_TAKEN])?;
        let mut views = Vec::new();
        while let Some(row) = found.next()? {
            match data_of(&row.get::<_, String>(0)?, &row.get::<_, String>(1)?) {
                // Each attempt begins with a reference.
                EventData::SpecimenPhase(entered) if entered.phase == Phase::Position => views.clear(),
                EventData::ViewTaken(view) => views.push(view),
                _ => {}
            }
        }
        Ok(views)
    })
}

fn event_row(row: &Row) -> rusqlite::Result<Event> {
    let data = data_of(&row.get::<_, String>(2)?, &row.get::<_, String>(5)?);
    Ok(Event { id: row.get(0)?, body: EventBody { time: row.get(1)?, run: row.get(3)?, well: row.get(4)?, data } })
}

fn data_of(kind: &str, json: &str) -> EventData {
    EventData::of(kind, serde_json::from_str(json).unwrap_or_default())
}

/// The newest `most` events without views, and the earlier events that are still valid: open faults, the newest events of a plate, of
/// its handover and of the sampler's sensor, and the acceptance of the newest run and of the runs among the newest events.
pub(super) fn remembered(c: &Connection, most: usize) -> rusqlite::Result<Vec<Event>> {
    let mut select = c.prepare(
        "WITH newest AS (SELECT id, run FROM events WHERE kind <> ?2 ORDER BY id DESC LIMIT ?1)
         SELECT id, time, kind, run, well, data FROM events
         WHERE id IN (SELECT id FROM newest)
            OR id IN (SELECT event FROM faults WHERE cleared IS NULL AND acknowledged IS NULL)
            OR id = (SELECT MAX(id) FROM events WHERE kind IN (?3, ?4))
            OR id = (SELECT MAX(id) FROM events WHERE kind IN (?3, ?4, ?6, ?7))
            OR id = (SELECT MAX(id) FROM events WHERE kind = ?5)
            OR id = (SELECT MAX(id) FROM events WHERE kind = ?8)
            OR kind = ?5 AND run IN (SELECT run FROM newest WHERE run IS NOT NULL)
         ORDER BY id",
    )?;
    let kinds = params![
        most,
        kind::VIEW_TAKEN,
        kind::PLATE_LOADED,
        kind::PLATE_UNLOADED,
        kind::RUN_ACCEPTED,
        kind::PLATE_ANNOUNCED,
        kind::PLATE_HANDOFF_ABORTED,
        kind::SPECIMEN_UNASKED
    ];
    select.query_map(kinds, event_row)?.collect()
}

/// The indexed length of the journal, and the id of the newest indexed event.
pub fn followed(root: &Path) -> Result<(u64, u64), StoreError> {
    ask(root, |c| {
        c.query_row("SELECT journal_bytes, (SELECT COALESCE(MAX(id), 0) FROM events) FROM place", [], |row| Ok((row.get(0)?, row.get(1)?)))
    })
}

pub fn used_bytes(root: &Path) -> Result<u64, StoreError> {
    ask(root, |c| c.query_row("SELECT COALESCE(SUM(bytes), 0) FROM specimens", [], |row| row.get(0)))
}
