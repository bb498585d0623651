//! Which references a larva is compared with, and what is said of it.

use super::*;

/// A group that states everything: 24 larvae, volume 2.7e8 +- 1e7 um^3, area 3.3e6 +- 1e5 um^2, no covariance.
pub(super) fn group(name: &str, dpf: f64) -> Group {
    Group {
        name: name.into(),
        dpf,
        treatment: None,
        strain: None,
        cohort: None,
        n: 24,
        asd: Some(21),
        voxel_um: Some(6.93),
        epsilon: Some(0.05),
        estimator: VOXEL.into(),
        simulated: false,
        volume_um3: Some(Moments { mean: 2.7e8, sd: 1e7 }),
        area_um2: Some(Moments { mean: 3.3e6, sd: 1e5 }),
        covariance_um5: None,
        eye_volume_um3: None,
        eye_distance_um: None,
        source: "a test".into(),
    }
}

fn file(groups: Vec<Group>) -> References {
    References { schema: SCHEMA.into(), name: "test".into(), gaps: Vec::new(), groups }
}

fn specimen() -> Specimen {
    let estimates = vec![
        Estimate { estimator: VOXEL, volume_um3: 2.8e8, area_um2: 3.22e6 },
        Estimate { estimator: FIELD, volume_um3: 2.7e8, area_um2: 3.4e6 },
    ];
    let (strain, treatment) = (None, None);
    Specimen {
        dpf: 4.0,
        asd: 21,
        views: 21,
        voxel_um: 6.93,
        epsilon: 0.05,
        simulated: false,
        strain,
        treatment,
        untreated: false,
        estimates,
        eyes: None,
        is_bound: false,
    }
}

fn keys(mismatches: &[Mismatch]) -> Vec<&str> {
    mismatches.iter().map(|m| m.key.as_str()).collect()
}

/// What is missing of the quantity, by the paper's estimator.
fn missing<T: Clone>(answer: &Answer<T>) -> Missing {
    match answer {
        Answer::Missing(missing) => missing.clone(),
        Answer::Known(_) => panic!("there is a reference"),
    }
}

/// A volume that is a lower bound is small among whole larvae whatever the larva's volume is.
#[test]
fn a_larva_of_which_a_part_was_not_measured_is_compared_with_none() {
    let eyes = Some(EyeNumbers { volume_um3: 7e6, distance_um: 230.0 });
    let standing = Standing::of(&Specimen { is_bound: true, eyes, ..specimen() }, &[file(vec![group("a", 4.0)])]);
    assert_eq!((standing.estimates.len(), &standing.eyes, standing.z(VOXEL)), (0, &None, [None, None]));
    let text = serde_json::to_value(&standing).unwrap();
    assert_eq!(text, serde_json::json!({ "dpf": 4.0, "not_compared": "part_unseen", "estimates": [] }));
    assert_eq!(serde_json::from_value::<Standing>(text).unwrap(), standing);
    assert_eq!(Standing::of(&specimen(), &[file(vec![group("a", 4.0)])]).not_compared, None);
}

#[test]
fn a_group_that_matches_in_everything_places_without_a_remark() {
    let standing = Standing::of(&specimen(), &[file(vec![group("a", 4.0)])]);
    let voxel = standing.by(VOXEL).unwrap();
    let (volume, area) = (voxel.volume.known().unwrap(), voxel.area.known().unwrap());
    assert!((volume.z - 1.0).abs() < 1e-12 && (area.z + 0.8).abs() < 1e-9, "{volume:?} {area:?}");
    assert_eq!((keys(&volume.mismatches), keys(&area.mismatches)), (vec![], vec![]));
    assert_eq!(voxel.volume.words(Quantity::Volume, 4.0), "volume 1.0 SD above the mean of 24 larvae of 4 dpf");
    assert_eq!(voxel.area.words(Quantity::Area, 4.0), "area 0.8 SD below the mean of 24 larvae of 4 dpf");
    assert_eq!(missing(&voxel.joint).reason, MissingReason::Quantity, "without a covariance nothing is joint");
    assert!(standing.by(FIELD).is_none(), "an estimator that nobody has references of is not asked for");
}

