//! `carved export ome-zarr`: the views of a run as an OME-Zarr 0.5 plate.
//!
//! ```text
//! OUT/zarr.json                     the plate: wells that are written, rewritten after each
//! OUT/A/1/0/zarr.json               one image per well: t (planned views), c, y, x; scale in um
//! OUT/A/1/0/0  1  2                 full size, half, quarter
//! OUT/A/1/0/labels/profile/0  1  2  1 inside the profile
//! OUT/tables/specimens              the table of the run, for ngio
//! ```
//! Only wells that are written are listed, and every well has all planned views: other plates are refused by ngio and ngff-zarr, or shown
//! wrong by napari-ome-zarr. Views that were not taken have no chunk. A command that was interrupted is repeated: it goes on with the wells
//! that are not listed.

use super::{read, views, wells, write};
use crate::export::zarr::{self, METADATA, PICTURES, Shard};
use crate::tables::{self, csv};
use anyhow::{Context, bail, ensure};
use carved_records::{PlannedWell, RunPlan};
use carved_store::{RecordingFiles, RecordingReader, StoreError, StoredRun, durable};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder of a run (`DATA/runs/RUN`).
    run: PathBuf,
    /// Wells of the run [default: all with views]
    wells: Vec<String>,
    /// Folder for the plate (`.ome.zarr`). One that an interrupted export of the same run left is continued.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Sizes of a well's image: full, half, quarter.
const LEVELS: usize = 3;

/// Version of the format.
pub(super) const VERSION: &str = "0.5";

/// Writes the plate.
///
/// # Errors
/// A run or a frame that cannot be read, wells that do not fit one plate, and files that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    check_folder_name(&args.out)?;
    let runs = read(std::slice::from_ref(&args.run))?;
    let run = runs.first().context("one run is named")?;
    let planned = wells(run, &args.wells)?;
    let mut plate = Plate::open(&args.out, run)?;
    for planned in planned {
        if plate.written.contains(&planned.well) {
            continue;
        }
        if let Some(reader) = recorded(run, planned)? {
            plate.add(&reader)?;
        } else if !args.wells.is_empty() {
            bail!("{}: nothing was recorded of well {}", args.run.display(), planned.well);
        }
    }
    table(&args.out, &runs)?;
    ensure!(!plate.written.is_empty(), "{}: no well of this run has a view", args.run.display());
    note!("carved: {}: {} well(s) of {} views", args.out.display(), plate.written.len(), plate.planned);
    Ok(())
}

/// Checks the ending of a folder's name.
///
/// # Errors
/// It is another one.
pub(super) fn check_folder_name(out: &Path) -> anyhow::Result<()> {
    let is = out.file_name().is_some_and(|name| name.to_string_lossy().to_lowercase().ends_with(".ome.zarr"));
    ensure!(is, "{}: the name of this folder ends in .ome.zarr", out.display());
    Ok(())
}

/// The table of the run as a table of ngio: the file of its backend `csv`, and what describes it.
fn table(out: &Path, runs: &[StoredRun]) -> anyhow::Result<()> {
    const NAME: &str = "specimens";
    let tables = out.join("tables");
    let folder = tables.join(NAME);
    file(&folder.join("table.csv"), csv::text(&tables::specimens(runs)).as_bytes())?;
    group(&folder, &json!({"type": "generic_table", "table_version": "1", "backend": "csv", "index_key": null, "index_type": null}))?;
    group(&tables, &json!({"tables": [NAME]}))
}

/// The recording of a well. `None` if it has no view.
pub(super) fn recorded(run: &StoredRun, planned: &PlannedWell) -> Result<Option<RecordingReader>, StoreError> {
    let folder = run.folder().join(&planned.well);
    if !RecordingFiles::of(&folder)?.has("recording.json") {
        return Ok(None);
    }
    let reader = RecordingReader::open(&folder)?;
    let has_views = reader.recording().ledger.carved().next().is_some();
    Ok(has_views.then_some(reader))
}

/// A plate that is being written.
struct Plate {
    out: PathBuf,
    run: String,
    /// Views of every well.
    planned: usize,
    /// Rows and columns.
    size: [usize; 2],
    /// Colours, rows and columns of every picture, once a well is written.
    shape: Option<[usize; 3]>,
    /// Wells that are listed.
    written: Vec<String>,
    plan: RunPlan,
}

