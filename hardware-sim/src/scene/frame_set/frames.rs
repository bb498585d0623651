//! The recipes of the frames for the evaluation of segmentation.

use super::item::Kind;
use super::recipe::{Along, Lies, Recipe};
use super::{Class, Difficulty};
use crate::scene::Placement;

const LIVE_3: Kind = Kind::Larva { dpf: 3, fins: true };

pub fn recipes() -> Vec<Recipe> {
    // The part of the bore that a larva fills if its recipe does not set it.
    let all = [
        (Difficulty::Easy, 0.75, easy()),
        (Difficulty::Medium, 0.82, medium()),
        (Difficulty::Hard, 0.88, hard()),
        (Difficulty::Vicious, 0.92, vicious()),
    ];
    all.into_iter()
        .flat_map(|(difficulty, fill, recipes)| {
            recipes.into_iter().map(move |r| if r.is_of(Class::Bead) { r } else { r.fill_by_default(fill) }.difficulty(difficulty))
        })
        .collect()
}

fn bubble(diameter_um: f64) -> Kind {
    Kind::Bubble { diameter_um }
}

fn chip(size_um: f64) -> Kind {
    Kind::Chip { size_um }
}

fn fibre(length_um: f64) -> Kind {
    Kind::Fibre { length_um }
}

/// Clean glass. The larva is centred or at rest and fills three quarters of the bore.
fn easy() -> Vec<Recipe> {
    vec![
        Recipe::bead("easy_bead_500", 500.0),
        Recipe::bead("easy_bead_300_rests", 300.0).lies(Lies::Rests),
        Recipe::bead("easy_bead_400_fine", 400.0).scale(4.0).blur(0.5),
        Recipe::larva("easy_3dpf_side", 3),
        Recipe::larva("easy_3dpf_side_right", 3).right(),
        Recipe::larva("easy_3dpf_below", 3).roll(90.0).scale(5.0),
        Recipe::larva("easy_4dpf_side", 4),
        Recipe::larva("easy_4dpf_oblique_right", 4).roll(40.0).right(),
        Recipe::larva("easy_4dpf_above", 4).roll(-90.0).scale(4.5),
        Recipe::larva("easy_5dpf_side", 5).scale(5.0),
        Recipe::larva("easy_5dpf_oblique", 5).roll(-45.0),
        Recipe::larva("easy_5dpf_below_right", 5).roll(90.0).right(),
        Recipe::bare_larva("easy_3dpf_bare", 3).fill(0.70),
        Recipe::bare_larva("easy_4dpf_bare_right", 4).right().fill(0.72).blur(0.6),
        Recipe::bare_larva("easy_5dpf_bare_oblique", 5).roll(60.0).fill(0.75),
        Recipe::larva("easy_4dpf_half_noise", 4).noise(0.5).roll(20.0),
        Recipe::larva("easy_3dpf_sharp", 3).blur(0.4).roll(-20.0).right(),
        Recipe::larva("easy_5dpf_mono", 5).mono().tilt(0.3),
    ]
}

/// One difficulty at a time.
fn medium() -> Vec<Recipe> {
    vec![
        Recipe::bead("medium_bead_soft", 500.0).blur(1.2).tilt(-1.0),
        Recipe::bead("medium_bead_in_air", 450.0).in_air().noise(1.5),
        Recipe::bead("medium_bead_80_percent_rests", 500.0).fill(0.80).lies(Lies::Rests),
        Recipe::larva("medium_3dpf_rests", 3).lies(Lies::Rests),
        Recipe::larva("medium_4dpf_rests_right", 4).lies(Lies::Rests).right().roll(15.0),
        Recipe::larva("medium_5dpf_rests_above", 5).lies(Lies::Rests).angle(180.0).tilt(0.6),
        Recipe::larva("medium_3dpf_80_percent", 3).fill(0.80).tilt(1.0),
        Recipe::larva("medium_4dpf_85_percent_right", 4).fill(0.85).right().tilt(-1.0),
        Recipe::larva("medium_5dpf_noise_2", 5).noise(2.0).roll(30.0),
        Recipe::larva("medium_3dpf_soft", 3).blur(1.1).roll(-70.0).right(),
        Recipe::larva("medium_4dpf_moving_across", 4).moving(0.0, 1.0),
        Recipe::larva("medium_5dpf_moving_along", 5).moving(1.2, 0.0).roll(100.0).right(),
        Recipe::larva("medium_4dpf_in_air", 4).in_air(),
        Recipe::bare_larva("medium_5dpf_bare_fine", 5).scale(4.4).fill(0.78).noise(1.4),
        Recipe::larva("medium_3dpf_dim", 3).drift(-0.25, 0.04).vignetting(0.25),
        Recipe::larva("medium_4dpf_marks", 4).glass(4, 14, 0.3).right().roll(-30.0),
        Recipe::larva("medium_5dpf_bubble_apart", 5).x(350.0).beside(bubble(250.0), Along::Left(150.0), 0.8, 180.0).scale(5.5),
        Recipe::larva("medium_3dpf_mono_light_off", 3).mono().light_at(250.0, -150.0, 0.2).roll(55.0),
    ]
}

