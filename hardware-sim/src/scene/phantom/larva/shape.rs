//! The drawing of a larva from its side, and its change from 2 to 7 dpf.
//!
//! ```text
//!            __-------- back ________________
//!          /  o        notochord ===========  ----______
//!         (  eye  ..--- gut line --..____ _______________>   s = 0 at the nose, 1 at the tail's end
//!          \___  (    yolk     )________/
//!              jaw\___belly___/
//! ```
//! Heights are in thousandths of the body length, downwards from the line along the tail. At 3 dpf the head is bowed and the yolk is a
//! ball. At 5 dpf the larva is straight and its yolk is nearly used up. At 2 dpf the change between them is continued backwards by a fifth.

use super::super::spline::Spline;

/// Properties of an age: body length, body volume, swim bladder, and the part of the drawing at 3 dpf in
/// its shape.
pub struct Age {
    pub length_um: f64,
    pub volume_um3: f64,
    pub bladder: f64,
    pub youth: f64,
    /// The amount of yolk over that of the drawing. At 6 and 7 dpf the drawing is that of 5 dpf.
    pub yolk_left: f64,
}

impl Age {
    pub const FIRST: u8 = 2;
    pub const LAST: u8 = 7;

    pub fn of(dpf: u8) -> Option<Self> {
        let age = |length_um, volume_um3, bladder, youth, yolk_left| Self { length_um, volume_um3, bladder, youth, yolk_left };
        Some(match dpf {
            2 => age(3000.0, 2.20e8, 0.0, 1.2, 1.0),
            3 => age(3500.0, 2.40e8, 0.0, 1.0, 1.0),
            4 => age(3900.0, 2.66e8, 0.75, 0.5, 1.0),
            5 => age(4100.0, 3.05e8, 1.0, 0.0, 1.0),
            6 => age(4200.0, 3.20e8, 1.1, 0.0, 0.6),
            7 => age(4300.0, 3.40e8, 1.2, 0.0, 0.3),
            _ => return None,
        })
    }
}

/// s; back, centre line, belly and half width at 3 dpf; the same at 5 dpf. The body adds the caps.
const BODY: [(f64, [f64; 4], [f64; 4]); 25] = [
    (0.000, [-19.9, 41.9, 94.2, 47.2], [-13.7, 36.4, 77.7, 43.5]),
    (0.030, [-33.7, 37.8, 95.5, 52.0], [-22.7, 33.7, 83.2, 49.6]),
    (0.055, [-39.2, 32.3, 96.2, 56.9], [-28.2, 30.2, 86.6, 55.6]),
    (0.080, [-48.1, 26.1, 96.9, 59.3], [-33.7, 26.8, 89.3, 59.3]),
    (0.100, [-53.6, 23.4, 96.9, 57.5], [-38.5, 24.7, 90.0, 59.3]),
    (0.118, [-57.7, 22.0, 96.9, 53.2], [-41.9, 23.4, 89.3, 57.5]),
    (0.135, [-60.5, 22.0, 105.2, 52.0], [-44.0, 22.7, 88.7, 55.6]),
    (0.155, [-62.5, 23.4, 120.3, 54.4], [-46.0, 22.7, 91.4, 55.6]),
    (0.180, [-63.9, 25.4, 127.8, 58.1], [-47.4, 23.4, 97.6, 56.2]),
    (0.210, [-63.9, 28.2, 130.6, 61.1], [-48.1, 24.1, 101.7, 56.2]),
    (0.250, [-63.9, 29.6, 131.3, 62.9], [-48.8, 23.4, 103.8, 55.6]),
    (0.290, [-63.2, 28.2, 130.6, 59.9], [-48.8, 20.6, 99.7, 53.2]),
    (0.320, [-62.5, 25.4, 126.5, 54.4], [-48.1, 17.2, 92.8, 49.6]),
    (0.350, [-61.2, 19.9, 113.4, 47.2], [-47.4, 13.1, 83.2, 45.4]),
    (0.380, [-59.8, 14.4, 87.3, 40.5], [-46.0, 8.9, 72.9, 41.1]),
    (0.420, [-58.4, 8.9, 61.9, 35.1], [-44.7, 4.8, 61.2, 36.3]),
    (0.480, [-55.7, 3.4, 55.7, 31.5], [-41.9, 1.4, 52.2, 32.7]),
    (0.540, [-52.9, 0.7, 53.6, 29.0], [-39.2, -0.7, 44.7, 30.2]),
    (0.600, [-50.2, -2.1, 44.0, 26.6], [-36.4, -2.7, 38.5, 27.8]),
    (0.660, [-46.0, -4.1, 30.9, 24.2], [-33.7, -4.1, 33.0, 24.8]),
    (0.740, [-39.2, -6.2, 25.4, 20.6], [-29.6, -5.5, 25.4, 20.6]),
    (0.820, [-30.9, -6.9, 19.2, 15.7], [-24.7, -6.2, 18.6, 15.7]),
    (0.900, [-22.7, -6.9, 12.4, 9.7], [-19.2, -6.9, 11.7, 9.7]),
    (0.960, [-15.8, -6.9, 8.2, 6.0], [-14.4, -7.6, 6.9, 6.0]),
    (1.000, [-12.4, -7.6, -2.1, 4.2], [-11.7, -7.6, -2.7, 4.2]),
];

