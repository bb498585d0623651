//! Whether a 95 % interval contains the truth in 95 of 100 turns.

use super::document::{Goal, Section, table};
use super::effort::Work;
use super::statistics::{Summary, student};
use super::turn::{Turn, off, support};
use hardware_sim::analytic::Disturbance;

const ASD: usize = 21;

/// For volume and area: error in standard deviations, error in per cent, and standard deviation in per cent.
type Found = [[f64; 3]; 2];

pub fn run(work: &Work) -> anyhow::Result<Section> {
    let n = work.effort.coverage;
    let each = work.each("coverage", n, |i| found(work.seed + 70_000 + i))?;
    let found: Vec<Found> = each.into_iter().flatten().collect();
    let t = student(0.95, ASD - 1);
    let mut section = Section { title: "8. Coverage", ..Section::default() };
    let mut rows = Vec::new();
    for (number, what) in ["volume", "area"].into_iter().enumerate() {
        let of = |i: usize| found.iter().map(|f| f[number][i]).collect::<Vec<f64>>();
        let held = 100.0 * of(0).iter().filter(|z| z.abs() <= t).count() as f64 / found.len().max(1) as f64;
        let (z, percent, sd) = (Summary::of(&of(0)), Summary::of(&of(1)), Summary::of(&of(2)));
        rows.push(vec![
            what.into(),
            format!("{held:.1}"),
            percent.signed(3),
            format!("{:.3} ± {:.3}", sd.mean, sd.sd),
            format!("{:+.2} ± {:.2}", z.mean, z.sd),
        ]);
        section.goals.push(Goal::new(
            format!("coverage: of {n} phantoms, 95 % intervals of {what} that contain the true value: 93 to 97 %"),
            format!("{held:.1} % of {} measured", found.len()),
            found.len() == n && (93.0..=97.0).contains(&held),
        ));
    }
    section.text = format!(
        "Simulation: {n} finless larvae, drift and noise, ASD {ASD}. The interval is the value ± {t:.3} standard deviations\n\
         (Student's t, {} degrees of freedom), from views (jackknife) and calibration. On an instrument the errors of its scale,\n\
         and edge errors that are the same in all views, are added. They are left out here, because the simulation has no such\n\
         errors. A mean error that is not small compared with the stated SD is a bias. Intervals of repeatability do not include\n\
         a bias.\n\n{}",
        ASD - 1,
        table(&["", "coverage, %", "error, %: mean ± SD, worst", "stated SD, %", "error in stated SDs"], &rows)
    );
    Ok(section)
}

fn found(seed: u64) -> anyhow::Result<Option<Found>> {
    let turn = Turn::of_larva(seed, ASD, &Disturbance::drift(seed))?;
    let stops = turn.all();
    let Ok(calibration) = turn.calibrated(&stops) else { return Ok(None) };
    let size = turn.truth.size;
    Ok(support(&turn, &stops, &calibration).map(|s| {
        let of = |value: f64, truth: f64, sd: f64| [(value - truth) / sd, off(value, truth), 100.0 * sd / truth];
        [of(s.estimate.volume_um3, size.volume_um3, s.volume_sd_um3), of(s.estimate.area_um2, size.area_um2, s.area_sd_um2)]
    }))
}
