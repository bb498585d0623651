//! The native part of `import carved`. It converts arrays and errors, and calls the functions that the commands call.
//!
//! ```text
//!  carved/*.py ── checks shapes, types, units ── _native ─┬─ arrays    numpy in and out
//!    documented, typed                                    ├─ task      without the GIL; progress, Ctrl-C
//!                                                         ├─ picture   one frame
//!                                                         ├─ measured  frames, silhouettes, recordings
//!                                                         └─ calibrated
//! ```
//! Settings and reports cross the border as JSON, in the form of carved's files.

// PyO3 hands arguments over as values, and `map_err` hands over errors.
#![allow(clippy::needless_pass_by_value)]

mod arrays;
mod calibrated;
mod errors;
mod measured;
mod picture;
mod recording;
mod task;

use carved_store::Software;
use pyo3::prelude::*;

/// Version, commit and whether the sources differed from it (`None`: not known), of the sources of this module.
#[pyfunction]
fn build() -> (String, String, Option<bool>) {
    let Software { version, commit, dirty, .. } = Software::this();
    (version, commit, dirty)
}

#[pymodule]
mod _native {
    use carved_store::Software;
    use pyo3::prelude::*;

    /// States the sources before the first number is made.
    #[pymodule_init]
    #[allow(clippy::unnecessary_wraps, reason = "PyO3 expects a result")]
    fn init(_module: &Bound<'_, PyModule>) -> PyResult<()> {
        Software::built_from(env!("CARVED_BUILD_COMMIT"), env!("CARVED_BUILD_DIRTY").parse().ok());
        Ok(())
    }

    #[pymodule_export]
    use super::build;
    #[pymodule_export]
    use super::calibrated::calibrate;
    #[pymodule_export]
    use super::measured::{Numbers, measure_frames, measure_silhouettes, projections};
    #[pymodule_export]
    use super::picture::{NativeProfile, segment};
    #[pymodule_export]
    use super::recording::NativeRecording;
}
