//! What is published of runs: how they were measured, with what, and a report to print.
//!
//! ```text
//!            ┌─ methods ── a paragraph and every parameter ──────────────────┐
//! StoredRun ─┼─ rocrate ── ro-crate-metadata.json (Process Run Crate)        ├─► html ── one file, pictures and plots inside
//!            ├─ rembi ── a study file for the BioImage Archive               │
//!            └─ tables, statistics ── plate, distributions, dose response ───┘
//! ```

mod chart;
pub mod html;
pub mod methods;
mod pictures;
mod plots;
pub mod rembi;
pub mod rocrate;
mod specimen;
