//! `carved calibrate history`: the dated files of beads over several days, as a table and as a plot.
//!
//! ```text
//!  uy     | o   o      o      one panel each of axis, roll, length over width and
//!  gamma  |   o    o   o      mean diameter, over the day of measuring, with standard deviations
//! ```

use super::beads::BeadsFile;
use anyhow::{Context, ensure};
use carved_core::statistics::{Line, Spread};
use carved_store::calibrations::BEADS_SCHEMA;
use carved_store::durable;
use std::fmt::Write as _;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Files of one rig, written by `carved calibrate beads`
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Plot to write; an older one is replaced
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
}

/// A quantity over several days.
struct Track {
    name: &'static str,
    digits: usize,
    /// Days since the first file and value; then the standard deviation, if there is one.
    points: Vec<([f64; 2], Option<f64>)>,
}

/// Reads, prints the table and writes the plot.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let files = read(&args.files)?;
    let first = files.first().context("0 files; 1 or more is expected")?.found.measured;
    let day = |f: &BeadsFile| f.found.measured.duration_since(first).as_secs_f64() / 86400.0;
    let track = |name, digits, value: fn(&BeadsFile) -> Option<Spread>| Track {
        name,
        digits,
        points: files.iter().filter_map(|f| value(f).map(|s| ([day(f), s.mean], s.sd))).collect(),
    };
    let tracks = [
        track("uy_px", 3, |f| f.found.uy_px),
        track("gamma_rad", 6, |f| f.found.gamma_rad),
        track("aspect_ratio", 5, |f| Some(f.found.aspect_ratio)),
        track("diameter_um", 2, |f| Some(f.found.diameter_um)),
    ];
    say!("{}", table(&files, &tracks).trim_end());
    if let Some(path) = &args.svg {
        let rig = &files[0].found.rig;
        let plot = svg(rig, &first.strftime("%Y-%m-%d").to_string(), &tracks);
        // The plot can be made again at any time, so it need not survive a crash.
        std::fs::write(path, plot).with_context(|| format!("{}: cannot write the plot", path.display()))?;
    }
    Ok(())
}

/// Reads the files and sorts them by the time of measurement.
fn read(paths: &[PathBuf]) -> anyhow::Result<Vec<BeadsFile>> {
    let mut files: Vec<BeadsFile> = Vec::new();
    for path in paths {
        let file: BeadsFile = durable::read_json(path, "what carved calibrate beads leaves")?;
        let at = path.display();
        ensure!(file.schema == BEADS_SCHEMA, "{at}: schema is {:?}; expected {BEADS_SCHEMA:?}", file.schema);
        if let Some(first) = files.first() {
            let (a, b) = (&first.found, &file.found);
            ensure!(a.rig == b.rig, "{at}: rig is {:?}, but that of the first file is {:?}; name files of one rig", b.rig, a.rig);
            ensure!(a.mode == b.mode, "{at}: mode is {:?}, but that of the first file is {:?}; name files of one mode", b.mode, a.mode);
        }
        ensure!(files.iter().all(|f| f.id != file.id), "{at}: id {} is there twice; name each calibration once", file.id);
        files.push(file);
    }
    files.sort_by_key(|f| f.found.measured);
    Ok(files)
}

