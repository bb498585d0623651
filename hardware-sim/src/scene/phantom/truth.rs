//! The exact values of a specimen. They are computed at the first request, because images do not need them and slices of fine meshes
//! take ten times as long as the mesh that is drawn.

use super::{Mesh, ideal_hull};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::{Arc, LazyLock};

/// Exact values of the specimen. They do not depend on the images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Volume of the body, without a fin fold.
    pub volume_um3: f64,
    /// Surface area of the body, without a fin fold.
    pub area_um2: f64,
    /// Volume of the ideal visual hull of body and fins: the best result that silhouettes can give.
    pub hull_volume_um3: f64,
    /// Surface area of the ideal visual hull.
    pub hull_area_um2: f64,
    /// Extent of the body along x.
    pub length_um: f64,
    /// Diameter of a sphere. `None` for other shapes.
    pub diameter_um: Option<f64>,
}

impl Truth {
    /// The true values of a closed mesh.
    pub(super) fn of_mesh(mesh: &Mesh) -> Self {
        let [low, high] = mesh.bounds()[0];
        let cuts = 2000;
        let step = (high - low) / f64::from(cuts);
        let mut stations: Vec<f64> = (0..cuts).map(|i| low + step * (f64::from(i) + 0.5)).collect();
        stations.insert(0, low + step * 1e-6);
        stations.push(high - step * 1e-6);
        let mut sections: Vec<_> = stations.into_iter().map(|x| (x, mesh.section(x))).collect();
        // A flat end is part of the surface, so each end is closed to a point.
        let first = sections.first().and_then(|(_, points)| points.first().copied());
        let last = sections.last().and_then(|(_, points)| points.first().copied());
        sections.insert(0, (low, first.into_iter().collect()));
        sections.push((high, last.into_iter().collect()));
        let hull = ideal_hull(&sections);
        Self {
            volume_um3: mesh.volume(),
            area_um2: mesh.area(),
            hull_volume_um3: hull.volume_um3,
            hull_area_um2: hull.area_um2,
            length_um: high - low,
            diameter_um: None,
        }
    }
}

type Work = Box<dyn FnOnce() -> Truth + Send>;

/// True values that are computed at the first request. Copies of a specimen share them.
#[derive(Clone)]
pub(super) struct AskedTruth(Arc<LazyLock<Truth, Work>>);

impl AskedTruth {
    pub fn by(work: impl FnOnce() -> Truth + Send + 'static) -> Self {
        Self(Arc::new(LazyLock::new(Box::new(work))))
    }

    pub fn get(&self) -> Truth {
        **self.0
    }

    /// The true values of a sphere of this diameter, um.
    pub fn of_sphere(self, diameter_um: f64) -> Self {
        Self::by(move || Truth { diameter_um: Some(diameter_um), ..self.get() })
    }
}

impl fmt::Debug for AskedTruth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
