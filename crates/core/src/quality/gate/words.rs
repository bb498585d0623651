//! A gate in plain words: what was found, and what the operator does about it.

use super::GateSettings;
use super::chart::Chart;
use super::judge::{BeadGate, GateVerdict};
use crate::measure::references::limb::BeadMaterial;
use crate::quality::Check;

pub(super) fn words(gate: &BeadGate, settings: &GateSettings) -> Vec<String> {
    let n = gate.numbers.beads;
    let mut said = vec![match gate.verdict {
        GateVerdict::Passed => format!("passed: {n} beads within every limit, and as in {} earlier gates", gate.history),
        GateVerdict::NoHistory => format!(
            "passed the limits: {n} beads; {} earlier gates that passed, {} are needed to tell a change. Measure beads daily",
            gate.history, settings.history_least
        ),
        GateVerdict::TooFewBeads => format!("no gate: {n} different bead(s), {} are needed. Measure more", settings.beads_least),
        GateVerdict::Failed => format!("failed: {n} beads. Measure no specimens before this is understood"),
    }];
    if gate.verdict != GateVerdict::TooFewBeads {
        said.extend(gate.checks.iter().filter(|c| c.over).map(check));
        said.extend(gate.charts.iter().filter(|c| c.jumped || c.drifted).map(chart));
    }
    said.extend(gate.score.as_ref().map(|s| {
        let (off_um, held_um) = ((s.mean_um - s.nominal_um).abs(), s.detectable_um.max(settings.tolerated_um()[0]));
        let percent = 100.0 * held_um / s.nominal_um;
        let looks = match settings.bead_material {
            BeadMaterial::Opaque => String::new(),
            BeadMaterial::Unknown => format!(
                " What the beads are made of is not stated (bead_material): clear ones look up to {:.1} um smaller than they are.",
                settings.nominal_um - BeadMaterial::Polystyrene.apparent_um(settings.nominal_um)[0]
            ),
            _ => format!(" Beads of this material look {:.1} um smaller than they are, which is corrected.", settings.nominal_um - s.nominal_um),
        };
        let surely = if s.t_score > s.critical && settings.tolerates(s.mean_um) {
            let [below_um, above_um] = settings.tolerated_um();
            format!(". This is certain, and no reason to doubt the rig: by repeat_um and bead_material {below_um:.1} um too small or {above_um:.1} um too large are tolerated")
        } else {
            String::new()
        };
        format!(
            "the mean diameter is {off_um:.2} um off (t score {:.2}, limit {:.2}){surely}. {n} beads can miss a bias of less than {held_um:.2} um \
             ({percent:.2} %).{looks} To calibrate the scale, use a certified bead or a micrometer",
            s.t_score, s.critical
        )
    }));
    if gate.numbers.repeat_um.is_none() {
        said.push("repeatability is unknown: measure one bead twice".into());
    }
    said
}

fn check(check: &Check) -> String {
    let Check { name, unit, found, limit, .. } = check;
    let found = found.map_or_else(|| "no number".to_owned(), |x| format!("{x:.4}"));
    let way_out = match name.as_str() {
        "aspect_off" => {
            "length over width is not 1: kx and ky do not belong together. carved calibrate beads says the right ky; look whether there is air around the capillary"
        }
        "roundness_um" => "a bead is not round: clean capillary and bead, look at the frames for bubbles and dirt, measure it again",
        "residual_px" => "the views of a bead do not agree: look at focus, vibration and the light; carved doctor",
        "repeat_um" => "the same bead twice is not the same: look at focus, light and the capillary's seat, and measure it again",
        "t_percent" => {
            "the mean diameter is not the nominal one: the scale, or the batch, is another. carved calibrate scale with a micrometer"
        }
        _ => "look at the beads' frames",
    };
    format!("{name} {found} {unit}, limit {limit}: {way_out}")
}

fn chart(chart: &Chart) -> String {
    let Chart { name, unit, found, history, limits: [low, high], cusum, .. } = chart;
    let how = if chart.jumped {
        format!("jumped: {found:.4} {unit}, {low:.4} to {high:.4} expected of {} earlier gates", history.n)
    } else {
        format!(
            "has drifted: {found:.4} {unit} where {} earlier gates have {:.4}, sums {:.1} up and {:.1} down",
            history.n, history.mean, cusum[0], cusum[1]
        )
    };
    let way_out = match name.as_str() {
        "uy_px" | "gamma_deg" => {
            "the capillary or the camera sits elsewhere. If that was meant, begin a new history (--begin-history); else look at the mounts"
        }
        "aspect_ratio" | "diameter_um" => {
            "the optics are not what they were: look at the lens, the working distance and the water around the capillary"
        }
        _ => "edges are worse than they were: look at focus, light and the glass",
    };
    format!("{name} {how}: {way_out}")
}
