use super::*;
use nalgebra::Rotation3;
use std::f64::consts::{PI, TAU};

/// Points around a tube's slice; a ring inscribed in a circle lacks `(2 pi / 180)^2 / 6` = 2.03e-4 of its area and a quarter of that
/// of its perimeter.
const AROUND: usize = 180;
const FACETS: f64 = 2.1e-4;

/// A closed tube: rings of as many points each, a fan from the first and last ring's middle.
fn lofted(rings: &[Vec<Vector>]) -> Mesh {
    let n = rings[0].len() as u32;
    let middle = |ring: &[Vector]| ring.iter().sum::<Vector>() / f64::from(n);
    let last = rings.len() as u32 - 1;
    let mut vertices = vec![middle(&rings[0]).into(), middle(&rings[last as usize]).into()];
    vertices.extend(rings.iter().flatten().map(|&v| <[f64; 3]>::from(v)));
    let at = |ring: u32, k: u32| 2 + ring * n + k % n;
    let mut triangles = Vec::new();
    for k in 0..n {
        triangles.extend([[0, at(0, k + 1), at(0, k)], [1, at(last, k), at(last, k + 1)]]);
        for ring in 0..last {
            let [a, b, c, d] = [at(ring, k), at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1)];
            triangles.extend([[a, b, c], [b, d, c]]);
        }
    }
    Mesh { vertices, triangles }
}

/// A tube along x: per ring its x, its middle's y and half axes along y and z.
fn tube(rings: impl IntoIterator<Item = (f64, f64, [f64; 2])>) -> Mesh {
    let ring = |(x, y, [a, b]): (f64, f64, [f64; 2])| {
        (0..AROUND)
            .map(|k| {
                let (sin, cos) = (TAU * k as f64 / AROUND as f64).sin_cos();
                Vector::new(x, y + a * cos, b * sin)
            })
            .collect()
    };
    lofted(&rings.into_iter().map(ring).collect::<Vec<_>>())
}

/// Even turns from pole to pole, which are left out.
fn polar(n: usize) -> impl Iterator<Item = f64> {
    (1..n).map(move |i| PI * i as f64 / n as f64)
}

fn ellipsoid([a, b, c]: [f64; 3]) -> Mesh {
    tube(polar(400).map(|t| (-a * t.cos(), 0.0, [b * t.sin(), c * t.sin()])))
}

/// A cylinder with flat ends whose radius is that of the place; its rings stand close where two radii meet.
fn cylinder(length: f64, rings: usize, radius: impl Fn(f64) -> f64) -> Mesh {
    tube((0..=rings).map(|i| i as f64 / rings as f64).map(|s| (length * (s - 0.5), 0.0, [radius(s); 2])))
}

/// Part of a ring of radius `bend` that a circle of radius `thick` sweeps, in the plane of x and y.
fn bow(bend: f64, angle: f64, thick: f64) -> Mesh {
    let ring = |i: i32| {
        let turn = angle * (f64::from(i) / 300.0 - 0.5);
        let out = Vector::new(turn.sin(), turn.cos(), 0.0);
        let around = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / AROUND as f64).sin_cos();
            out * (bend + thick * cos) + Vector::z() * (thick * sin)
        };
        (0..AROUND).map(around).collect()
    };
    let mesh = lofted(&(0..=300).map(ring).collect::<Vec<_>>());
    assert!(crate::measure::volume(&mesh) > 0.0);
    mesh
}

/// A larva of two lines: a trunk of which the front third hangs lower by `belly`, all of it arched by `arch`; twice as high as wide.
fn fish(belly: f64, arch: f64) -> Mesh {
    let yolk = |s: f64| if (s - 0.26).abs() < 0.16 { f64::midpoint(1.0, (PI * (s - 0.26) / 0.16).cos()) } else { 0.0 };
    tube(polar(400).map(|t| {
        let s = f64::midpoint(1.0, -t.cos());
        let half = (300.0 - 200.0 * s) * t.sin().powf(0.7);
        (4000.0 * (s - 0.5), belly * yolk(s) + arch * (2.0 * s - 1.0).powi(2), [half, half / 2.0])
    }))
}

