//! Larvae as `make run` shows them, measured by the pipeline of the instrument.
//!
//! ```text
//!   scene as on a VAST ── frames ── segmentation ──┬── outlines as found ──────── Pipeline ── the numbers of the demo
//!            └── exact outlines ───────────────────┴── exact part by part ─────── Pipeline ── what each part costs
//! ```

use super::document::{Goal, Section, table};
use super::effort::Work;
use super::statistics::{Summary, share_within, student};
use super::turn::{CAPTURED, VOXEL_UM, even_plan, even_stops, off, pipeline};
use crate::camera::camera;
use carved_core::flag::StoredFlag;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::pipeline::SegmentedFrame;
use carved_core::profile::{ColumnEdges, Columns, Mask, Polygon, Profile};
use carved_core::statistics::upper_median;
use hardware_sim::scene::{Camera, Exposure, Outline, Scene, SceneSettings, Specimen};
use std::collections::BTreeMap;

/// Views of the turns that are measured: even subsets of the captured ones.
const ASDS: [usize; 5] = [4, 7, 12, 21, CAPTURED];
/// Rows of the sensor: the bore and what is beside it.
const ROWS: u32 = 256;

/// The outlines that are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Outlines {
    /// As segmentation finds them.
    Found,
    /// Exact where only the body is seen, as found where a fin stands out.
    ExactBody,
    /// Exact where a fin stands out, as found where only the body is seen.
    ExactFins,
    /// Exact.
    Exact,
}

impl Outlines {
    const ALL: [Self; 4] = [Self::Found, Self::ExactBody, Self::ExactFins, Self::Exact];

    const fn name(self) -> &'static str {
        match self {
            Self::Found => "as found",
            Self::ExactBody => "exact at the body",
            Self::ExactFins => "exact at the fins",
            Self::Exact => "exact",
        }
    }
}

/// What a turn gives.
#[derive(Debug)]
struct Measured {
    /// Errors against the ideal hull, %.
    volume: f64,
    area: f64,
    length: f64,
    /// The same of the length along the body. These larvae are nearly straight.
    body_length: f64,
    /// Standard deviation that is stated for the volume, %.
    stated: f64,
    flags: Vec<StoredFlag>,
}

/// A frame with its segmentation and the exact outlines.
struct View {
    frame: SegmentedFrame,
    edge: Columns,
    body: Columns,
}

/// How far a found edge lies outside the exact one, px, by what is seen there.
#[derive(Debug, Default, Clone)]
struct EdgeErrors(BTreeMap<&'static str, Vec<f64>>);

/// A side of a column: how far the fin stands out of the body, and the part of the length.
fn place(standing_out_px: f64, is_beyond_body: bool, along: f64) -> &'static str {
    match standing_out_px {
        _ if is_beyond_body => "behind the body",
        ..0.3 if along < 0.25 => "body, first quarter",
        ..0.3 if along < 0.6 => "body, second",
        ..0.3 => "body, tail",
        ..4.0 => "fin to 4 px",
        ..8.0 => "fin 4 to 8 px",
        _ => "fin from 8 px",
    }
}

fn columns(outlines: &[Outline], width: u32, height: u32) -> Columns {
    let polygons: Vec<Polygon> = outlines.iter().map(|vertices| Polygon { vertices: vertices.clone() }).collect();
    Columns::from_outlines(&polygons, width as usize, height as usize)
}

/// The outline of columns that are next to each other.
fn outline(edges: &[(usize, ColumnEdges)]) -> Vec<Polygon> {
    let mut out: Vec<Polygon> = Vec::new();
    for run in edges.chunk_by(|a, b| a.0 + 1 == b.0) {
        let upper = run.iter().map(|(u, e)| [*u as f64, e.upper]);
        let lower = run.iter().rev().map(|(u, e)| [*u as f64, e.lower]);
        let mut vertices: Vec<[f64; 2]> = upper.chain(lower).collect();
        // A column that is the last one is seen as far as half a pixel further.
        let (first, last) = (run[0], run[run.len() - 1]);
        let at = run.len();
        vertices.insert(at, [last.0 as f64 + 0.5, f64::midpoint(last.1.upper, last.1.lower)]);
        vertices.push([first.0 as f64 - 0.5, f64::midpoint(first.1.upper, first.1.lower)]);
        out.push(Polygon { vertices });
    }
    out
}