/// Several difficulties at once.
fn hard() -> Vec<Recipe> {
    vec![
        Recipe::bead("hard_bead_90_percent_wall", 480.0).fill(0.90).lies(Lies::Rests).blur(1.0).tilt(1.5),
        Recipe::bead("hard_bead_moving_marks", 350.0).moving(1.0, 1.5).glass(8, 30, 0.45).noise(2.0),
        Recipe::larva("hard_3dpf_90_percent_rests", 3).fill(0.90).lies(Lies::Rests).tilt(-1.5).blur(0.9),
        Recipe::larva("hard_4dpf_90_percent_nearly_touches", 4).fill(0.90).lies(Lies::Moved(0.85)).right().noise(1.5),
        Recipe::larva("hard_5dpf_92_percent_soft", 5).fill(0.92).blur(1.2).tilt(1.0).roll(10.0),
        Recipe::larva("hard_3dpf_clipped_left", 3).x(-1750.0).lies(Lies::Rests).noise(1.5),
        Recipe::larva("hard_4dpf_clipped_right", 4).x(1900.0).right().blur(0.9).tilt(0.8),
        Recipe::larva("hard_5dpf_tail_clipped_left", 5).x(-1700.0).right().lies(Lies::Rests).roll(80.0),
        Recipe::larva("hard_3dpf_tail_clipped_right_fine", 3).x(900.0).scale(4.0).noise(2.0),
        Recipe::larva("hard_4dpf_bubble_touches_nose", 4).x(250.0).beside(bubble(320.0), Along::Left(0.0), 0.0, 0.0).noise(1.5),
        Recipe::larva("hard_5dpf_bubbles_along_tail", 5)
            .beside(bubble(150.0), Along::At(0.72), 0.95, 180.0)
            .beside(bubble(110.0), Along::At(0.83), 0.95, 185.0)
            .tilt(-0.7),
        Recipe::larva("hard_3dpf_debris", 3)
            .right()
            .beside(chip(110.0), Along::Right(40.0), 0.2, 0.0)
            .beside(fibre(260.0), Along::At(0.2), 0.7, 0.0)
            .beside(chip(60.0), Along::At(0.05), 0.9, 180.0),
        Recipe::larva("hard_4dpf_scratched", 4).glass(14, 50, 0.55).window(4, 16, 0.35).roll(65.0),
        Recipe::larva("hard_5dpf_noise_3_dim", 5).noise(3.0).drift(-0.35, -0.05).lies(Lies::Rests).roll(-25.0),
        Recipe::bare_larva("hard_4dpf_bare_in_air_moving", 4).in_air().moving(0.4, 1.6).fill(0.82).right(),
        Recipe::larva("hard_3dpf_vignetted_mono", 3).mono().vignetting(0.45).light_at(-300.0, 200.0, 0.25).blur(1.0).tilt(1.8),
        Recipe::larva("hard_5dpf_fine_rests_hot_pixels", 5).scale(4.4).lies(Lies::Rests).hot_pixels(400).blur(1.3).right(),
        Recipe::of("hard_dead_4dpf_rests", Class::DeadLarva, Kind::DeadLarva { dpf: 4 }).lies(Lies::Rests).noise(1.5),
    ]
}