fn moved(mesh: &Mesh, turn: Rotation3<f64>, by: [f64; 3]) -> Mesh {
    let vertices = mesh.vertices.iter().map(|&v| (turn * Vector::from(v) + Vector::from(by)).into()).collect();
    Mesh { vertices, triangles: mesh.triangles.clone() }
}

/// As a specimen may lie in a capillary.
fn laid(mesh: &Mesh) -> Mesh {
    moved(mesh, Rotation3::from_euler_angles(0.6, 0.05, -0.08), [120.0, -40.0, 75.0])
}

fn body(mesh: &Mesh) -> Body {
    let shape = Shape::of(mesh);
    shape.body.unwrap_or_else(|| panic!("{:?}", shape.body_reason))
}

#[track_caller]
fn near(found: f64, wanted: f64, share: f64) {
    assert!((found / wanted - 1.0).abs() < share, "{found} is off {wanted} by {:.2e}, more than {share:.1e}", found / wanted - 1.0);
}

#[test]
fn a_balls_and_an_ellipsoids_solid_have_their_numbers_wherever_they_lie() {
    let half = [1900.0, 260.0, 190.0];
    let solid = Shape::of(&laid(&ellipsoid(half))).solid.unwrap();
    let volume = 4.0 / 3.0 * PI * half.iter().product::<f64>();
    // Inscribed facets: around, and half as much along.
    near(solid.volume_um3, volume, 1.5 * FACETS);
    assert!((Vector::from(solid.centroid_um) - Vector::new(120.0, -40.0, 75.0)).norm() < 1e-6, "{solid:?}");
    for (axis, found) in solid.principal_moments_um5.iter().enumerate() {
        let [b, c] = [half[(axis + 1) % 3], half[(axis + 2) % 3]];
        // Fifth powers of lengths that are too short by FACETS / 2.
        near(*found, volume / 5.0 * (b * b + c * c), 4.0 * FACETS);
    }
    let turn = Rotation3::from_euler_angles(0.6, 0.05, -0.08);
    for (axis, found) in solid.principal_axes.iter().enumerate() {
        assert!((Vector::from(*found).dot(&(turn * Vector::ith(axis, 1.0))).abs() - 1.0).abs() < 1e-9, "{found:?}");
    }
    let [x, y, z] = solid.principal_axes.map(Vector::from);
    assert!((x.cross(&y) - z).norm() < 1e-12);

    let ball = Shape::of(&laid(&ellipsoid([250.0; 3]))).solid.unwrap();
    near(ball.sphericity, 1.0, FACETS);
    near(ball.surface_per_volume_per_um, 3.0 / 250.0, 2.0 * FACETS);
}

#[test]
fn an_ellipsoids_slices_are_its_ellipses() {
    let [a, b, c] = [1900.0, 260.0, 190.0];
    let found = body(&laid(&ellipsoid([a, b, c])));
    // The mesh ends with its last ring.
    near(found.length_um, 2.0 * a * (PI / 400.0).cos(), 1e-6);
    near(found.slices_volume_share, 1.0, FACETS);
    assert!(found.axis_rms_um < 0.01 && found.bending.total_deg < 0.01, "{found:?}");
    assert_eq!(found.stations.len(), STATIONS);
    for station in &found.stations {
        let x = station.s_um / a - (PI / 400.0).cos();
        let size = (1.0 - x * x).sqrt();
        // Between rings of pi / 400 the chord is short by its square over 8 of the radius of curvature, more at the ends.
        let facets = FACETS + 2e-5 / (size * size);
        near(station.area_um2, PI * b * c * size * size, facets);
        near(station.height_um, 2.0 * b * size, facets);
        near(station.width_um, 2.0 * c * size, facets);
        let turn = Rotation3::from_euler_angles(0.6, 0.05, -0.08);
        let centre = turn * Vector::new(a * x, 0.0, 0.0) + Vector::new(120.0, -40.0, 75.0);
        assert!((Vector::from(station.centre_um) - centre).norm() < 0.02, "{station:?}");
    }
    assert_eq!((found.head.end, found.dorsal.direction), (None, None), "both ends and both sides of an ellipsoid are alike");
    assert!(found.head.confidence == 0.0 && found.dorsal.confidence == 0.0);
}

