//! The cheapest closed path along an outline: one state for every step, with small changes between neighbours.

/// One state per step of a closed outline.
#[derive(Debug, Default)]
pub(super) struct Path {
    /// `costs[step * states + state]`.
    pub costs: Vec<f32>,
    before: Vec<f32>,
    next: Vec<f32>,
    came: Vec<u8>,
    around: Vec<usize>,
    pub chosen: Vec<usize>,
}

impl Path {
    /// The cheapest closed path in which neighbours differ by at most `REACH` states, at a cost of `kink` per squared state.
    pub fn cheapest(&mut self, steps: usize, states: usize, kink: f32) {
        const REACH: usize = 3;
        // The path runs around twice and its second half is kept, which closes it: the influence of the start vanishes within a
        // few steps.
        self.before.clear();
        self.before.resize(states, 0.0);
        self.next.resize(states, 0.0);
        self.came.clear();
        for step in 0..2 * steps {
            let costs = &self.costs[step % steps * states..][..states];
            for (k, cost) in costs.iter().enumerate() {
                let (mut least, mut from) = (f32::INFINITY, 0u8);
                for j in k.saturating_sub(REACH)..(k + REACH + 1).min(states) {
                    let apart = j as f32 - k as f32;
                    let total = self.before[j] + kink * apart * apart;
                    if total < least {
                        (least, from) = (total, (j + REACH - k) as u8);
                    }
                }
                self.next[k] = least + cost;
                self.came.push(from);
            }
            let least = self.next.iter().copied().fold(f32::INFINITY, f32::min);
            self.next.iter_mut().for_each(|cost| *cost -= least);
            std::mem::swap(&mut self.before, &mut self.next);
        }
        let mut k = (0..states).min_by(|&a, &b| self.before[a].total_cmp(&self.before[b])).unwrap_or(0);
        self.around.clear();
        self.around.resize(2 * steps, 0);
        for step in (0..2 * steps).rev() {
            self.around[step] = k;
            k = k + usize::from(self.came[step * states + k]) - REACH;
        }
        // The middle of the two rounds depends on neither end.
        let half = steps / 2;
        self.chosen.clear();
        self.chosen.extend((0..steps).map(|i| self.around[if i >= half { i } else { i + steps }]));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The valley of the costs is followed all the way round, also across the seam, and a single wrong dip is not.
    #[test]
    fn a_valley_is_followed_around_and_a_pit_beside_it_is_not() {
        let (steps, states) = (60, 21);
        let valley = |step: usize| 10.0 + 6.0 * (step as f32 / steps as f32 * std::f32::consts::TAU).sin();
        let mut path = Path::default();
        for step in 0..steps {
            path.costs.extend((0..states).map(|k| (k as f32 - valley(step)).abs().min(4.0)));
        }
        path.costs[30 * states] = -3.0;
        path.cheapest(steps, states, 0.1);
        for (step, &k) in path.chosen.iter().enumerate() {
            assert!((k as f32 - valley(step)).abs() <= 1.0, "step {step}: {k} beside {}", valley(step));
        }
    }
}