impl Plate {
    /// A new plate, or the one that an interrupted export of this run left.
    fn open(out: &Path, run: &StoredRun) -> anyhow::Result<Self> {
        let record = run.record();
        let plan = &record.plan;
        let size = views::size(plan.plate_format, &plan.plate_map.iter().map(|planned| planned.well.as_str()));
        let mut plate = Self {
            out: out.to_owned(),
            run: record.id.clone(),
            planned: record.method.asd as usize,
            size,
            shape: None,
            written: Vec::new(),
            plan: plan.clone(),
        };
        let file = out.join(METADATA);
        if file.is_file() {
            let found: Value = durable::read_json(&file, "the plate of an earlier export")?;
            let own = &found["attributes"]["carved"];
            ensure!(
                own["run"] == json!(plate.run) && own["views"] == json!(plate.planned),
                "{}: it holds another plate (run {}, {} views); this is run {} with {} views. Name another folder",
                out.display(),
                own["run"],
                own["views"],
                plate.run,
                plate.planned
            );
            plate.shape = serde_json::from_value(own["shape"].clone()).context("the shape of the earlier export")?;
            plate.written = serde_json::from_value(own["wells"].clone()).context("the wells of the earlier export")?;
        } else {
            ensure!(!out.exists(), "{}: exists already and is no plate; name another folder", out.display());
        }
        Ok(plate)
    }

    /// Writes a well, and lists it.
    fn add(&mut self, reader: &RecordingReader) -> anyhow::Result<()> {
        let recording = reader.recording();
        let camera = &recording.rig.camera;
        let colours = views::samples(recording.rig.pixel_format) as usize;
        let shape = [colours, camera.height as usize, camera.width as usize];
        let expected = *self.shape.get_or_insert(shape);
        ensure!(
            shape == expected,
            "{}: its pictures are {shape:?} (colours, rows, columns), those of the other wells {expected:?}; export it by itself",
            reader.folder().display()
        );
        let [row, column] = views::place(&recording.specimen.well)?;
        let letters = row_name(row);
        let folder = self.out.join(&letters).join((column + 1).to_string());
        // Spatial scales are um per pixel at the axis of rotation.
        let um = [1.0 / camera.ky, 1.0 / camera.kx];
        let image = folder.join("0");
        self.arrays(&image, shape, |view| picture(reader, view), zarr::halved)?;
        let labels = image.join("labels").join("profile");
        let has_profiles = self.arrays(&labels, [1, shape[1], shape[2]], |view| views::profile(reader, view), zarr::thinned)?;
        let name = format!("{} {}", self.run, recording.specimen.well);
        if has_profiles {
            let shown = json!({"source": {"image": "../../"}, "colors": [{"label-value": 1, "rgba": [255, 140, 0, 255]}]});
            group(&labels, &json!({"ome": {"version": VERSION, "multiscales": [multiscale("profile", um)], "image-label": shown}}))?;
            group(&image.join("labels"), &json!({"ome": {"version": VERSION, "labels": ["profile"]}}))?;
        }
        let angles: Vec<Value> =
            views::by_number(reader).iter().map(|e| json!({"view": e.view, "omega_deg": e.omega.to_degrees()})).collect();
        let mut facts = serde_json::Map::new();
        facts.extend(super::model::facts(recording).into_iter().map(|(key, value)| (key.to_owned(), value.into())));
        facts.extend(views::measured_facts(reader)?.into_iter().map(|(key, value)| (key, value.into())));
        facts.extend(views::plate_map_facts(&recording.specimen, Some(&self.plan))?.into_iter().map(|(key, value)| (key, value.into())));
        let ome = json!({"version": VERSION, "multiscales": [multiscale(&name, um)], "omero": {"channels": channels(colours)}});
        group(&image, &json!({"ome": ome, "carved": {"views": angles, "facts": facts}}))?;
        group(&folder, &json!({"ome": {"version": VERSION, "well": {"images": [{"path": "0"}]}}}))?;
        group(&self.out.join(&letters), &json!({}))?;
        self.written.push(recording.specimen.well.clone());
        group(&self.out, &self.attributes()?)
    }