#[test]
fn each_thing_that_does_not_match_is_said() {
    let other = Group {
        voxel_um: Some(5.5),
        epsilon: None,
        treatment: Some("fixed".into()),
        strain: Some("ABxTL".into()),
        cohort: Some("May".into()),
        simulated: true,
        ..group("a", 4.0)
    };
    let specimen = Specimen { views: 20, ..specimen() };
    let standing = Standing::of(&specimen, &[file(vec![other])]);
    let area = standing.by(VOXEL).unwrap().area.known().unwrap().clone();
    assert_eq!(keys(&area.mismatches), ["views", "voxel_um", "epsilon", "treatment", "strain", "cohort", "mode"]);
    let said: Vec<_> = area.mismatches.iter().map(ToString::to_string).collect();
    assert_eq!(said[1], "voxel edge: 6.93 um, the reference's 5.5 um");
    assert_eq!(said[2], "epsilon: 0.05, the reference's not stated");
    assert_eq!(said[3], "treatment: not known, the reference's fixed");
}

#[test]
fn another_asd_is_not_compared_and_an_unstated_one_says_so() {
    let with = |asd| Group { asd, ..group(&format!("{asd:?}"), 4.0) };
    let standing = Standing::of(&specimen(), &[file(vec![with(Some(84)), with(Some(7))])]);
    let area = &standing.by(VOXEL).unwrap().area;
    let why = missing(area);
    assert_eq!((why.reason, why.there_are), (MissingReason::Asd, vec![7.0, 84.0]));
    assert_eq!(area.words(Quantity::Area, 4.0), "area: no reference larvae with as many views (there are: 7, 84 views)");

    let standing = Standing::of(&specimen(), &[file(vec![with(Some(84)), with(None)])]);
    let area = &standing.by(VOXEL).unwrap().area;
    assert_eq!(keys(&area.known().unwrap().mismatches), ["asd"]);
    let words =
        "area: no reference larvae with as many views; 0.8 SD below the mean of 24 larvae of 4 dpf whose number of views is not stated";
    assert_eq!(area.words(Quantity::Area, 4.0), words);
}

#[test]
fn the_best_group_is_that_of_the_asd_then_that_with_fewest_mismatches_then_the_largest() {
    let found = |groups| Standing::of(&specimen(), &[file(groups)]).by(VOXEL).unwrap().area.known().unwrap().group.clone();
    let no_asd = || Group { asd: None, ..group("no ASD", 4.0) };
    let fixed = || Group { treatment: Some("fixed".into()), voxel_um: None, ..group("fixed", 4.0) };
    let few = || Group { n: 3, ..group("few", 4.0) };
    assert_eq!(found(vec![no_asd(), fixed(), few(), group("all", 4.0)]), "all");
    assert_eq!(found(vec![no_asd(), fixed(), few()]), "few");
    assert_eq!(found(vec![no_asd(), fixed()]), "fixed");
    assert_eq!(found(vec![no_asd()]), "no ASD");
}

#[test]
fn what_is_missing_is_named_by_the_first_question_that_nothing_answers() {
    let ask = |references: &[References]| Standing::of(&specimen(), references).by(VOXEL).unwrap().volume.clone();
    let why = missing(&ask(&[]));
    assert_eq!((why.reason, why.there_are.len()), (MissingReason::Age, 0));
    let why = ask(&[file(vec![group("a", 5.0), group("b", 3.0), group("c", 4.2)])]);
    assert_eq!(missing(&why).there_are, [3.0, 4.2, 5.0]);
    assert_eq!(why.words(Quantity::Volume, 4.0), "volume: no reference of 4 dpf (there are: 3, 4.2, 5)");
    let why = missing(&ask(&[file(vec![Group { estimator: FIELD.into(), ..group("a", 4.0) }])]));
    assert_eq!(why.reason, MissingReason::Estimator);
    let gap = |quantity, dpf| Gap { quantity, dpf, why: format!("{quantity} {dpf:?}") };
    let gaps = vec![gap(Quantity::Volume, None), gap(Quantity::Volume, None), gap(Quantity::Volume, Some(5.0)), gap(Quantity::Area, None)];
    let why = ask(&[References { gaps, ..file(vec![Group { volume_um3: None, ..group("a", 4.1) }]) }]);
    assert_eq!(missing(&why).reason, MissingReason::Quantity);
    assert_eq!(missing(&why).why, ["volume None"], "the reference's own words, of this quantity and age");
    assert_eq!(why.words(Quantity::Volume, 4.0), "volume: no reference of 4 dpf");
}

#[test]
fn estimators_are_looked_up_by_name() {
    let field = Group { estimator: FIELD.into(), ..group("f", 4.0) };
    let standing = Standing::of(&specimen(), &[file(vec![group("v", 4.0), field])]);
    assert_eq!(standing.estimates.iter().map(|e| e.estimator.as_str()).collect::<Vec<_>>(), [VOXEL, FIELD]);
    let field = standing.by(FIELD).unwrap();
    assert_eq!(field.area.known().unwrap().group, "f");
    assert!((field.area.known().unwrap().z - 1.0).abs() < 1e-9);
}

