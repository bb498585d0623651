//! Coverage of pixels by outlines: the exact part of each pixel that lies inside.
//!
//! ```text
//!        row    0  0 .4  1  1  1 .7  0     each side of the outline adds, in every row that it passes, its height there to
//!                  /           \           all pixels to its right, and to the pixels that it crosses their part of it:
//!                 /             \          running sums along the row are then the coverage
//! ```

use crate::scene::{Coverage, Outline};

/// Coverage by outlines. They must lie within the sensor, run clockwise and not overlap.
pub fn coverage(outlines: &[Outline], width: u32, height: u32) -> Coverage {
    let (columns, rows) = (width as usize, height as usize);
    // One more pixel at the right takes what lies on the border of the sensor.
    let stride = columns + 2;
    let mut changes = vec![0.0f64; stride * rows];
    for outline in outlines {
        for (p, q) in outline.iter().zip(outline.iter().cycle().skip(1)) {
            // From here on pixel borders are at integers.
            let place = |[u, v]: [f64; 2]| [(u + 0.5).clamp(0.0, f64::from(width)), (v + 0.5).clamp(0.0, f64::from(height))];
            add_side(&mut changes, stride, place(*p), place(*q));
        }
    }
    let mut data = Vec::with_capacity(columns * rows);
    for row in changes.chunks_exact(stride) {
        let mut covered = 0.0;
        for change in &row[..columns] {
            covered += change;
            data.push((255.0 * covered.clamp(0.0, 1.0)).round() as u8);
        }
    }
    Coverage { width, height, data }
}

fn add_side(changes: &mut [f64], stride: usize, p: [f64; 2], q: [f64; 2]) {
    // Upwards on the screen is where a clockwise outline has its inside to the right.
    let (sign, top, bottom) = if p[1] > q[1] { (1.0, q, p) } else { (-1.0, p, q) };
    if bottom[1] <= top[1] {
        return;
    }
    let slope = (bottom[0] - top[0]) / (bottom[1] - top[1]);
    let (left, right) = (top[0].min(bottom[0]), top[0].max(bottom[0]));
    let at = |v: f64| (top[0] + slope * (v - top[1])).clamp(left, right);
    for row in top[1].floor() as usize..bottom[1].ceil() as usize {
        let (from, to) = (top[1].max(row as f64), bottom[1].min(row as f64 + 1.0));
        if to > from {
            add_piece(&mut changes[row * stride..(row + 1) * stride], sign * (to - from), at(from), at(to));
        }
    }
}

/// A side within one row: its height there, spread evenly over the columns between both ends.
fn add_piece(row: &mut [f64], height: f64, u0: f64, u1: f64) {
    let (from, to) = (u0.min(u1), u0.max(u1));
    let (first, last) = (from.floor() as usize, to.floor() as usize);
    for column in first..=last {
        let (a, b) = (from.max(column as f64), to.min(column as f64 + 1.0));
        let part = if to > from { height * (b - a) / (to - from) } else { height };
        // What lies right of its middle within the pixel is covered in this pixel, the rest in the next.
        let here = column as f64 + 1.0 - f64::midpoint(a, b);
        row[column] += part * here;
        row[column + 1] += part * (1.0 - here);
    }
}

#[cfg(test)]
mod tests {
    use super::super::union::area_px2;
    use super::super::views::within;
    use super::*;
    use crate::analytic::{Phantom, Pose};
    use crate::scene::Camera;

    /// Each pixel against the outline cut off at that pixel's four sides.
    fn assert_exact(outline: &Outline, width: u32, height: u32) {
        let found = coverage(std::slice::from_ref(outline), width, height);
        for v in 0..height {
            for u in 0..width {
                let own: Outline = outline.iter().map(|p| [p[0] - f64::from(u), p[1] - f64::from(v)]).collect();
                let cut = within(own, 1, 1);
                let exact = if cut.len() < 3 { 0.0 } else { 255.0 * area_px2(&cut) };
                let value = f64::from(found.data[(v * width + u) as usize]);
                assert!((value - exact).abs() < 0.5 + 1e-6, "{value} against {exact} at ({u}, {v})");
            }
        }
    }

    #[test]
    fn coverage_is_the_part_of_a_pixel_inside_the_outline() {
        assert_exact(&vec![[2.3, 1.2], [9.4, 3.9], [7.1, 8.25], [6.9, 4.4], [1.0, 7.7]], 12, 10);
        assert_exact(&vec![[-0.5, -0.5], [11.5, -0.5], [11.5, 2.0], [3.0, 9.5], [-0.5, 9.5]], 12, 10);
        assert_exact(&vec![[2.0, 2.5], [5.25, 2.5], [5.25, 4.5], [2.0, 4.5]], 12, 10);
    }

    #[test]
    fn a_larva_covers_its_outlines_area() {
        let camera = Camera { gamma_rad: 0.01, ..Camera::default() };
        let outline = Phantom::finned(4, 7).unwrap().placed(Pose::seeded(7)).outline(&camera, 1.0);
        let covered: f64 = coverage(std::slice::from_ref(&outline), 1024, 1024).data.iter().map(|&c| f64::from(c) / 255.0).sum();
        // Some 2000 pixels of rim are rounded to 1/255, each by 0.29 of that: 0.05 px^2 in all.
        assert!((covered - area_px2(&outline)).abs() < 0.25, "{covered} against {}", area_px2(&outline));
    }
}
