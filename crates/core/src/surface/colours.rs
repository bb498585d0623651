//! Colours of a surface, from the frames that it was measured from.
//!
//! ```text
//!  vertex ─┬─ projection of a view ── place in its frame, between four pixels ── colour ─┐
//!          └─ cosine between normal and direction to the camera ── fourth power: weight ─┴─ mean over the views
//! ```
//! A frame shows the light that passed through the specimen. The colour at a vertex is therefore that of the whole depth behind it, seen
//! along its normal. Whether another part of the specimen lies in front of it is not considered, because that part is transparent, too.
//! The fourth power favours the views that face the surface, and makes the changes from one view to the next gradual.

use super::Mesh;
use crate::geometry::Projection;
use crate::profile::Picture;

/// Weight of a view that does not face the vertex. It decides only where no view does, as at the ends of the specimen.
const LEAST_WEIGHT: f64 = 1e-4;

/// Blends frames at the vertices of a mesh.
#[derive(Debug)]
pub struct Colours<'a> {
    mesh: &'a Mesh,
    normals: Vec<[f64; 3]>,
    /// Weighted sum of the colours of each vertex, and sum of the weights.
    sums: Vec<([f64; 3], f64)>,
}

impl<'a> Colours<'a> {
    /// No frame is blended yet. The mesh has the unit of the projections, um.
    pub fn new(mesh: &'a Mesh) -> Self {
        Self { mesh, normals: mesh.normals(), sums: vec![([0.0; 3], 0.0); mesh.vertices.len()] }
    }

    /// Adds the frame of a view.
    pub fn add(&mut self, projection: &Projection, picture: &Picture) {
        let lookup = projection.lookup();
        for ((&vertex, normal), (sum, total)) in self.mesh.vertices.iter().zip(&self.normals).zip(&mut self.sums) {
            let Some(colour) = lookup.project(vertex).and_then(|at| between_pixels(picture, at)) else { continue };
            // The depth falls by the cosine along a step of length 1 towards the camera.
            let outside: [f64; 3] = std::array::from_fn(|i| vertex[i] + normal[i]);
            let cosine = (projection.depth(vertex) - projection.depth(outside)).clamp(0.0, 1.0);
            let weight = cosine.powi(4).max(LEAST_WEIGHT);
            sum.iter_mut().zip(colour).for_each(|(sum, part)| *sum += weight * part);
            *total += weight;
        }
    }

    /// Red, green and blue of each vertex, 0 to 255 as in the frames. `None` for a vertex that no frame shows.
    pub fn finish(self) -> Vec<Option<[f64; 3]>> {
        self.sums.into_iter().map(|(sum, total)| (total > 0.0).then(|| sum.map(|s| s / total))).collect()
    }
}

