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
pub(in crate::profile) fn depth(width: usize, set: impl ExactSizeIterator<Item = bool>, depth: &mut Vec<f32>) {
    const ASLANT: f32 = std::f32::consts::SQRT_2;
    let (w, len) = (width, set.len());
    let far = (w + len / w.max(1)) as f32;
    depth.clear();
    depth.extend(set.map(|set| if set { far } else { 0.0 }));
    // What comes from the row before depends on no other cell of the row, so that many cells are computed at once.
    let from_row = |row: &mut [f32], before: &[f32]| {
        let relax = |depth: &mut f32, other: f32| *depth = if other < *depth { other } else { *depth };
        row.iter_mut().zip(before).for_each(|(depth, other)| relax(depth, other + 1.0));
        row[1..].iter_mut().zip(before).for_each(|(depth, other)| relax(depth, other + ASLANT));
        row.iter_mut().zip(&before[1..]).for_each(|(depth, other)| relax(depth, other + ASLANT));
    };
    let step = |before: f32, depth: &mut f32| {
        *depth = depth.min(before + 1.0);
        *depth
    };
    for at in (0..len).step_by(w.max(1)) {
        let (before, row) = depth.split_at_mut(at);
        if at > 0 {
            from_row(&mut row[..w], &before[at - w..]);
        }
        row[..w].iter_mut().fold(far, step);
    }
    for at in (0..len).step_by(w.max(1)).rev() {
        let (row, next) = depth[at..].split_at_mut(w);
        if !next.is_empty() {
            from_row(row, &next[..w]);
        }
        row.iter_mut().rev().fold(far, step);
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