    /// Writes the arrays of an image, one per size. `pixels` gives a view's planes, `smaller` halves them. Views are read and compressed in
    /// parallel. Returns whether a view is there.
    fn arrays(
        &self,
        image: &Path,
        [colours, rows, columns]: [usize; 3],
        pixels: impl Fn(usize) -> anyhow::Result<Option<Vec<u8>>> + Sync,
        smaller: impl Fn(&[u8], [usize; 2]) -> Vec<u8> + Sync,
    ) -> anyhow::Result<bool> {
        let sizes: [[usize; 2]; LEVELS] = std::array::from_fn(|level| [columns, rows].map(|n| n.div_ceil(1 << level)));
        let compressed = |view: usize| -> anyhow::Result<Option<[Vec<u8>; LEVELS]>> {
            let Some(mut planes) = pixels(view)? else { return Ok(None) };
            let mut chunks: [Vec<u8>; LEVELS] = Default::default();
            for (level, chunk) in chunks.iter_mut().enumerate() {
                if level > 0 {
                    planes = smaller(&planes, sizes[level - 1]);
                }
                *chunk = zarr::chunk(&planes)?;
            }
            Ok(Some(chunks))
        };
        let views: Vec<Option<[Vec<u8>; LEVELS]>> = (0..self.planned).into_par_iter().map(compressed).collect::<anyhow::Result<_>>()?;
        let mut shards: [Shard; LEVELS] = std::array::from_fn(|_| Shard::new(self.planned));
        for (view, chunks) in views.iter().enumerate().filter_map(|(view, chunks)| Some((view, chunks.as_ref()?))) {
            for (shard, chunk) in shards.iter_mut().zip(chunks) {
                shard.add(view, chunk)?;
            }
        }
        let is_there = views.iter().any(Option::is_some);
        if is_there {
            for (level, (shard, [width, height])) in shards.into_iter().zip(sizes).enumerate() {
                let folder = image.join(level.to_string());
                file(&folder.join(zarr::shard(PICTURES.len())), &shard.finish())?;
                json_file(&folder.join(METADATA), &zarr::array([self.planned, colours, height, width], PICTURES))?;
            }
        }
        Ok(is_there)
    }

    fn attributes(&self) -> anyhow::Result<Value> {
        let [rows, columns] = self.size;
        let mut wells = Vec::new();
        for well in &self.written {
            let [row, column] = views::place(well)?;
            wells.push(json!({"path": format!("{}/{}", row_name(row), column + 1), "rowIndex": row, "columnIndex": column}));
        }
        let named = |names: Vec<String>| names.into_iter().map(|name| json!({"name": name})).collect::<Vec<_>>();
        let plate = json!({
            "version": VERSION,
            "name": self.run,
            "field_count": 1,
            "rows": named((0..rows).map(row_name).collect()),
            "columns": named((1..=columns).map(|n| n.to_string()).collect()),
            "wells": wells,
        });
        let own = json!({"run": self.run, "views": self.planned, "shape": self.shape, "wells": self.written});
        Ok(json!({"ome": {"version": VERSION, "plate": plate}, "carved": own}))
    }
}

/// A frame, one plane after another. `None` if the view was not taken.
fn picture(reader: &RecordingReader, view: usize) -> anyhow::Result<Option<Vec<u8>>> {
    let entry = reader.recording().ledger.carved().find(|entry| entry.view as usize == view);
    entry.map(|entry| Ok(views::planar(&reader.frame(entry)?))).transpose()
}

/// `A` to `AF`.
fn row_name(row: usize) -> String {
    let letter = |n: usize| char::from(b'A' + n as u8);
    if row < 26 { letter(row).into() } else { [letter(row / 26 - 1), letter(row % 26)].iter().collect() }
}

/// The sizes of an image. `um` is the size of a pixel down and along the picture.
fn multiscale(name: &str, [down, along]: [f64; 2]) -> Value {
    let dataset = |level: usize| {
        let times = f64::from(1u32 << level);
        // The centre of a larger pixel lies between those of its parts.
        let between = (times - 1.0) / 2.0;
        json!({"path": level.to_string(), "coordinateTransformations": [
            {"type": "scale", "scale": [1.0, 1.0, down * times, along * times]},
            {"type": "translation", "translation": [0.0, 0.0, down * between, along * between]},
        ]})
    };
    let axes = json!([
        {"name": "t", "type": "time"},
        {"name": "c", "type": "channel"},
        {"name": "y", "type": "space", "unit": "micrometer"},
        {"name": "x", "type": "space", "unit": "micrometer"},
    ]);
    json!({"name": name, "axes": axes, "datasets": (0..LEVELS).map(dataset).collect::<Vec<_>>()})
}

fn channels(colours: usize) -> Vec<Value> {
    let named: &[[&str; 2]] =
        if colours == 1 { &[["grey", "FFFFFF"]] } else { &[["red", "FF0000"], ["green", "00FF00"], ["blue", "0000FF"]] };
    let window = json!({"min": 0, "max": 255, "start": 0, "end": 255});
    named.iter().map(|[label, color]| json!({"label": label, "color": color, "active": true, "window": window})).collect()
}

pub(super) fn group(folder: &Path, attributes: &Value) -> anyhow::Result<()> {
    json_file(&folder.join(METADATA), &zarr::group(attributes))
}

pub(super) fn json_file(path: &Path, value: &Value) -> anyhow::Result<()> {
    file(path, &serde_json::to_vec_pretty(value)?)
}

pub(super) fn file(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    durable::create_folder(durable::folder_of(path))?;
    write(path, bytes)
}
