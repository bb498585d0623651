//! Which triangles a cell of marching cubes holds, derived instead of listed.
//!
//! ```text
//!   corner c = x + 2 y + 4 z            edge 4 axis + n: the n-th of the four edges along an axis,
//!      6-----7                          n = the other two coordinates of its start, lower axis first
//!     /|    /|
//!    4-----5 |      On each face, walked counter-clockwise seen from outside, every run of inside corners is cut off by
//!    | 2---|-3      a segment from the edge where the run is entered to the edge where it is left. The rule looks at the
//!    |/    |/       face alone, so neighbouring cells agree and no crack can open; an ambiguous face separates its
//!    0-----1        inside corners. The segments chain into loops, and each loop is cut into triangles.
//! ```

use std::sync::LazyLock;

/// Start corner and axis of each of the 12 edges.
pub(super) const EDGES: [(usize, usize); 12] = {
    let mut edges = [(0, 0); 12];
    let mut axis = 0;
    while axis < 3 {
        let (a, b) = ([1, 0, 0][axis], [2, 2, 1][axis]);
        let mut n = 0;
        while n < 4 {
            edges[4 * axis + n] = (((n & 1) << a) | ((n >> 1) << b), axis);
            n += 1;
        }
        axis += 1;
    }
    edges
};

/// Corners of each face, counter-clockwise seen from outside.
const FACES: [[usize; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Triangles of each of the 256 patterns of inside corners, as edges of the cell.
pub(super) static TRIANGLES: LazyLock<[Vec<[u8; 3]>; 256]> = LazyLock::new(|| std::array::from_fn(triangles));

fn edge_between(a: usize, b: usize) -> usize {
    let axis = (a ^ b).trailing_zeros() as usize;
    let start = a & b;
    let n = match axis {
        0 => start >> 1,
        1 => (start & 1) | (start >> 1 & 2),
        _ => start & 3,
    };
    4 * axis + n
}

fn triangles(inside: usize) -> Vec<[u8; 3]> {
    let is_in = |corner: usize| inside >> corner & 1 != 0;
    // From the edge where a run of inside corners begins to the edge where it ends.
    let mut next = [None; 12];
    for face in FACES {
        for i in 0..4 {
            if !is_in(face[(i + 3) % 4]) && is_in(face[i]) {
                let run = (0..4).take_while(|n| is_in(face[(i + n) % 4])).count();
                let entered = edge_between(face[(i + 3) % 4], face[i]);
                let left = edge_between(face[(i + run - 1) % 4], face[(i + run) % 4]);
                next[entered] = Some(left);
            }
        }
    }
    let mut out = Vec::new();
    for start in 0..12 {
        let mut ring = Vec::new();
        let mut at = start;
        while let Some(to) = next[at].take() {
            ring.push(at);
            at = to;
        }
        if !ring.is_empty() {
            let cut = cut_ring(&ring, false).or_else(|| cut_ring(&ring, true)).unwrap_or_default();
            out.extend(cut.into_iter().map(|t| t.map(|edge| edge as u8)));
        }
    }
    out
}

/// Cuts a ring into triangles. A diagonal between two edges of one face would lie in that face, where the neighbouring
/// cell may have the same one: four triangles would then share it. Such diagonals are taken only where `any` allows them.
fn cut_ring(ring: &[usize], any: bool) -> Option<Vec<[usize; 3]>> {
    let n = ring.len();
    if n < 3 {
        return Some(Vec::new());
    }
    let free = |a: usize, b: usize| any || !share_a_face(ring[a], ring[b]);
    (1..n - 1).find_map(|apex| {
        if (apex > 1 && !free(0, apex)) || (apex < n - 2 && !free(apex, n - 1)) {
            return None;
        }
        let mut cut = cut_ring(&ring[..=apex], any)?;
        cut.extend(cut_ring(&ring[apex..], any)?);
        cut.push([ring[0], ring[apex], ring[n - 1]]);
        Some(cut)
    })
}

fn share_a_face(a: usize, b: usize) -> bool {
    let on = |face: &[usize; 4], edge: usize| {
        let (start, axis) = EDGES[edge];
        face.contains(&start) && face.contains(&(start | 1 << axis))
    };
    FACES.iter().any(|face| on(face, a) && on(face, b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_numbered_both_ways_alike() {
        for (edge, (start, axis)) in EDGES.into_iter().enumerate() {
            assert_eq!(start >> axis & 1, 0, "edges begin at their lower end");
            assert_eq!(edge_between(start, start | 1 << axis), edge);
        }
    }

    /// Of a corner alone the triangle faces away from it; and no pattern needs a diagonal within a face.
    #[test]
    fn patches_face_outwards_and_keep_off_the_faces() {
        assert_eq!(TRIANGLES[1].len(), 1);
        let at = TRIANGLES[1][0].map(|e| EDGES[e as usize].1);
        assert!([[0, 1, 2], [1, 2, 0], [2, 0, 1]].contains(&at), "x, y, z is counter-clockwise from outside corner 0");
        for inside in 0..256 {
            let mut sides: Vec<[u8; 2]> = TRIANGLES[inside].iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
            let count = sides.len();
            sides.sort_unstable();
            sides.dedup();
            assert_eq!(sides.len(), count, "pattern {inside:08b} has a side twice");
            for &[a, b] in &sides {
                let inner = sides.contains(&[b, a]);
                assert_eq!(inner, !share_a_face(a as usize, b as usize), "pattern {inside:08b}: side {a}-{b}");
            }
        }
    }
}