impl View {
    /// Edges by column: those of `exact`, where `is_exact` says so of a side; otherwise those of `found`.
    fn mixed(&self, found: &Columns, exact: &Columns, outlines: Outlines) -> Vec<(usize, ColumnEdges)> {
        let is_exact = |standing_out: f64, beyond: bool| match outlines {
            Outlines::Found => false,
            Outlines::ExactBody => standing_out < 0.3 && !beyond,
            Outlines::ExactFins => standing_out >= 0.3 || beyond,
            Outlines::Exact => true,
        };
        (0..self.edge.width())
            .filter_map(|u| {
                let (all, body, own) = (self.edge.get(u), self.body.get(u), found.get(u));
                let out = match (all, body) {
                    (Some(all), Some(body)) => [body.upper - all.upper, all.lower - body.lower],
                    _ => [f64::INFINITY; 2],
                };
                let beyond = body.is_none();
                match (exact.get(u), own) {
                    (Some(e), Some(o)) => {
                        let upper = if is_exact(out[0], beyond) { e.upper } else { o.upper };
                        let lower = if is_exact(out[1], beyond) { e.lower } else { o.lower };
                        (lower > upper).then_some((u, ColumnEdges { upper, lower, gap: 0.0 }))
                    }
                    (Some(e), None) => is_exact(out[0], beyond).then_some((u, e)),
                    (None, Some(o)) => (!is_exact(0.3, true)).then_some((u, o)),
                    (None, None) => None,
                }
            })
            .collect()
    }

    /// The frame with these outlines.
    fn with(&self, outlines: Outlines) -> anyhow::Result<SegmentedFrame> {
        let profile = self.frame.profile.as_ref().map_err(|e| anyhow::anyhow!("no profile: {e}"))?;
        let (width, height) = (self.edge.width(), self.edge.height());
        let profile = if outlines == Outlines::Found {
            profile.clone()
        } else {
            let found = |polygons: &[Polygon]| Columns::from_outlines(polygons, width, height);
            let edge = outline(&self.mixed(&found(&profile.edge), &self.edge, outlines));
            let body = outline(&self.mixed(&found(&profile.body), &self.body, outlines));
            let columns = Columns::from_outlines(&edge, width, height);
            let mut mask = Mask::empty(width, height);
            for (u, e) in (0..width).filter_map(|u| columns.get(u).map(|e| (u, e))) {
                for v in e.upper.ceil().max(0.0) as usize..=(e.lower.floor() as usize).min(height - 1) {
                    mask.set(u, v, true);
                }
            }
            Profile { mask, edge, body, ..profile.clone() }
        };
        let borders = if outlines == Outlines::Exact { None } else { self.frame.borders.clone() };
        Ok(SegmentedFrame { picture: self.frame.picture.clone(), profile: Ok(profile), borders })
    }

    fn add_errors(&self, errors: &mut EdgeErrors) {
        let Ok(profile) = &self.frame.profile else { return };
        let found = Columns::from_outlines(&profile.edge, self.edge.width(), self.edge.height());
        let Some((first, last)) = self.body.extent() else { return };
        for u in 0..self.edge.width() {
            let (Some(all), Some(own)) = (self.edge.get(u), found.get(u)) else { continue };
            let along = (u as f64 - first as f64) / (last - first).max(1) as f64;
            let body = self.body.get(u);
            for (standing_out, error) in [
                (body.map(|body| body.upper - all.upper), all.upper - own.upper),
                (body.map(|body| all.lower - body.lower), own.lower - all.lower),
            ] {
                let at = place(standing_out.unwrap_or(0.0), body.is_none(), along);
                errors.0.entry(at).or_default().push(error);
            }
        }
    }
}

/// Captured frames of a larva, and what is true of it.
struct Larva {
    camera: carved_core::geometry::Camera,
    hull_um: [f64; 2],
    length_um: f64,
    views: BTreeMap<usize, View>,
    closure: SegmentedFrame,
}