/// Frames that no method is expected to segment correctly.
fn vicious() -> Vec<Recipe> {
    vec![
        Recipe::bead("vicious_bead_wedged", 420.0).lies(Lies::Wedged).blur(1.3).noise(2.0).tilt(2.0),
        Recipe::bead("vicious_bead_bubble_touches", 400.0)
            .beside(bubble(380.0), Along::Right(0.0), 0.0, 0.0)
            .beside(chip(120.0), Along::Left(-15.0), 0.3, 180.0)
            .moving(0.0, 1.5)
            .noise(2.0),
        Recipe::larva("vicious_3dpf_wedged", 3).lies(Lies::Wedged).tilt(2.0).blur(1.0).noise(1.5),
        Recipe::larva("vicious_4dpf_wedged_right", 4).lies(Lies::Wedged).right().tilt(-2.0).moving(0.0, 1.5),
        Recipe::larva("vicious_5dpf_95_percent_rests", 5).fill(0.95).lies(Lies::Rests).blur(1.4).noise(2.5).tilt(1.2),
        Recipe::larva("vicious_3dpf_95_percent_in_air", 3).fill(0.95).lies(Lies::Rests).in_air().tilt(-1.7).noise(2.0).right(),
        Recipe::larva("vicious_4dpf_clipped_left_bubble", 4)
            .x(-1650.0)
            .right()
            .lies(Lies::Rests)
            .beside(bubble(300.0), Along::Right(-10.0), 0.5, 180.0)
            .noise(2.0)
            .drift(-0.3, 0.05),
        Recipe::larva("vicious_5dpf_clipped_right_debris", 5)
            .x(1800.0)
            .roll(95.0)
            .fill(0.88)
            .lies(Lies::Rests)
            .beside(chip(200.0), Along::Left(-25.0), 0.3, 0.0)
            .beside(fibre(300.0), Along::At(0.1), 0.9, 180.0)
            .blur(1.2),
        Recipe::larva("vicious_4dpf_clipped_both", 4).scale(3.6).lies(Lies::Rests).blur(1.2).tilt(1.5).noise(2.0),
        Recipe::larva("vicious_3dpf_bubbles_beside", 3)
            .lies(Lies::Moved(0.9))
            .beside(bubble(180.0), Along::At(0.62), 1.0, 180.0)
            .beside(bubble(220.0), Along::At(0.78), 1.0, 170.0)
            .beside(bubble(140.0), Along::At(0.9), 0.8, 20.0)
            .beside(bubble(300.0), Along::Left(-5.0), 0.6, 0.0)
            .blur(1.0),
        Recipe::larva("vicious_5dpf_plug_at_tail", 5)
            .x(-300.0)
            .lies(Lies::Rests)
            .beside(Kind::Plug { length_um: 900.0, diameter_um: 640.0 }, Along::Right(10.0), 0.0, 0.0)
            .tilt(-1.0)
            .noise(1.5),
        Recipe::larva("vicious_4dpf_debris_all_over", 4)
            .right()
            .roll(35.0)
            .beside(chip(300.0), Along::Right(-20.0), 0.5, 0.0)
            .beside(chip(90.0), Along::At(0.25), 1.0, 0.0)
            .beside(chip(70.0), Along::At(0.35), 1.0, 180.0)
            .beside(fibre(300.0), Along::At(0.3), 0.8, 200.0)
            .beside(fibre(280.0), Along::At(0.75), 1.0, 10.0)
            .beside(chip(40.0), Along::At(0.1), 0.9, 150.0)
            .noise(2.0),
        Recipe::larva("vicious_3dpf_filthy_glass", 3).glass(40, 160, 0.8).window(10, 60, 0.6).hot_pixels(600).lies(Lies::Rests).noise(2.0),
        Recipe::larva("vicious_5dpf_shaken_soft_noisy", 5).moving(1.4, 1.4).blur(1.4).noise(3.0).roll(-90.0).right().fill(0.85),
        Recipe::larva("vicious_4dpf_dark_corner_mono", 4)
            .mono()
            .light_at(450.0, 350.0, 0.5)
            .vignetting(0.4)
            .drift(-0.4, 0.0)
            .noise(2.5)
            .lies(Lies::Rests)
            .tilt(2.0),
        Recipe::of("vicious_dead_3dpf_bubble", Class::DeadLarva, Kind::DeadLarva { dpf: 3 })
            .right()
            .lies(Lies::Rests)
            .beside(bubble(280.0), Along::Right(0.0), 0.3, 180.0)
            .blur(1.2)
            .glass(10, 40, 0.5),
        Recipe::bare_larva("vicious_5dpf_bare_wedged_clipped", 5).x(-1500.0).lies(Lies::Wedged).blur(1.2).moving(1.0, 0.8).noise(2.0),
        Recipe::empty("vicious_two_3dpf_tail_on_tail")
            .class(Class::TwoLarvae)
            .with(LIVE_3, Placement { x_um: -1250.0, y_um: -20.0, ..Placement::default() })
            .with(LIVE_3, Placement { x_um: 1250.0, y_um: 20.0, faces_right: true, ..Placement::default() })
            .bore(700.0)
            .noise(1.5)
            .tilt(-1.0),
    ]
}
