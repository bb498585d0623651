//! The standard pictures of emulated larvae, whose left side and back are known: which view shows them, and which way up.

use crate::closures;
use carved::cli::emulated;
use carved_core::frame::{PixelFormat, RawFrame};
use carved_core::geometry::Camera;
use carved_core::pipeline::standard::{Aspect, NoStandardView, StandardView};
use carved_core::pipeline::{Pipeline, SpecimenRecord};
use hardware_sim::scene::{Capillary, Condition, Exposure, Larva, Look, Placement, Scene, SceneSettings};
use std::f64::consts::TAU;

type Vector = [f64; 3];

/// A larva whose sides are known.
struct Known {
    words: String,
    placement: Placement,
    camera: Camera,
    views: u32,
    record: SpecimenRecord,
}

impl Known {
    fn larva(dpf: u8, seed: u64, condition: Condition, placement: Placement, views: u32) -> Self {
        let mut settings = closures::settings();
        settings.planned_views = views;
        let camera = settings.camera.clone();
        let look = Look { condition, ..Look::healthy(dpf, seed) };
        let larva = Larva::new(dpf, seed).unwrap().with_look(look).specimen().placed(placement).centred();
        // A swollen larva does not fit into the usual bore.
        let bore_diameter_um = Capillary::default().bore_diameter_um.max(larva.narrowest_bore().diameter_um + 10.0);
        let real = SceneSettings::real(1 + seed % 7);
        let capillary = Capillary { bore_diameter_um, ..real.capillary };
        let scene = Scene::new(SceneSettings { camera: emulated::scene_camera(&camera), capillary, ..real });
        scene.load(larva).unwrap();
        let mut pipeline = Pipeline::new(settings).unwrap();
        for view in 0..views {
            let omega = angle(view, views);
            let rgb = scene.render(&Exposure { angle_rad: omega, number: u64::from(view) }).demosaicked();
            let frame = RawFrame::new(rgb.width, rgb.height, PixelFormat::RGB8Packed, rgb.data).unwrap();
            let seen = pipeline.look(&frame).unwrap();
            pipeline.observe(view, omega, &seen).unwrap();
        }
        let words = format!("{dpf} dpf, seed {seed}, {condition:?}");
        Self { words, placement, camera, views, record: pipeline.finish().unwrap().1 }
    }

    /// Directions to its back and from its right side to its left, in the coordinates of the capillary. A larva at rest has its back at -y and,
    /// because it looks to the left, its left side at -z; facing right it is turned about y.
    fn back_and_left(&self) -> [Vector; 2] {
        let (sin, cos) = self.placement.roll_rad.sin_cos();
        let side = if self.placement.faces_right { -1.0 } else { 1.0 };
        [[0.0, -cos, -sin], [0.0, side * sin, -side * cos]]
    }

    fn standard(&self) -> Result<[StandardView; 2], NoStandardView> {
        self.record.standard_views(&self.camera)
    }

    /// How far the view is from showing what it is said to show, deg.
    fn off_deg(&self, aspect: Aspect, view: u32) -> f64 {
        let [back, left] = self.back_and_left();
        let (sin, cos) = angle(view, self.views).sin_cos();
        let to_camera = [0.0, -sin, -cos];
        let shown = if aspect == Aspect::Lateral { left } else { back };
        (0..3).map(|a| to_camera[a] * shown[a]).sum::<f64>().clamp(-1.0, 1.0).acos().to_degrees()
    }

    /// Where a direction of the larva points in the picture, px right and down in the frame of a picture without turn: the frame's place of a
    /// point is compared with that of the picture's points.
    fn in_picture(&self, view: &StandardView, direction: Vector) -> [f64; 2] {
        let at = |x: f64, y: f64| view.in_frame([x, y]).map(|(u, v)| [u, v]).unwrap();
        let [middle, right, down] = [at(0.0, 0.0), at(100.0, 0.0), at(0.0, 100.0)];
        let projection = self.camera.projection(angle(view.view, self.views));
        let seen = |point: Vector| projection.project(point).map(|(u, v)| [u, v]).unwrap();
        let [from, to] = [seen([0.0; 3]), seen(direction.map(|c| 100.0 * c))];
        let along = |axis: [f64; 2]| (0..2).map(|a| (axis[a] - middle[a]) * (to[a] - from[a])).sum::<f64>();
        [along(right), along(down)]
    }
}