impl Larva {
    /// The larva in the frames that turns of so many views take.
    fn of(dpf: u8, seed: u64, asds: &[usize]) -> anyhow::Result<Self> {
        let nominal = Camera { height: ROWS, uy_px: f64::from(ROWS - 1) / 2.0, gamma_rad: 0.25f64.to_radians(), ..Camera::default() };
        let mut settings = SceneSettings::real_in(&nominal, seed);
        settings.optics.noise_seed = seed;
        let specimen = Specimen::as_on_a_vast(dpf, seed)?;
        let truth = specimen.truth();
        let camera = camera(&settings.camera);
        let scene = Scene::new(settings);
        scene.load(specimen)?;
        let segmenter = pipeline(&camera, CAPTURED, VOXEL_UM)?;
        let look = |angle_rad: f64, number: u64| {
            let rgb = scene.render(&Exposure { angle_rad, number });
            Ok::<_, anyhow::Error>(segmenter.look(&RawFrame::new(rgb.width, rgb.height, PixelFormat::BayerRG8, rgb.to_bayer_rg8())?)?)
        };
        let ledger = even_plan(CAPTURED);
        let mut views = BTreeMap::new();
        let mut length_um: f64 = 0.0;
        for stop in asds.iter().flat_map(|asd| even_stops(*asd)) {
            if views.contains_key(&stop) {
                continue;
            }
            let outlines = scene.truth_edge(ledger[stop]);
            let ends = || outlines.iter().flatten().map(|p| p[0]);
            let seen_px = ends().fold(f64::NEG_INFINITY, f64::max) - ends().fold(f64::INFINITY, f64::min);
            length_um = length_um.max(seen_px / nominal.kx_px_per_um);
            let edge = columns(&outlines, nominal.width, ROWS);
            let body = columns(&scene.body_edge(ledger[stop]), nominal.width, ROWS);
            views.insert(stop, View { frame: look(ledger[stop], stop as u64)?, edge, body });
        }
        let closure = look(std::f64::consts::TAU, CAPTURED as u64)?;
        Ok(Self { camera, hull_um: [truth.hull_volume_um3, truth.hull_area_um2], length_um, views, closure })
    }

    fn measured(&self, asd: usize, outlines: Outlines) -> anyhow::Result<Measured> {
        let mut pipeline = pipeline(&self.camera, asd, VOXEL_UM)?;
        let ledger = even_plan(CAPTURED);
        for (view, stop) in even_stops(asd).into_iter().enumerate() {
            pipeline.observe(view as u32, ledger[stop], &self.views[&stop].with(outlines)?)?;
        }
        if outlines == Outlines::Found {
            pipeline.observe_closure(&self.closure);
        }
        let (_, record) = pipeline.finish()?;
        let m = &record.measurement;
        Ok(Measured {
            volume: off(m.volume_um3, self.hull_um[0]),
            area: off(m.area_um2, self.hull_um[1]),
            length: off(m.length_um, self.length_um),
            body_length: off(
                record.shape.as_ref().and_then(|shape| shape.body.as_ref()).map_or(f64::NAN, |body| body.length_um),
                self.length_um,
            ),
            stated: 100.0 * m.volume_sd_um3.unwrap_or(f64::NAN) / self.hull_um[0],
            flags: record.flags,
        })
    }
}

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let mut section = Section { title: "12. As `make run` shows them", ..Section::default() };
    let larvae = work.effort.demo;
    if larvae == 0 {
        section.text += "No frames were rendered.\n\n";
        return Ok(section);
    }
    let each = work.each("as make run shows them", larvae, |i| {
        let (dpf, seed) = (3 + (i % 3) as u8, work.seed + 150_000 + i);
        let larva = Larva::of(dpf, seed, &ASDS)?;
        let mut errors = EdgeErrors::default();
        for stop in even_stops(21) {
            larva.views[&stop].add_errors(&mut errors);
        }
        let turns = ASDS.iter().flat_map(|asd| Outlines::ALL.map(|outlines| ((*asd, outlines.name()), larva.measured(*asd, outlines))));
        let turns = turns.map(|(key, turn)| Ok((key, turn?))).collect::<anyhow::Result<BTreeMap<_, _>>>()?;
        Ok((errors, turns))
    })?;
    let mut rows = Vec::new();
    for asd in ASDS {
        for outlines in Outlines::ALL {
            let of =
                |number: fn(&Measured) -> f64| each.iter().map(|(_, turns)| number(&turns[&(asd, outlines.name())])).collect::<Vec<f64>>();
            let t = student(0.95, asd - 1);
            let held: Vec<f64> = of(|m| m.volume / m.stated).iter().map(|share| share / t).collect();
            rows.push(vec![
                asd.to_string(),
                outlines.name().to_owned(),
                Summary::of(&of(|m| m.volume)).signed(2),
                Summary::of(&of(|m| m.area)).signed(2),
                Summary::of(&of(|m| m.length)).signed(2),
                Summary::of(&of(|m| m.body_length)).signed(2),
                format!("{:.2}", Summary::of(&of(|m| m.stated)).mean),
                format!("{:.0}", share_within(&held, 1.0)),
            ]);
        }
    }
    let mut flags: BTreeMap<&str, usize> = BTreeMap::new();
    for flag in each.iter().flat_map(|(_, turns)| &turns[&(21, Outlines::Found.name())].flags) {
        *flags.entry(flag.as_str()).or_default() += 1;
    }
    let mut places: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (errors, _) in &each {
        for (place, errors) in &errors.0 {
            places.entry(place).or_default().extend(errors);
        }
    }
    let places: Vec<Vec<String>> = places
        .iter()
        .map(|(place, errors)| {
            let short = 100.0 * errors.iter().filter(|e| **e < -1.5).count() as f64 / errors.len() as f64;
            let Summary { mean, sd, .. } = Summary::of(errors);
            vec![
                (*place).to_owned(),
                errors.len().to_string(),
                format!("{mean:+.3}"),
                format!("{:+.3}", upper_median(errors.clone())),
                format!("{sd:.2}"),
                format!("{short:.1}"),
            ]
        })
        .collect();
    for (asd, [mean, sd, worst]) in [(21, [0.25, 0.35, 0.9]), (12, [0.4, f64::INFINITY, 1.5])] {
        let found = Summary::of(&each.iter().map(|(_, turns)| turns[&(asd, Outlines::Found.name())].volume).collect::<Vec<_>>());
        section.goals.push(Goal::new(
            format!("12: as `make run` shows them, ASD {asd}, volume: mean within {mean} %, worst {worst} %"),
            found.signed(2),
            found.mean.abs() <= mean && found.sd <= sd && found.worst.abs() <= worst,
        ));
    }
    let length = Summary::of(&each.iter().map(|(_, turns)| turns[&(21, Outlines::Found.name())].length).collect::<Vec<_>>());
    section.goals.push(Goal::new("12: the same, ASD 21, length: worst 1 %".to_owned(), length.signed(2), length.worst.abs() <= 1.0));
    section.text = format!(
        "Simulation: {larvae} larvae of 3, 4 and 5 dpf with the look of `make run`: light, walls, dust and bodies as on a VAST. The\n\
         seeds draw the larva and the scene. Frames are rendered, segmented and measured by the pipeline of the instrument. The\n\
         true value is the ideal visual hull of body and fins, and the length of the longest silhouette. The other rows replace\n\
         outlines by exact ones, part by part: they say what segmentation costs. `holds` is the share of the intervals (Student's\n\
         t, 95 %) that contain the true volume. The second table has the distances of the found edges from the exact ones at 21\n\
         views, column by column and before the views are compared.\n\n{}{}Flags at 21 views: {}\n\n",
        table(
            &["ASD", "outlines", "volume, %: mean ± SD, worst", "area, %", "length, %", "along the body, %", "stated SD, %", "holds, %"],
            &rows
        ),
        table(&["where", "edges", "outside by, px: mean", "median", "SD", "short by more than 1.5 px, %"], &places),
        flags.iter().map(|(flag, n)| format!("`{flag}` {n}")).collect::<Vec<_>>().join(", ")
    );
    Ok(section)
}

