//! Frames of one turn to numbers.

use carved_core::frame::RawFrame;
use carved_core::pipeline::{Finished, Pipeline, PipelineError, PipelineSettings, SegmentedFrame};
use rayon::prelude::*;

/// A frame's place in its turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// Number of the view; 0 is the view at 0 deg.
    pub number: u32,
    /// Angle of the capillary, rad.
    pub omega: f64,
    /// Whether the frame repeats view 0 at 360 deg. It is compared with view 0 and never carved.
    pub closure: bool,
}

/// Measures a turn. The numbers are bit-identical to those of a live run. `frame` gives the frame of a view by its place in `views`, and
/// `seen` gets the segmented frame; both are called from several threads. `ended_early`: the turn has fewer views than were planned.
///
/// # Errors
/// The error of `frame` or `seen` of the first view that has one, or the pipeline gives no number.
pub fn measure<E: From<PipelineError> + Send>(
    settings: PipelineSettings,
    views: &[View],
    ended_early: bool,
    frame: impl Fn(usize) -> Result<RawFrame, E> + Sync,
    seen: impl Fn(usize, &SegmentedFrame) -> Result<(), E> + Sync,
) -> Result<Finished, E> {
    let mut pipeline = Pipeline::new(settings)?;
    let look = |at: usize| {
        let segmented = pipeline.look(&frame(at)?)?;
        seen(at, &segmented)?;
        Ok::<_, E>(segmented)
    };
    // All frames are segmented before any is judged, so that the reported error is always the first one of the turn, on any number of threads.
    let segmented = (0..views.len()).into_par_iter().map(look).collect::<Vec<_>>().into_iter().collect::<Result<Vec<_>, E>>()?;
    for (view, segmented) in views.iter().zip(&segmented) {
        if view.closure {
            pipeline.observe_closure(segmented);
        } else {
            pipeline.observe(view.number, view.omega, segmented)?;
        }
    }
    if ended_early {
        pipeline.end_early()?;
    }
    Ok(pipeline.finish_with_hull()?)
}