fn table(files: &[BeadsFile], tracks: &[Track]) -> String {
    let mut text =
        format!("{:<22}{:<14}{:>4}{:>10}{:>12}{:>14}{:>13}\n", "measured", "id", "n", "uy_px", "gamma_rad", "aspect_ratio", "diameter_um");
    let cell = |s: Option<Spread>, digits: usize| s.map_or_else(|| "-".to_owned(), |s| format!("{:.digits$}", s.mean));
    for BeadsFile { id, found: f, .. } in files {
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:<22}{id:<14}{:>4}{:>10}{:>12}{:>14}{:>13}",
            f.measured.strftime("%Y-%m-%dT%H:%M:%SZ").to_string(),
            f.diameter_um.n,
            cell(f.uy_px, 3),
            cell(f.gamma_rad, 6),
            cell(Some(f.aspect_ratio), 5),
            cell(Some(f.diameter_um), 2)
        );
    }
    text.push_str("\ndrift per day\n");
    for track in tracks {
        let points: Vec<[f64; 2]> = track.points.iter().map(|(p, _)| *p).collect();
        let digits = track.digits + 1;
        let said = match Line::through(&points) {
            Some(d) => {
                let sd = d.slope_sd.map_or_else(|| "(two days do not tell how sure)".into(), |sd| format!("+- {sd:.digits$}"));
                format!("{:+.digits$} {sd}", d.slope)
            }
            None => format!("- ({} value(s) of one moment; two days are needed)", points.len()),
        };
        let _ = writeln!(text, "  {:<14}{said}", track.name);
    }
    text
}

const WIDTH: f64 = 640.0;
const PANEL: f64 = 130.0;
const LEFT: f64 = 150.0;
const TOP: f64 = 40.0;

/// Draws the panels below each other over the days since the first file.
fn svg(rig: &str, first: &str, tracks: &[Track]) -> String {
    let rig = quick_xml::escape::partial_escape(rig);
    let last_day = tracks.iter().flat_map(|t| &t.points).map(|(p, _)| p[0]).fold(0.0, f64::max);
    let height = TOP + PANEL * tracks.len() as f64 + 30.0;
    let right = WIDTH - 20.0;
    let x = |day: f64| LEFT + 10.0 + (right - LEFT - 20.0) * if last_day > 0.0 { day / last_day } else { 0.5 };
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" font-size=\"12\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n<text x=\"{LEFT}\" y=\"24\" font-size=\"14\">Beads on {rig} from {first}</text>\n"
    );
    for (i, track) in tracks.iter().enumerate() {
        let (top, bottom) = (TOP + PANEL * i as f64, TOP + PANEL * (i as f64 + 1.0) - 24.0);
        let ends = track.points.iter().flat_map(|([_, v], sd)| [v - sd.unwrap_or(0.0), v + sd.unwrap_or(0.0)]);
        let (low, high) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        let name_y = f64::midpoint(top, bottom);
        let _ = writeln!(
            text,
            "<rect x=\"{LEFT}\" y=\"{top}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#999\"/>",
            right - LEFT,
            bottom - top
        );
        let _ = writeln!(text, "<text x=\"8\" y=\"{name_y}\">{}</text>", track.name);
        if track.points.is_empty() {
            continue;
        }
        // The range of equal values must not be zero.
        let half = (0.5 * (high - low)).max(0.5 * 0.1_f64.powi(track.digits as i32));
        let middle = f64::midpoint(low, high);
        let y = |v: f64| name_y - (v - middle) / half * (0.5 * (bottom - top) - 8.0);
        for v in [middle - half, middle + half] {
            let _ = writeln!(text, "<text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{v:.*}</text>", LEFT - 6.0, y(v) + 4.0, track.digits);
        }
        for ([day, value], sd) in &track.points {
            let (x, sd) = (x(*day), sd.unwrap_or(0.0));
            let _ = writeln!(text, "<path d=\"M{x:.1} {:.1}V{:.1}\" stroke=\"#0072b2\"/>", y(value - sd), y(value + sd));
            let _ = writeln!(text, "<circle cx=\"{x:.1}\" cy=\"{:.1}\" r=\"3\" fill=\"#0072b2\"/>", y(*value));
        }
    }
    let at = height - 12.0;
    let _ = writeln!(text, "<text x=\"{LEFT}\" y=\"{at}\">0</text>");
    let _ = writeln!(text, "<text x=\"{right}\" y=\"{at}\" text-anchor=\"end\">{last_day:.1} days after the first</text>\n</svg>");
    text
}
