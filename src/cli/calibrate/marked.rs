//! `carved calibrate marked`: determines once the rotation sense and the mirroring of a rig, from a turn of a capillary with a dot of ink.
//!
//! ```text
//!  RECORDING ── frames ── spots that move ── track ──┐
//!  --mark-side, --mark-edge, --mark-end ─────────────┴─ judge ── sense, mirror ── marked-DAY-ID.json, lines to paste
//! ```

use super::{keep, measured};
use anyhow::Context;
use carved_core::calibration::mark::{Depth, Edge, End, MarkSighting, MarkTrack, MarkView, Verdict, judge, track};
use carved_core::profile::{Moving, Picture, Spot};
use carved_records::Mode;
use carved_store::{Recording, RecordingReader};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::Serialize;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A turn of the marked capillary: a recording of a run (`runs/RUN/A01`) or of `carved import`
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
    /// Side of the glass on which you saw the mark at the first view, as seen from the camera
    #[arg(long, value_name = "near|far", value_parser = PossibleValuesParser::new(["near", "far"]).map(|s| if s == "near" { Depth::Near } else { Depth::Far }))]
    mark_side: Depth,
    /// The mark was in the upper or in the lower half
    #[arg(long, value_name = "top|bottom", value_parser = PossibleValuesParser::new(["top", "bottom"]).map(|s| if s == "top" { Edge::Top } else { Edge::Bottom }))]
    mark_edge: Edge,
    /// The mark was nearer to this end of the camera's picture
    #[arg(long, value_name = "left|right", value_parser = PossibleValuesParser::new(["left", "right"]).map(|s| if s == "left" { End::Left } else { End::Right }))]
    mark_end: End,
    /// Folder for the dated file
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

/// Contents of `marked-DAY-ID.json`.
#[derive(Serialize)]
struct MarkedFile {
    schema: &'static str,
    id: String,
    /// When this was computed, RFC 3339.
    date: String,
    #[serde(flatten)]
    found: MarkedTurn,
}

/// What the mark shows. The id of the file is the hash of this.
#[derive(Serialize)]
#[allow(clippy::struct_excessive_bools, reason = "each is an answer of its own")]
struct MarkedTurn {
    rig: String,
    mode: Mode,
    /// When the turn was recorded, RFC 3339.
    measured: jiff::Timestamp,
    recording: PathBuf,
    said: Said,
    /// 1 if positive steps move the near wall to larger v, -1 if they move it to smaller v.
    sense: i8,
    /// The sense with which the turn was recorded.
    sense_configured: i8,
    sense_agrees: bool,
    /// The picture is a mirror image: exactly one of the next two fields is true.
    mirrored: bool,
    left_for_right: bool,
    upside_down: bool,
    mark: Mark,
    words: Vec<String>,
    toml: Vec<String>,
}

/// The operator's description of the first view.
#[derive(Serialize)]
struct Said {
    side: &'static str,
    edge: &'static str,
    end: &'static str,
}

/// The measured path of the mark.
#[derive(Serialize)]
struct Mark {
    views: usize,
    seen: usize,
    u_px: f64,
    axis_px: f64,
    amplitude_px: f64,
    /// Phase in `v = axis + amplitude sin(omega + phase)`.
    phase_deg: f64,
    residual_px: f64,
    radius_um: f64,
    /// Radius of the glass from its walls, um.
    wall_radius_um: f64,
    /// Distance from the first position after one turn, px. `None` without a closure view.
    closure_px: Option<f64>,
    /// Position at the first view, in radii: downwards in the picture, and towards the camera.
    first_down: f64,
    first_near: f64,
    /// How much further from the picture's middle the mark is on the side that was named as near, px: measured, and expected from
    /// perspective. `null` if a tilt could have the same effect.
    perspective_px: Option<[f64; 2]>,
    /// Share of the next best spot that follows a circular path. `None` if there is no other.
    rival_share: Option<f64>,
}

/// Reads the turn, judges it, stores the file and prints it.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let found = find(args).with_context(|| args.recording.display().to_string())?;
    let date = jiff::Timestamp::now().to_string();
    let file = MarkedFile { schema: "carved.calibration-marked/1", id: measured::id(&found)?, date, found };
    keep::keep(&args.out, "marked", file.found.measured, &file.id, &file)?;
    for words in &file.found.words {
        note!("carved: {words}");
    }
    say!("{}", serde_json::to_string_pretty(&file)?);
    Ok(())
}

