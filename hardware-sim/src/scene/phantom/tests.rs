use super::*;
use std::f64::consts::PI;

#[test]
fn a_bead_has_the_volume_and_area_of_its_diameter() {
    let truth = Specimen::bead(500.0).unwrap().truth();
    assert!((truth.volume_um3 / (PI / 6.0 * 500f64.powi(3)) - 1.0).abs() < 1e-9);
    assert!((truth.area_um2 / (PI * 500f64.powi(2)) - 1.0).abs() < 1e-7);
    assert_eq!(truth.diameter_um, Some(500.0));
    assert!((truth.hull_volume_um3 - truth.volume_um3).abs() < 1e-9 * truth.volume_um3);
}

#[test]
fn the_hull_of_a_convex_mesh_is_itself() {
    let half = [600.0, 200.0, 150.0];
    let mesh = solid::ellipsoid_mesh([0.0; 3], half, 200, 256);
    let truth = Specimen::mesh(mesh).truth();
    // Cuts of the facets, midpoints in x: the ends' last half step of 2000 is a cone instead of a cap.
    assert!((truth.hull_volume_um3 / truth.volume_um3 - 1.0).abs() < 3e-4, "{truth:?}");
    assert!((truth.hull_area_um2 / truth.area_um2 - 1.0).abs() < 1e-3, "{truth:?}");
}

#[test]
fn a_prism_keeps_its_flat_ends_in_the_hull() {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[y, z]| [100.0 * y, 100.0 * z]);
    let ring = |x: f64| corners.map(|[y, z]| [x, y, z]).to_vec();
    let prism = Mesh::lofted([-300.0, 0.0, 0.0], &[ring(-300.0), ring(300.0)], [300.0, 0.0, 0.0]).closed().unwrap();
    let truth = Specimen::mesh(prism).truth();
    assert!((truth.volume_um3 / (200.0 * 200.0 * 600.0) - 1.0).abs() < 1e-12);
    assert!((truth.area_um2 / (4.0 * 200.0 * 600.0 + 2.0 * 200.0 * 200.0) - 1.0).abs() < 1e-12);
    assert!((truth.hull_volume_um3 / truth.volume_um3 - 1.0).abs() < 1e-3, "{truth:?}");
    assert!((truth.hull_area_um2 / truth.area_um2 - 1.0).abs() < 3e-3, "{truth:?}");
}

#[test]
fn sizes_that_are_not_positive_are_refused() {
    assert_eq!(Specimen::bead(0.0).unwrap_err(), SizeError::NotPositive { name: "bead diameter", found: 0.0 });
    assert!(Specimen::ellipsoid([1.0, f64::NAN, 1.0]).is_err());
}
