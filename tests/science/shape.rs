//! The shape of phantoms with known length, head and back, carved from their exact silhouettes.
//!
//! ```text
//!  Larva, placed ── truth_mask x 21 ── Reconstruction ── Mesh ── Shape      compared with Truth and Placement
//! ```

use carved_core::carver::Leaves;
use carved_core::geometry::{BoxUm, Camera, VoxelGrid};
use carved_core::measure::facing::Facing;
use carved_core::measure::shape::{Body, End, Shape};
use carved_core::profile::Mask;
use carved_core::reconstruction::{Reconstruction, ReconstructionSettings};
use carved_core::surface::Mesh;
use hardware_sim::scene::{Larva, Placement, Scene, SceneSettings, Specimen};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Coarse voxels, because the field surface is accurate enough with them for these checks.
const SD_UM: f64 = 12.0;
const VIEWS: u32 = 21;

fn hull(specimen: Specimen) -> Mesh {
    let scene = Scene::new(SceneSettings::default());
    scene.load(Some(specimen)).unwrap();
    let k = 1.0 / 5.5;
    let phi = FRAC_PI_2;
    let camera = Camera {
        f: 60_000.0,
        kx: k,
        ky: k,
        ux: 511.5,
        uy: 511.5,
        s: 0.0,
        alpha: 0.0,
        gamma: 0.0,
        phi,
        width: 1024,
        height: 1024,
        glass: None,
    };
    let grid = VoxelGrid::new(BoxUm::PAPER, SD_UM).unwrap();
    let mut model = Reconstruction::new(&camera, grid, VIEWS as usize, ReconstructionSettings::default()).unwrap();
    for view in 0..VIEWS {
        let omega = TAU * f64::from(view) / f64::from(VIEWS);
        let mask = Mask::from_coverage(1024, 1024, scene.truth_mask(omega).data).unwrap();
        model.observe(&mask, &[], omega, Leaves::default()).unwrap();
    }
    model.finish(false).unwrap().model.mesh
}

fn told(shape: &Shape) -> &Body {
    shape.body.as_ref().unwrap_or_else(|| panic!("{:?}", shape.body_reason))
}

/// The length of the body is known along x. Its arc is longer, because the head is bowed and the back is bent; and a head that hangs ends
/// at a plane across itself. Together this is half a per cent. The tail fin adds 3 % of the length.
#[test]
fn larvae_have_their_length_head_and_back_whichever_way_they_lie() {
    for (dpf, seed, finned, faces_right, roll_rad) in
        [(3, 0, false, false, 0.5), (3, 1, true, true, -2.2), (4, 2, true, false, 1.9), (5, 1, false, true, 3.0)]
    {
        let larva = Larva::new(dpf, seed).unwrap();
        let specimen = if finned { larva } else { larva.without_fins() }.specimen();
        let truth = specimen.truth();
        let placement = Placement { roll_rad, faces_right, x_um: 80.0, y_um: 20.0, z_um: -10.0, ..Placement::default() };
        let shape = Shape::of(&hull(specimen.placed(placement)));
        let body = told(&shape);
        let name = format!("{dpf} dpf, seed {seed}: length {} of {}, {:?} {:?}", body.length_um, truth.length_um, body.head, body.dorsal);
        let expected = truth.length_um * if finned { 1.027 } else { 0.997 };
        assert!((body.length_um / expected - 1.0).abs() < 0.006, "{name}");
        assert!((body.slices_volume_share - 1.0).abs() < 2e-3, "{name}, share {}", body.slices_volume_share);
        assert_eq!(body.head.end, Some(if faces_right { End::Right } else { End::Left }), "{name}");
        assert!(body.head.confidence > 0.9, "{name}");
        // The phantom's back is at -y, turned by the roll.
        let (sin, cos) = roll_rad.sin_cos();
        let [_, y, z] = body.dorsal.direction.unwrap_or_else(|| panic!("{name}"));
        assert!(-y * cos - z * sin > 5f64.to_radians().cos(), "{name}");
        // After a quarter of a turn the side that was nearest to the camera is lowest in the picture, where y is largest.
        let camera = Camera::published(1024, 1024);
        let near = if camera.projection(0.0).depth([0.0, 0.0, 100.0]) < camera.projection(0.0).depth([0.0; 3]) { 1.0 } else { -1.0 };
        let front = cos.atan2(-near * sin);
        let views: Vec<(u32, f64)> = (0..VIEWS).map(|view| (view, TAU * f64::from(view) / f64::from(VIEWS))).collect();
        let facing = Facing::of(&shape, None, &camera, &views).unwrap();
        let off = |a: f64, b: f64| (a - b - TAU * ((a - b) / TAU).round()).abs().to_degrees();
        assert!(off(facing.roll_deg.to_radians(), front) < 5.0, "{name}: {facing:?}, the back is in front at {} deg", front.to_degrees());
        let angle = |view: u32| views[view as usize].1;
        assert!(off(angle(facing.dorsal_view), front) < 9.0 + 5.0 && off(angle(facing.ventral_view), front + PI) < 9.0 + 5.0, "{facing:?}");
        let [left, right] = facing.lateral_views.map(angle);
        assert!(off(left, front - FRAC_PI_2) < 9.0 + 5.0 && off(right, front + FRAC_PI_2) < 9.0 + 5.0, "{facing:?}");
        // The phantom bends with its bow and its waves, not like a snake.
        assert!(body.bending.total_deg < 60.0 && body.bending.end_to_end_share > 0.99, "{name}: {:?}", body.bending);
        let harmonics = shape.harmonics.as_ref().unwrap_or_else(|| panic!("{name}: {:?}", shape.harmonics_reason));
        assert!(harmonics.power_share[0] > 0.9 && harmonics.power_share[1] > 0.02, "{name}: {harmonics:?}");
        // The trunk is taller than wide, and the tail is thinner than the yolk.
        let [yolk, tail] = [25, 80].map(|i| body.stations[i]);
        assert!(yolk.height_um > 1.2 * yolk.width_um && yolk.area_um2 > 4.0 * tail.area_um2, "{name}: {yolk:?} {tail:?}");
    }
}

#[test]
fn a_bead_has_neither_head_nor_back_and_the_power_of_a_ball() {
    let shape = Shape::of(&hull(Specimen::bead(500.0).unwrap().placed(Placement { x_um: 300.0, ..Placement::default() })));
    let body = told(&shape);
    assert_eq!((body.head.end, body.dorsal.direction), (None, None), "{:?} {:?}", body.head, body.dorsal);
    // The tolerance of 21 views adds 0.7 % across the capillary (docs/measured.md). The sides of the pixels add the same amount at the size
    // of a bead.
    assert!((body.length_um / 500.0 - 1.0).abs() < 0.015, "{}", body.length_um);
    let (solid, harmonics) = (shape.solid.unwrap(), shape.harmonics.unwrap());
    assert!(solid.sphericity > 0.985, "{solid:?}");
    assert!(harmonics.power_share[0] > 0.999 && (harmonics.power_um2[0].sqrt() / 250.0 - 1.0).abs() < 0.015, "{harmonics:?}");
}