#[cfg(test)]
mod tests {
    use super::*;
    use carved_core::flag::Flag;

    /// Its fins are faint in single views. Where the views do not decide together which faint pieces are fins, it reads 2.7 % too small.
    #[test]
    fn fins_that_are_faint_in_single_views_count() -> anyhow::Result<()> {
        let found = Larva::of(4, 120_001, &[21])?.measured(21, Outlines::Found)?;
        assert!(found.volume.abs() < 1.2, "{found:?}");
        // Only the views across the tail fin show its tip: a length of what most views agree on was 4.4 % too small.
        assert!(found.length.abs() < 1.0 && found.body_length.abs() < 1.0, "{found:?}");
        Ok(())
    }

    /// 12 views look from 12 directions, so that two or four half-views show a pectoral fin. Without these fins they read 1.7 % too small.
    #[test]
    fn few_views_show_both_pectoral_fins() -> anyhow::Result<()> {
        let found = Larva::of(5, 120_008, &[12])?.measured(12, Outlines::Found)?;
        assert!(found.volume.abs() < 1.0, "{found:?}");
        Ok(())
    }

    /// What the slices of 12 views cannot follow, the fins above all, looks like a turn of the larva, and the axis that it gives is worse.
    #[test]
    fn few_views_of_fins_are_no_turn_of_the_larva() -> anyhow::Result<()> {
        for (dpf, seed, outlines) in [(3, 120_000, Outlines::Exact), (4, 120_010, Outlines::Found)] {
            let found = Larva::of(dpf, seed, &[12])?.measured(12, outlines)?;
            let odd = [Flag::Moved, Flag::Uncalibrated];
            assert!(odd.iter().all(|odd| !found.flags.iter().any(|flag| flag == odd)), "{seed}, {outlines:?}: {found:?}");
        }
        Ok(())
    }
}
