//! The depth of cells within a set.
//!
//! ```text
//!    . . . . . .
//!    . 1 1 1 1 .      steps to a neighbour count 1, those aslant the root of 2: the way to the nearest cell
//!    . 1 2 2 1 .      outside, 8 % too long at most
//!    . 1 1 1 1 .
//! ```

/// Computes the chamfer distance of each cell of a set from the nearest cell outside; 0 outside. The border of the map, which
/// is `width` cells wide, does not count as outside: where the whole map is in the set, every cell is as deep as the map's
/// sides together.
pub(super) fn depth(width: usize, set: impl ExactSizeIterator<Item = bool>, depth: &mut Vec<f32>) {
    const ASLANT: f32 = std::f32::consts::SQRT_2;
    let (w, len) = (width, set.len());
    let far = (w + len / w.max(1)) as f32;
    depth.clear();
    depth.extend(set.map(|set| if set { far } else { 0.0 }));
    let mut relax = |at: usize, from: Option<usize>, step: f32| {
        if let Some(from) = from {
            depth[at] = depth[at].min(depth[from] + step);
        }
    };
    for at in 0..len {
        let (up, left, right) = (at >= w, at % w > 0, at % w + 1 < w);
        relax(at, left.then(|| at - 1), 1.0);
        relax(at, up.then(|| at - w), 1.0);
        relax(at, (up && left).then(|| at - w - 1), ASLANT);
        relax(at, (up && right).then(|| at - w + 1), ASLANT);
    }
    for at in (0..len).rev() {
        let (down, left, right) = (at + w < len, at % w > 0, at % w + 1 < w);
        relax(at, right.then(|| at + 1), 1.0);
        relax(at, down.then(|| at + w), 1.0);
        relax(at, (down && right).then(|| at + w + 1), ASLANT);
        relax(at, (down && left).then(|| at + w - 1), ASLANT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[&str]) -> Vec<f32> {
        let set: Vec<bool> = rows.iter().flat_map(|r| r.chars().map(|c| c == '#')).collect();
        let mut found = vec![9.0; 3];
        depth(rows[0].len(), set.into_iter(), &mut found);
        found
    }

    #[test]
    fn the_nearest_way_out_is_counted_and_the_border_is_none() {
        const R: f32 = std::f32::consts::SQRT_2;
        assert_eq!(of(&["....", "###.", "###.", "###."]), [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 2.0, 2.0, 1.0, 0.0, 3.0, 2.0, 1.0, 0.0]);
        assert!((of(&["#####", "#####", "##.##"])[0] - 2.0 * R).abs() < 1e-6);
        assert_eq!(of(&["##", "##", "##"]), [5.0; 6]);
    }
}
