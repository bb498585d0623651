//! The table of body slices: a row per slice of every specimen that has a body axis, head first.

use super::{Cell, Heading, Kind, Table};
use carved_store::{StoredRun, columns};
use serde_json::Value;

/// Numbers of a slice: column, JSON pointer, meaning.
pub const NUMBERS: [(&str, &str, &str); 8] = [
    ("s_um", "/s_um", "distance along the body axis from the first end"),
    ("area_um2", "/area_um2", "area of the slice"),
    ("width_um", "/width_um", "extent from side to side"),
    ("height_um", "/height_um", "extent from dorsal to ventral"),
    ("perimeter_um", "/perimeter_um", "length of the border"),
    ("centre_x_um", "/centre_um/0", "centre of the slice in the coordinates of `mesh.ply`"),
    ("centre_y_um", "/centre_um/1", "the same, across the capillary"),
    ("centre_z_um", "/centre_um/2", "the same, across the capillary"),
];

/// The table of these runs. `run` and `well` are the keys of the table of specimens. A well with a file that cannot be read, or was altered, is
/// left out.
pub fn table(runs: &[StoredRun]) -> Table {
    let heading = |name: &str, kind| Heading { name: name.to_owned(), kind };
    let mut headings = vec![
        heading("run", Kind::Text),
        heading("well", Kind::Text),
        heading("mode", Kind::Text),
        heading("estimator", Kind::Text),
        heading("head_end", Kind::Text),
        heading("station", Kind::Integer),
        heading("s_share", Kind::Number),
    ];
    headings.extend(NUMBERS.map(|(name, ..)| heading(name, Kind::Number)));
    let mut rows = Vec::new();
    for run in runs {
        for well in run.wells() {
            let Some(measurement) = well.measurement else { continue };
            let body = &measurement["shape"]["body"];
            let stations: Vec<&Value> = body["stations"].as_array().into_iter().flatten().collect();
            // The first and the last slice are half a thickness from the ends of the axis.
            let ends = stations.first().zip(stations.last()).and_then(|(first, last)| first["s_um"].as_f64().zip(last["s_um"].as_f64()));
            for (i, station) in stations.into_iter().enumerate() {
                let share = station["s_um"].as_f64().zip(ends).map(|(s, (first, last))| s / (first + last));
                let mut row = vec![
                    Cell::from(run.record().id.as_str()),
                    Cell::from(well.planned.well.as_str()),
                    Cell::from(measurement["mode"].as_str()),
                    Cell::from(columns::shape_estimator(&measurement)),
                    Cell::from(body["head"]["end"].as_str()),
                    Cell::from(i + 1),
                    Cell::from(share),
                ];
                row.extend(NUMBERS.map(|(_, pointer, _)| Cell::from(station.pointer(pointer).and_then(Value::as_f64))));
                rows.push(row);
            }
        }
    }
    Table { headings, rows }
}
