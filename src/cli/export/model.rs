//! `carved export nrrd`, `voxels`, `stl`, `glb` and `rois`: the model of a specimen in the formats of other programs.
//!
//! ```text
//!  RECORDING ─┬─ mesh.ply, or computed where there is none ── stl, glb
//!             └─ frames ── measure::compute_with_hull ─┬─ voxels ── nrrd, voxels       compared with the stored numbers
//!                                                      ├─ outlines ── rois
//!                                                      └─ surface with the colours of the frames ── glb --texture
//! ```

use super::{ome_zarr, views, write};
use crate::cli::folders::open_recording;
use crate::cli::measure::compute_with_hull;
use crate::cli::stored::{self, Stored};
use crate::export::zarr::{self, Shard, VOXELS};
use crate::export::{Outline, Unit, facts_of_mesh, imagej_rois, read_ply, write_glb, write_nrrd, write_stl};
use crate::session::numbers;
use anyhow::{Context, ensure};
use carved_core::measure::Estimator;
use carved_core::surface::Mesh;
use carved_offline::recording::Computed;
use carved_records::Mode;
use carved_store::{Recording, RecordingReader};
use serde_json::json;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct NrrdArgs {
    /// A recording (`DATA/runs/RUN/WELL`, or its pack `WELL.tar`).
    recording: PathBuf,
    /// File for the voxels (`.nrrd`), in mm.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

#[derive(Debug, clap::Args)]
pub struct VoxelsArgs {
    /// A recording (`DATA/runs/RUN/WELL`, or its pack `WELL.tar`).
    recording: PathBuf,
    /// Folder for the voxels (`.ome.zarr`), in um.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Debug, clap::Args)]
pub struct RoisArgs {
    /// A recording (`DATA/runs/RUN/WELL`, or its pack `WELL.tar`).
    recording: PathBuf,
    /// File for the outlines (`.zip`).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

#[derive(Debug, clap::Args)]
pub struct StlArgs {
    /// A recording (`DATA/runs/RUN/WELL`, or its pack `WELL.tar`).
    recording: PathBuf,
    /// File for the surface (`.stl`).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Unit of the coordinates. The format has none; printers take mm.
    #[arg(long, value_enum, default_value_t = Unit::Mm)]
    unit: Unit,
}

#[derive(Debug, clap::Args)]
pub struct GlbArgs {
    /// A recording (`DATA/runs/RUN/WELL`, or its pack `WELL.tar`).
    recording: PathBuf,
    /// File for the surface (`.glb`).
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Unit of the scene. That of the format is m; another one is for programs that clip what is as small as 0.004.
    #[arg(long, value_enum, default_value_t = Unit::M)]
    unit: Unit,
    /// Colour the surface with the frames of its views. The surface is computed from them again.
    #[arg(long)]
    texture: bool,
}

/// Writes the voxels.
///
/// # Errors
/// A recording that cannot be read or measured, or a file that cannot be written.
pub fn nrrd(args: &NrrdArgs) -> anyhow::Result<()> {
    ends_in(&args.out, "nrrd")?;
    let reader = open_recording(&args.recording)?;
    let mut facts = facts(reader.recording());
    let found = computed(&reader, &mut facts)?;
    let carver = found.hull.carver();
    let voxels = carver.voxels().with_context(|| format!("{}: no voxel is left", args.recording.display()))?;
    facts.push(("estimator", Estimator::Voxel.name().into()));
    facts.push(("labels", "1 is inside the specimen".into()));
    facts.push(("voxels", carver.live_voxels().to_string()));
    facts.push(("volume_um3", carver.volume_um3().to_string()));
    let mut bytes = Vec::new();
    write_nrrd(&voxels, &facts, &mut bytes)?;
    write(&args.out, &bytes)?;
    let [nx, ny, nz] = voxels.counts;
    note!("carved: {}: {nx} x {ny} x {nz} voxels of {} um, in mm", args.out.display(), voxels.size);
    Ok(())
}

/// Writes the voxels as an image and as its labels.
///
/// # Errors
/// A recording that cannot be read or measured, a folder that exists, or a file that cannot be written.
pub fn voxels(args: &VoxelsArgs) -> anyhow::Result<()> {
    const LABEL: &str = "specimen";
    ome_zarr::check_folder_name(&args.out)?;
    ensure!(!args.out.exists(), "{}: exists already; name another folder", args.out.display());
    let reader = open_recording(&args.recording)?;
    let recording = reader.recording();
    let mut facts = facts(recording);
    let found = computed(&reader, &mut facts)?;
    let carver = found.hull.carver();
    let voxels = carver.voxels().with_context(|| format!("{}: no voxel is left", args.recording.display()))?;
    facts.push(("estimator", Estimator::Voxel.name().into()));
    facts.push(("voxels", carver.live_voxels().to_string()));
    facts.push(("volume_um3", carver.volume_um3().to_string()));
    let [nx, ny, nz] = voxels.counts;
    let [x, y, z] = voxels.origin;
    let axes: Vec<_> = VOXELS.iter().map(|name| json!({"name": name, "type": "space", "unit": "micrometer"})).collect();
    let scale = [voxels.size; 3];
    let multiscale = |name: &str| {
        json!([{"name": name, "axes": axes, "datasets": [{"path": "0", "coordinateTransformations": [
            {"type": "scale", "scale": scale},
            {"type": "translation", "translation": [z, y, x]},
        ]}]}])
    };
    let array = |folder: &Path, inside: u8| -> anyhow::Result<()> {
        let mut shard = Shard::new(nz);
        for (at, slice) in voxels.inside.chunks_exact(nx * ny).enumerate() {
            let values: Vec<u8> = slice.iter().map(|voxel| voxel * inside).collect();
            shard.add(at, &zarr::chunk(&values)?)?;
        }
        ome_zarr::file(&folder.join("0").join(zarr::shard(VOXELS.len())), &shard.finish())?;
        ome_zarr::json_file(&folder.join("0").join(zarr::METADATA), &zarr::array([nz, ny, nx], VOXELS))
    };
    let version = ome_zarr::VERSION;
    let labels = args.out.join("labels");
    array(&labels.join(LABEL), 1)?;
    let shown = json!({"source": {"image": "../../"}, "colors": [{"label-value": 1, "rgba": [255, 140, 0, 255]}]});
    ome_zarr::group(&labels.join(LABEL), &json!({"ome": {"version": version, "multiscales": multiscale(LABEL), "image-label": shown}}))?;
    ome_zarr::group(&labels, &json!({"ome": {"version": version, "labels": [LABEL]}}))?;
    array(&args.out, u8::MAX)?;
    let facts: serde_json::Map<_, _> = facts.into_iter().map(|(key, value)| (key.to_owned(), value.into())).collect();
    let name = format!("{} {}", recording.run, recording.specimen.well);
    // Last: without it the folder is no image.
    ome_zarr::group(&args.out, &json!({"ome": {"version": version, "multiscales": multiscale(&name)}, "carved": {"facts": facts}}))?;
    note!("carved: {}: {nx} x {ny} x {nz} voxels of {} um", args.out.display(), voxels.size);
    Ok(())
}

/// Writes the outlines of all views as regions of ImageJ.
///
/// # Errors
/// A recording that cannot be read or measured, or a file that cannot be written.
pub fn rois(args: &RoisArgs) -> anyhow::Result<()> {
    ends_in(&args.out, "zip")?;
    let reader = open_recording(&args.recording)?;
    let found = views::outlines(&reader)?;
    let mut outlines = Vec::new();
    // The pictures are those of `carved export ome-tiff`, counted from 1.
    for (picture, entry) in (1..).zip(views::by_number(&reader)) {
        for (part, polygon) in (1..).zip(found.get(&entry.view).into_iter().flatten()) {
            let part = if part == 1 { String::new() } else { format!(" part {part}") };
            outlines.push(Outline { name: format!("view {:03}{part}", entry.view), picture, polygon });
        }
    }
    ensure!(!outlines.is_empty(), "{}: no view has an outline", args.recording.display());
    write(&args.out, &imagej_rois(&outlines)?)?;
    note!("carved: {}: {} outline(s)", args.out.display(), outlines.len());
    Ok(())
}

/// Writes the surface as STL.
///
/// # Errors
/// A recording that cannot be read, or a file that cannot be written.
pub fn stl(args: &StlArgs) -> anyhow::Result<()> {
    ends_in(&args.out, "stl")?;
    let reader = open_recording(&args.recording)?;
    let mesh = args.unit.mesh(&mesh(&reader)?);
    let recording = reader.recording();
    let words = format!(
        "unit {} {} estimator {} {} {}",
        args.unit.symbol(),
        mode(recording.mode),
        Estimator::Field.name(),
        recording.specimen.well,
        recording.run
    );
    let mut bytes = Vec::new();
    write_stl(&mesh, &words, &mut bytes)?;
    write(&args.out, &bytes)?;
    print_summary(&args.out, &mesh, args.unit);
    Ok(())
}

/// Writes the surface as GLB.
///
/// # Errors
/// A recording that cannot be read, or a file that cannot be written.
pub fn glb(args: &GlbArgs) -> anyhow::Result<()> {
    ends_in(&args.out, "glb")?;
    let reader = open_recording(&args.recording)?;
    let mut facts = facts(reader.recording());
    let (mesh, colours) = if args.texture {
        let found = computed(&reader, &mut facts)?;
        let colours = numbers::colours(&reader, &found.file, &found.mesh)?;
        (found.mesh, Some(colours))
    } else {
        (mesh(&reader)?, None)
    };
    facts.extend(facts_of_mesh());
    let mut bytes = Vec::new();
    write_glb(&mesh, colours.as_deref(), args.unit, &facts, &mut bytes)?;
    write(&args.out, &bytes)?;
    print_summary(&args.out, &mesh, args.unit);
    Ok(())
}

fn print_summary(out: &Path, mesh: &Mesh, unit: Unit) {
    note!("carved: {}: {} triangles, in {}", out.display(), mesh.triangles.len(), unit.symbol());
}

/// Checks the ending of a file's name.
///
/// # Errors
/// It is another one.
pub(super) fn ends_in(file: &Path, expected: &str) -> anyhow::Result<()> {
    let is = file.extension().is_some_and(|e| e.eq_ignore_ascii_case(expected));
    ensure!(is, "{}: the name of this file ends in .{expected}", file.display());
    Ok(())
}

/// The surface of a specimen, um: the stored one, or the computed one where none is stored.
fn mesh(reader: &RecordingReader) -> anyhow::Result<Mesh> {
    const MESH: &str = "mesh.ply";
    if let Some(bytes) = reader.file(MESH)? {
        return read_ply(&bytes).with_context(|| reader.folder().join(MESH).display().to_string());
    }
    let mut mesh = compute_with_hull(reader, &reader.recording().method)?.mesh;
    // As `mesh.ply` has them, so that both ways give the same bytes.
    mesh.vertices.iter_mut().flatten().for_each(|x| *x = f64::from(*x as f32));
    Ok(mesh)
}

/// The specimen measured again from its frames. How its numbers compare with the stored ones becomes one of the facts.
fn computed(reader: &RecordingReader, facts: &mut Vec<(&'static str, String)>) -> anyhow::Result<Computed> {
    let found = compute_with_hull(reader, &reader.recording().method)?;
    let compared = stored::compare(reader.files(), &found.file)?;
    if let Stored::Differs { at } = &compared {
        note!("carved: {}: the numbers of this model differ from the stored ones at {at}", reader.folder().display());
    }
    facts.push(("stored_numbers", compared.to_string()));
    Ok(found)
}

/// What a file says about its specimen.
pub(super) fn facts(recording: &Recording) -> Vec<(&'static str, String)> {
    vec![
        ("mode", mode(recording.mode).into()),
        ("run", recording.run.clone()),
        ("well", recording.specimen.well.clone()),
        ("method", recording.method_name.clone()),
        ("recorded_by", recording.software.words()),
        ("axes", "x along the capillary to the right, y down, z away from the camera; the origin is on the axis of rotation".into()),
    ]
}

pub(super) fn mode(mode: Mode) -> &'static str {
    crate::tables::mode(mode)
}