fn angle(view: u32, views: u32) -> f64 {
    TAU * f64::from(view) / f64::from(views)
}

/// Both ways in which a head can lie, and rolls all around.
#[test]
fn pictures_show_the_left_side_with_the_back_up_and_the_head_to_the_left() {
    for (seed, faces_right, roll_rad) in [(2, false, 0.4), (2, true, 0.4), (4, true, -2.0)] {
        let known = Known::larva(3, seed, Condition::Healthy, Placement { faces_right, roll_rad, ..Placement::default() }, 12);
        let [lateral, dorsal] = known.standard().unwrap_or_else(|why| panic!("{}: {why}", known.words));
        let [back, left] = known.back_and_left();
        let head = [if faces_right { 1.0 } else { -1.0 }, 0.0, 0.0];
        for view in [&lateral, &dorsal] {
            let off_deg = known.off_deg(view.aspect, view.view);
            assert!(off_deg < 15.0 + 8.0, "{}: {:?} is {off_deg} deg off", known.words, view.aspect);
            assert!(view.off_deg <= 15.0, "the nearest of 12 views");
            assert!(known.in_picture(view, head)[0] < 0.0, "{}: the head is at the right of {:?}", known.words, view.aspect);
        }
        assert!(known.in_picture(&lateral, back)[1] < 0.0, "{}: the back is down", known.words);
        // From above a larva that looks to the left has its left side below. In a mirror image it is above.
        assert!(known.in_picture(&dorsal, left)[1] > 0.0, "{}: a mirror image", known.words);
    }
}

/// Standard pictures of many larvae, a third of them sick, at 21 views:
/// `CARVED_LARVAE=24 cargo test --test science standard::survey -- --ignored --nocapture`
#[test]
#[ignore = "a survey: it prints how often pictures show what they should"]
fn survey() {
    const VIEWS: u32 = 21;
    let larvae: u64 = std::env::var("CARVED_LARVAE").ok().and_then(|n| n.parse().ok()).unwrap_or(24);
    let [mut pictures, mut within, mut best, mut wrong, mut sure, mut sure_wrong] = [0; 6];
    let mut none = Vec::new();
    for seed in 0..larvae {
        let dpf = 3 + (seed % 4) as u8;
        let sick = Condition::SICK[(seed / 3) as usize % Condition::SICK.len()];
        let condition = if seed % 3 == 2 { sick } else { Condition::Healthy };
        // The golden angle spreads the rolls over the turn.
        let placement = Placement { roll_rad: 2.399_963 * seed as f64, faces_right: seed % 2 == 1, ..Placement::default() };
        let known = Known::larva(dpf, 9000 + seed, condition, placement, VIEWS);
        let confidences = known.record.facing.as_ref().map(|f| (f.head_confidence, f.confidence));
        match known.standard() {
            Ok(views) => {
                let confidence = views[0].confidence;
                let offs = views.each_ref().map(|view| known.off_deg(view.aspect, view.view));
                let [back, left] = known.back_and_left();
                let is_wrong = offs.iter().any(|off| *off > 90.0)
                    || known.in_picture(&views[0], back)[1] > 0.0
                    || known.in_picture(&views[1], left)[1] < 0.0;
                pictures += offs.len();
                within += offs.iter().filter(|off| **off <= 8.0).count();
                // What a perfect knowledge of the sides would give.
                best += Aspect::ALL.iter().filter(|aspect| (0..VIEWS).any(|view| known.off_deg(**aspect, view) <= 8.0)).count();
                wrong += usize::from(is_wrong);
                sure += usize::from(confidence > 0.9);
                sure_wrong += usize::from(confidence > 0.9 && is_wrong);
                println!(
                    "{}: confidence {confidence:.2} {confidences:.2?}, lateral {:.1} deg off, dorsal {:.1}",
                    known.words, offs[0], offs[1]
                );
            }
            Err(why) => {
                println!("{}: none, {why} {:?}", known.words, known.record.facing);
                none.push(why);
            }
        }
    }
    let decided = larvae as usize - none.len();
    println!(
        "{larvae} larvae: {} without pictures, {wrong} of {decided} with the wrong side, {sure} over 0.9, of which {sure_wrong} wrong",
        none.len()
    );
    println!("{pictures} pictures: {within} within 8 deg, {best} if the sides were known exactly");
}