fn find(args: &Args) -> anyhow::Result<MarkedTurn> {
    let reader = RecordingReader::open(&args.recording)?;
    let recording = reader.recording();
    let camera = &recording.rig.camera;
    let entries: Vec<_> = recording.ledger.counted().collect();
    let first = recording.ledger.carved().next().context("the ledger has 0 views; a turn is expected")?;
    let mut unread = None;
    let pictures = entries.iter().map_while(|entry| {
        let frame = reader.frame(entry).map_err(|e| unread = Some(e)).ok()?;
        Some(Picture::from_frame(&frame))
    });
    let moving = Moving::new(pictures);
    if let Some(error) = unread {
        return Err(error.into());
    }
    let moving = moving?;
    let walls = moving.walls(&recording.method.segment.walls)?;
    let spots = moving.spots();
    let view = |at: usize| MarkView { omega: entries[at].omega, spots: &spots[at] };
    let views: Vec<MarkView> = (0..entries.len()).filter(|&i| !entries[i].closure).map(view).collect();
    let glass = |u: f64| {
        let (upper, lower) = (walls.upper.outer.at(u), walls.lower.outer.at(u));
        [f64::midpoint(upper, lower), (lower - upper) / 2.0]
    };
    let found = track(&views, glass)?;
    let spot = |closure: bool| -> Option<Spot> {
        let at = entries.iter().position(|e| e.closure == closure)?;
        found.nearest(&view(at))
    };
    let closure_px = spot(false).zip(spot(true)).map(|(a, b)| (a.u_px - b.u_px).hypot(a.v_px - b.v_px));
    let said = MarkSighting { depth: args.mark_side, edge: args.mark_edge, end: args.mark_end };
    let verdict = judge(&found, camera, first.omega, said, closure_px)?;
    let measured = recording.started.parse().with_context(|| format!("started = {:?}", recording.started))?;
    let sense_configured = i8::from(recording.rig.sense);
    let sense = if verdict.sense_agrees { sense_configured } else { -sense_configured };
    let (words, toml) = advice(recording, &verdict, sense);
    Ok(MarkedTurn {
        rig: recording.rig.name.clone(),
        mode: recording.mode,
        measured,
        recording: args.recording.clone(),
        said: Said {
            side: if said.depth == Depth::Near { "near" } else { "far" },
            edge: if said.edge == Edge::Top { "top" } else { "bottom" },
            end: if said.end == End::Left { "left" } else { "right" },
        },
        sense,
        sense_configured,
        sense_agrees: verdict.sense_agrees,
        mirrored: verdict.mirrored(),
        left_for_right: verdict.left_for_right,
        upside_down: verdict.upside_down,
        mark: mark(&found, &verdict, camera.ky, closure_px),
        words,
        toml,
    })
}

fn mark(found: &MarkTrack, verdict: &Verdict, ky: f64, closure_px: Option<f64>) -> Mark {
    Mark {
        views: found.views,
        seen: found.seen,
        u_px: found.u_px,
        axis_px: found.axis_px,
        amplitude_px: found.amplitude_px(),
        phase_deg: found.b_px.atan2(found.c_px).to_degrees(),
        residual_px: found.residual_px,
        radius_um: verdict.radius_um,
        wall_radius_um: found.wall_px / ky,
        closure_px,
        first_down: verdict.down,
        first_near: verdict.near,
        perspective_px: verdict.perspective_px,
        rival_share: found.rival.map(|(share, _)| share),
    }
}

/// Returns the text for the operator, and the lines of the configuration to change.
fn advice(recording: &Recording, verdict: &Verdict, sense: i8) -> (Vec<String>, Vec<String>) {
    let (mut words, mut toml) = (Vec::new(), Vec::new());
    let configured = i8::from(recording.rig.sense);
    let imported = recording.mode == Mode::Imported;
    words.push(match (verdict.sense_agrees, imported) {
        (true, false) => format!("the sense is {sense}, as configured"),
        (true, true) => "the angles were imported with the right sense".into(),
        (false, true) => {
            "the angles were imported with the wrong sense: import with the other --sense, and put it into the configuration".into()
        }
        (false, false) => {
            toml.extend(["[acquisition]".to_owned(), format!("sense = {sense}   # found with a marked capillary; it was {configured}")]);
            format!("the sense is {sense}, but {configured} is configured: models are mirror images in depth until it is changed")
        }
    });
    words.push(match (verdict.left_for_right, verdict.upside_down) {
        (false, false) => "the picture is upright and not mirrored".into(),
        (true, true) => "the picture is turned by half a turn, and not mirrored: +x is to the eye's left".into(),
        (left_for_right, _) => {
            toml.extend([
                "[camera]".to_owned(),
                "features = [[\"ReverseX\", \"true\"]]   # \"false\" where it is \"true\" now; the sense stays".to_owned(),
            ]);
            let how = if left_for_right { "left for right" } else { "top for bottom" };
            format!(
                "the picture is a mirror image, {how}: models are mirror images until the camera, or one mirror before it, turns it round"
            )
        }
    });
    if verdict.perspective_px.is_none() {
        words.push(
            "the perspective does not tell near from far here: that is the operator's word alone; a mark nearer to an end would".into(),
        );
    }
    (words, toml)
}
