//! Whole turns of the renderer's frames, through segmentation and reconstruction, against the volume of the ideal visual hull.

use crate::cases::{Kind, Size, scene};
use crate::dust::Dirt;
use crate::judge::raw_frame;
use crate::scene::Scene;
use crate::shape::Specimen;
use crate::truth::{mask, outlines};
use carved_core::carver::Leaves;
use carved_core::flag::{Flag, StoredFlag};
use carved_core::frame::PixelFormat;
use carved_core::geometry::{BoxUm, Camera, VoxelGrid};
use carved_core::measure::Measurement;
use carved_core::pipeline::{Pipeline, PipelineError, PipelineSettings, SegmentedFrame, SpecimenRecord};
use carved_core::profile::{Mask, Polygon, SegmentSettings};
use carved_core::quality::QualitySettings;
use carved_core::reconstruction::{Reconstruction, ReconstructionSettings};
use rayon::prelude::*;
use std::f64::consts::TAU;

const VIEWS: u32 = 21;
/// Distance of the camera, um: so far that its rays are parallel, as the renderer's are. Over a specimen of 600 um they differ by 1e-5 px.
const DISTANCE_UM: f64 = 1e8;
/// Coarser than on an instrument, for the time that it takes. The volume by support functions does not depend on it.
const VOXEL_UM: f64 = 13.86;

/// Turns of one kind and what is reached on them.
struct Row {
    name: &'static str,
    kind: Kind,
    dirt: Dirt,
    specimens: u64,
    /// Largest accepted error of any turn's volume, %.
    most_percent: f64,
    /// The same in stated standard deviations. Above 2 to 3 the stated one is too small.
    most_sds: f64,
    /// Largest accepted error with the true silhouettes, %.
    most_exact_percent: f64,
}

const fn row(name: &'static str, kind: Kind, dirt: Dirt, specimens: u64, most_percent: f64, most_sds: f64, exact: f64) -> Row {
    Row { name, kind, dirt, specimens, most_percent, most_sds, most_exact_percent: exact }
}

/// The bounds lie a little above the worst of these turns and of the four of `survey`, which has other seeds.
const ROWS: [Row; 8] = [
    row("bead", Kind::Bead, Dirt::NONE, 1, 1.2, 3.0, 0.1),
    row("bead, dust", Kind::Bead, Dirt::MEASURED, 1, 1.2, 3.0, 0.1),
    row("ellipsoid", Kind::Ellipsoid, Dirt::NONE, 1, 2.5, 5.0, 0.1),
    row("ellipsoid, dust", Kind::Ellipsoid, Dirt::MEASURED, 1, 2.5, 5.0, 0.1),
    row("finless larva", Kind::Finless, Dirt::NONE, 1, 1.2, 3.0, 0.4),
    row("finless larva, dust", Kind::Finless, Dirt::MEASURED, 1, 1.2, 3.0, 0.4),
    row("finned larva", Kind::Finned, Dirt::NONE, 2, 2.5, 3.0, 1.5),
    row("finned larva, dust", Kind::Finned, Dirt::MEASURED, 2, 2.5, 3.0, 1.5),
];

pub struct Turn {
    seed: u64,
    /// Volume that the true silhouettes give, um^3. `None` in dust, which does not change them.
    exact_um3: Option<f64>,
    /// Volume of the ideal hull and of the body without fins, um^3.
    hull_um3: f64,
    body_um3: f64,
    pub record: SpecimenRecord,
    /// Of a larva, by all views and by a third of them with smaller voxels: [`percents`].
    by_views: Option<[[[f64; 2]; 2]; 2]>,
}

/// Error and stated standard deviation of volume and area against the ideal hull, %.
fn percents(m: &Measurement, specimen: &Specimen) -> [[f64; 2]; 2] {
    let of = |found: f64, sd: Option<f64>, truth: f64| [100.0 * (found / truth - 1.0), 100.0 * sd.unwrap_or(f64::NAN) / truth];
    [of(m.volume_um3, m.volume_sd_um3, specimen.hull_um3()), of(m.area_um2, m.area_sd_um2, specimen.hull_um2())]
}

/// Errors of a turn's volumes against the ideal hull, %: measured, of the voxels, from the true silhouettes; and the stated standard deviation
/// of the measured one.
struct Percent {
    error: f64,
    sd: f64,
    voxel: f64,
    exact: Option<f64>,
}

/// The angle of a view of an even turn, rad.
fn omega(view: u32, views: u32) -> f64 {
    TAU * f64::from(view) / f64::from(views)
}

/// Voxels of this edge around the specimen.
fn grid(scene: &Scene, voxel_um: f64) -> VoxelGrid {
    let span = scene.specimen.as_ref().unwrap().slices();
    let along = |slice: isize, more_um: f64| slice as f64 * scene.view.step_um() + more_um;
    let across_um = scene.glass.bore_um + 30.0;
    let region = BoxUm { min: [along(span.start, -250.0), -across_um, -across_um], max: [along(span.end, 250.0), across_um, across_um] };
    VoxelGrid::new(region, voxel_um).unwrap()
}

