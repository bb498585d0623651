//! Disk space of specimens, and the disk budget of the runs.

use super::{Store, StoreError};
use carved_core::frame::PixelFormat;
use carved_core::geometry::Camera;
use carved_records::Method;

/// The disk space that all runs use, and their budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Budget {
    pub used_bytes: u64,
    /// `[store] budget_gb`. `None` if only the disk limits the runs.
    pub budget_bytes: Option<u64>,
}

impl Budget {
    /// Why `more_bytes` exceed the budget. `None` if they fit.
    pub fn refuses(&self, more_bytes: u64) -> Option<String> {
        let budget = self.budget_bytes.filter(|budget| self.used_bytes + more_bytes > *budget)?;
        Some(format!(
            "the runs take {} and {} more are to come, over the budget of {} ([store] budget_gb). Archive runs and prune \
             them (carved archive, carved prune), or raise it",
            size(self.used_bytes),
            size(more_bytes),
            size(budget)
        ))
    }
}

/// A size as text.
pub fn size(bytes: u64) -> String {
    match bytes as f64 / 1e9 {
        gb if gb < 0.9995 => format!("{:.0} MB", gb * 1e3),
        gb => format!("{gb:.1} GB"),
    }
}

impl Store {
    /// The disk space of all runs, from the index.
    ///
    /// # Errors
    /// The index cannot be read.
    pub fn budget(&self, budget_gb: Option<f64>) -> Result<Budget, StoreError> {
        let budget_bytes = budget_gb.map(|gb| (gb * 1e9) as u64);
        Ok(Budget { used_bytes: self.reader().used_bytes()?, budget_bytes })
    }
}

/// Allowance for masks, mesh, model and numbers. Those of a larva at SD 5.5 um take about 8 MB. The rest is room for smaller voxels.
const RESULTS_BYTES: u64 = 16_000_000;

/// Allowance for a view's mask and its entry in the ledger.
const PER_VIEW_BYTES: u64 = 12_000;

/// Maximum disk space of a specimen, bytes: its frames without compression, and its results. The frames are the views, the closure view,
/// the detection frame, the empty-capillary picture and the frames of a second camera.
pub fn bytes_per_specimen(method: &Method, camera: &Camera, format: PixelFormat, second: Option<&Camera>) -> u64 {
    let frame = |c: &Camera, per_pixel: usize| u64::from(c.width) * u64::from(c.height) * per_pixel as u64;
    let views = u64::from(method.asd) + 1;
    let first = (views + 2) * frame(camera, format.bytes_per_pixel());
    let second = second.map_or(0, |c| views * frame(c, 1));
    // PNG is slightly larger than incompressible data.
    (first + second) * 1001 / 1000 + views * PER_VIEW_BYTES + RESULTS_BYTES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plate_that_does_not_fit_is_refused_with_both_numbers() {
        let budget = Budget { used_bytes: 90_000_000_000, budget_bytes: Some(100_000_000_000) };
        assert_eq!(budget.refuses(10_000_000_000), None);
        let why = budget.refuses(10_000_000_001).unwrap();
        for part in ["90.0 GB", "10.0 GB", "100.0 GB", "budget_gb", "carved prune"] {
            assert!(why.contains(part), "{why}");
        }
        assert_eq!(Budget { budget_bytes: None, ..budget }.refuses(u64::MAX / 2), None);
    }

    /// A stored larva of the emulated rig with 84 views needs less.
    #[test]
    fn a_specimen_is_counted_with_all_its_frames() {
        let method: Method = serde_json::from_str(r#"{"asd": 84, "order": "sequential", "epsilon": 0.05, "voxel_um": 5.5}"#).unwrap();
        let camera: Camera =
            serde_json::from_str(r#"{"f": 60000.0, "kx": 0.18, "ky": 0.18, "ux": 512.0, "uy": 512.0, "width": 1024, "height": 1024}"#)
                .unwrap();
        let mono = bytes_per_specimen(&method, &camera, PixelFormat::Mono8, None);
        assert!((87 << 20..110_000_000).contains(&mono), "{mono}");
        let colour = bytes_per_specimen(&method, &camera, PixelFormat::RGB8Packed, None);
        assert!(colour > mono + (174 << 20), "{colour}");
        let second = bytes_per_specimen(&method, &camera, PixelFormat::Mono8, Some(&camera));
        assert!(second > mono + (85 << 20) && second < mono + (86 << 20), "{second}");
    }
}
