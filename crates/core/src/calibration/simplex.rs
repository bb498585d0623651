//! The simplex of Nelder and Mead, within bounds.
//!
//! ```text
//!   worst ─► through the middle of the others: reflect, further: expand, short of it: contract, else shrink to the best
//! ```
//! A vertex beyond a bound is moved onto it. The coefficients are those of Gao and Han (Comput. Optim. Appl. 51, 2012), which
//! for two unknowns are Nelder and Mead's own. With them the simplex does not flatten in more dimensions.

use super::search::{Counted, Minimum, Reach, Stop};

/// Searches for the least value of `function`.
pub(crate) fn minimise(reach: &[Reach], stop: Stop, function: impl FnMut(&[f64]) -> f64) -> Minimum {
    let mut function = Counted::new(reach, function);
    let mut from = vec![0.0; reach.len()];
    let mut again = true;
    loop {
        let length = if again { 1.0 } else { 0.25 };
        let (best, converged) = descend(&mut function, &from, length, stop);
        let on_bound = reach.iter().zip(&best).any(|(r, &s)| r.room(s) < 1e-9);
        // Vertices that were moved onto a bound may all lie in it, so that the search no longer looks across. It then starts
        // once more in all directions.
        if converged && again && on_bound {
            (from, again) = (best, false);
        } else {
            return function.found(converged);
        }
    }
}

/// Best vertex, and whether the simplex became small.
fn descend<F: FnMut(&[f64]) -> f64>(function: &mut Counted<F>, from: &[f64], length: f64, stop: Stop) -> (Vec<f64>, bool) {
    let n = from.len();
    let dims = n.max(2) as f64;
    let (expand, contract, shrink) = (1.0 + 2.0 / dims, 0.75 - 0.5 / dims, 1.0 - 1.0 / dims);
    let reach = function.reach;
    let within = |at: Vec<f64>| -> Vec<f64> { reach.iter().zip(at).map(|(r, s)| r.within(s)).collect() };
    let mut vertices: Vec<(Vec<f64>, f64)> = Vec::with_capacity(n + 1);
    for vertex in 0..=n {
        let mut at = within(from.to_vec());
        if let Some(axis) = vertex.checked_sub(1) {
            // The other way where the bound leaves less room.
            let up = reach[axis].within(at[axis] + length);
            let down = reach[axis].within(at[axis] - length);
            at[axis] = if up - at[axis] >= at[axis] - down { up } else { down };
        }
        let value = function.at(&at);
        vertices.push((at, value));
    }
    loop {
        vertices.sort_by(|a, b| a.1.total_cmp(&b.1));
        let best = &vertices[0].0;
        let far = vertices[1..].iter().flat_map(|v| v.0.iter().zip(best).map(|(a, b)| (a - b).abs())).fold(0.0, f64::max);
        if far <= stop.share || function.evaluations >= stop.evaluations {
            return (vertices.swap_remove(0).0, far <= stop.share);
        }
        let middle: Vec<f64> = (0..n).map(|i| vertices[..n].iter().map(|v| v.0[i]).sum::<f64>() / n as f64).collect();
        let worst = vertices[n].clone();
        let along = |t: f64| within(middle.iter().zip(&worst.0).map(|(m, w)| m + t * (m - w)).collect());
        let mut tried = |t: f64| {
            let at = along(t);
            let value = function.at(&at);
            (at, value)
        };
        let reflected = tried(1.0);
        let better = if reflected.1 < vertices[0].1 {
            let expanded = tried(expand);
            Some(if expanded.1 < reflected.1 { expanded } else { reflected })
        } else if reflected.1 < vertices[n - 1].1 {
            Some(reflected)
        } else if reflected.1 < worst.1 {
            Some(tried(contract)).filter(|outside| outside.1 <= reflected.1)
        } else {
            Some(tried(-contract)).filter(|inside| inside.1 < worst.1)
        };
        if let Some(vertex) = better {
            vertices[n] = vertex;
            continue;
        }
        let best = vertices[0].0.clone();
        for (at, value) in &mut vertices[1..] {
            for (a, b) in at.iter_mut().zip(&best) {
                *a = b + shrink * (*a - b);
            }
            *value = function.at(at);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::search::bowls::*;
    use super::*;

    const STOP: Stop = Stop { evaluations: 5000, share: 1e-7 };

    #[test]
    fn it_follows_a_bent_valley() {
        let found = minimise(&box_of(&[-1.2, 1.0], 5.0), STOP, rosenbrock);
        assert!(found.converged && found.evaluations < 300, "{found:?}");
        assert!(found.at.iter().all(|x| (x - 1.0).abs() < 1e-5), "{found:?}");
    }

    #[test]
    fn it_finds_the_bottom_of_a_turned_ellipsoid() {
        let found = minimise(&box_of(&[-1.0; 4], 5.0), STOP, |x| ellipsoid(x, 1e3));
        assert!(found.converged && found.evaluations < 1500, "{found:?}");
        assert!(found.at.iter().all(|x| (x - 0.7).abs() < 1e-5), "{found:?}");
    }

    #[test]
    fn a_minimum_on_a_bound_is_found_there_and_nothing_beyond_is_asked() {
        let found = minimise(&box_of(&[-0.5, -0.9], 1.0), STOP, |x| {
            assert!(x.iter().all(|v| v.abs() <= 1.0), "{x:?}");
            beyond_the_bound(x)
        });
        assert!(found.converged && (found.at[0] - 1.0).abs() < 1e-9 && (found.at[1] - 0.3).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn it_ends_when_its_evaluations_are_used_up() {
        let found = minimise(&box_of(&[-1.2, 1.0], 5.0), Stop { evaluations: 20, share: 1e-7 }, rosenbrock);
        // A shrinking simplex asks for its vertices together.
        assert!(!found.converged && (20..=23).contains(&found.evaluations), "{found:?}");
    }

    #[test]
    fn one_unknown_will_do_and_what_is_no_number_is_avoided() {
        let found = minimise(&box_of(&[-2.0], 5.0), STOP, |x| if x[0] > 1.0 { f64::NAN } else { (x[0] - 0.25).powi(2) });
        assert!(found.converged && (found.at[0] - 0.25).abs() < 1e-6, "{found:?}");
    }
}
