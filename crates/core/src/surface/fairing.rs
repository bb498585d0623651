//! Implicit fairing (Desbrun et al. 1999): each iteration solves `(I - lambda U) x' = x`.
//!
//! ```text
//!   x' = x + d      (I - lambda U) d = lambda U x      x in f64, d in f32: a part in 10^7 of a step of a um
//! ```
//! `U` is the umbrella operator, `U x_i = mean of the neighbours of i - x_i`, which reproduces the paper's areas with lambda =
//! 0.8 and 10 iterations. In the inner product that weights each vertex by the number of its neighbours it is symmetric, and
//! `I - lambda U` has eigenvalues between 1 and 1 + 2 lambda. Conjugate gradients therefore need few steps, and no matrix
//! besides the list of neighbours.

use super::Mesh;
use crate::parallel::prelude::*;

/// How a mesh is faired.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fairing {
    /// Weight of the umbrella operator in one iteration.
    pub lambda: f64,
    /// Number of iterations.
    pub iterations: usize,
}

/// Why a mesh cannot be faired.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum FairingError {
    /// The weight is negative or not a number.
    #[error("fairing lambda is {found}; it must be a finite number of at least 0")]
    Lambda {
        /// The weight that was given.
        found: f64,
    },
    /// The mesh is not closed.
    #[error("fairing: the side from vertex {from} to {to} is not that of two triangles that run it opposite ways; mend the mesh")]
    Open {
        /// Vertex at one end of an open side.
        from: u32,
        /// Vertex at its other end.
        to: u32,
    },
    /// The solver did not reach its goal.
    #[error("fairing: conjugate gradients are still off by {residual:.1e} of the mesh's size after {steps} steps; lower lambda")]
    NotConverged {
        /// Relative residual that is left.
        residual: f64,
        /// Steps that were made.
        steps: usize,
    },
}

/// Relative residual that ends an iteration: its root mean square over that of the distances from the mesh's centre. On a body
/// of 4 mm it is a hundredth of a um.
const TOLERANCE: f64 = 1e-6;
const MAX_STEPS: usize = 500;
/// Sums are taken over pieces of this many vertices, in order, so that they do not depend on the number of threads.
const PIECE: usize = 4096;

/// The fourth number pads the vector to the width of a processor's load.
type Vector = [f32; 4];

/// The faired mesh; its triangles are those of `mesh`.
///
/// # Errors
///
/// A lambda that is no weight, a mesh that is not closed, and a lambda so large that the solver does not converge.
pub fn fair(mesh: &Mesh, fairing: Fairing) -> Result<Mesh, FairingError> {
    let lambda = fairing.lambda;
    if !(lambda.is_finite() && lambda >= 0.0) {
        return Err(FairingError::Lambda { found: lambda });
    }
    let mut solver = Solver::new(mesh, lambda)?;
    let mut vertices = mesh.vertices.clone();
    for _ in 0..fairing.iterations {
        solver.step(&mut vertices)?;
    }
    Ok(Mesh { vertices, triangles: mesh.triangles.clone() })
}

/// Adjacency of the vertices: the neighbours of vertex i are `list[starts[i]..starts[i + 1]]`.
struct Neighbours {
    starts: Vec<u32>,
    list: Vec<u32>,
}

