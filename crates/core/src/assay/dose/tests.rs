use super::*;
use std::f64::consts::TAU;

/// Values of tests/oracles/assay.py.
const FALLING: [(f64, [f64; 3]); 7] = [
    (0.0, [3.1384e8, 2.9859e8, 3.1546e8]),
    (0.1, [3.0610e8, 3.2128e8, 2.9918e8]),
    (0.3, [3.1204e8, 2.8820e8, 3.0559e8]),
    (1.0, [2.7850e8, 2.9383e8, 3.0031e8]),
    (3.0, [2.3211e8, 2.4520e8, 2.4752e8]),
    (10.0, [2.1089e8, 2.0228e8, 1.9539e8]),
    (30.0, [1.9421e8, 2.0342e8, 1.8902e8]),
];

fn falling() -> Vec<[f64; 2]> {
    FALLING.iter().flat_map(|(dose, values)| values.map(|y| [*dose, y])).collect()
}

/// Doses, and what scipy's curve has there with its standard deviation.
const FALLING_AT: [(f64, [f64; 2]); 4] = [
    (0.0, [307_885_663.090_146_7, 3_355_069.655_491_938_3]),
    (0.5, [302_065_263.506_616_2, 3_120_260.416_254_446]),
    (2.5, [251_228_305.110_440_2, 4_731_901.754_358_321]),
    (30.0, [195_489_778.212_862_8, 4_525_444.967_790_989]),
];

const RISING: [[f64; 2]; 8] = [[1.0, 10.2], [2.0, 10.9], [4.0, 14.1], [8.0, 22.8], [16.0, 33.9], [32.0, 38.6], [64.0, 40.3], [128.0, 39.7]];

/// scipy takes its derivatives by differences: with a step of 1.5e-8 of the value they are right to some 1e-6.
fn near(found: f64, wanted: f64) {
    assert!((found - wanted).abs() <= 1e-5 * wanted.abs(), "{found} is not {wanted}");
}

fn is(found: Parameter, [value, sd]: [f64; 2], t: f64) {
    near(found.value, value);
    near(found.sd, sd);
    near(found.interval_95[1] - found.interval_95[0], 2.0 * t * sd);
}

#[test]
fn a_falling_response_has_the_curve_and_the_intervals_of_scipy() {
    let fit = DoseResponse::fit(&falling()).unwrap();
    let t = 2.109_815_577_833_315_6;
    is(fit.at_zero, [307_885_663.090_146_7, 3_355_069.655_491_938_3], t);
    is(fit.at_infinity, [194_231_082.395_668_72, 5_321_471.122_824_905], t);
    is(fit.log10_ec50, [0.399_374_942_801_14, 0.051_888_699_832_918_515], t);
    is(fit.hill, [1.810_100_948_850_737_4, 0.371_596_557_193_850_26], t);
    near(fit.residual_sd, 9_080_702.279_346_047);
    near(fit.p_no_effect, 3.797_537_017_020_879_3e-13);
    near(fit.ec50, 10f64.powf(0.399_374_942_801_14));
    near(fit.ec50_interval_95[1].log10(), 0.399_374_942_801_14 + t * 0.051_888_699_832_918_515);
    assert_eq!((fit.n, fit.doses, fit.ec50_is_within_doses), (21, 7, true));
    near(fit.at(fit.ec50).unwrap().value, f64::midpoint(fit.at_zero.value, fit.at_infinity.value));
    for (dose, of_scipy) in FALLING_AT {
        is(fit.at(dose).unwrap(), of_scipy, t);
    }
    is(fit.at(1e9).unwrap(), [fit.at_infinity.value, fit.at_infinity.sd], t);
}

