//! Frames as a VAST BioImager takes and stores them, drawn instead of listed.
//!
//! ```text
//!   frames      48 larvae: 2 to 7 dpf, all sides, a quarter from above or below, filling 85 to 97 % of the bore
//!   detection   500 labelled frames: empty, larva, clipped larva, dead larva, bead, two larvae, bubble, debris
//! ```
//! All are 1024 x 200 px with a bore of 112 px, with the dust, light, walls and larvae of real frames.

use super::item::Kind;
use super::recipe::{Along, Lies, Recipe};
use super::{Class, Difficulty};
use crate::scene::Placement;
use crate::scene::seeded::{Seeded, mixed};

/// Larvae in the list for segmentation.
const FRAMES: u32 = 48;
/// Diameter of the bore if it does not follow from the specimen, um.
const BORE_UM: f64 = 604.8;

pub fn frames(seed: u64) -> Vec<Recipe> {
    (0..FRAMES)
        .map(|i| {
            let mut draw = stream(seed, u64::from(i));
            // Ages and views do not repeat together.
            larva(&format!("vast_{i:02}"), 2 + (i % 6) as u8, View::of(i + i / 6), &mut draw)
        })
        .map(finished)
        .collect()
}

/// Number of labelled frames of each class. Together they are 500.
const DETECTION: [(Class, u32); 7] = [
    (Class::Empty, 80),
    (Class::Larva, 170),
    (Class::DeadLarva, 50),
    (Class::Bead, 50),
    (Class::TwoLarvae, 50),
    (Class::Bubble, 50),
    (Class::Debris, 50),
];
/// Of 17 larvae this many leave the image.
const CLIPPED: u32 = 5;

pub fn detection(seed: u64) -> Vec<Recipe> {
    let of = |(class, count): (Class, u32)| {
        (0..count).map(move |i| {
            let mut draw = stream(mixed(seed ^ class as u64), u64::from(i));
            match class {
                Class::Empty => Recipe::empty(format!("empty_{i:03}")).bore(BORE_UM),
                Class::Larva if i % 17 < CLIPPED => clipped(i, &mut draw),
                Class::Larva => larva(&format!("larva_{i:03}"), 2 + (i % 6) as u8, View::of(i), &mut draw),
                Class::DeadLarva => dead(i, &mut draw),
                Class::Bead => bead(i, &mut draw),
                Class::TwoLarvae => two(i, &mut draw),
                Class::Bubble => bubble(i, &mut draw),
                Class::Debris => debris(i, &mut draw),
            }
        })
    };
    DETECTION.into_iter().flat_map(of).map(finished).collect()
}

fn stream(seed: u64, index: u64) -> Seeded {
    Seeded::new(mixed(mixed(seed ^ 0x7A57) ^ index))
}

fn finished(recipe: Recipe) -> Recipe {
    recipe.vast().difficulty(Difficulty::Hard)
}

/// The side from which a larva is seen.
#[derive(Clone, Copy)]
enum View {
    Above,
    Below,
    Side,
    Oblique,
}

impl View {
    /// A quarter from above or below, half from a side, a quarter in between.
    fn of(number: u32) -> Self {
        match number % 8 {
            0 => Self::Above,
            4 => Self::Below,
            2 | 6 => Self::Oblique,
            _ => Self::Side,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Above => "above",
            Self::Below => "below",
            Self::Side => "side",
            Self::Oblique => "oblique",
        }
    }

    fn roll_deg(self, draw: &mut Seeded) -> f64 {
        let off = draw.normal(8.0);
        match self {
            Self::Above => -90.0 + off,
            Self::Below => 90.0 + off,
            // Half of the larvae turn their other side to the camera.
            Self::Side => off + if draw.between(0.0, 1.0) < 0.5 { 0.0 } else { 180.0 },
            Self::Oblique => draw.between(25.0, 65.0) + 90.0 * draw.between(0.0, 4.0).floor(),
        }
    }
}

fn larva(name: &str, dpf: u8, view: View, draw: &mut Seeded) -> Recipe {
    let recipe = Recipe::larva(format!("{name}_{dpf}dpf_{}", view.name()), dpf).roll(view.roll_deg(draw)).x(draw.between(-300.0, 300.0));
    turned(placed(recipe, draw), draw)
}

/// Head to the right in half of the frames.
fn turned(recipe: Recipe, draw: &mut Seeded) -> Recipe {
    if draw.between(0.0, 1.0) < 0.5 { recipe.right() } else { recipe }
}