impl Neighbours {
    /// In a closed mesh each neighbour of a vertex is the end of exactly one side that a triangle runs from it.
    fn new(mesh: &Mesh) -> Result<Self, FairingError> {
        let sides = || mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        let mut starts = vec![0u32; mesh.vertices.len() + 1];
        for (from, _) in sides() {
            starts[from as usize + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut next = starts.clone();
        let mut list = vec![0u32; 3 * mesh.triangles.len()];
        for (from, to) in sides() {
            let at = &mut next[from as usize];
            list[*at as usize] = to;
            *at += 1;
        }
        let found = Self { starts, list };
        let count = |from: u32, to: u32| found.of(from as usize).iter().filter(|&&n| n == to).count();
        let open = mesh.triangles.par_iter().find_map_first(|&[a, b, c]| {
            [(a, b), (b, c), (c, a)].into_iter().find(|&(from, to)| count(from, to) != 1 || count(to, from) != 1)
        });
        match open {
            Some((from, to)) => Err(FairingError::Open { from, to }),
            None => Ok(found),
        }
    }

    fn of(&self, vertex: usize) -> &[u32] {
        &self.list[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }

    /// Number of a vertex's neighbours, which is its weight in the inner product.
    fn weight(&self, vertex: usize) -> f64 {
        f64::from(self.starts[vertex + 1] - self.starts[vertex])
    }
}

/// What conjugate gradients keep per vertex: the displacement so far and its residual.
#[derive(Clone, Copy, Default)]
struct State {
    d: Vector,
    r: Vector,
}

/// The solver of `x -> x'` with its memory.
struct Solver {
    lambda: f64,
    neighbours: Neighbours,
    /// Squared residual, summed with the vertices' weights, that ends an iteration.
    goal: f64,
    state: Vec<State>,
    /// The direction of a step, and the operator applied to it.
    p: Vec<Vector>,
    q: Vec<Vector>,
}

impl Solver {
    fn new(mesh: &Mesh, lambda: f64) -> Result<Self, FairingError> {
        let neighbours = Neighbours::new(mesh)?;
        let n = mesh.vertices.len();
        let centre: [f64; 3] = std::array::from_fn(|c| mesh.vertices.iter().map(|v| v[c]).sum::<f64>() / n as f64);
        let from_centre = |v: &[f64; 3]| (0..3).map(|c| (v[c] - centre[c]).powi(2)).sum::<f64>();
        let size2: f64 = mesh.vertices.iter().enumerate().map(|(i, v)| neighbours.weight(i) * from_centre(v)).sum();
        let goal = TOLERANCE * TOLERANCE * size2;
        Ok(Self { lambda, neighbours, goal, state: vec![State::default(); n], p: vec![[0.0; 4]; n], q: vec![[0.0; 4]; n] })
    }

    /// One iteration of the fairing. The three coordinates are solved together, as the same operator acts on each.
    fn step(&mut self, x: &mut [[f64; 3]]) -> Result<(), FairingError> {
        // The old position is the first guess: the displacement is zero, and the residual is lambda U x.
        let mut rr = self.start(x);
        for _ in 0..MAX_STEPS {
            if rr <= self.goal {
                let moved = |(x, state): (&mut [f64; 3], &State)| (0..3).for_each(|c| x[c] += f64::from(state.d[c]));
                x.par_iter_mut().zip(&self.state).with_min_len(PIECE).for_each(moved);
                return Ok(());
            }
            let pq = self.apply();
            let next = self.advance((rr / pq) as f32);
            let beta = (next / rr) as f32;
            let turn = |(p, state): (&mut Vector, &State)| *p = std::array::from_fn(|c| state.r[c] + beta * p[c]);
            self.p.par_iter_mut().zip(&self.state).with_min_len(PIECE).for_each(turn);
            rr = next;
        }
        Err(FairingError::NotConverged { residual: TOLERANCE * (rr / self.goal).sqrt(), steps: MAX_STEPS })
    }

    /// Sets `r = p = lambda U x` and returns the square of `r`.
    fn start(&mut self, x: &[[f64; 3]]) -> f64 {
        let (neighbours, lambda) = (&self.neighbours, self.lambda);
        let rr = sum(&mut self.state, |i, state| {
            let mut total = [0.0; 3];
            for &n in neighbours.of(i) {
                let other = x[n as usize];
                (0..3).for_each(|c| total[c] += other[c] - x[i][c]);
            }
            let share = lambda / neighbours.weight(i).max(1.0);
            let [a, b, c] = total.map(|t| (share * t) as f32);
            *state = State { d: [0.0; 4], r: [a, b, c, 0.0] };
            neighbours.weight(i) * dot(state.r, state.r)
        });
        self.p.par_iter_mut().zip(&self.state).with_min_len(PIECE).for_each(|(p, state)| *p = state.r);
        rr
    }

    /// Sets `q = (I - lambda U) p` and returns `p q`.
    fn apply(&mut self) -> f64 {
        let (neighbours, lambda, p) = (&self.neighbours, self.lambda as f32, &self.p);
        sum(&mut self.q, |i, q| {
            let mut total = [0.0; 4];
            for &n in neighbours.of(i) {
                let other = p[n as usize];
                (0..4).for_each(|c| total[c] += other[c]);
            }
            let share = lambda / (neighbours.of(i).len() as f32).max(1.0);
            *q = std::array::from_fn(|c| (1.0 + lambda) * p[i][c] - share * total[c]);
            neighbours.weight(i) * dot(p[i], *q)
        })
    }

    /// Moves by `alpha p` and returns the square of the residual there.
    fn advance(&mut self, alpha: f32) -> f64 {
        let (neighbours, p, q) = (&self.neighbours, &self.p, &self.q);
        sum(&mut self.state, |i, State { d, r }| {
            for c in 0..4 {
                d[c] += alpha * p[i][c];
                r[c] -= alpha * q[i][c];
            }
            neighbours.weight(i) * dot(*r, *r)
        })
    }
}

fn dot(a: Vector, b: Vector) -> f64 {
    f64::from((a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]))
}

/// Applies `change` to every item with its number and sums the results. The sum is the same on any number of threads.
fn sum<T: Send>(items: &mut [T], change: impl Fn(usize, &mut T) -> f64 + Sync) -> f64 {
    let piece = |(n, piece): (usize, &mut [T])| piece.iter_mut().enumerate().map(|(i, item)| change(n * PIECE + i, item)).sum();
    let sums: Vec<f64> = items.par_chunks_mut(PIECE).enumerate().map(piece).collect();
    sums.into_iter().sum()
}
