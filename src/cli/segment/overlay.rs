//! The picture with the results drawn into it: the outline with sub-pixel vertices, and the walls as lines.

use carved_core::profile::{Line, Picture, Profile};

const OUTLINE: [u8; 3] = [255, 64, 160];
const WALL: [u8; 3] = [0, 160, 255];
/// Distance of the samples along a line, px: small enough to leave no gap between the pixels.
const STEP_PX: f64 = 0.25;

/// The RGB bytes, of the same size as the picture.
pub(super) fn draw(picture: &Picture, profile: &Profile) -> Vec<u8> {
    let mut canvas = Canvas { width: picture.width(), height: picture.height(), rgb: picture.to_rgb() };
    let last_u = (picture.width() - 1) as f64;
    for wall in [&profile.walls.upper, &profile.walls.lower] {
        for line in [&wall.inner, &wall.outer] {
            let at = |line: &Line, u: f64| [u, line.at(u)];
            canvas.line(at(line, 0.0), at(line, last_u), WALL);
        }
    }
    for polygon in &profile.edge {
        let vertices = &polygon.vertices;
        for (from, to) in vertices.iter().zip(vertices.iter().cycle().skip(1)) {
            canvas.line(*from, *to, OUTLINE);
        }
    }
    canvas.rgb
}

struct Canvas {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Canvas {
    fn line(&mut self, from: [f64; 2], to: [f64; 2], colour: [u8; 3]) {
        let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / STEP_PX).ceil().max(1.0) as usize;
        for k in 0..=steps {
            let part = k as f64 / steps as f64;
            let (u, v) = ((from[0] + part * (to[0] - from[0])).round(), (from[1] + part * (to[1] - from[1])).round());
            if u >= 0.0 && v >= 0.0 && (u as usize) < self.width && (v as usize) < self.height {
                let at = (v as usize * self.width + u as usize) * 3;
                self.rgb[at..at + 3].copy_from_slice(&colour);
            }
        }
    }
}
