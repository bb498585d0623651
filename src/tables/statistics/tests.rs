#![allow(clippy::float_cmp, reason = "the numbers compared are exact")]

use super::*;
use crate::tables::Cell;
use carved_core::flag::{Flag, StoredFlag};

fn sample(run: &str, well: &str, planned: &serde_json::Value, volume: f64) -> Sample {
    let mut planned = planned.clone();
    planned["well"] = well.into();
    let mut numbers = [None; QUANTITIES.len()];
    numbers[0] = Some(volume);
    let planned: PlannedWell = serde_json::from_value(planned).unwrap();
    Sample {
        run: run.into(),
        well: well.into(),
        condition: WellCondition::of(&planned),
        is_refused: false,
        flags: Vec::new(),
        saturated: false,
        numbers,
        references: [const { None }; QUANTITIES.len()],
    }
}

fn of(samples: &[Sample], flagged: Flagged) -> Statistics {
    Statistics::of_samples(samples, vec!["r1".into(), "r2".into()], vec!["simulated".into()], flagged)
}

fn dmso() -> serde_json::Value {
    serde_json::json!({"compound": "DMSO", "control": "negative", "concentration": 0.1, "concentration_unit": "%"})
}

fn dose(concentration: f64) -> serde_json::Value {
    serde_json::json!({"compound": "x", "concentration": concentration, "concentration_unit": "uM"})
}

fn plate() -> Vec<Sample> {
    let kill = serde_json::json!({"compound": "y", "control": "positive"});
    let mut samples = vec![
        sample("r1", "A01", &dmso(), 100.0),
        sample("r1", "A02", &dmso(), 102.0),
        sample("r1", "A03", &kill, 10.0),
        sample("r1", "A04", &kill, 12.0),
        sample("r2", "A01", &dmso(), 104.0),
    ];
    let truth = |c: f64| 100.0 - 60.0 / (1.0 + 3.0 / c);
    for (i, c) in [0.3, 1.0, 3.0, 10.0, 30.0].into_iter().enumerate() {
        samples.push(sample("r1", &format!("B{:02}", 2 * i + 1), &dose(c), truth(c) + 0.5));
        samples.push(sample("r2", &format!("B{:02}", 2 * i + 2), &dose(c), truth(c) - 0.5));
    }
    samples
}

#[test]
fn wells_that_were_treated_alike_are_one_group_and_a_compound_is_one_over_its_doses() {
    let found = of(&plate(), Flagged::Included);
    let volume = &found.quantities[0];
    assert_eq!((volume.name.as_str(), volume.unit.as_str(), found.quantities.len()), ("volume_um3", "um^3", 1));
    let words: Vec<(String, usize)> = volume.groups.iter().map(|g| (g.condition.words(), g.n)).collect();
    let doses = ["0.3", "1", "3", "10", "30"].map(|c| (format!("x {c} uM"), 2));
    assert_eq!(words[1..6], doses);
    assert_eq!([&words[0], &words[6]], [&("negative control: DMSO 0.1 %".to_owned(), 3), &("positive control: y".to_owned(), 2)]);
    let negative = &volume.groups[0];
    assert_eq!((negative.mean, negative.median, negative.mad), (102.0, 102.0, 2.0));
    assert!((negative.sd.unwrap() - 2.0).abs() < 1e-12);
    assert_eq!((volume.compounds[1].condition.words().as_str(), volume.compounds[1].n), ("x", 10));
}

#[test]
fn z_prime_belongs_to_a_plate_and_a_plate_without_enough_controls_has_a_reason() {
    let found = of(&plate(), Flagged::Included);
    let [first, second] = &found.quantities[0].windows[..] else { panic!("{:?}", found.quantities[0].windows) };
    // Means 101 and 11, both with a standard deviation of the root of 2.
    let expected = 1.0 - 6.0 * 2f64.sqrt() / 90.0;
    assert!((first.z_prime.unwrap() - expected).abs() < 1e-12, "{first:?}");
    assert_eq!((second.z_prime, second.positive, second.negative), (None, 0, 1));
    assert!(second.reason.as_ref().unwrap().contains("0 positive and 1 negative"), "{second:?}");
}

