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

use pyo3::pymodule;

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::calibrated::calibrate;
    #[pymodule_export]
    use super::measured::{Numbers, measure_frames, measure_silhouettes, projections};
    #[pymodule_export]
    use super::picture::{NativeProfile, segment};
    #[pymodule_export]
    use super::recording::NativeRecording;

    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");
}
