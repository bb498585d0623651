//! A 3 x 4 projection of any origin: psi's, or a public turntable set's with skew and a far principal point.

use serde::{Deserialize, Serialize};

/// `(u w, v w, w) = P (x, y, z, 1)`, with the rows scaled so that `w` is the depth in world units.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Projection {
    rows: [[f64; 4]; 3],
}

#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ProjectionError {
    #[error("projection: row {row}, column {column} is {found}; every entry must be a finite number")]
    NotFinite { row: usize, column: usize, found: f64 },
    #[error("projection: the left 3 x 3 part has determinant {found}; a camera's is not 0")]
    Singular { found: f64 },
}

impl Projection {
    pub(super) fn from_rows(rows: [[f64; 4]; 3]) -> Self {
        Self { rows }
    }

    /// Takes any camera matrix; its scale and sign are free in theory, so both are normalised: the third row's
    /// direction gets length 1 and the determinant of the left part becomes positive, which makes `w` the depth in
    /// front of the camera.
    ///
    /// # Errors
    /// Refuses entries that are not finite and a matrix that is no camera.
    pub fn from_matrix(rows: [[f64; 4]; 3]) -> Result<Self, ProjectionError> {
        for (row, entries) in rows.iter().enumerate() {
            for (column, &found) in entries.iter().enumerate() {
                if !found.is_finite() {
                    return Err(ProjectionError::NotFinite { row, column, found });
                }
            }
        }
        let m = nalgebra::Matrix3::from_fn(|i, j| rows[i][j]);
        let det = m.determinant();
        let size = m.row(2).norm();
        if det == 0.0 || size == 0.0 || !det.is_normal() {
            return Err(ProjectionError::Singular { found: det });
        }
        let scale = det.signum() / size;
        Ok(Self { rows: rows.map(|r| r.map(|x| x * scale)) })
    }

    pub fn rows(&self) -> &[[f64; 4]; 3] {
        &self.rows
    }

    /// The order of these operations is part of the definition of the carver: it takes the part of y, z and the offset
    /// once per row of voxels, and must round as this does.
    fn homogeneous(&self, x: [f64; 3]) -> [f64; 3] {
        self.rows.map(|r| r[0] * x[0] + ((r[1] * x[1] + r[2] * x[2]) + r[3]))
    }

    /// Depth of a point in front of the camera; not positive behind it.
    pub fn depth(&self, x: [f64; 3]) -> f64 {
        self.homogeneous(x)[2]
    }

    /// Pixel coordinates `(u, v)`, or nothing for a point that is not in front of the camera.
    pub fn project(&self, x: [f64; 3]) -> Option<(f64, f64)> {
        let [u, v, w] = self.homogeneous(x);
        (w > 0.0).then(|| (u / w, v / w))
    }
}