#[test]
fn controls_that_were_not_treated_alike_have_no_z_prime_and_their_wells_are_named() {
    let window = |change: &dyn Fn(&mut Sample)| {
        let mut samples = plate();
        samples.iter_mut().for_each(change);
        of(&samples, Flagged::Included).quantities[0].windows[0].clone()
    };
    assert!(window(&|_| ()).z_prime.is_some());
    let other_dose = window(&|s| {
        if s.well == "A02" {
            s.condition.concentration = Some(1.0);
        }
    });
    let why = other_dose.reason.unwrap();
    assert!(other_dose.z_prime.is_none() && why.contains("negative") && why.contains("A01") && why.contains("A02"), "{why}");
    let other_age = window(&|s| {
        if s.condition.control.as_deref() == Some("positive") {
            s.condition.dpf = Some(5.0);
        }
    });
    let why = other_age.reason.unwrap();
    assert!(other_age.z_prime.is_none() && why.contains("other larvae") && why.contains("5 dpf"), "{why}");
}

#[test]
fn a_response_starts_from_the_negative_controls_and_finds_the_ec50_of_its_wells() {
    let found = of(&plate(), Flagged::Included);
    let [response] = &found.quantities[0].responses[..] else { panic!("one compound has several doses") };
    assert_eq!((response.points.len(), response.points[0].dose, response.points[2].value), (13, 0.0, 104.0));
    let curve = response.curve.as_ref().unwrap_or_else(|| panic!("{response:?}"));
    assert!(curve.ec50_interval_95.contains(3.0), "{curve:?}");
    let near = curve.line.iter().min_by(|a, b| (a.dose - 3.0).abs().total_cmp(&(b.dose - 3.0).abs())).unwrap();
    assert!((near.value - 70.0).abs() < 2.0 && near.interval_95.contains(near.value) && curve.ec50_is_within_doses, "{curve:?}");
    let [least, most] = [&response.points[3], response.points.last().unwrap()].map(|p| p.dose);
    assert!(curve.line.len() == 61 && (curve.line[0].dose / least - 1.0).abs() + (curve.line[60].dose / most - 1.0).abs() < 1e-12);
    // Larvae of another age, or with another treatment, are no zero dose of these.
    let changes: [fn(&mut Sample); 2] = [|s| s.condition.dpf = Some(5.0), |s| s.condition.treatment = Some("in the dark".into())];
    for change in changes {
        let mut samples = plate();
        samples.iter_mut().filter(|s| s.condition.control.is_some()).for_each(change);
        assert_eq!(of(&samples, Flagged::Included).quantities[0].responses[0].points.len(), 10);
    }
}

#[test]
fn the_words_of_what_is_left_out_count_each_well_once_and_name_the_person_first() {
    let mut samples = plate();
    samples[0].flags = vec![Flag::Moved.into(), Flag::Excluded.into()];
    samples[1].flags = vec![Flag::Moved.into(), Flag::OutsideBox.into(), Flag::ClippedLeft.into()];
    samples[2].flags = vec![Flag::Residual.into(), Flag::Moved.into()];
    samples[3].flags = vec![Flag::Moved.into()];
    let words = |samples: &[Sample], flagged| of(samples, flagged).quantities[0].left_out_words();
    assert_eq!(
        words(&samples, Flagged::Sound).unwrap(),
        "4 of 15 wells are left out: 1 by a person, 1 because its number is a bound (clipped_left, outside_box), \
         2 because their numbers are doubtful (moved, residual)"
    );
    assert_eq!(words(&samples, Flagged::Included).unwrap(), "1 of 15 wells is left out: 1 by a person");
    samples[3].is_refused = true;
    assert_eq!(words(&samples, Flagged::Included).unwrap(), "2 of 15 wells are left out: 1 by a person, 1 because it did not succeed");
    samples[3].is_refused = false;
    samples[4].flags = vec![Flag::BeadGate.into()];
    let on_request = words(&samples, Flagged::Excluded).unwrap();
    assert!(on_request.starts_with("5 of 15") && on_request.ends_with(", 1 because it has a flag (bead_gate)"), "{on_request}");
}