// The paper's fixed larvae at ASD 21. python3 -c "import numpy as np; from scipy.stats import t
// for x in (3.40, 3.55):
//     d = np.array([t.pdf((x-m)/(s*(1+1/n)**.5), n-1)/(s*(1+1/n)**.5) for m, s, n in [(3.20,.15,12), (3.34,.17,24), (3.63,.14,24)]])
//     print(d/d.sum())"
#[test]
fn ages_are_as_probable_as_their_densities_say() {
    let age = |dpf, n, mean, sd| {
        let area = Some(Moments { mean: mean * 1e6, sd: sd * 1e6 });
        Group { n, volume_um3: None, area_um2: area, ..group(&format!("{dpf}"), dpf) }
    };
    // Out of order, and with a single group that matches less: the series of three is asked.
    let lone = Group { asd: None, ..age(2.0, 9, 3.4, 0.1) };
    let references = file(vec![age(5.0, 24, 3.63, 0.14), lone, age(3.0, 12, 3.20, 0.15), age(4.0, 24, 3.34, 0.17)]);
    let expected = [
        (3.40, [0.271_886_866_984_496_9, 0.535_792_253_161_177_5, 0.192_320_879_854_325_47]),
        (3.55, [0.070_737_606_596_215_2, 0.293_557_577_436_609_4, 0.635_704_815_967_175_4]),
    ];
    for (area, probabilities) in expected {
        let estimates = vec![Estimate { estimator: VOXEL, volume_um3: 1.0, area_um2: area * 1e6 }];
        let standing = Standing::of(&Specimen { estimates, ..specimen() }, std::slice::from_ref(&references));
        let stage = standing.by(VOXEL).unwrap().stage.known().unwrap().clone();
        assert_eq!(stage.by, Quantity::Area);
        assert_eq!(stage.ages.iter().map(|a| a.dpf).collect::<Vec<_>>(), [3.0, 4.0, 5.0]);
        for (found, wanted) in stage.ages.iter().zip(probabilities) {
            assert!((found.probability - wanted).abs() < 1e-9, "{found:?} is not {wanted}");
        }
    }
}

#[test]
fn ages_of_different_kinds_make_no_series_and_both_quantities_are_better_than_one() {
    let stage = |groups| Standing::of(&specimen(), &[file(groups)]).by(VOXEL).unwrap().stage.clone();
    let fixed = Group { treatment: Some("fixed".into()), ..group("fixed", 3.0) };
    assert!(stage(vec![fixed, group("a", 4.0)]).known().is_none());
    let both = |dpf: f64| Group { covariance_um5: Some(5e11), ..group(&format!("{dpf}"), dpf) };
    let found = stage(vec![both(3.0), both(4.0)]);
    let found = found.known().unwrap();
    assert_eq!(found.by, Quantity::Joint);
    assert!(found.ages.iter().all(|a| (a.probability - 0.5).abs() < 1e-12), "the same numbers are equally probable: {found:?}");
    assert_eq!(stage(vec![group("a", 3.0), group("b", 4.0)]).known().unwrap().by, Quantity::Area);
}

/// Far from every age the densities are smaller than a float can hold, and their shares are still shares.
#[test]
fn a_larva_far_from_every_age_has_an_age_all_the_same() {
    let age = |dpf: f64, mean| Group { n: 5000, area_um2: Some(Moments { mean, sd: 1e5 }), ..group(&format!("{dpf}"), dpf) };
    let estimates = vec![Estimate { estimator: VOXEL, volume_um3: 1.0, area_um2: 9e6 }];
    let standing = Standing::of(&Specimen { estimates, ..specimen() }, &[file(vec![age(3.0, 3.2e6), age(5.0, 3.6e6)])]);
    let stage = standing.by(VOXEL).unwrap().stage.known().unwrap().clone();
    assert!(stage.ages[1].probability > 0.999, "{stage:?}");
}