/// The colour at a place (u, v) in px, linear between the centres of four pixels. `None` outside the picture.
fn between_pixels(picture: &Picture, (u, v): (f64, f64)) -> Option<[f64; 3]> {
    let (right, bottom) = (picture.width().checked_sub(1)?, picture.height().checked_sub(1)?);
    if !(u >= 0.0 && v >= 0.0 && u <= right as f64 && v <= bottom as f64) {
        return None;
    }
    let (x, y) = (u as usize, v as usize);
    let (du, dv) = (u - x as f64, v - y as f64);
    Some(picture.planes().each_ref().map(|plane| {
        let at = |x: usize, y: usize| f64::from(plane[y.min(bottom) * picture.width() + x.min(right)]);
        (1.0 - dv) * ((1.0 - du) * at(x, y) + du * at(x + 1, y)) + dv * ((1.0 - du) * at(x, y + 1) + du * at(x + 1, y + 1))
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{PixelFormat, RawFrame};
    use crate::geometry::Camera;

    const VIEWS: u32 = 8;
    const RADIUS_UM: f64 = 100.0;

    /// A ball about the axis: rings along x, from pole to pole.
    fn ball() -> Mesh {
        let (rings, around) = (15u32, 24u32);
        let mut vertices = Vec::new();
        for ring in 0..=rings {
            let (sin, cos) = (std::f64::consts::PI * f64::from(ring) / f64::from(rings)).sin_cos();
            vertices.extend((0..around).map(|i| {
                let (z, y) = (std::f64::consts::TAU * f64::from(i) / f64::from(around)).sin_cos();
                [-RADIUS_UM * cos, RADIUS_UM * sin * y, RADIUS_UM * sin * z]
            }));
        }
        let id = |ring: u32, i: u32| ring * around + i % around;
        let squares = (0..rings).flat_map(|ring| (0..around).map(move |i| (ring, i)));
        let triangles = squares
            .flat_map(|(ring, i)| {
                let [a, b, c, d] = [id(ring, i), id(ring, i + 1), id(ring + 1, i + 1), id(ring + 1, i)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        Mesh { vertices, triangles }
    }

    fn omega(view: u32) -> f64 {
        std::f64::consts::TAU * f64::from(view) / f64::from(VIEWS)
    }

    /// Red is the column, green the view, blue nothing.
    fn colours(mesh: &Mesh, camera: &Camera) -> Vec<Option<[f64; 3]>> {
        let mut colours = Colours::new(mesh);
        for view in 0..VIEWS {
            let bytes = (0..camera.width * camera.height).flat_map(|i| [(i % camera.width) as u8, 20 * view as u8, 0]);
            let frame = RawFrame::new(camera.width, camera.height, PixelFormat::RGB8Packed, bytes.collect()).unwrap();
            colours.add(&camera.projection(omega(view)), &Picture::from_frame(&frame));
        }
        colours.finish()
    }

    fn camera() -> Camera {
        Camera { f: 1e6, kx: 0.5, ky: 0.5, ..Camera::published(200, 200) }
    }

    #[test]
    fn a_colour_that_all_views_show_at_a_place_is_the_colour_of_that_place() {
        let (mesh, camera) = (ball(), camera());
        for (vertex, colour) in mesh.vertices.iter().zip(colours(&mesh, &camera)) {
            let [red, _, blue] = colour.unwrap();
            // The column of the place; the perspective of the distant camera is 0.01 % of it.
            assert!((red - (camera.ux + camera.kx * vertex[0])).abs() < 0.02 && blue == 0.0, "{vertex:?}: {red}");
        }
    }

    #[test]
    fn a_vertex_has_the_colours_of_the_views_that_face_it() {
        let (mesh, camera) = (ball(), camera());
        let normals = mesh.normals();
        let colours = colours(&mesh, &camera);
        for view in 0..VIEWS {
            let projection = camera.projection(omega(view));
            let depth = |x: [f64; 3]| projection.depth(x);
            let nearest = (0..mesh.vertices.len()).min_by(|&a, &b| depth(mesh.vertices[a]).total_cmp(&depth(mesh.vertices[b]))).unwrap();
            // By hand: the eight weights of the fourth power, at multiples of 45 deg from the nearest vertex.
            let facing = |k: u32| {
                let p = camera.projection(omega(k));
                let outside: [f64; 3] = std::array::from_fn(|i| mesh.vertices[nearest][i] + normals[nearest][i]);
                (p.depth(mesh.vertices[nearest]) - p.depth(outside)).max(0.0)
            };
            assert!(facing(view) > 0.99);
            let weights: Vec<f64> = (0..VIEWS).map(|k| facing(k).powi(4)).collect();
            let expected = (0..VIEWS).map(|k| weights[k as usize] * 20.0 * f64::from(k)).sum::<f64>() / weights.iter().sum::<f64>();
            let found = colours[nearest].unwrap()[1];
            assert!((found - expected).abs() < 0.2, "view {view}: {found}, expected {expected}");
        }
    }

    #[test]
    fn a_vertex_outside_every_frame_has_no_colour() {
        let narrow = Camera { width: 80, ux: 39.5, ..camera() };
        let mesh = ball();
        for (vertex, colour) in mesh.vertices.iter().zip(colours(&mesh, &narrow)) {
            assert_eq!(colour.is_some(), vertex[0].abs() < 79.0, "{vertex:?}");
        }
        assert!(Colours::new(&mesh).finish().iter().all(Option::is_none));
    }
}