/// The rig's camera is 1.2 px beside the true axis and does not know its roll.
fn settings(scene: &Scene, planned_views: u32, sphere: bool) -> PipelineSettings {
    let view = scene.view;
    let scale = 1.0 / view.px_um;
    let [ux, uy] = view.origin_px;
    let camera =
        Camera { f: DISTANCE_UM, kx: scale, ky: scale, ux, uy: uy + 1.2, ..Camera::published(view.width as u32, view.height as u32) };
    PipelineSettings {
        camera,
        grid: grid(scene, VOXEL_UM),
        planned_views,
        segment: SegmentSettings::default(),
        empty_capillary: None,
        reconstruction: ReconstructionSettings::default(),
        quality: QualitySettings::default(),
        sphere,
    }
}

impl Turn {
    /// Measures a specimen.
    pub fn of(kind: Kind, dirt: Dirt, seed: u64) -> Result<Self, PipelineError> {
        Self::of_scene(&scene(kind, Size::Crop, dirt, seed), kind, seed)
    }

    /// Measures the specimen of a scene.
    pub fn of_scene(scene: &Scene, kind: Kind, seed: u64) -> Result<Self, PipelineError> {
        let specimen = scene.specimen.as_ref().unwrap();
        let of_all = settings(scene, VIEWS, kind == Kind::Bead);
        let few = |seen: &[(SegmentedFrame, Mask, Vec<Polygon>)]| {
            let of_few = settings(scene, VIEWS / 3, false);
            let mut pipeline = Pipeline::new(PipelineSettings { grid: grid(scene, 10.0), ..of_few }).unwrap();
            for (view, (frame, ..)) in (0..).zip(seen.iter().step_by(3)) {
                pipeline.observe(view, omega(view, VIEWS / 3), frame)?;
            }
            Ok::<_, PipelineError>(pipeline.finish()?.1)
        };
        let mut exact = Reconstruction::new(&of_all.camera, of_all.grid, VIEWS as usize, ReconstructionSettings::default()).unwrap();
        let mut pipeline = Pipeline::new(of_all).unwrap();
        let look = |view: u32| {
            let frame = scene.render(omega(view, VIEWS), u64::from(view));
            let seen = pipeline.look(&raw_frame(&frame, PixelFormat::RGB8Packed)).unwrap();
            (seen, mask(&frame, &frame.covered), outlines(&frame))
        };
        let seen: Vec<_> = (0..VIEWS).into_par_iter().map(look).collect();
        for (view, (frame, mask, outlines)) in (0..).zip(&seen) {
            pipeline.observe(view, omega(view, VIEWS), frame).unwrap();
            exact.observe(mask, outlines, omega(view, VIEWS), Leaves::default()).unwrap();
        }
        let exact_um3 = scene.specks.is_empty().then(|| exact.finish(kind == Kind::Bead).unwrap().model.measurement.volume_um3);
        let (_, record) = pipeline.finish()?;
        let by_views = match kind {
            Kind::Finned | Kind::Finless => Some([percents(&record.measurement, specimen), percents(&few(&seen)?.measurement, specimen)]),
            Kind::Bead | Kind::Ellipsoid => None,
        };
        Ok(Self { seed, exact_um3, hull_um3: specimen.hull_um3(), body_um3: specimen.body_um3(), record, by_views })
    }

    fn percent(&self) -> Percent {
        let of_hull = |um3: f64| 100.0 * um3 / self.hull_um3;
        let m = &self.record.measurement;
        Percent {
            error: of_hull(m.volume_um3) - 100.0,
            sd: of_hull(m.volume_sd_um3.unwrap_or(0.0)),
            voxel: of_hull(m.estimators.voxel.volume_um3) - 100.0,
            exact: self.exact_um3.map(|um3| of_hull(um3) - 100.0),
        }
    }

    fn print(&self, name: &str) {
        let Percent { error, sd, voxel, exact } = self.percent();
        let exact = exact.map_or("-".to_owned(), |e| format!("{e:+.2}"));
        let covered = if error.abs() <= 2.0 * sd { "yes" } else { "no" };
        let hull = 100.0 * (self.hull_um3 / self.body_um3 - 1.0);
        let flags: Vec<&str> = self.record.flags.iter().filter(|f| **f != Flag::NoClosure).map(StoredFlag::as_str).collect();
        println!(
            "| {name:20} | {:4} | {hull:4.1} | {error:+5.2} | {sd:4.2} | {covered:3} | {voxel:+5.2} | {exact:5} | {:?} | {} |",
            self.seed,
            self.record.measurement.estimator,
            flags.join(" "),
        );
    }
}

const HEAD: &str =
    "| specimen | seed | hull over body, % | error, % | stated SD, % | within 2 SD | voxels, % | true silhouettes, % | estimator | flags |";
