//! The recipes of the labelled examples: six of each class, six of each side of the head, and six of each clipped side.

use super::item::Kind;
use super::recipe::{Along, Lies, Recipe};
use super::{Class, Difficulty};
use crate::scene::Placement;

const LIVE_3: Kind = Kind::Larva { dpf: 3, fins: true };
const LIVE_4: Kind = Kind::Larva { dpf: 4, fins: true };
const LIVE_5: Kind = Kind::Larva { dpf: 5, fins: true };

pub fn recipes() -> Vec<Recipe> {
    [empty(), left(), right(), two(), bubbles(), debris(), clipped_left(), clipped_right(), dead(), beads()]
        .into_iter()
        .flatten()
        .map(|r| r.difficulty(Difficulty::Medium))
        .collect()
}

fn bubble(name: &'static str, diameter_um: f64) -> Recipe {
    Recipe::of(name, Class::Bubble, Kind::Bubble { diameter_um })
}

fn plug(name: &'static str, length_um: f64) -> Recipe {
    Recipe::of(name, Class::Bubble, Kind::Plug { length_um, diameter_um: 640.0 }).fill(0.985)
}

fn empty() -> Vec<Recipe> {
    vec![
        Recipe::empty("empty_clean"),
        Recipe::empty("empty_tilted").tilt(1.5).blur(1.0),
        Recipe::empty("empty_scratched").glass(14, 60, 0.6),
        Recipe::empty("empty_dusty_window").window(6, 50, 0.5).noise(2.0),
        Recipe::empty("empty_dim_light_off").light_at(300.0, 200.0, 0.4).drift(-0.3, 0.05).noise(2.0),
        Recipe::empty("empty_fine_in_air").scale(4.2).in_air().tilt(-0.8).hot_pixels(300),
    ]
}

fn left() -> Vec<Recipe> {
    vec![
        Recipe::larva("left_3dpf", 3),
        Recipe::larva("left_3dpf_below_rests", 3).roll(90.0).lies(Lies::Rests).noise(2.0),
        Recipe::larva("left_4dpf_90_percent", 4).fill(0.90).lies(Lies::Rests).tilt(1.0),
        Recipe::larva("left_4dpf_upside_down", 4).roll(180.0).blur(1.0),
        Recipe::larva("left_5dpf_bubble_at_nose", 5).x(250.0).beside(Kind::Bubble { diameter_um: 300.0 }, Along::Left(20.0), 0.5, 180.0),
        Recipe::bare_larva("left_5dpf_bare_scratched", 5).roll(-60.0).glass(10, 40, 0.5),
    ]
}

fn right() -> Vec<Recipe> {
    vec![
        Recipe::larva("right_3dpf", 3).right(),
        Recipe::larva("right_3dpf_above_noisy", 3).right().roll(-90.0).noise(2.5),
        Recipe::larva("right_4dpf_rests_tilted", 4).right().lies(Lies::Rests).tilt(-1.5),
        Recipe::larva("right_4dpf_upside_down_moving", 4).right().roll(180.0).moving(0.5, 1.2),
        Recipe::larva("right_5dpf_debris", 5).right().beside(Kind::Chip { size_um: 150.0 }, Along::At(0.15), 0.9, 0.0).beside(
            Kind::Fibre { length_um: 300.0 },
            Along::At(0.3),
            0.8,
            180.0,
        ),
        Recipe::bare_larva("right_5dpf_bare_in_air", 5).right().roll(50.0).in_air(),
    ]
}

/// Two larvae: one at the right of the gap, and one at the left.
fn two() -> Vec<Recipe> {
    let pair = |name, first: Kind, second: Kind, apart_um: f64| {
        let half = apart_um / 2.0;
        Recipe::of(name, Class::TwoLarvae, first).x(-half).with(second, Placement { x_um: half, ..Placement::default() })
    };
    let facing = |name, first: Kind, apart_um: f64, [y_um, z_um]: [f64; 2]| {
        // Heads outwards, tails beside each other.
        let one = Placement { x_um: -apart_um / 2.0, y_um: -y_um, z_um: -z_um, ..Placement::default() };
        let other = Placement { x_um: apart_um / 2.0, y_um, z_um, faces_right: true, ..Placement::default() };
        Recipe::empty(name).class(Class::TwoLarvae).with(first, one).with(LIVE_3, other).bore(700.0)
    };
    vec![
        pair("two_3dpf_in_line", LIVE_3, LIVE_3, 3900.0),
        pair("two_4dpf_3dpf_close", LIVE_4, LIVE_3, 3950.0).right().noise(1.5),
        pair("two_5dpf_in_line_below", LIVE_5, LIVE_5, 4700.0).roll(90.0),
        facing("two_3dpf_tails_overlap", LIVE_3, 2500.0, [15.0, 0.0]),
        facing("two_3dpf_tails_side_by_side", LIVE_3, 2300.0, [0.0, 35.0]).angle(90.0).noise(1.5),
        facing("two_4dpf_3dpf_wide_bore", LIVE_4, 1500.0, [200.0, 30.0]).bore(1150.0).blur(0.9),
    ]
}