#[test]
fn a_capsule_has_the_sphericity_and_perimeter_of_one() {
    let (r, straight) = (200.0, 3000.0);
    let side = |t: f64| if t.cos() > 0.0 { -straight / 2.0 } else { straight / 2.0 };
    let mesh = tube(polar(201).map(|t| (side(t) - r * t.cos(), 0.0, [r * t.sin(); 2])));
    let shape = Shape::of(&laid(&mesh));
    let (volume, area) = (PI * r * r * (straight + 4.0 / 3.0 * r), TAU * r * (straight + 2.0 * r));
    let solid = shape.solid.unwrap();
    near(solid.sphericity, (36.0 * PI * volume * volume).cbrt() / area, FACETS);
    near(solid.surface_per_volume_per_um, area / volume, FACETS);
    let body = shape.body.unwrap();
    near(body.length_um, straight + 2.0 * r, 1e-4);
    near(body.stations[50].perimeter_um, TAU * r, FACETS / 2.0);
}

#[test]
fn a_boxs_slices_are_its_rectangle_to_the_last_digits() {
    let [a, b, c] = [3800.0, 500.0, 400.0];
    let ring =
        |x: f64| [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(|[y, z]| Vector::new(x, f64::from(y) * b / 2.0, f64::from(z) * c / 2.0)).to_vec();
    let shape = Shape::of(&laid(&lofted(&[ring(-a / 2.0), ring(a / 2.0)])));
    let solid = shape.solid.unwrap();
    near(solid.volume_um3, a * b * c, 1e-12);
    near(solid.sphericity, (36.0 * PI * (a * b * c).powi(2)).cbrt() / (2.0 * (a * b + b * c + c * a)), 1e-12);
    near(solid.principal_moments_um5[0], a * b * c * (b * b + c * c) / 12.0, 1e-10);
    let body = shape.body.unwrap();
    near(body.length_um, a, 1e-9);
    for station in &body.stations {
        near(station.area_um2, b * c, 1e-9);
        near(station.perimeter_um, 2.0 * (b + c), 1e-9);
        near(station.height_um, b, 1e-9);
        near(station.width_um, c, 1e-9);
    }
    near(body.bending.end_to_end_share, 1.0, 1e-12);
}

#[test]
fn a_bent_tube_has_its_arc_and_its_curvature() {
    for (bend, angle) in [(6000.0, 0.5), (2500.0, 1.2), (1500.0, PI / 2.0)] {
        let thick = 150.0;
        let found = body(&laid(&bow(bend, angle, thick)));
        near(found.length_um, bend * angle, 1e-3);
        near(found.slices_volume_share, 1.0, 1e-3);
        // Turned from the first station to the last: 99 of 100 parts of the arc. An end slice that stands a little aslant
        // turns the axis there, by 0.3 % of a right angle.
        near(found.bending.total_deg, 0.99 * angle.to_degrees(), 1e-2);
        // The second derivative of the quartic that is next to a quarter of a circle errs by 2.3 %.
        near(found.bending.max_curvature_per_mm, 1e3 / bend, 3e-2);
        near(found.bending.end_to_end_share, 2.0 * (angle / 2.0).sin() / angle, 1e-3);
        for station in &found.stations[5..95] {
            near(station.area_um2, PI * thick * thick, 1e-3);
        }
    }
}

#[test]
fn a_body_is_longer_by_what_the_silhouettes_show_beyond_its_surface() {
    let added_um = |body: &Body, beyond_um| {
        let mut longer = body.clone();
        longer.reach(beyond_um);
        longer.length_um - body.length_um
    };
    let straight = Shape::of(&cylinder(2000.0, 200, |_| 100.0)).body.unwrap();
    for (beyond_um, expected_um) in [([0.0; 2], 0.0), ([10.0, 30.0], 40.0), ([-100.0, 30.0], 30.0)] {
        assert!((added_um(&straight, beyond_um) - expected_um).abs() < 1e-6, "{beyond_um:?}");
    }
    // Where it is bent by nearly 45 deg at its ends, what it lacks along x is longer along the body.
    let bent = Shape::of(&bow(1000.0, PI / 2.0, 50.0)).body.unwrap();
    assert!((added_um(&bent, [10.0, 0.0]) - 10.0 * 2f64.sqrt()).abs() < 0.3, "{}", added_um(&bent, [10.0, 0.0]));
    // What lies beyond an end that leans by more than 60 deg, or that curls back, is not that end's.
    for angle in [0.75 * PI, 1.2 * PI] {
        let bent = Shape::of(&bow(1000.0, angle, 50.0)).body.unwrap();
        assert!(added_um(&bent, [10.0; 2]).abs() < 1e-9, "{angle}");
    }
}

#[test]
fn the_head_is_the_thicker_end_and_comes_first() {
    // 0.3 of the length at twice the radius: areas 4 : 1, the first moment is the difference of the ends' rectangles.
    let (thick, thin) = (0.3 * 4.0, 0.7);
    let moment = (thick * 0.35 - thin * 0.15) / (thick + thin) / 0.5;
    for (turn, end) in [(0.0, End::Left), (PI, End::Right)] {
        let mesh = cylinder(4000.0, 1000, |s| if s <= 0.3 { 240.0 } else { 120.0 });
        let found = body(&laid(&moved(&mesh, Rotation3::from_euler_angles(0.0, turn, 0.0), [0.0; 3])));
        assert_eq!((found.head.end, found.head.confidence), (Some(end), 1.0));
        // The step is a thousandth of the length wide.
        near(found.head.first_moment, moment, 5e-3);
        near(found.stations[10].area_um2, PI * 240.0 * 240.0, FACETS);
        near(found.stations[60].area_um2, PI * 120.0 * 120.0, FACETS);
        let [x, ..] = found.to_body.rotation[0];
        assert!(if end == End::Left { x > 0.99 } else { x < -0.99 }, "x runs from the head to the tail: {:?}", found.to_body);
    }
}

#[test]
fn the_back_is_where_the_belly_is_not_and_an_arch_is_no_belly() {
    let direction = |mesh: &Mesh| body(mesh).dorsal.direction.map(Vector::from);
    for turn in [0.0, 2.0, -1.3] {
        for half_turn in [0.0, PI] {
            let turned = Rotation3::from_euler_angles(turn, half_turn, 0.0);
            for (belly, up) in [(120.0, -1.0), (-120.0, 1.0)] {
                let found = direction(&moved(&fish(belly, 0.0), turned, [0.0; 3])).unwrap();
                let wanted = turned * Vector::y() * up;
                // The direction stands across the body's long one, which leans a little towards the belly.
                assert!(found.dot(&wanted) > 0.995, "{found} is not {wanted}");
            }
        }
    }
    for arch in [0.0, 200.0, -200.0] {
        let found = body(&fish(0.0, arch));
        assert_eq!((found.head.end, found.dorsal.direction), (Some(End::Left), None), "{:?}", found.dorsal);
    }
    // A round body has a belly side, but not a median plane to look for it in.
    let round = Mesh { vertices: fish(120.0, 0.0).vertices.iter().map(|&[x, y, z]| [x, y, 2.0 * z]).collect(), ..fish(120.0, 0.0) };
    let found = body(&round).dorsal;
    assert!(found.direction.is_none() && found.median_share < 0.05, "{found:?}");
}

#[test]
fn one_specimen_laid_in_two_ways_is_the_same_slice_by_slice() {
    let mesh = fish(120.0, 80.0);
    let ways = [Rotation3::from_euler_angles(0.3, 0.04, 0.06), Rotation3::from_euler_angles(-2.5, PI - 0.05, -0.03)];
    let [one, other] = ways.map(|turn| body(&moved(&mesh, turn, [70.0, 30.0, -20.0])));
    near(one.length_um, other.length_um, 1e-6);
    for body in [&one, &other] {
        let rows = body.to_body.rotation.map(Vector::from);
        assert!((rows[0].cross(&rows[1]) - rows[2]).norm() < 1e-12 && rows[0].dot(&rows[1]).abs() < 1e-12);
    }
    for (a, b) in one.stations.iter().zip(&other.stations) {
        near(a.area_um2, b.area_um2, 1e-6);
        near(a.height_um, b.height_um, 1e-4);
        near(a.width_um, b.width_um, 1e-4);
        let [p, q] = [one.to_body.apply(a.centre_um), other.to_body.apply(b.centre_um)];
        assert!((0..3).all(|k| (p[k] - q[k]).abs() < 1e-2), "{p:?} and {q:?}");
    }
    // Head first, back up: x grows along the body, the yolk hangs towards +y.
    let at = |i: usize| one.to_body.apply(one.stations[i].centre_um);
    assert!(at(0)[0] < at(99)[0] && at(26)[1] > at(50)[1] + 20.0, "{:?} {:?}", at(26), at(50));
}

#[test]
fn a_balls_power_is_its_squared_radius_in_degree_1() {
    let found = Shape::of(&laid(&ellipsoid([250.0; 3]))).harmonics.unwrap();
    // Facets, and the latitudes of flat triangles: a thousandth.
    near(found.power_um2[0], 250.0 * 250.0, 1e-3);
    assert!(found.power_share[1..].iter().all(|&p| p < 1e-6) && found.finer_um2 < 1e-4 * 250.0 * 250.0, "{found:?}");
}

/// Along a spheroid's axis x = f(z), where z is what is left of the area; in the ring there, r. Orthonormal harmonics of both by
/// sums over fine steps of the angle, which share nothing with meshes and slices.
#[test]
fn a_spheroids_power_is_that_of_its_integrals() {
    let (a, b) = (1500.0, 250.0);
    let n = 200_000;
    let step = PI / f64::from(n);
    let rings: Vec<[f64; 3]> = (0..n)
        .map(|i| {
            let (sin, cos) = ((f64::from(i) + 0.5) * step).sin_cos();
            [a * cos, b * sin, b * sin * (a * sin).hypot(b * cos) * step]
        })
        .collect();
    let whole: f64 = rings.iter().map(|r| r[2]).sum();
    let (mut ahead, mut axial, mut radial) = (0.0, [0.0; 4], [0.0; 4]);
    for [x, r, area] in rings {
        let z = 1.0 - 2.0 * (ahead + area / 2.0) / whole;
        ahead += area;
        let dz = 2.0 * area / whole;
        let ring = (1.0 - z * z).sqrt();
        let p = [z, (3.0 * z * z - 1.0) / 2.0, (5.0 * z.powi(3) - 3.0 * z) / 2.0];
        let slope = [1.0, 3.0 * z, (15.0 * z * z - 3.0) / 2.0];
        for l in 1..=3 {
            axial[l] += x * p[l - 1] * dz;
            radial[l] += r * ring * slope[l - 1] * dz;
        }
    }
    let found = Shape::of(&laid(&ellipsoid([a, b, b]))).harmonics.unwrap();
    for l in 1..=3 {
        let degree = l as f64;
        // x has order 0, y and z are alike with order 1: Int P_l^2 dz = 2 / (2l + 1), Int (P_l^1)^2 dz is l (l + 1) times that.
        let wanted = (2.0 * degree + 1.0) / 4.0 * (axial[l].powi(2) + radial[l].powi(2) / (degree * (degree + 1.0)));
        let (found, sum) = (found.power_um2[l - 1], found.power_um2[0]);
        assert!((found - wanted).abs() < 1e-3 * sum, "degree {l}: {found} is not {wanted}");
    }
}

#[test]
fn power_does_not_depend_on_place_and_turn_and_grows_with_the_square_of_size() {
    let mesh = fish(120.0, 80.0);
    let plain = Shape::of(&mesh).harmonics.unwrap();
    let larger = Mesh { vertices: mesh.vertices.iter().map(|v| v.map(|x| 1.5 * x)).collect(), triangles: mesh.triangles.clone() };
    let turned = moved(&larger, Rotation3::from_euler_angles(-2.5, PI - 0.05, -0.03), [300.0, -80.0, 40.0]);
    let found = Shape::of(&turned).harmonics.unwrap();
    let sum: f64 = plain.power_um2.iter().sum();
    for (a, b) in plain.power_um2.iter().zip(&found.power_um2) {
        assert!((b / 2.25 - a).abs() < 2e-5 * sum, "{plain:?} and {found:?}");
    }
}

/// Two meshes as one.
fn both(mesh: &Mesh, other: &Mesh) -> Mesh {
    let first = mesh.vertices.len() as u32;
    let triangles = other.triangles.iter().map(|t| t.map(|v| v + first));
    Mesh {
        vertices: mesh.vertices.iter().chain(&other.vertices).copied().collect(),
        triangles: mesh.triangles.iter().copied().chain(triangles).collect(),
    }
}

#[test]
fn a_loose_tip_of_a_fin_leaves_the_body_its_axis_and_is_missing_in_its_slices() {
    let whole = fish(120.0, 80.0);
    let end = whole.vertices.iter().map(|v| v[0]).fold(f64::NEG_INFINITY, f64::max);
    let tip = moved(&ellipsoid([40.0, 60.0, 15.0]), Rotation3::identity(), [end + 160.0, 0.0, 0.0]);
    for torn in [both(&whole, &tip), both(&tip, &whole)] {
        assert_eq!(torn.largest_piece().unwrap().vertices.len(), whole.vertices.len());
        let (found, alone) = (Shape::of(&torn), Shape::of(&whole));
        let (found_body, alone_body) = (found.body.unwrap_or_else(|| panic!("{:?}", found.body_reason)), alone.body.unwrap());
        near(found_body.length_um, alone_body.length_um, 1e-3);
        let missing = 1.0 - alone.solid.unwrap().volume_um3 / found.solid.unwrap().volume_um3;
        let lost = alone_body.slices_volume_share - found_body.slices_volume_share;
        assert!(missing > 1e-4 && (lost - missing).abs() < 0.1 * missing, "{lost:e} of the slices, {missing:e} of the volume");
        assert!(found.harmonics.is_some());
    }
    assert_eq!(whole.largest_piece(), None);
    assert_eq!(Mesh::default().largest_piece(), None);
}

#[test]
fn what_has_no_shape_is_refused_by_name() {
    let said = |mesh: &Mesh| {
        let Shape { solid_reason, body_reason, harmonics_reason, .. } = Shape::of(mesh);
        [solid_reason, body_reason, harmonics_reason].map(Option::unwrap_or_default)
    };
    let ball = ellipsoid([250.0; 3]);
    let mut open = ball.clone();
    open.triangles.pop();
    assert!(said(&open)[0].contains("not closed"), "{:?}", said(&open));
    let inside_out = Mesh { triangles: ball.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(), ..ball.clone() };
    assert!(said(&inside_out)[0].contains("-6.5"), "{:?}", said(&inside_out));
    assert!(said(&Mesh::default())[0].contains("0 triangles"));

    let two = both(&moved(&ball, Rotation3::identity(), [-900.0, 0.0, 0.0]), &moved(&ball, Rotation3::identity(), [900.0, 0.0, 0.0]));
    let [solid, body, harmonics] = said(&two);
    assert!(solid.is_empty() && body.contains("in pieces") && harmonics.contains("axis"), "{body} {harmonics}");

    // Bent into three quarters of a ring.
    let [solid, body, _] = said(&bow(700.0, 1.5 * PI, 150.0));
    assert!(solid.is_empty() && !body.is_empty());

    // A gutter: its slices' centres lie outside of it.
    let ring = |x: f64| {
        let around = |k: usize| {
            let out = k < AROUND / 2;
            let k = if out { k } else { AROUND - 1 - k };
            let (sin, cos) = (1.7 * PI * k as f64 / (AROUND / 2 - 1) as f64).sin_cos();
            Vector::new(x, cos, sin).component_mul(&if out { Vector::new(1.0, 300.0, 300.0) } else { Vector::new(1.0, 240.0, 240.0) })
        };
        (0..AROUND).map(around).collect()
    };
    let gutter = lofted(&(0..=200).map(|i| ring(20.0 * f64::from(i))).collect::<Vec<_>>());
    let [solid, _, harmonics] = said(&gutter);
    assert!(solid.is_empty() && harmonics.contains("star-shaped"), "{harmonics}");
}

#[test]
fn a_shape_is_the_same_bits_on_any_number_of_threads_and_survives_being_written_down() {
    let mesh = laid(&fish(120.0, 80.0));
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        serde_json::to_string(&pool.install(|| Shape::of(&mesh))).unwrap()
    };
    let one = on(1);
    assert!([2, 3, 8].into_iter().all(|threads| on(threads) == one));
    assert_eq!(serde_json::to_string(&serde_json::from_str::<Shape>(&one).unwrap()).unwrap(), one);
    for key in ["length_um", "area_um2", "width_um", "height_um", "perimeter_um", "centre_um", "power_um2", "principal_moments_um5"] {
        assert!(one.contains(&format!("\"{key}\":")), "{key}");
    }
}
