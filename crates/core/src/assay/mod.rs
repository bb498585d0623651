//! Statistics of plates: samples of wells, the window between controls, and the response to a dose.
//!
//! ```text
//!  values of wells that were treated alike ── Summary ─────── n, mean, sd, 95 % interval of the mean, median, MAD
//!  positive and negative controls ─────────── Window ──────── Z' (Zhang, Chung and Oldenburg 1999)
//!  (dose, value) of one compound ──────────── DoseResponse ── four-parameter logistic curve with 95 % intervals
//! ```
//! Each answers with numbers or with the reason why the data do not determine them. `docs/statistics.md` has the formulas.

mod dose;
mod summary;
mod window;

pub use dose::{DoseRefusal, DoseResponse, Parameter};
pub use summary::Summary;
pub use window::{Window, WindowRefusal};
