//! Sets of blocks: hysteresis, closing, opening, holes, connected pieces. All operations write into memory that is reused.

use super::chamfer;

/// A set of blocks of a map `width` wide.
#[derive(Debug, Default, Clone)]
pub(in crate::profile) struct Region {
    pub width: usize,
    pub set: Vec<bool>,
}

/// Memory of the operations below.
#[derive(Debug, Default)]
pub(in crate::profile) struct Scratch {
    stack: Vec<usize>,
    other: Vec<bool>,
}

/// The neighbours of block `at` in a map `width` wide: 4 of them, or 8 with the diagonals.
pub(in crate::profile) fn neighbours(at: usize, width: usize, len: usize, diagonals: bool) -> impl Iterator<Item = usize> {
    const STEPS: [(isize, isize); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
    let (u, v) = ((at % width) as isize, (at / width) as isize);
    let (w, h) = (width as isize, (len / width) as isize);
    STEPS[..if diagonals { 8 } else { 4 }].iter().filter_map(move |(du, dv)| {
        let (u, v) = (u + du, v + dv);
        ((0..w).contains(&u) && (0..h).contains(&v)).then_some((v * w + u) as usize)
    })
}

impl Region {
    /// Takes the blocks for which `inside` holds.
    pub fn take(&mut self, width: usize, inside: impl Iterator<Item = bool>) {
        self.width = width;
        self.set.clear();
        self.set.extend(inside);
    }

    pub fn copy(&mut self, other: &Self) {
        self.width = other.width;
        self.set.clear();
        self.set.extend_from_slice(&other.set);
    }

    /// Adds all blocks for which `more` holds and that are connected to the set through such blocks.
    pub fn grow(&mut self, more: impl Fn(usize) -> bool, scratch: &mut Scratch) {
        let stack = &mut scratch.stack;
        stack.clear();
        stack.extend((0..self.set.len()).filter(|&i| self.set[i]));
        while let Some(at) = stack.pop() {
            for next in neighbours(at, self.width, self.set.len(), true) {
                if !self.set[next] && more(next) {
                    self.set[next] = true;
                    stack.push(next);
                }
            }
        }
    }

    /// Closes gaps narrower than twice the radius, and those narrower than the radius to the end of the map, beyond which the
    /// set is assumed to continue.
    pub fn close(&mut self, radius: usize, scratch: &mut Scratch) {
        self.dilate(radius, scratch);
        self.invert();
        self.dilate(radius, scratch);
        self.invert();
    }

    /// Removes whiskers narrower than twice the radius.
    pub fn open(&mut self, radius: usize, scratch: &mut Scratch) {
        self.invert();
        self.dilate(radius, scratch);
        self.invert();
        self.dilate(radius, scratch);
    }

    /// The depth of each block within the set.
    pub fn depth(&self, depth: &mut Vec<f32>) {
        chamfer::depth(self.width, self.set.iter().copied(), depth);
    }

    fn invert(&mut self) {
        self.set.iter_mut().for_each(|s| *s = !*s);
    }

    /// Grows the set by a disc.
    pub fn dilate(&mut self, radius: usize, scratch: &mut Scratch) {
        let (w, h, r) = (self.width, self.set.len() / self.width, radius as isize);
        let grown = &mut scratch.other;
        grown.clear();
        grown.resize(self.set.len(), false);
        for v in 0..h {
            let row = &self.set[v * w..(v + 1) * w];
            if !row.contains(&true) {
                continue;
            }
            for dv in -r..=r {
                let to = v as isize + dv;
                if !(0..h as isize).contains(&to) {
                    continue;
                }
                // A radius of r + 1/2 makes rounder small discs than r.
                let half = ((radius as f64 + 0.5).powi(2) - (dv * dv) as f64).sqrt() as usize;
                let out = &mut grown[to as usize * w..(to as usize + 1) * w];
                let mut u = 0;
                while u < w {
                    if !row[u] {
                        u += 1;
                        continue;
                    }
                    let from = u;
                    while u < w && row[u] {
                        u += 1;
                    }
                    out[from.saturating_sub(half)..(u + half).min(w)].fill(true);
                }
            }
        }
        std::mem::swap(&mut self.set, grown);
    }

    /// Fills background that only the set encloses: the bright swim bladder, the clear centre of a bead. Background that is
    /// connected to a block outside of the walls (not `within`) is open water, also where the specimen touches the wall on both
    /// sides of it.
    pub fn fill_holes(&mut self, within: &[bool], scratch: &mut Scratch) {
        let (w, len) = (self.width, self.set.len());
        // Open water, grown inwards from everything beyond the walls.
        let open = &mut scratch.other;
        open.clear();
        open.extend(within.iter().map(|within| !within));
        let h = len / w;
        for v in 0..h {
            for u in [0, w - 1] {
                open[v * w + u] |= !self.set[v * w + u];
            }
        }
        for u in 0..w {
            for v in [0, h - 1] {
                open[v * w + u] |= !self.set[v * w + u];
            }
        }
        // The water flows down and along the rows, and then up, until it flows no further.
        for round in 0.. {
            let mut flows = round == 0;
            for v in (0..h).chain((0..h).rev()) {
                let (before, rest) = open.split_at_mut(v * w);
                let (row, after) = rest.split_at_mut(w);
                let set = &self.set[v * w..(v + 1) * w];
                let mut enters = round == 0;
                for beside in [before.rchunks_exact(w).next(), after.chunks_exact(w).next()].into_iter().flatten() {
                    for u in 0..w {
                        let free = !(set[u] | row[u]);
                        let new = beside[u] & free;
                        row[u] |= new;
                        enters |= new;
                    }
                }
                if enters {
                    let mut along = |u: usize, from: usize| row[u] = row[u] || row[from] && !set[u];
                    (1..w).for_each(|u| along(u, u - 1));
                    (1..w).rev().for_each(|u| along(u - 1, u));
                    flows = true;
                }
            }
            if !flows {
                break;
            }
        }
        for (set, open) in self.set.iter_mut().zip(open) {
            *set |= !*open;
        }
    }
}

/// Connected pieces of a region, sorted with the largest first.
#[derive(Debug, Default)]
pub(in crate::profile) struct Pieces {
    /// Number of the piece of each block, from 1. 0 in none.
    pub labels: Vec<u32>,
    /// Label and size.
    pub sizes: Vec<(u32, usize)>,
}

impl Pieces {
    pub fn find(&mut self, region: &Region, scratch: &mut Scratch) {
        let (w, len) = (region.width, region.set.len());
        self.labels.clear();
        self.labels.resize(len, 0);
        self.sizes.clear();
        for start in 0..len {
            if !region.set[start] || self.labels[start] != 0 {
                continue;
            }
            let label = self.sizes.len() as u32 + 1;
            let mut size = 0;
            self.labels[start] = label;
            scratch.stack.clear();
            scratch.stack.push(start);
            while let Some(at) = scratch.stack.pop() {
                size += 1;
                for next in neighbours(at, w, len, true) {
                    if region.set[next] && self.labels[next] == 0 {
                        self.labels[next] = label;
                        scratch.stack.push(next);
                    }
                }
            }
            self.sizes.push((label, size));
        }
        // Of two equal pieces the first one found stays first, so that the same frame gives the same result.
        self.sizes.sort_unstable_by_key(|&(label, size)| (std::cmp::Reverse(size), label));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(rows: &[&str]) -> Region {
        Region { width: rows[0].len(), set: rows.iter().flat_map(|r| r.chars().map(|c| c == '#')).collect() }
    }

    fn drawn(region: &Region) -> Vec<String> {
        region.set.chunks(region.width).map(|row| row.iter().map(|s| if *s { '#' } else { '.' }).collect()).collect()
    }

    #[test]
    fn holes_are_filled_where_only_the_set_shuts_them_in() {
        let mut r = region(&["........", ".####...", ".#..#.##", ".####.#.", "......##"]);
        r.fill_holes(&[true; 40], &mut Scratch::default());
        assert_eq!(drawn(&r), ["........", ".####...", ".####.##", ".####.#.", "......##"], "a bay at the frame's end stays open");
        let mut r = region(&["........", ".####...", ".#..#...", "........", "........"]);
        let within: Vec<bool> = (0..40).map(|i| i < 24).collect();
        r.fill_holes(&within, &mut Scratch::default());
        assert_eq!(drawn(&r)[2], ".#..#...", "a bay at the wall is open water");
    }

    #[test]
    fn pieces_are_counted_with_their_diagonals_from_the_largest_down() {
        let r = region(&["#...##", ".#..##", "......", "...#.."]);
        let mut pieces = Pieces::default();
        pieces.find(&r, &mut Scratch::default());
        assert_eq!(pieces.sizes.iter().map(|s| s.1).collect::<Vec<_>>(), [4, 2, 1]);
        assert_eq!(pieces.labels[0], pieces.labels[7]);
    }

    #[test]
    fn closing_bridges_and_opening_shaves() {
        let gap = "..###.####..";
        let mut r = region(&["............", "............", gap, gap, gap, "............", "............"]);
        r.close(1, &mut Scratch::default());
        assert_eq!(drawn(&r)[3], "..########..");
        assert_eq!(drawn(&r)[1], "............");
        let mut r = region(&["..........", ".####.....", "#####....."]);
        r.close(1, &mut Scratch::default());
        assert_eq!(drawn(&r)[1], "#####.....", "what nearly reaches the map's end extends beyond it");
        let mut r = region(&["..........", "....#.....", ".########.", ".########.", ".########.", "..........", ".........."]);
        r.open(1, &mut Scratch::default());
        assert_eq!(drawn(&r)[1], "..........");
        assert_eq!(drawn(&r)[3], ".########.");
    }
}