/// s; gut line and notochord at 3 dpf; the same at 5 dpf.
const INNER: [(f64, [f64; 2], [f64; 2]); 14] = [
    (0.110, [32.3, 4.8], [43.3, 13.1]),
    (0.135, [25.4, -4.8], [36.4, 3.4]),
    (0.160, [12.4, -13.7], [25.4, -5.5]),
    (0.200, [-6.9, -21.3], [8.9, -13.1]),
    (0.250, [-15.1, -21.3], [-0.7, -15.8]),
    (0.300, [-13.1, -19.2], [-0.7, -15.8]),
    (0.350, [-7.6, -16.5], [2.1, -14.4]),
    (0.400, [0.7, -13.7], [6.2, -12.4]),
    (0.500, [11.7, -9.6], [11.7, -9.6]),
    (0.600, [17.2, -6.9], [15.8, -7.6]),
    (0.700, [18.6, -4.8], [15.8, -5.5]),
    (0.800, [14.4, -2.7], [12.4, -4.1]),
    (0.900, [7.6, -3.4], [6.9, -4.1]),
    (0.970, [0.7, -6.2], [0.7, -6.2]),
];

/// The curves of one individual, as functions of s.
#[derive(Debug, Clone)]
pub struct Shape {
    pub centre: Spline,
    /// Distances of back and belly from the centre line, and half the width.
    pub dorsal: Spline,
    pub ventral: Spline,
    pub width: Spline,
    pub gut_line: Spline,
    pub notochord: Spline,
    /// Height half way between back and belly where the body is deepest.
    pub middle: f64,
}

/// Where the body is deepest.
const DEEPEST: f64 = 0.25;

impl Shape {
    /// `vary` returns the variation of the individual on a curve at s, a factor near 1. It is called once per distance: dorsal, ventral,
    /// width.
    pub fn new(youth: f64, vary: &[impl Fn(f64) -> f64; 3]) -> Self {
        let mixed = |a: f64, b: f64| youth * a + (1.0 - youth) * b;
        let body = |of: &dyn Fn(f64, [f64; 4]) -> f64| -> Spline {
            Spline::through(&BODY.map(|(s, young, old)| [s, of(s, std::array::from_fn(|i| mixed(young[i], old[i])))]))
        };
        let inner = |i: usize| Spline::through(&INNER.map(|(s, young, old)| [s, mixed(young[i], old[i])]));
        let centre = body(&|_, [_, centre, ..]| centre);
        let dorsal = body(&|s, [back, centre, ..]| (centre - back) * vary[0](s));
        let ventral = body(&|s, [_, centre, belly, _]| (belly - centre) * vary[1](s));
        Self {
            middle: centre.at(DEEPEST) + (ventral.at(DEEPEST) - dorsal.at(DEEPEST)) / 2.0,
            centre,
            dorsal,
            ventral,
            width: body(&|s, [.., width]| width * vary[2](s)),
            gut_line: inner(0),
            notochord: inner(1),
        }
    }
}