/// At rest, centred or in between, in a bore that it nearly fills.
fn placed(recipe: Recipe, draw: &mut Seeded) -> Recipe {
    let lies = match draw.between(0.0, 3.0) as u32 {
        0 => Lies::Rests,
        1 => Lies::Moved(draw.between(-0.9, 0.9)),
        _ => Lies::Moved(0.0),
    };
    recipe.lies(lies).fill(draw.between(0.85, 0.97)).tilt(draw.normal(0.15))
}

/// A larva whose head or tail is outside the image.
fn clipped(i: u32, draw: &mut Seeded) -> Recipe {
    let left = i.is_multiple_of(2);
    let side = if left { "left" } else { "right" };
    let x_um = draw.between(2100.0, 3000.0) * if left { -1.0 } else { 1.0 };
    let dpf = 3 + (i % 3) as u8;
    let recipe = Recipe::larva(format!("clipped_{side}_{i:03}_{dpf}dpf"), dpf).roll(View::of(i).roll_deg(draw)).x(x_um);
    turned(placed(recipe, draw), draw)
}

fn dead(i: u32, draw: &mut Seeded) -> Recipe {
    let dpf = 3 + (i % 3) as u8;
    let recipe = Recipe::of(format!("dead_{i:03}_{dpf}dpf"), Class::DeadLarva, Kind::DeadLarva { dpf });
    turned(placed(recipe.roll(draw.between(0.0, 360.0)), draw), draw)
}

fn bead(i: u32, draw: &mut Seeded) -> Recipe {
    let diameter_um = draw.between(250.0, 560.0).round();
    let recipe = Recipe::bead(format!("bead_{i:03}"), diameter_um).bore(BORE_UM).x(draw.between(-1800.0, 1800.0));
    if i.is_multiple_of(2) { recipe.lies(Lies::Rests) } else { recipe }
}

/// Two larvae one behind the other, of which the image shows parts, or side by side in a wider bore.
fn two(i: u32, draw: &mut Seeded) -> Recipe {
    let kind = |draw: &mut Seeded| Kind::Larva { dpf: 3 + draw.between(0.0, 3.0) as u8, fins: true };
    let (first, second) = (kind(draw), kind(draw));
    let turn = |draw: &mut Seeded| draw.between(0.0, std::f64::consts::TAU);
    let in_line = i.is_multiple_of(2);
    let (half_um, y_um) =
        if in_line { (draw.between(2000.0, 2400.0), 0.0) } else { (draw.between(300.0, 1300.0), draw.between(60.0, 130.0)) };
    let shift_um = draw.between(-400.0, 400.0);
    let at = |side: f64, roll_rad: f64| Placement {
        x_um: shift_um + side * half_um,
        y_um: side * y_um,
        // Heads outwards, so that tails are beside each other.
        faces_right: side > 0.0,
        roll_rad,
        ..Placement::default()
    };
    let (one, other) = (at(-1.0, turn(draw)), at(1.0, turn(draw)));
    Recipe::empty(format!("two_{i:03}")).class(Class::TwoLarvae).bore(BORE_UM).with(first, one).with(second, other)
}

fn bubble(i: u32, draw: &mut Seeded) -> Recipe {
    let name = format!("bubble_{i:03}");
    let x_um = draw.between(-1500.0, 1500.0);
    if i.is_multiple_of(4) {
        let kind = Kind::Plug { length_um: draw.between(700.0, 3000.0).round(), diameter_um: 580.0 };
        return Recipe::of(name, Class::Bubble, kind).fill(0.985).x(x_um / 3.0);
    }
    let kind = Kind::Bubble { diameter_um: draw.between(90.0, 560.0).round() };
    Recipe::of(name, Class::Bubble, kind).bore(BORE_UM).lies(Lies::Moved(draw.between(-1.0, 0.0))).x(x_um)
}

fn debris(i: u32, draw: &mut Seeded) -> Recipe {
    let kind = |draw: &mut Seeded| match draw.between(0.0, 3.0) as u32 {
        0 => Kind::Fibre { length_um: draw.between(120.0, 320.0).round() },
        _ => Kind::Chip { size_um: draw.between(50.0, 300.0).round() },
    };
    let recipe = Recipe::of(format!("debris_{i:03}"), Class::Debris, kind(draw)).bore(BORE_UM).x(draw.between(-2000.0, 2000.0));
    let pieces = draw.between(0.0, 4.0) as u32;
    (0..pieces).fold(recipe.lies(Lies::Moved(draw.between(-0.9, 0.95))), |recipe, _| {
        recipe.beside(kind(draw), Along::Right(draw.between(60.0, 900.0)), draw.between(0.0, 0.95), draw.between(0.0, 360.0))
    })
}
