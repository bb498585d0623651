//! How often the closure view flags a larva as `moved` or `closure_undecided`, at rest and moved: the table of docs/quality.md.
//!
//! ```sh
//! cargo bench --bench closure_rates            # 12 larvae, five cases, some minutes
//! cargo bench --bench closure_rates -- 32 rest # 32 larvae at rest only, two closure views each
//! ```

#[path = "../tests/science/closures.rs"]
mod closures;

use carved_core::calibration::PoseOffset;
use carved_core::flag::Flag;
use carved_core::quality::Check;
use closures::{Done, Reading, readings};

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let larvae: u64 = args.iter().find_map(|a| a.parse().ok()).unwrap_or(12);
    let rest_only = args.iter().any(|a| a == "rest");
    let all = [Done::Nothing, Done::Nothing, Done::Turned, Done::TurnedBack, Done::Along, Done::Across];
    // Seeds below 100 were used to choose the common error of whole edges.
    let found = readings(100..100 + larvae, if rest_only { &all[..2] } else { &all });
    for done in [Done::Nothing, Done::Turned, Done::TurnedBack, Done::Along, Done::Across] {
        let of: Vec<&Reading> = found.iter().filter(|reading| reading.done == done).collect();
        if !of.is_empty() {
            print(done, &of);
        }
    }
}

fn print(done: Done, of: &[&Reading]) {
    let count = |is: &dyn Fn(&Reading) -> bool| of.iter().filter(|reading| is(reading)).count();
    let turn = |reading: &Reading| reading.record.quality.as_ref().and_then(|q| q.check("closure_turn_deg")).cloned();
    let turns = |is: &dyn Fn(&Check) -> bool| count(&|reading| turn(reading).is_some_and(|check| is(&check)));
    println!(
        "{done:?}: {} turns; moved {}, closure_undecided {}, neither {}; the turn is over {}, undecided {}, beyond the bare limit {}",
        of.len(),
        count(&|r| r.has_flag(Flag::Moved)),
        count(&|r| r.has_flag(Flag::ClosureUndecided)),
        count(&|r| !r.has_flag(Flag::Moved) && !r.has_flag(Flag::ClosureUndecided)),
        turns(&|check| check.over),
        turns(&|check| check.undecided),
        turns(&|check| check.found.is_some_and(|deg| deg.abs() > check.limit)),
    );
    let spread = |read: &dyn Fn(&PoseOffset) -> Option<[f64; 2]>| {
        let values: Vec<[f64; 2]> = of.iter().filter_map(|reading| read(&reading.lie)).collect();
        let n = values.len() as f64;
        let mean = values.iter().map(|v| v[0]).sum::<f64>() / n;
        let sd = (values.iter().map(|v| (v[0] - mean).powi(2)).sum::<f64>() / n).sqrt();
        let mut stated: Vec<f64> = values.iter().map(|v| v[1]).collect();
        stated.sort_by(f64::total_cmp);
        let beyond = values.iter().filter(|v| (v[0] - mean).abs() > 2.0 * v[1]).count();
        let (median, most) = (stated.get(stated.len() / 2).copied(), stated.last().copied());
        format!(
            "{mean:+.2} +- {sd:.2}; stated {:.2} (median) to {:.2}; {beyond} beyond 2 sd of the mean",
            median.unwrap_or(f64::NAN),
            most.unwrap_or(f64::NAN)
        )
    };
    println!("   turn, deg:  {}", spread(&|l| l.sd.map(|sd| [l.turn_rad.to_degrees(), sd.turn_rad.to_degrees()])));
    println!("   along, px:  {}", spread(&|l| l.sd.map(|sd| [l.along_px, sd.along_px])));
    println!("   across, px: {}", spread(&|l| l.sd.map(|sd| [l.across_px, sd.across_px])));
}
