//! The model of a specimen from three sides, drawn in one picture at one scale.
//!
//! ```text
//!   from the side   from the front        side:  x right, y down        x: from head to tail
//!   from above                            above: x right, -z down       y: from back to belly
//!   ---- 500 um                           front: -z right, y down       z: away from who sees the left side
//! ```
//! The axes are those of the body. A bead, and a larva whose back is not known, has those of the world, of which x is along the capillary.

use carved_core::surface::Mesh;
use image::{Rgb, RgbImage, imageops};

/// Width of the picture, px.
const WIDTH: u32 = 360;
/// Pixels that are drawn for each pixel of the picture, in each direction: smooth borders.
const FINER: u32 = 2;
/// Space between the sides, px of the picture.
const GAP: f64 = 8.0;
/// Length of the scale bar, um.
pub const BAR_UM: f64 = 500.0;
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);
const INK: Rgb<u8> = Rgb([60, 60, 60]);
/// Colour of a surface that faces the light.
const SURFACE: [f64; 3] = [196.0, 208.0, 222.0];
/// Where the light comes from: over the left shoulder of who looks. Right, down, away.
const LIGHT: [f64; 3] = [-0.41, -0.51, -0.76];
/// Brightness of a surface that the light does not reach.
const AMBIENT: f64 = 0.28;

type Vector = [f64; 3];

/// Right, down and away from who looks, as directions of the body: a right-handed frame.
const SIDE: [Vector; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const ABOVE: [Vector; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]];
const FRONT: [Vector; 3] = [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]];

fn dot(a: Vector, b: Vector) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn turned(rows: &[Vector; 3], v: Vector) -> Vector {
    rows.map(|row| dot(row, v))
}

/// Draws a model. `to_body`: rows of the rotation from the world to the body. `None` for a model without triangles.
pub fn from_three_sides(mesh: &Mesh, to_body: Option<[[f64; 3]; 3]>) -> Option<RgbImage> {
    let rows = to_body.unwrap_or(SIDE);
    let of_body = |vectors: Vec<Vector>| -> Vec<Vector> { vectors.into_iter().map(|v| turned(&rows, v)).collect() };
    let (points, normals) = (of_body(mesh.vertices.clone()), of_body(mesh.normals()));
    let sides = [SIDE, FRONT, ABOVE].map(|axes| View::of(&axes, &points, &normals));
    let [[length, height], [depth, _], [_, above]] = sides.each_ref().map(View::extents);
    let scale = f64::from(FINER) * (f64::from(WIDTH) - 3.0 * GAP) / (length + depth);
    if !scale.is_finite() || mesh.triangles.is_empty() {
        return None;
    }
    let gap = f64::from(FINER) * GAP;
    let (second_column, second_row) = (2.0 * gap + length * scale, 2.0 * gap + height * scale);
    let bottom = second_row + above * scale + gap;
    let mut picture = RgbImage::from_pixel(FINER * WIDTH, bottom.ceil() as u32 + 3 * FINER, PAPER);
    for (side, corner) in sides.iter().zip([[gap, gap], [second_column, gap], [gap, second_row]]) {
        side.draw(mesh, scale, corner, &mut picture);
    }
    let bar = (BAR_UM * scale) as u32;
    for (u, v) in (0..bar).flat_map(|u| (0..FINER).map(move |v| (u, v))) {
        let (u, v) = (second_column as u32 + u, bottom as u32 - gap as u32 + v);
        if u < picture.width() {
            picture.put_pixel(u, v, INK);
        }
    }
    Some(imageops::thumbnail(&picture, picture.width() / FINER, picture.height() / FINER))
}

/// The model as it is seen from one side.
struct View {
    /// Right, down, away, um.
    points: Vec<Vector>,
    /// Share of the colour of each vertex.
    brightness: Vec<f64>,
    low: Vector,
    high: Vector,
}

impl View {
    fn of(axes: &[Vector; 3], points: &[Vector], normals: &[Vector]) -> Self {
        let points: Vec<Vector> = points.iter().map(|p| turned(axes, *p)).collect();
        let lit = |normal: &Vector| AMBIENT + (1.0 - AMBIENT) * dot(turned(axes, *normal), LIGHT).max(0.0);
        let brightness = normals.iter().map(lit).collect();
        let bound = |start: f64, pick: fn(f64, f64) -> f64| points.iter().fold([start; 3], |b, p| [0, 1, 2].map(|i| pick(b[i], p[i])));
        let (low, high) = (bound(f64::INFINITY, f64::min), bound(f64::NEG_INFINITY, f64::max));
        Self { points, brightness, low, high }
    }

