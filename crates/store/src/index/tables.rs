//! The tables of the index, by version. A released step is never changed. A newer step follows it.
//!
//! The columns of specimens have tables of their own (`cells`), which follow the list of columns without a step.

use super::{cells, failed, in_one};
use crate::StoreError;
use rusqlite::Connection;
use std::path::Path;

/// Step `i` migrates version `i` to version `i + 1`. The file stores its version as `user_version`.
pub(super) const STEPS: &[&str] = &[
    "
    CREATE TABLE runs (
        id TEXT PRIMARY KEY, schema TEXT NOT NULL, software TEXT NOT NULL, mode TEXT NOT NULL, plate_barcode TEXT NOT NULL,
        method TEXT NOT NULL, operator TEXT NOT NULL, external_id TEXT, started TEXT NOT NULL, started_us INTEGER NOT NULL,
        ended TEXT, outcome TEXT, wells INTEGER NOT NULL, run_json_ns INTEGER NOT NULL, run_json_bytes INTEGER NOT NULL
    ) WITHOUT ROWID;
    CREATE INDEX runs_by_time ON runs (started_us DESC, id DESC);
    CREATE TABLE wells (
        run TEXT NOT NULL, place INTEGER NOT NULL, well TEXT NOT NULL, specimen TEXT NOT NULL, dpf REAL,
        PRIMARY KEY (run, well)
    ) WITHOUT ROWID;
    CREATE TABLE specimens (
        run TEXT NOT NULL, well TEXT NOT NULL, outcome TEXT, reason TEXT, flags TEXT NOT NULL, started TEXT, views INTEGER NOT NULL,
        bytes INTEGER NOT NULL, status TEXT NOT NULL,
        PRIMARY KEY (run, well)
    ) WITHOUT ROWID;
    CREATE TABLE measurements (
        run TEXT NOT NULL, well TEXT NOT NULL, sha256 TEXT NOT NULL, mode TEXT, estimator TEXT, views INTEGER, volume_um3 REAL,
        volume_sd_um3 REAL, area_um2 REAL, area_sd_um2 REAL, field_volume_um3 REAL, field_area_um2 REAL, length_um REAL,
        PRIMARY KEY (run, well)
    ) WITHOUT ROWID;
    CREATE TABLE beads (
        run TEXT NOT NULL, well TEXT NOT NULL, diameter_um REAL NOT NULL, sphere_rms_um REAL, aspect_ratio REAL,
        PRIMARY KEY (run, well)
    ) WITHOUT ROWID;
    CREATE TABLE events (id INTEGER PRIMARY KEY, time TEXT NOT NULL, kind TEXT NOT NULL, run TEXT, well TEXT, data TEXT NOT NULL);
    CREATE INDEX events_by_run ON events (run, id);
    CREATE TABLE faults (
        seq INTEGER PRIMARY KEY, event INTEGER NOT NULL, run TEXT, well TEXT, code TEXT, category TEXT, message TEXT,
        raised TEXT NOT NULL, cleared TEXT, acknowledged TEXT
    );
    CREATE TABLE place (one INTEGER PRIMARY KEY CHECK (one = 1), journal_bytes INTEGER NOT NULL);
    INSERT INTO place VALUES (1, 0);
",
    "
    -- Attempts at a specimen: 0 is the newest, whose status run.json has.
    CREATE TABLE specimens_2 (
        run TEXT NOT NULL, well TEXT NOT NULL, attempt INTEGER NOT NULL, outcome TEXT, reason TEXT, flags TEXT, started TEXT,
        views INTEGER NOT NULL, bytes INTEGER NOT NULL, status TEXT,
        PRIMARY KEY (run, well, attempt)
    ) WITHOUT ROWID;
    INSERT INTO specimens_2 SELECT run, well, 0, outcome, reason, flags, started, views, bytes, status FROM specimens;
    DROP TABLE specimens;
    ALTER TABLE specimens_2 RENAME TO specimens;
    CREATE TABLE measurements_2 (
        run TEXT NOT NULL, well TEXT NOT NULL, attempt INTEGER NOT NULL, sha256 TEXT NOT NULL, mode TEXT, estimator TEXT, views INTEGER,
        volume_um3 REAL, volume_sd_um3 REAL, area_um2 REAL, area_sd_um2 REAL, field_volume_um3 REAL, field_area_um2 REAL, length_um REAL,
        PRIMARY KEY (run, well, attempt)
    ) WITHOUT ROWID;
    INSERT INTO measurements_2 SELECT run, well, 0, sha256, mode, estimator, views, volume_um3, volume_sd_um3, area_um2, area_sd_um2,
        field_volume_um3, field_area_um2, length_um FROM measurements;
    DROP TABLE measurements;
    ALTER TABLE measurements_2 RENAME TO measurements;
    CREATE TABLE beads_2 (
        run TEXT NOT NULL, well TEXT NOT NULL, attempt INTEGER NOT NULL, diameter_um REAL NOT NULL, sphere_rms_um REAL, aspect_ratio REAL,
        PRIMARY KEY (run, well, attempt)
    ) WITHOUT ROWID;
    INSERT INTO beads_2 SELECT run, well, 0, diameter_um, sphere_rms_um, aspect_ratio FROM beads;
    DROP TABLE beads;
    ALTER TABLE beads_2 RENAME TO beads;
",
    "
    ALTER TABLE runs ADD COLUMN method_version TEXT;
    -- Of the program that recorded: a run may go on with another one.
    ALTER TABLE specimens ADD COLUMN software_version TEXT;
    ALTER TABLE specimens ADD COLUMN software_commit TEXT;
    ALTER TABLE specimens ADD COLUMN software_dirty INTEGER;
    ALTER TABLE wells ADD COLUMN strain TEXT;
    ALTER TABLE wells ADD COLUMN treatment TEXT;
    ALTER TABLE wells ADD COLUMN compound TEXT;
    ALTER TABLE wells ADD COLUMN concentration REAL;
    ALTER TABLE wells ADD COLUMN concentration_unit TEXT;
    ALTER TABLE wells ADD COLUMN control TEXT;
    ALTER TABLE wells ADD COLUMN replicate INTEGER;
    ALTER TABLE measurements ADD COLUMN body_length_um REAL;
    ALTER TABLE measurements ADD COLUMN sphericity REAL;
    ALTER TABLE measurements ADD COLUMN signal_grey_px_per_nl REAL;
    ALTER TABLE measurements ADD COLUMN reference_volume_z REAL;
    ALTER TABLE measurements ADD COLUMN reference_area_z REAL;
    ALTER TABLE measurements ADD COLUMN qc_passed INTEGER;
    -- A row per planned well, with the column names of `carved export table`.
    CREATE VIEW specimen_table AS SELECT
        w.run, r.external_id, r.plate_barcode, r.operator, r.mode, w.well, w.place + 1 AS place, w.specimen, w.dpf, w.strain, w.treatment,
        w.compound, w.concentration, w.concentration_unit, w.control, w.replicate, s.outcome, s.reason,
        (SELECT group_concat(value, ';') FROM json_each(s.flags)) AS flags, m.estimator, m.volume_um3, m.volume_sd_um3, m.area_um2,
        m.area_sd_um2, m.body_length_um, m.length_um AS extent_along_um, b.diameter_um, b.sphere_rms_um, b.aspect_ratio, m.sphericity,
        m.field_volume_um3, m.field_area_um2, m.signal_grey_px_per_nl, m.reference_volume_z, m.reference_area_z, m.qc_passed, m.views,
        s.started, r.started AS run_started, r.ended AS run_ended, r.outcome AS run_outcome, r.method,
        CASE WHEN s.software_version IS NOT NULL THEN r.method_version END AS method_version,
        s.software_version, s.software_commit, s.software_dirty, m.sha256 AS measurement_sha256
    FROM wells w JOIN runs r ON r.id = w.run
        LEFT JOIN specimens s ON s.run = w.run AND s.well = w.well AND s.attempt = 0
        LEFT JOIN measurements m ON m.run = w.run AND m.well = w.well AND m.attempt = 0
        LEFT JOIN beads b ON b.run = w.run AND b.well = w.well AND b.attempt = 0;
    -- The new columns are filled from the folders by the refresh that follows.
    UPDATE runs SET run_json_ns = 0, run_json_bytes = 0;
",
    "
    -- The columns of `carved export table` have tables of their own.
    DROP VIEW specimen_table;
    ALTER TABLE runs DROP COLUMN method_version;
    ALTER TABLE specimens DROP COLUMN software_version;
    ALTER TABLE specimens DROP COLUMN software_commit;
    ALTER TABLE specimens DROP COLUMN software_dirty;
    ALTER TABLE wells DROP COLUMN strain;
    ALTER TABLE wells DROP COLUMN treatment;
    ALTER TABLE wells DROP COLUMN compound;
    ALTER TABLE wells DROP COLUMN concentration;
    ALTER TABLE wells DROP COLUMN concentration_unit;
    ALTER TABLE wells DROP COLUMN control;
    ALTER TABLE wells DROP COLUMN replicate;
    ALTER TABLE measurements DROP COLUMN body_length_um;
    ALTER TABLE measurements DROP COLUMN sphericity;
    ALTER TABLE measurements DROP COLUMN signal_grey_px_per_nl;
    ALTER TABLE measurements DROP COLUMN reference_volume_z;
    ALTER TABLE measurements DROP COLUMN reference_area_z;
    ALTER TABLE measurements DROP COLUMN qc_passed;
",
    "
    -- Nothing reads these: the columns of specimens are in `cells`, and the text of a fault is in its event.
    DROP TABLE wells;
    DROP TABLE measurements;
    DROP TABLE beads;
    ALTER TABLE runs DROP COLUMN schema;
    ALTER TABLE runs DROP COLUMN wells;
    ALTER TABLE specimens DROP COLUMN reason;
    ALTER TABLE specimens DROP COLUMN started;
    ALTER TABLE specimens DROP COLUMN views;
    ALTER TABLE faults DROP COLUMN run;
    ALTER TABLE faults DROP COLUMN well;
    ALTER TABLE faults DROP COLUMN code;
    ALTER TABLE faults DROP COLUMN category;
    ALTER TABLE faults DROP COLUMN message;
    ALTER TABLE faults DROP COLUMN raised;
",
];

/// Migrates an index to the newest version. Each step is one transaction.
///
/// # Errors
/// The version of the index is unknown to this carved.
pub(super) fn migrate(connection: &mut Connection, path: &Path) -> Result<(), StoreError> {
    let newest = STEPS.len();
    let found: usize = connection.pragma_query_value(None, "user_version", |row| row.get(0)).map_err(failed("be read", path))?;
    if found > newest {
        let of = |version| format!("index version {version}");
        return Err(StoreError::Newer { path: path.to_owned(), found: of(found), known: of(newest), writer: None });
    }
    for (version, step) in STEPS.iter().enumerate().skip(found) {
        in_one(connection, |tx| {
            tx.execute_batch(step)?;
            tx.pragma_update(None, "user_version", version + 1)
        })
        .map_err(failed("be brought to its newest version", path))?;
        if found > 0 {
            tracing::info!(path = %path.display(), from = version, to = version + 1, "the index is brought to a newer version");
        }
    }
    in_one(connection, |tx| cells::follow_the_list(tx)).map_err(failed("be given the columns of specimens", path))
}