#[test]
fn a_rising_response_without_a_dose_of_0_has_the_curve_of_scipy() {
    let fit = DoseResponse::fit(&RISING).unwrap();
    let t = 2.776_445_105_197_793_4;
    is(fit.at_zero, [10.081_223_547_098_37, 0.269_076_133_914_480_6], t);
    is(fit.at_infinity, [40.166_218_105_373_986, 0.228_199_329_230_709_4], t);
    is(fit.log10_ec50, [0.958_159_709_203_865_4, 0.008_427_426_918_784_488], t);
    is(fit.hill, [2.336_184_803_263_056_8, 0.097_162_711_551_623], t);
    near(fit.p_no_effect, 2.038_227_244_842_592_3e-7);
}

/// The order of the points and the unit of the response change nothing.
#[test]
fn the_curve_depends_on_the_values_alone() {
    let mut points = falling();
    let first = DoseResponse::fit(&points).unwrap();
    points.reverse();
    for point in &mut points {
        point[1] /= 1e9;
    }
    let second = DoseResponse::fit(&points).unwrap();
    near(second.ec50, first.ec50);
    near(second.at_zero.value * 1e9, first.at_zero.value);
}

/// Normal numbers from a counter (splitmix64, Box and Muller).
fn normal(seed: u64) -> f64 {
    let uniform = |seed: u64| {
        let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    (-2.0 * (1.0 - uniform(2 * seed + 1)).ln()).sqrt() * (TAU * uniform(2 * seed + 2)).cos()
}

/// 400 plates with a known EC50 of 2.5, three wells per dose and a scatter of 4 %. Of so many intervals of 95 %, 380 contain it, with a
/// standard deviation of 4.4; three of them to either side.
#[test]
fn the_intervals_contain_a_known_ec50_as_often_as_they_say() {
    let truth = Vector4::new(3.1e8, 1.9e8, 2.5f64.ln(), 1.4f64.ln());
    let mut inside = 0;
    for plate in 0..400u64 {
        let well = |i: u64| {
            let dose = [0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0][i as usize / 3];
            [dose, value(dose, &truth) + 1e7 * normal(1000 * plate + i)]
        };
        let fit = DoseResponse::fit(&(0..21).map(well).collect::<Vec<_>>()).unwrap();
        inside += usize::from((fit.ec50_interval_95[0]..=fit.ec50_interval_95[1]).contains(&2.5));
    }
    assert!((366..=394).contains(&inside), "{inside} of 400");
}

/// Values without an effect are refused, but for the share that the F test lets pass.
#[test]
fn noise_is_no_response() {
    let noise = |seed: u64| {
        (0..21u64).map(|i| [[0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0][i as usize / 3], normal(1000 * seed + i)]).collect::<Vec<_>>()
    };
    let refused = (0..100).filter(|&seed| matches!(DoseResponse::fit(&noise(seed)), Err(DoseRefusal::NoEffect { p }) if p > 0.05)).count();
    assert!(refused >= 80, "{refused} of 100 plates without an effect are refused");
}

#[test]
fn points_that_determine_no_curve_are_refused_with_the_reason() {
    let fit = |points: &[[f64; 2]]| DoseResponse::fit(points).unwrap_err();
    assert_eq!(fit(&RISING[..4]), DoseRefusal::FewValues { values: 4 });
    let two = [[0.0, 1.0], [0.0, 1.1], [1.0, 2.0], [1.0, 2.1], [2.0, 3.0]];
    assert_eq!(fit(&two), DoseRefusal::FewDoses { doses: 3, above_zero: 2 });
    assert_eq!(fit(&[[-1.0, 2.0]]), DoseRefusal::NotFinite { dose: -1.0, response: 2.0 });
    let flat: Vec<[f64; 2]> = RISING.iter().map(|&[dose, _]| [dose, 7.0]).collect();
    assert_eq!(fit(&flat), DoseRefusal::NoEffect { p: 1.0 });
    // A step between two doses has no slope.
    let step: Vec<[f64; 2]> =
        RISING.iter().enumerate().map(|(i, &[dose, _])| [dose, if i < 4 { 1.0 } else { 2.0 } + 0.01 * normal(i as u64)]).collect();
    let refusal = fit(&step);
    assert!(matches!(refusal, DoseRefusal::NoSlope { .. } | DoseRefusal::Undetermined), "{refusal:?}");
}
