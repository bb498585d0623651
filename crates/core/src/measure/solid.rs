//! Area, volume and place of what a closed mesh bounds.

use crate::surface::Mesh;

/// Area by Heron's formula, um^2 for a mesh in um. It is in Kahan's form, with sorted sides and kept brackets, so that needles
/// do not lose their digits.
pub fn area(mesh: &Mesh) -> f64 {
    mesh.triangles.iter().map(|&t| heron(mesh.corners(t))).sum()
}

fn heron([p, q, r]: [[f64; 3]; 3]) -> f64 {
    let length = |a: [f64; 3], b: [f64; 3]| (0..3).map(|i| (a[i] - b[i]) * (a[i] - b[i])).sum::<f64>().sqrt();
    let mut sides = [length(p, q), length(q, r), length(r, p)];
    sides.sort_unstable_by(|x, y| y.total_cmp(x));
    let [a, b, c] = sides;
    // Rounding may make the excess of two sides over the third a little negative where it is 0.
    let excess = (c - (a - b)).max(0.0);
    0.25 * ((a + (b + c)) * excess * (c + (a - b)) * (a + (b - c))).sqrt()
}

/// Signed volume, um^3 for a mesh in um. Positive for triangles that turn counter-clockwise seen from outside.
pub fn volume(mesh: &Mesh) -> f64 {
    let base = base(mesh);
    mesh.triangles.iter().map(|&t| tetrahedron(mesh.corners(t), base).0).sum()
}

/// Centre of mass of the enclosed volume. `None` where none is enclosed.
pub fn centroid(mesh: &Mesh) -> Option<[f64; 3]> {
    let base = base(mesh);
    let (mut volume, mut moment) = (0.0, [0.0; 3]);
    for &triangle in &mesh.triangles {
        let (v, sum) = tetrahedron(mesh.corners(triangle), base);
        volume += v;
        (0..3).for_each(|i| moment[i] += v * sum[i] / 4.0);
    }
    (volume != 0.0).then(|| std::array::from_fn(|i| base[i] + moment[i] / volume))
}

/// Tips of tetrahedra near the body keep the terms as small as the sum.
fn base(mesh: &Mesh) -> [f64; 3] {
    mesh.vertices.first().copied().unwrap_or_default()
}

/// Signed volume of the tetrahedron over a triangle with its tip at `base`, and the sum of its corners seen from there.
fn tetrahedron(corners: [[f64; 3]; 3], base: [f64; 3]) -> (f64, [f64; 3]) {
    let [a, b, c]: [[f64; 3]; 3] = corners.map(|p| std::array::from_fn(|i| p[i] - base[i]));
    let v = a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
    (v / 6.0, std::array::from_fn(|i| a[i] + b[i] + c[i]))
}

/// The axis-parallel box around a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extents {
    /// Least coordinates.
    pub min: [f64; 3],
    /// Largest coordinates.
    pub max: [f64; 3],
}

impl Extents {
    /// Lengths of its sides.
    pub fn sides(&self) -> [f64; 3] {
        std::array::from_fn(|a| self.max[a] - self.min[a])
    }
}

/// The box around a mesh. `None` for a mesh without vertices.
pub fn extents(mesh: &Mesh) -> Option<Extents> {
    let &first = mesh.vertices.first()?;
    let start = Extents { min: first, max: first };
    Some(
        mesh.vertices.iter().fold(start, |e, v| Extents {
            min: std::array::from_fn(|a| e.min[a].min(v[a])),
            max: std::array::from_fn(|a| e.max[a].max(v[a])),
        }),
    )
}
