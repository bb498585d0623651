//! The plan of the run: the wells, what is in them, and the angle of each view.

use super::sort::{Plate, first_of};
use crate::cli::import::angles::PlatePictures;
use crate::cli::import::rig::Sources;
use crate::cli::import::turn::{self, Turn};
use crate::cli::import::{Args, omega_deg};
use crate::cli::plate as plate_map;
use anyhow::{Context, bail};
use carved_records::plate_map::PlateMap;
use carved_records::{Method, PlannedWell, RunPlan};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

pub(super) struct Plan {
    pub run: RunPlan,
    /// The method with the number of views of a whole turn.
    pub method: Method,
    /// Numbers of the views in the order of the angles.
    pub views: Vec<u32>,
    /// omega of each view, deg, in the same order.
    pub omega_deg: Vec<f64>,
    pub angles_from: String,
    /// Whether the last view repeats the first.
    pub closure: bool,
}

impl Plan {
    pub fn of(args: &Args, barcode: &str, plate: &Plate, sources: &Sources, warn: &mut dyn FnMut(String)) -> anyhow::Result<Self> {
        let views = plate.views(args.of_plate.views)?;
        let names: Vec<String> = views.iter().map(|view| format!("view {view}")).collect();
        let pictures = plate.wells.values().flat_map(|well| &well.views);
        let pictures = pictures.flat_map(|(view, paths)| paths.iter().map(|path| (*view, path.as_path()))).collect();
        let of_plate = PlatePictures { views: &views, pictures };
        let (omega_deg, angles_from) = omega_deg(args, sources, &names, Some(&of_plate), warn)?;
        let whole = turn::turn(omega_deg.clone(), args.closure).with_context(|| angles_from.clone())?;
        let closure = whole.stops.last().is_some_and(|stop| stop.closure);
        // 4, 12 or 20 views are usual, and so are these with the first view repeated.
        if args.even && !closure && views.len() % 4 == 1 {
            warn(format!("{} views are spread over the turn; if the last repeats the first at 360 deg, say --closure", views.len()));
        }
        let PlateMap { plate_format, plate_map, metadata, .. } = wells(args, barcode, plate, warn)?;
        let plate_format = args.of_plate.plate_format.or(plate_format);
        let (method_name, method) = sources.method();
        let method = Method { asd: whole.asd, ..method.clone() };
        let run = RunPlan { plate_format, metadata, ..RunPlan::new(barcode, method_name, &args.of_plate.operator, plate_map) };
        if let Err(errors) = run.check(&BTreeMap::from([(method_name.to_owned(), &method)])) {
            let said: Vec<String> = errors.iter().map(|e| format!("{}: {}", e.pointer.trim_start_matches('/'), e.detail)).collect();
            bail!("{}", said.join("\n"));
        }
        Ok(Self { run, method, views, omega_deg, angles_from, closure })
    }

    /// The turn of these views of the plate.
    pub fn turn(&self, present: &[u32]) -> anyhow::Result<Turn> {
        let angle = |view: &u32| self.views.iter().position(|v| v == view).map(|at| self.omega_deg[at]);
        // A closure view whose first view is missing is an ordinary view at its angle.
        let closure = self.closure && present.first() == self.views.first() && present.last() == self.views.last();
        turn::turn(present.iter().filter_map(angle).collect(), closure)
    }
}

/// The plate map, with the wells that have pictures and that it does not name after its own.
fn wells(args: &Args, barcode: &str, plate: &Plate, warn: &mut dyn FnMut(String)) -> anyhow::Result<PlateMap> {
    let mut map = match &args.of_plate.plate_map {
        Some(file) => map(file, barcode, args.of_plate.plate_format, args.of_plate.columns.as_deref())?,
        None => PlateMap::default(),
    };
    let wells = &mut map.plate_map;
    let named: BTreeSet<String> = wells.iter().map(|w| w.well.clone()).collect();
    let unnamed: Vec<&String> = plate.wells.keys().filter(|well| !named.contains(*well)).collect();
    if !named.is_empty() && !unnamed.is_empty() {
        warn(format!("the plate map does not name {} wells with pictures: {}; they are imported", unnamed.len(), first_of(&unnamed)));
    }
    wells.extend(unnamed.into_iter().map(|well| PlannedWell::new(well, args.specimen.into(), None)));
    for well in wells {
        let of_names = plate.wells.get(&well.well).and_then(|w| w.dpf);
        if let (Some(mapped), Some(named)) = (well.dpf, of_names)
            && mapped.total_cmp(&named).is_ne()
        {
            warn(format!("{}: the plate map says {mapped} dpf, the names of the pictures {named} dpf; the plate map is used", well.well));
        }
        well.dpf = well.dpf.or(args.dpf).or(of_names);
    }
    Ok(map)
}

fn map(file: &Path, barcode: &str, plate_format: Option<u32>, columns: Option<&Path>) -> anyhow::Result<PlateMap> {
    // A MIHCSME file may have several plates, of which the barcode names one.
    let map = plate_map::read(file, Some(barcode), plate_format, columns)?;
    let map = map.map_err(|mistakes| {
        plate_map::print(file, &mistakes);
        anyhow::anyhow!("--plate-map {}: {} mistakes; correct them, then import", file.display(), mistakes.len())
    })?;
    map.notes.iter().chain(&map.confirm).for_each(|note| note!("{}: {note}", file.display()));
    Ok(map)
}