#[test]
fn a_bound_and_a_doubtful_number_are_left_out_by_name_and_all_or_none_of_the_flagged_count_on_request() {
    let mut samples = plate();
    // A01 and A02 of r1 and A01 of r2 are negative controls.
    samples[0].flags = vec![Flag::ClippedLeft.into(), Flag::DeadLooking.into()];
    samples[1].flags = vec![Flag::DeadLooking.into()];
    samples[4].flags = vec![Flag::Moved.into()];
    samples[4].saturated = true;
    let negative = |s: &Statistics| (s.quantities[0].groups[0].n, s.quantities[0].groups[0].left_out);
    let sound = of(&samples, Flagged::Sound);
    assert_eq!((sound.specimens, sound.specimens_with_flags), (15, 3));
    assert_eq!(negative(&sound), (1, 2));
    let left_out: Vec<_> = sound.quantities[0].left_out.iter().map(|w| (w.run.as_str(), w.well.as_str(), w.flags.join(" "))).collect();
    assert_eq!(left_out, [("r1", "A01", "clipped_left".to_owned()), ("r2", "A01", "moved".to_owned())]);
    assert_eq!(
        sound.quantities[0].left_out_words().unwrap(),
        "2 of 15 wells are left out: 1 because its number is a bound (clipped_left), 1 because its number is doubtful (moved)"
    );
    let response = |s: &Statistics| s.quantities[0].responses[0].points.len();
    assert_eq!((response(&sound), sound.quantities[0].windows[0].negative), (11, 1), "neither Z' nor a curve contains them");
    let all = of(&samples, Flagged::Included);
    assert_eq!((negative(&all), all.quantities[0].left_out_words(), response(&all)), ((3, 0), None, 13));
    assert!(of(&samples, Flagged::Excluded).quantities[0].groups.iter().all(|g| g.condition.control.as_deref() != Some("negative")));
    // A flag of another version, and a second camera that is saturated: only its signal is a bound.
    samples[4].flags = vec![];
    assert_eq!(negative(&of(&samples, Flagged::Sound)), (2, 1));
    let signal = QUANTITIES.iter().position(|(name, ..)| *name == SIGNAL).unwrap();
    samples[4].numbers[signal] = Some(7.0);
    assert_eq!(of(&samples, Flagged::Sound).quantities[1].left_out[0].flags, ["saturated"]);
    samples[4].flags = vec![StoredFlag::Unknown("blur_mismatch".into())];
    assert_eq!(negative(&of(&samples, Flagged::Sound)), (2, 1));
}

#[test]
fn a_group_has_the_references_of_its_first_well_that_has_some() {
    let mut samples = plate();
    let reference = GroupReference { group: "fixed, 3 dpf".into(), n: 12, interval_95: [90.0, 110.0].into() };
    samples[1].references[0] = Some(reference.clone());
    let volume = &of(&samples, Flagged::Included).quantities[0];
    assert_eq!(volume.groups[0].reference, Some(reference));
    assert!(volume.groups[1..].iter().all(|group| group.reference.is_none()));
}

#[test]
fn every_statistic_has_a_row_of_its_own() {
    let found = of(&plate(), Flagged::Included);
    let tables = [groups_table(&found), windows_table(&found), responses_table(&found)];
    // 7 groups and 3 compounds; two runs with controls; one response.
    assert_eq!(tables.each_ref().map(|t| t.rows.len()), [10, 2, 1]);
    for table in &tables {
        assert!(table.rows.iter().all(|row| row.len() == table.headings.len()));
    }
    let ec50 = tables[2].headings.iter().position(|h| h.name == "ec50").unwrap();
    assert_eq!(tables[2].rows[0][ec50], Cell::Number(found.quantities[0].responses[0].curve.as_ref().unwrap().ec50));
}
