//! A 3 x 4 projection of any origin: that of a psi, or a public turntable set's with skew and a far principal point.

use super::glass::{Through, TurnTable};
use serde::{Deserialize, Serialize};

/// A 3 x 4 projection: `(u w, v w, w) = P (x, y, z, 1)`. The rows are scaled so that `w` is the depth in world units. Through glass, the
/// point is first turned about x by the angle by which its ray is turned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Projection {
    rows: [[f64; 4]; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    through: Option<Through>,
}

/// Why a matrix is no projection.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum ProjectionError {
    /// An entry is not finite.
    #[error("projection: row {row}, column {column} is {found}; every entry must be a finite number")]
    NotFinite {
        /// Its row, 0 to 2.
        row: usize,
        /// Its column, 0 to 3.
        column: usize,
        /// The entry.
        found: f64,
    },
    /// The left 3 x 3 part has no inverse.
    #[error("projection: the left 3 x 3 part has determinant {found}; a camera's is not 0")]
    Singular {
        /// Its determinant.
        found: f64,
    },
}

impl Projection {
    pub(super) fn from_rows(rows: [[f64; 4]; 3], through: Option<Through>) -> Self {
        Self { rows, through }
    }

    /// The projection of any camera matrix. Its scale and sign are free in theory. Both are normalised: the direction of the
    /// third row gets length 1, and the determinant of the left part becomes positive. This makes `w` the depth in front of the
    /// camera.
    ///
    /// # Errors
    /// Entries that are not finite and a matrix that does not describe a camera.
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
        Ok(Self { rows: rows.map(|r| r.map(|x| x * scale)), through: None })
    }

    /// The angle (rad) by which the glass turns the ray that passes the axis at distance `b_um`, positive below the axis in the image.
    pub fn turn_rad(&self, b_um: f64) -> f64 {
        self.through.map_or(0.0, |through| through.tube.turn(b_um)[0])
    }

    /// For many points of this view.
    pub fn lookup(&self) -> Lookup {
        Lookup { projection: *self, table: self.through.map(|through| TurnTable::of(&through.tube)) }
    }

    /// The three rows of the matrix, without glass.
    pub fn rows(&self) -> &[[f64; 4]; 3] {
        &self.rows
    }

    /// The order of these operations is part of the definition of the carver. The carver takes the part of y, z and the offset
    /// once per row of voxels, and must round as this function does.
    fn homogeneous(&self, x: [f64; 3]) -> [f64; 3] {
        self.rows.map(|r| r[0] * x[0] + ((r[1] * x[1] + r[2] * x[2]) + r[3]))
    }

    /// Depth of a point in front of the camera, in world units. Not positive for a point that is not in front of it. Glass hardly changes it.
    pub fn depth(&self, x: [f64; 3]) -> f64 {
        self.homogeneous(x)[2]
    }

    /// Pixel coordinates `(u, v)` of a point. `None` where it is not in front of the camera.
    pub fn project(&self, x: [f64; 3]) -> Option<(f64, f64)> {
        let [y, z] = self.through.map_or([x[1], x[2]], |through| through.apparent([x[1], x[2]], |b| through.tube.turn(b)));
        self.image([x[0], y, z])
    }

    fn image(&self, x: [f64; 3]) -> Option<(f64, f64)> {
        let [u, v, w] = self.homogeneous(x);
        (w > 0.0).then(|| (u / w, v / w))
    }
}

/// A projection with a table of how the glass turns rays: much quicker than [`Projection::project`] for many points, and the same to
/// a thousandth of a px.
#[derive(Debug, Clone)]
pub struct Lookup {
    projection: Projection,
    table: Option<TurnTable>,
}

impl Lookup {
    /// The three rows of the matrix, without glass.
    pub fn rows(&self) -> &[[f64; 4]; 3] {
        self.projection.rows()
    }

    /// Whether there is glass.
    pub fn is_through_glass(&self) -> bool {
        self.table.is_some()
    }

    /// Where a point (y, z) would lie if it were seen there without glass. The whole row of points along x is seen there.
    pub fn apparent(&self, at: [f64; 2]) -> [f64; 2] {
        match (&self.table, self.projection.through) {
            (Some(table), Some(through)) => through.apparent(at, |b| table.turn(b)),
            _ => at,
        }
    }

    /// As [`Projection::project`].
    pub fn project(&self, [x, y, z]: [f64; 3]) -> Option<(f64, f64)> {
        let [y, z] = self.apparent([y, z]);
        self.projection.image([x, y, z])
    }
}
