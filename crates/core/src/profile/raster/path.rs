//! The cheapest closed path along an outline: one state for every step, with small changes between neighbours.

/// Greatest change of the state from step to step.
const REACH: usize = 3;
/// Steps after which the influence of the path's start has vanished.
const RUN_IN: usize = 60;

/// One state per step of a closed outline.
#[derive(Debug, Default)]
pub(in crate::profile) struct Path {
    /// `costs[step * states + state]`.
    pub costs: Vec<f32>,
    /// Cost of the cheapest way to each state, with `REACH` states of infinite cost before and after.
    before: Vec<f32>,
    next: Vec<f32>,
    came: Vec<u8>,
    pub chosen: Vec<usize>,
}

impl Path {
    /// The cheapest closed path in which neighbours differ by at most [`REACH`] states, at a cost of `kink` per squared state.
    pub fn cheapest(&mut self, steps: usize, states: usize, kink: f32) {
        // The path starts before the first step and ends after the last one, which closes it: the influence of either end vanishes
        // within a few steps.
        let run_in = RUN_IN.min(steps / 2);
        let changes: [f32; 2 * REACH + 1] = std::array::from_fn(|j| kink * (j as f32 - REACH as f32).powi(2));
        for costs in [&mut self.before, &mut self.next] {
            costs.clear();
            costs.resize(states + 2 * REACH, f32::INFINITY);
        }
        self.before[REACH..REACH + states].fill(0.0);
        self.came.clear();
        self.came.resize((steps + 2 * run_in) * states, 0);
        let step_at = |at: usize| (at + steps - run_in) % steps.max(1);
        for (at, came) in self.came.chunks_exact_mut(states).enumerate() {
            let costs = &self.costs[step_at(at) * states..][..states];
            let before: [&[f32]; 2 * REACH + 1] = std::array::from_fn(|j| &self.before[j..j + states]);
            let next = &mut self.next[REACH..REACH + states];
            for k in 0..states {
                let (mut least, mut from) = (f32::INFINITY, 0u32);
                for j in 0..=2 * REACH {
                    let total = before[j][k] + changes[j];
                    (least, from) = if total < least { (total, j as u32) } else { (least, from) };
                }
                next[k] = least + costs[k];
                came[k] = from as u8;
            }
            // Only differences matter.
            let level = next[0];
            for cost in next {
                *cost -= level;
            }
            std::mem::swap(&mut self.before, &mut self.next);
        }
        let mut k = (0..states).min_by(|&a, &b| self.before[REACH + a].total_cmp(&self.before[REACH + b])).unwrap_or(0);
        self.chosen.clear();
        self.chosen.resize(steps, 0);
        for (at, came) in self.came.chunks_exact(states).enumerate().rev() {
            if (run_in..run_in + steps).contains(&at) {
                self.chosen[step_at(at)] = k;
            }
            k = k + usize::from(came[k]) - REACH;
        }
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