#[test]
fn a_standing_survives_being_written_down() {
    let both = Group { covariance_um5: Some(5e11), treatment: Some("fixed".into()), ..group("a", 4.0) };
    let standing = Standing::of(&specimen(), &[file(vec![both])]);
    let text = serde_json::to_string(&standing).unwrap();
    assert_eq!(serde_json::from_str::<Standing>(&text).unwrap(), standing);
    assert!(text.contains(r#""key":"treatment","specimen":null,"reference":"fixed""#), "{text}");
}

fn control(volume_um3: f64, area_um2: f64) -> Control {
    Control {
        dpf: 4.0,
        treatment: None,
        strain: None,
        cohort: None,
        asd: Some(21),
        voxel_um: Some(6.93),
        epsilon: Some(0.05),
        estimator: VOXEL.into(),
        simulated: false,
        volume_um3: Some(volume_um3),
        area_um2: Some(area_um2),
        eye_volume_um3: None,
        eye_distance_um: None,
    }
}

fn controls() -> Vec<Control> {
    vec![control(2.5e8, 3.2e6), control(2.7e8, 3.3e6), control(2.6e8, 3.35e6), control(2.9e8, 3.5e6)]
}

// numpy.std(ddof=1) and numpy.cov of the four controls.
#[test]
fn controls_give_their_mean_spread_and_covariance() {
    let Summaries { groups, refusals, warnings } = summarise(&controls(), "lab");
    assert_eq!((groups.len(), refusals.len(), warnings.len()), (1, 0, 0));
    let g = &groups[0];
    assert_eq!(g.name, "4 dpf, ASD 21, SD 6.93 um, epsilon 0.05, voxel");
    assert_eq!((g.n, g.asd, g.source.as_str()), (4, Some(21), "lab"));
    let close = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9 * wanted, "{found} is not {wanted}");
    close(g.volume_um3.unwrap().mean, 267.5e6);
    close(g.volume_um3.unwrap().sd, 17_078_251.276_599_333);
    close(g.area_um2.unwrap().mean, 3_337_500.0);
    close(g.area_um2.unwrap().sd, 125_000.0);
    close(g.covariance_um5.unwrap(), 1_958_333_333_333.333_3);
    assert_eq!(file(groups).check(), []);
}

#[test]
fn what_was_measured_differently_is_kept_apart_with_a_warning() {
    let mut all = controls();
    all.extend(controls().into_iter().map(|c| Control { asd: Some(84), ..c }));
    all.extend(controls().into_iter().map(|c| Control { treatment: Some("fixed".into()), ..c }));
    let Summaries { groups, refusals, warnings } = summarise(&all, "lab");
    assert_eq!((groups.len(), refusals.len()), (3, 0));
    assert_eq!(warnings, ["4 dpf: ASD is mixed (21, 84); these are kept apart"], "treatments are no mixture");
    for (what, change) in [
        ("SD (voxel_um)", (|c| Control { voxel_um: Some(5.5), ..c }) as fn(Control) -> Control),
        ("epsilon", |c| Control { epsilon: None, ..c }),
        ("mode", |c| Control { simulated: true, ..c }),
    ] {
        let mut all = controls();
        all.extend(controls().into_iter().map(change));
        let warnings = summarise(&all, "lab").warnings;
        assert!(warnings.len() == 1 && warnings[0].contains(what), "{what}: {warnings:?}");
    }
    let fields = || controls().into_iter().map(|c| Control { estimator: FIELD.into(), ..c });
    let with = |n| summarise(&controls().into_iter().chain(fields().take(n)).collect::<Vec<_>>(), "lab").warnings;
    assert!(with(4).is_empty(), "every larva has both numbers");
    assert_eq!(with(3), ["4 dpf: estimator is mixed (field, voxel); these are kept apart"]);
}

#[test]
fn controls_that_make_no_group_are_refused_with_the_reason() {
    let mut all = controls();
    all.extend(controls().into_iter().take(2).map(|c| Control { dpf: 5.0, ..c }));
    all.extend(controls().into_iter().map(|c| Control { dpf: 3.0, volume_um3: Some(1e8), ..c }));
    let mut uneven = controls();
    uneven[1].area_um2 = None;
    all.extend(uneven.into_iter().map(|c| Control { dpf: 6.0, ..c }));
    let Summaries { groups, refusals, .. } = summarise(&all, "lab");
    assert_eq!(groups.len(), 1);
    let said: Vec<_> = refusals.iter().map(ToString::to_string).collect();
    assert!(said[0].starts_with("3 dpf") && said[0].contains("volume_um3 is the same number 4 times"), "{said:?}");
    assert!(said[1].starts_with("5 dpf") && said[1].contains("2 larva(e)"), "{said:?}");
    assert!(said[2].starts_with("6 dpf") && said[2].contains("3 of 4 larvae have area_um2"), "{said:?}");
}

/// What the plate map says of a larva is known: the same word is no mismatch, another is told with both.
#[test]
fn strain_and_treatment_of_the_plate_map_are_held_against_the_references() {
    let references = Group { strain: Some("ABxTL".into()), treatment: Some("none".into()), ..group("a", 4.0) };
    let mismatches = |strain: Option<&str>, treatment: Option<&str>| {
        let (strain, treatment) = (strain.map(str::to_owned), treatment.map(str::to_owned));
        let standing = Standing::of(&Specimen { strain, treatment, ..specimen() }, &[file(vec![references.clone()])]);
        standing.by(VOXEL).unwrap().volume.known().unwrap().mismatches.clone()
    };
    assert_eq!(keys(&mismatches(Some("abxtl "), Some("None"))), [""; 0]);
    let differ = mismatches(Some("nacre"), None);
    assert_eq!(keys(&differ), ["treatment", "strain"]);
    assert_eq!((&differ[0].specimen, &differ[1].specimen), (&None, &Some(Known::Word("nacre".into()))));
}

/// `living` references are those to which nothing was done: an untreated larva differs from them in nothing, whatever its own word is.
#[test]
fn an_untreated_larva_matches_living_references_and_not_fixed_ones() {
    let mismatches = |treatment: &str, untreated: bool, reference: &str| {
        let references = Group { treatment: Some(reference.into()), ..group("a", 4.0) };
        let larva = Specimen { treatment: Some(treatment.into()), untreated, ..specimen() };
        let standing = Standing::of(&larva, &[file(vec![references])]);
        standing.by(VOXEL).unwrap().volume.known().unwrap().mismatches.clone()
    };
    for (treatment, reference) in [("none", "living"), ("untreated", "None"), ("immersion from 3 dpf", "living")] {
        assert_eq!(keys(&mismatches(treatment, true, reference)), [""; 0], "{treatment}, {reference}");
    }
    assert_eq!(keys(&mismatches("none", true, "fixed")), ["treatment"]);
    assert_eq!(keys(&mismatches("immersion from 3 dpf", false, "living")), ["treatment"]);
}

#[test]
fn the_eyes_are_compared_with_references_that_have_eyes() {
    let eyes = Some(EyeNumbers { volume_um3: 8e6, distance_um: 340.0 });
    let with = Specimen { eyes, ..specimen() };
    let old = Standing::of(&with, &[file(vec![group("old", 4.0)])]).eyes.unwrap();
    assert_eq!(old.volume.words(Quantity::EyeVolume, 4.0), "eye volume: no reference of the eyes of 4 dpf");
    let moments = |mean, sd| Some(Moments { mean, sd });
    let own = Group {
        estimator: EYES.into(),
        volume_um3: None,
        area_um2: None,
        eye_volume_um3: moments(7e6, 5e5),
        eye_distance_um: moments(350.0, 10.0),
        ..group("eyes", 4.0)
    };
    let references = [file(vec![group("old", 4.0), own])];
    assert_eq!(references[0].check(), []);
    let found = Standing::of(&with, &references);
    let place = |answer: &Answer<Place>| answer.known().map(|place| (place.z, place.group.clone()));
    let eyes = found.eyes.as_ref().unwrap();
    assert_eq!(place(&eyes.volume), Some((2.0, "eyes".into())));
    assert_eq!(place(&eyes.distance), Some((-1.0, "eyes".into())));
    assert!(found.by(VOXEL).unwrap().volume.known().is_some(), "the volume has its own group");
    assert!(found.estimates.iter().all(|estimate| estimate.estimator != EYES));
    assert_eq!(Standing::of(&specimen(), &references).eyes, None, "no eye was found");
}

#[test]
fn controls_give_references_of_eyes_also_where_some_larvae_have_none() {
    let mut all = controls();
    let larvae = all.len();
    for (i, larva) in controls().into_iter().take(larvae - 1).enumerate() {
        let (volume_um3, area_um2) = (None, None);
        let (eye_volume_um3, eye_distance_um) = (Some(8e6 + i as f64 * 1e5), Some(340.0 + i as f64));
        all.push(Control { estimator: EYES.into(), volume_um3, area_um2, eye_volume_um3, eye_distance_um, ..larva });
    }
    let Summaries { groups, refusals, warnings } = summarise(&all, "own");
    assert_eq!((groups.len(), refusals.len(), warnings.len()), (2, 0, 0), "{refusals:?} {warnings:?}");
    let eyes = groups.iter().find(|group| group.estimator == EYES).unwrap();
    assert_eq!(eyes.n as usize, larvae - 1);
    assert!(eyes.volume_um3.is_none() && eyes.eye_volume_um3.is_some() && eyes.eye_distance_um.is_some());
}
