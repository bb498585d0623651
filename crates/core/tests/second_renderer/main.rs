//! A second renderer of frames, to judge the science by pictures that it was not tuned on.
//!
//! ```text
//!   shape ──> optics ──┐                                  checks         the renderer itself
//!   specimen  chords   ├──> scene ──> frame, truth ──┬──> segmentation   profiles against the true silhouette
//!   dust ──────────────┘    lamp, glass, sensor      ├──> volume         whole turns against the ideal hull
//!                                                    └──> turning        turns that are none, put together by wrong_turns
//!      cases: the scenes of the tests by seed
//!      tube: exact silhouettes through a glass tube, ray by ray ──> glass: their volumes, the glass and the sense that they show
//! ```
//! `random`, `shape`, `optics`, `dust` and `scene` are the renderer. They use the standard library and rayon, and no code of carved or of
//! `hardware-sim`. docs/second-renderer.md has the model and the results.

#![allow(clippy::unwrap_used, clippy::expect_used)] // a test may panic; its helpers are part of it

mod bladder;
mod cases;
mod checks;
mod dust;
mod eyes;
mod glass;
mod judge;
mod optics;
mod pictures;
mod random;
mod scene;
mod segmentation;
mod shape;
mod truth;
mod tube;
mod turning;
mod volume;
mod wrong_turns;