/// Seed of the first turn that the bounds are checked on.
const FIRST_SEED: u64 = 700;

#[test]
fn volumes_are_those_of_the_ideal_hull() {
    println!("{HEAD}");
    let (mut beyond, mut of_larvae) = (Vec::new(), Vec::new());
    for row in &ROWS {
        for seed in FIRST_SEED..FIRST_SEED + row.specimens {
            let turn = Turn::of(row.kind, row.dirt, seed).unwrap();
            turn.print(row.name);
            of_larvae.extend(turn.by_views);
            let Percent { error, sd, exact, .. } = turn.percent();
            let figures = [
                (Some(error), row.most_percent, "%"),
                (Some(error / sd), row.most_sds, "stated standard deviations"),
                (exact, row.most_exact_percent, "% with the true silhouettes"),
            ];
            for (error, most, unit) in figures {
                if let Some(error) = error.filter(|e| e.abs() > most) {
                    beyond.push(format!("{}, seed {seed}: {error:+.2} {unit}, {most} allowed", row.name));
                }
            }
        }
    }
    assert!(beyond.is_empty(), "{beyond:#?}");
    // Volume and area of larvae, from 21 views and from 7 of them: nine in ten are within two stated standard deviations, and fewer views do
    // not know the size better. The part of the edges changes with the area, by per cents of the whole.
    let numbers: Vec<[f64; 2]> = of_larvae.iter().flatten().flatten().copied().collect();
    let covered = numbers.iter().filter(|[error, sd]| error.abs() <= 2.0 * sd).count();
    assert!(numbers.len() == 24 && 10 * covered >= 9 * numbers.len(), "{covered} of {numbers:?}");
    let is_larger = |[all, few]: &[[[f64; 2]; 2]; 2]| all.iter().zip(few).all(|([_, all], [_, few])| *few > 0.98 * all);
    assert!(of_larvae.iter().all(is_larger), "{of_larvae:?}");
}

/// The same for other seeds: what the bounds are taken from.
#[test]
#[ignore = "prints the turns of seeds that no bound is checked on"]
fn survey() {
    println!("{HEAD}");
    for row in &ROWS {
        for seed in 100..104 {
            match Turn::of(row.kind, row.dirt, seed) {
                Ok(turn) => turn.print(row.name),
                Err(why) => println!("| {:20} | {seed:4} | {why} |", row.name),
            }
        }
    }
}

/// A larva of 84 views, and even turns of some of them.
struct Larva {
    scene: Scene,
    frames: Vec<SegmentedFrame>,
}

impl Larva {
    const CAPTURED: u32 = 84;

    fn of(kind: Kind, dirt: Dirt, seed: u64) -> Self {
        let scene = scene(kind, Size::Crop, dirt, seed);
        let pipeline = Pipeline::new(settings(&scene, Self::CAPTURED, false)).unwrap();
        let look = |view: u32| {
            let frame = scene.render(omega(view, Self::CAPTURED), u64::from(view));
            pipeline.look(&raw_frame(&frame, PixelFormat::RGB8Packed)).unwrap()
        };
        let frames = (0..Self::CAPTURED).into_par_iter().map(look).collect();
        Self { scene, frames }
    }

    fn record(&self, views: u32, voxel_um: f64) -> Result<SpecimenRecord, PipelineError> {
        let settings = PipelineSettings { grid: grid(&self.scene, voxel_um), ..settings(&self.scene, views, false) };
        let mut pipeline = Pipeline::new(settings).unwrap();
        for view in 0..views {
            let stop = view * Self::CAPTURED / views;
            pipeline.observe(view, omega(stop, Self::CAPTURED), &self.frames[stop as usize])?;
        }
        Ok(pipeline.finish()?.1)
    }
}

/// Errors and stated standard deviations, %, by number of views: what the parts for fins are taken from.
#[test]
#[ignore = "prints larvae that no bound is checked on"]
fn survey_of_few_views() {
    println!("| larva | seed | views | volume: error, % | SD, % | area: error, % | SD, % | fins | fins_unseen |");
    for (kind, seed) in [Kind::Finned, Kind::Finless].into_iter().flat_map(|kind| (900..912).map(move |seed| (kind, seed))) {
        let larva = Larva::of(kind, Dirt::MEASURED, seed);
        let specimen = larva.scene.specimen.as_ref().unwrap();
        for views in [7, 12, 21, Larva::CAPTURED] {
            match larva.record(views, VOXEL_UM) {
                Ok(record) => {
                    let m = &record.measurement;
                    let [volume, area] = percents(m, specimen);
                    println!(
                        "| {kind:?} | {seed} | {views} | {:+.2} | {:.2} | {:+.2} | {:.2} | {} | {} |",
                        volume[0],
                        volume[1],
                        area[0],
                        area[1],
                        record.fins.len(),
                        m.misses_fins()
                    );
                }
                Err(why) => println!("| {kind:?} | {seed} | {views} | {why} |"),
            }
        }
    }
}
