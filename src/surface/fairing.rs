//! Implicit fairing (Desbrun et al. 1999): each iteration solves `(I - lambda U) x' = x`.
//!
//! `U` is the umbrella operator, `U x_i = mean of the neighbours of i - x_i`: the one that reproduces the paper's areas with
//! lambda = 0.8 and 10 iterations. Multiplied by the number of neighbours the system is symmetric and positive definite, with
//! eigenvalues of the preconditioned one between 1 and 1 + 2 lambda: conjugate gradients need about ten steps, and no
//! matrix but the list of neighbours.

use super::Mesh;
use super::mesh::{add, sub};
use rayon::prelude::*;

/// How a mesh is faired.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fairing {
    /// Weight of the umbrella operator in one iteration.
    pub lambda: f64,
    pub iterations: usize,
}

#[derive(Debug, thiserror::Error, PartialEq)]
pub enum FairingError {
    #[error("fairing lambda is {found}; it must be a finite number of at least 0")]
    Lambda { found: f64 },
    #[error("fairing: conjugate gradients are still off by {residual:.1e} of the right side after {steps} steps; lower lambda")]
    NotConverged { residual: f64, steps: usize },
}

/// The residual, relative to the right side, that ends an iteration: on a body of 4 mm less than a hundredth of a um.
const TOLERANCE: f64 = 1e-6;
const MAX_STEPS: usize = 500;
/// Sums are taken over pieces of this many vertices, in order, so that they don't depend on the number of threads.
const PIECE: usize = 4096;

/// The faired mesh; its triangles are those of `mesh`.
///
/// # Errors
/// Refuses a lambda that is no weight, and says so when one so large was given that the solver does not get through.
pub fn fair(mesh: &Mesh, fairing: Fairing) -> Result<Mesh, FairingError> {
    let lambda = fairing.lambda;
    if !(lambda.is_finite() && lambda >= 0.0) {
        return Err(FairingError::Lambda { found: lambda });
    }
    let mut vertices = mesh.vertices.clone();
    // Around their own centre the coordinates are small, and so is what the tolerance is relative to.
    let n = vertices.len().max(1) as f64;
    let centre: [f64; 3] = std::array::from_fn(|c| vertices.iter().map(|v| v[c]).sum::<f64>() / n);
    for v in &mut vertices {
        *v = sub(*v, centre);
    }
    let umbrella = Umbrella::new(mesh, lambda);
    for _ in 0..fairing.iterations {
        umbrella.solve(&mut vertices)?;
    }
    for v in &mut vertices {
        *v = add(*v, centre);
    }
    Ok(Mesh { vertices, triangles: mesh.triangles.clone() })
}