    /// Extents to the right and down, um.
    fn extents(&self) -> [f64; 2] {
        [self.high[0] - self.low[0], self.high[1] - self.low[1]]
    }

    /// Draws the model with its upper left corner at `corner`, `scale` pixels per um. Nearer triangles hide those behind them.
    fn draw(&self, mesh: &Mesh, scale: f64, corner: [f64; 2], picture: &mut RgbImage) {
        let (width, height) = picture.dimensions();
        let mut nearest = vec![f64::INFINITY; width as usize * height as usize];
        let at = |vertex: u32| {
            let p = self.points[vertex as usize];
            [corner[0] + (p[0] - self.low[0]) * scale, corner[1] + (p[1] - self.low[1]) * scale, p[2]]
        };
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(at);
            let area = cross(a, b, c);
            if area == 0.0 {
                continue;
            }
            let brightness = triangle.map(|vertex| self.brightness[vertex as usize]);
            let range = |i: usize, end: u32| {
                let (low, high) = (a[i].min(b[i]).min(c[i]), a[i].max(b[i]).max(c[i]));
                (low.floor().max(0.0) as u32)..(high.ceil().max(0.0) as u32 + 1).min(end)
            };
            let columns = range(0, width);
            for v in range(1, height) {
                for u in columns.clone() {
                    let pixel = [f64::from(u) + 0.5, f64::from(v) + 0.5, 0.0];
                    let shares = [cross(pixel, b, c), cross(a, pixel, c), cross(a, b, pixel)].map(|part| part / area);
                    if shares.iter().any(|share| *share < 0.0) {
                        continue;
                    }
                    let away = dot(shares, [a[2], b[2], c[2]]);
                    let place = &mut nearest[v as usize * width as usize + u as usize];
                    if away < *place {
                        *place = away;
                        let lit = dot(shares, brightness);
                        picture.put_pixel(u, v, Rgb(SURFACE.map(|channel| (channel * lit).round().clamp(0.0, 255.0) as u8)));
                    }
                }
            }
        }
    }
}

/// Twice the area of a triangle in the picture.
fn cross(a: Vector, b: Vector, c: Vector) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box with its corners at these places.
    fn cuboid(low: Vector, high: Vector) -> Mesh {
        let vertices = (0..8).map(|i| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high[axis] } else { low[axis] })).collect();
        let faces: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Mesh { vertices, triangles: faces.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect() }
    }

    fn is_drawn(picture: &RgbImage, u: f64, v: f64) -> bool {
        picture.get_pixel(u as u32, v as u32).0.iter().any(|&channel| channel < 230)
    }

    #[test]
    fn the_three_sides_have_the_extents_of_the_body() {
        // 3000 long, 600 high, 400 wide; and a small part on the back behind the head.
        let mut mesh = cuboid([0.0, -300.0, -200.0], [3000.0, 300.0, 200.0]);
        let eye = cuboid([100.0, -400.0, 50.0], [300.0, -300.0, 150.0]);
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(&eye.vertices);
        mesh.triangles.extend(eye.triangles.iter().map(|t| t.map(|v| v + first)));
        let picture = from_three_sides(&mesh, None).unwrap();
        let scale = (f64::from(WIDTH) - 3.0 * GAP) / 3400.0;
        let at = |corner: [f64; 2], um: [f64; 2]| is_drawn(&picture, corner[0] + um[0] * scale, corner[1] + um[1] * scale);
        let side = [GAP, GAP];
        assert!(at(side, [200.0, 50.0]), "the part on the back is above");
        assert!(!at(side, [1000.0, 50.0]) && at(side, [1000.0, 400.0]) && at(side, [2950.0, 650.0]));
        let front = [2.0 * GAP + 3000.0 * scale, GAP];
        // z from 50 to 150 is on the left of who looks along x: -z is to the right.
        assert!(at(front, [100.0, 50.0]) && !at(front, [300.0, 50.0]) && at(front, [300.0, 400.0]));
        let above = [GAP, 2.0 * GAP + 700.0 * scale];
        assert!(at(above, [1500.0, 200.0]) && at(above, [2950.0, 350.0]));
        assert_eq!(picture.width(), WIDTH);
    }

    #[test]
    fn the_axes_are_those_of_the_body_where_it_is_known() {
        let mesh = cuboid([0.0; 3], [1000.0, 300.0, 100.0]);
        let height = |to_body| from_three_sides(&mesh, to_body).unwrap().height();
        // A body that lies on its side: height and width change places, their sum stays.
        let lying = Some([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]);
        assert!(height(None) > height(lying), "its front is narrower, so its scale is larger: {} {}", height(None), height(lying));
        assert_eq!(from_three_sides(&Mesh::default(), None), None);
    }
}
