//! The exact values of a specimen, worked out when they are first asked for: pictures need none, and slices of fine meshes
//! take ten times as long as building what is drawn.

use super::{Mesh, ideal_hull};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::{Arc, LazyLock};

/// Exact values of the specimen, whatever the pictures show of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// The body: without the fin fold where there is one.
    pub volume_um3: f64,
    pub area_um2: f64,
    /// The ideal visual hull of all that casts a profile, fins included: what silhouettes can at best recover.
    pub hull_volume_um3: f64,
    pub hull_area_um2: f64,
    /// Extent of the body along x.
    pub length_um: f64,
    /// Of a sphere.
    pub diameter_um: Option<f64>,
}

impl Truth {
    /// Of a closed mesh.
    pub(super) fn of_mesh(mesh: &Mesh) -> Self {
        let [low, high] = mesh.bounds()[0];
        let cuts = 2000;
        let step = (high - low) / f64::from(cuts);
        let mut stations: Vec<f64> = (0..cuts).map(|i| low + step * (f64::from(i) + 0.5)).collect();
        stations.insert(0, low + step * 1e-6);
        stations.push(high - step * 1e-6);
        let mut sections: Vec<_> = stations.into_iter().map(|x| (x, mesh.section(x))).collect();
        // A flat end is part of the surface: each end closes to a point.
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

/// A truth that is known once it has been asked for; copies of a specimen share it.
#[derive(Clone)]
pub(super) struct AskedTruth(Arc<LazyLock<Truth, Work>>);

impl AskedTruth {
    pub fn by(work: impl FnOnce() -> Truth + Send + 'static) -> Self {
        Self(Arc::new(LazyLock::new(Box::new(work))))
    }

    pub fn get(&self) -> Truth {
        **self.0
    }

    /// The same, of a sphere of this diameter.
    pub fn of_sphere(self, diameter_um: f64) -> Self {
        Self::by(move || Truth { diameter_um: Some(diameter_um), ..self.get() })
    }
}

impl fmt::Debug for AskedTruth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}