fn bubbles() -> Vec<Recipe> {
    vec![
        bubble("bubble_400", 400.0),
        bubble("bubble_150_at_the_top", 150.0).lies(Lies::Moved(-0.97)),
        bubble("bubble_600_noisy", 600.0).noise(2.0).tilt(1.0),
        bubble("bubble_three", 300.0)
            .x(-700.0)
            .with(Kind::Bubble { diameter_um: 420.0 }, Placement { x_um: 500.0, y_um: -90.0, ..Placement::default() })
            .with(Kind::Bubble { diameter_um: 200.0 }, Placement { x_um: 1000.0, y_um: -200.0, ..Placement::default() }),
        plug("bubble_plug_short", 800.0).tilt(-1.2),
        plug("bubble_plug_long", 3200.0).blur(1.0),
    ]
}

fn debris() -> Vec<Recipe> {
    let chip = |name, size_um: f64| Recipe::of(name, Class::Debris, Kind::Chip { size_um });
    let at = |x_um: f64, y_um: f64| Placement { x_um, y_um, ..Placement::default() };
    vec![
        chip("debris_chip_300", 300.0).lies(Lies::Rests),
        chip("debris_chip_120", 120.0),
        chip("debris_chip_60_scratched", 60.0).glass(8, 30, 0.5),
        Recipe::of("debris_fibre_300", Class::Debris, Kind::Fibre { length_um: 300.0 }),
        chip("debris_chips_and_fibres", 200.0)
            .x(-600.0)
            .with(Kind::Fibre { length_um: 280.0 }, at(300.0, 120.0))
            .with(Kind::Chip { size_um: 90.0 }, at(700.0, -220.0))
            .with(Kind::Fibre { length_um: 180.0 }, at(1300.0, -40.0))
            .noise(2.0),
        chip("debris_grit", 40.0)
            .with(Kind::Chip { size_um: 30.0 }, at(400.0, 250.0))
            .with(Kind::Chip { size_um: 70.0 }, at(-900.0, 200.0))
            .with(Kind::Chip { size_um: 50.0 }, at(-400.0, -260.0))
            .blur(1.0),
    ]
}

fn clipped_left() -> Vec<Recipe> {
    vec![
        Recipe::larva("clipped_left_3dpf_head", 3).x(-1700.0),
        Recipe::larva("clipped_left_4dpf_head_most", 4).x(-3000.0),
        Recipe::larva("clipped_left_5dpf_tail", 5).x(-1800.0).right(),
        Recipe::larva("clipped_left_3dpf_tail_most_gone", 3).x(-2500.0).right().noise(2.0),
        Recipe::larva("clipped_left_4dpf_nose_only_just", 4).x(-1000.0).lies(Lies::Rests).tilt(1.0),
        Recipe::larva("clipped_left_5dpf_below", 5).x(-1500.0).roll(90.0).fill(0.85),
    ]
}

fn clipped_right() -> Vec<Recipe> {
    vec![
        Recipe::larva("clipped_right_3dpf_head", 3).x(1700.0).right(),
        Recipe::larva("clipped_right_4dpf_head_most", 4).x(3000.0).right(),
        Recipe::larva("clipped_right_5dpf_tail", 5).x(1800.0),
        Recipe::larva("clipped_right_3dpf_tail_most_gone", 3).x(2500.0).noise(2.0),
        Recipe::larva("clipped_right_4dpf_nose_only_just", 4).x(1000.0).right().lies(Lies::Rests).tilt(-1.0),
        Recipe::larva("clipped_right_5dpf_above", 5).x(1500.0).right().roll(-90.0).fill(0.85),
    ]
}

fn dead() -> Vec<Recipe> {
    let dead = |name, dpf| Recipe::of(name, Class::DeadLarva, Kind::DeadLarva { dpf });
    vec![
        dead("dead_3dpf", 3),
        dead("dead_3dpf_right_rests", 3).right().lies(Lies::Rests).noise(2.0),
        dead("dead_4dpf_below", 4).roll(90.0),
        dead("dead_4dpf_right_tilted", 4).right().tilt(1.2).roll(-45.0),
        dead("dead_5dpf_rests_soft", 5).lies(Lies::Rests).blur(1.2).roll(150.0),
        dead("dead_5dpf_right_debris", 5).right().beside(Kind::Chip { size_um: 140.0 }, Along::Left(30.0), 0.5, 0.0),
    ]
}

fn beads() -> Vec<Recipe> {
    vec![
        Recipe::bead("bead_500", 500.0),
        Recipe::bead("bead_500_rests_tilted", 500.0).lies(Lies::Rests).tilt(-1.5),
        Recipe::bead("bead_300_noisy", 300.0).noise(2.5).x(900.0),
        Recipe::bead("bead_400_in_air", 400.0).in_air(),
        Recipe::bead("bead_600_soft", 600.0).blur(1.3).x(-1200.0),
        Recipe::bead("bead_350_bubble_and_grit", 350.0)
            .beside(Kind::Bubble { diameter_um: 250.0 }, Along::Right(200.0), 0.9, 180.0)
            .beside(Kind::Chip { size_um: 60.0 }, Along::Left(300.0), 0.9, 0.0),
    ]
}