struct Umbrella {
    lambda: f64,
    /// Neighbours of vertex i are `neighbours[starts[i]..starts[i + 1]]`.
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

impl Umbrella {
    fn new(mesh: &Mesh, lambda: f64) -> Self {
        let mut ends = vec![0u32; mesh.vertices.len() + 1];
        let sides = || mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)]);
        for (from, _) in sides() {
            ends[from as usize + 1] += 1;
        }
        for i in 1..ends.len() {
            ends[i] += ends[i - 1];
        }
        let mut next = ends.clone();
        let mut twice = vec![0u32; ends.last().map_or(0, |&n| n as usize)];
        for (from, to) in sides() {
            let at = &mut next[from as usize];
            twice[*at as usize] = to;
            *at += 1;
        }
        // A side between two triangles was listed by both.
        let mut starts = vec![0];
        let mut neighbours = Vec::with_capacity(twice.len() / 2);
        for range in ends.windows(2) {
            let list = &mut twice[range[0] as usize..range[1] as usize];
            list.sort_unstable();
            neighbours.extend(list.chunk_by(|a, b| a == b).map(|run| run[0]));
            starts.push(neighbours.len() as u32);
        }
        Self { lambda, starts, neighbours }
    }

    fn degree(&self, vertex: usize) -> f64 {
        f64::from(self.starts[vertex + 1] - self.starts[vertex])
    }

    /// `(D (1 + lambda) - lambda A) x` at one vertex; one without neighbours stays where it is.
    fn apply(&self, x: &[[f64; 3]], vertex: usize) -> [f64; 3] {
        let list = &self.neighbours[self.starts[vertex] as usize..self.starts[vertex + 1] as usize];
        if list.is_empty() {
            return x[vertex];
        }
        let mut sum = [0.0; 3];
        for &n in list {
            let p = x[n as usize];
            (0..3).for_each(|c| sum[c] += p[c]);
        }
        let own = list.len() as f64 * (1.0 + self.lambda);
        std::array::from_fn(|c| own * x[vertex][c] - self.lambda * sum[c])
    }

    /// Replaces `x` by the solution for `x` as right side; the three coordinates are three systems solved side by side,
    /// preconditioned by the diagonal.
    fn solve(&self, x: &mut [[f64; 3]]) -> Result<(), FairingError> {
        let scale: Vec<f64> = (0..x.len()).map(|i| 1.0 / (self.degree(i) * (1.0 + self.lambda)).max(1.0)).collect();
        // The old position is a good first guess.
        let mut r: Vec<[f64; 3]> = x
            .par_iter()
            .enumerate()
            .map(|(i, b)| {
                let ax = self.apply(x, i);
                let degree = self.degree(i).max(1.0);
                std::array::from_fn(|c| degree * b[c] - ax[c])
            })
            .collect();
        let mut p: Vec<[f64; 3]> = r.iter().zip(&scale).map(|(r, s)| r.map(|r| r * s)).collect();
        let mut q = vec![[0.0; 3]; x.len()];
        let right = sums(x.len(), |i| (x[i], x[i].map(|b| b * self.degree(i))));
        let mut rz = sums(x.len(), |i| (r[i], p[i]));
        // In the norm of the preconditioner, as `rz` is.
        let goal: [f64; 3] = std::array::from_fn(|c| TOLERANCE * TOLERANCE * right[c]);
        for _ in 0..MAX_STEPS {
            if (0..3).all(|c| rz[c] <= goal[c]) {
                return Ok(());
            }
            q.par_iter_mut().enumerate().for_each(|(i, q)| *q = self.apply(&p, i));
            let pq = sums(x.len(), |i| (p[i], q[i]));
            let alpha = quotient(rz, pq);
            x.par_iter_mut().zip(&mut r).zip(&p).zip(&q).for_each(|(((x, r), p), q)| {
                for c in 0..3 {
                    x[c] += alpha[c] * p[c];
                    r[c] -= alpha[c] * q[c];
                }
            });
            let next = sums(x.len(), |i| (r[i], r[i].map(|r| r * scale[i])));
            let beta = quotient(next, rz);
            p.par_iter_mut().zip(&r).zip(&scale).for_each(|((p, r), s)| {
                for c in 0..3 {
                    p[c] = r[c] * s + beta[c] * p[c];
                }
            });
            rz = next;
        }
        let residual = (0..3).map(|c| (rz[c] / right[c]).sqrt()).fold(0.0, f64::max);
        Err(FairingError::NotConverged { residual, steps: MAX_STEPS })
    }
}

/// A coordinate that is solved already has nothing to divide.
fn quotient(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|c| if b[c] > 0.0 { a[c] / b[c] } else { 0.0 })
}

/// Inner products per coordinate, the same on any number of threads.
fn sums(n: usize, terms: impl Fn(usize) -> ([f64; 3], [f64; 3]) + Sync) -> [f64; 3] {
    let pieces: Vec<[f64; 3]> = (0..n.div_ceil(PIECE))
        .into_par_iter()
        .map(|piece| {
            (piece * PIECE..((piece + 1) * PIECE).min(n)).fold([0.0; 3], |sum, i| {
                let (a, b) = terms(i);
                std::array::from_fn(|c| sum[c] + a[c] * b[c])
            })
        })
        .collect();
    pieces.into_iter().fold([0.0; 3], |sum, piece| std::array::from_fn(|c| sum[c] + piece[c]))
}
