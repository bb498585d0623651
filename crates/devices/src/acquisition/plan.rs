//! The stops of one revolution: integer absolute steps, fixed before anything moves.
//!
//! ```text
//! view i of N ──► the step nearest to i / N of a turn: at most half a step off, and the turn closes
//! closure     ──► the step nearest to a whole turn, the last stop
//! ```

use carved_core::units::{Steps, StepsPerRevolution};
use carved_records::{Method, ViewOrder};

/// One stop of the axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stop {
    /// Number of the view around the turn, from 0. The closure view has the number after the last one.
    pub view: u32,
    /// Absolute target, from the reference.
    pub target: Steps,
    /// Whether this is the view at 360 degrees. It is compared with the view at 0 degrees, and never carved.
    pub closure: bool,
}

/// The stops of one revolution in the order in which they are visited, the closure view last if there is one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RevolutionPlan {
    asd: u32,
    steps_per_revolution: StepsPerRevolution,
    order: ViewOrder,
    stops: Vec<Stop>,
}

/// A number of views that cannot be planned.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[allow(missing_docs, reason = "the fields are the words of the messages")]
pub enum PlanError {
    /// Too few views to enclose a volume.
    #[error("ASD is {asd}; a revolution needs at least {least} axial views to enclose a volume")]
    TooFew { asd: u32, least: u32 },
    /// More views than steps.
    #[error("ASD is {asd}, but the axis has only {whole_steps} whole steps per revolution; two views would share a stop")]
    TooMany { asd: u32, whole_steps: u32 },
}

impl RevolutionPlan {
    /// Plans `asd` axial views evenly around the turn, and the closure view.
    ///
    /// # Errors
    /// Fewer than three views, or more views than steps.
    pub fn new(asd: u32, steps_per_revolution: StepsPerRevolution, order: ViewOrder) -> Result<Self, PlanError> {
        if asd < Method::LEAST_ASD {
            return Err(PlanError::TooFew { asd, least: Method::LEAST_ASD });
        }
        let [num, den] = <[u32; 2]>::from(steps_per_revolution);
        // With asd <= num / den neighbours are at least one step apart, so no two are rounded to the same step.
        if u64::from(asd) * u64::from(den) > u64::from(num) {
            return Err(PlanError::TooMany { asd, whole_steps: num / den });
        }
        let views = match order {
            // A sweep passes its stops in this order.
            ViewOrder::Sequential | ViewOrder::Sweep => (0..asd).collect(),
            ViewOrder::CoarseToFine => coarse_to_fine(asd),
        };
        let stop = |view, closure| Stop { view, target: steps_per_revolution.nearest(view, asd), closure };
        let stops = Vec::into_iter(views).map(|view| stop(view, false)).chain([stop(asd, true)]).collect();
        Ok(Self { asd, steps_per_revolution, order, stops })
    }

    /// The same without the closure view, for turns that end with the last view.
    #[must_use]
    pub fn without_closure(mut self) -> Self {
        self.stops.retain(|stop| !stop.closure);
        self
    }

    /// Number of axial views to be carved, without the closure view.
    pub fn asd(&self) -> u32 {
        self.asd
    }

    /// Steps per revolution of the axis.
    pub fn steps_per_revolution(&self) -> StepsPerRevolution {
        self.steps_per_revolution
    }

    /// The order of the views.
    pub fn order(&self) -> ViewOrder {
        self.order
    }

    /// The stops in the order of the visit.
    pub fn stops(&self) -> &[Stop] {
        &self.stops
    }

    /// The targets in the order of the visit, as they are announced to the axis.
    pub fn targets(&self) -> Vec<Steps> {
        self.stops.iter().map(|stop| stop.target).collect()
    }
}

/// Every view once, in the order of the places 0, 1/2, 1/4, 3/4, 1/8, ... of the turn. Each place takes the view at or before it,
/// unless that view has been taken. There are at least as many places as views, so every view occurs.
fn coarse_to_fine(asd: u32) -> Vec<u32> {
    let bits = u32::BITS - (asd - 1).leading_zeros();
    let places = 1_u64 << bits;
    let mut taken = vec![false; asd as usize];
    let mut views = Vec::with_capacity(asd as usize);
    for rank in 0..places {
        let place = u64::from((rank as u32).reverse_bits() >> (u32::BITS - bits));
        let view = (place * u64::from(asd) / places) as u32;
        if !std::mem::replace(&mut taken[view as usize], true) {
            views.push(view);
        }
    }
    views
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spr(num: u32, den: u32) -> StepsPerRevolution {
        StepsPerRevolution::new(num, den).unwrap()
    }

    proptest! {
        #[test]
        fn every_view_is_visited_once_within_half_a_step_and_the_closure_view_ends_the_turn(
            num in 3_u32..200_000, den in 1_u32..7, asd in 3_u32..400, coarse: bool
        ) {
            prop_assume!(asd * den <= num);
            let order = if coarse { ViewOrder::CoarseToFine } else { ViewOrder::Sequential };
            let plan = RevolutionPlan::new(asd, spr(num, den), order).unwrap();
            let (closure, carved) = plan.stops().split_last().unwrap();
            prop_assert!(closure.closure && carved.iter().all(|s| !s.closure));
            prop_assert_eq!((closure.view, closure.target), (asd, spr(num, den).nearest(1, 1)));
            prop_assert_eq!(carved[0], Stop { view: 0, target: Steps(0), closure: false });
            let mut views: Vec<u32> = carved.iter().map(|s| s.view).collect();
            let mut targets: Vec<Steps> = carved.iter().map(|s| s.target).collect();
            views.sort_unstable();
            targets.sort_unstable();
            targets.dedup();
            prop_assert_eq!(views, (0..asd).collect::<Vec<_>>());
            prop_assert_eq!(targets.len(), asd as usize, "two views share a stop");
            for s in carved {
                // |target - view * num / (den * asd)| <= 1/2, in whole numbers.
                let (den, asd) = (i128::from(den), i128::from(asd));
                let off = i128::from(s.target.0) * den * asd - i128::from(s.view) * i128::from(num);
                prop_assert!(2 * off.abs() <= den * asd);
            }
        }
    }

    #[test]
    fn coarse_to_fine_halves_the_widest_gap_as_it_goes() {
        assert_eq!(coarse_to_fine(8), [0, 4, 2, 6, 1, 5, 3, 7]);
        assert_eq!(coarse_to_fine(4), [0, 2, 1, 3]);
        for asd in [7, 12, 21, 84] {
            let views = coarse_to_fine(asd);
            for seen in [4_u32, 8, 16] {
                let Some(first) = views.get(..seen as usize) else { continue };
                let mut first = first.to_vec();
                first.sort_unstable();
                first.push(asd);
                let widest = first.windows(2).map(|w| w[1] - w[0]).max().unwrap();
                // The places are 1/seen of a turn apart; each view stands less than one view spacing before its place.
                assert!(f64::from(widest) < f64::from(asd) / f64::from(seen) + 1.0, "asd {asd}, {seen} views: gap {widest}");
            }
        }
    }

    #[test]
    fn a_plan_that_cannot_enclose_or_resolve_the_turn_is_refused() {
        let plan = |asd| RevolutionPlan::new(asd, spr(500, 1), ViewOrder::Sequential);
        assert_eq!(plan(0), Err(PlanError::TooFew { asd: 0, least: 3 }));
        assert_eq!(plan(2), Err(PlanError::TooFew { asd: 2, least: 3 }));
        assert_eq!(plan(501), Err(PlanError::TooMany { asd: 501, whole_steps: 500 }));
        assert!(plan(500).is_ok() && plan(3).is_ok());
    }

    #[test]
    fn eighty_four_views_of_a_500_step_motor_end_at_the_full_turn() {
        let plan = RevolutionPlan::new(84, spr(500, 1), ViewOrder::Sequential).unwrap();
        assert_eq!(plan.stops().len(), 85);
        assert_eq!(plan.stops()[84].target, Steps(500));
        assert_eq!(plan.stops()[42].target, Steps(250));
        let open = plan.without_closure();
        assert_eq!((open.stops().len(), open.stops()[83].closure, open.asd()), (84, false, 84));
    }
}
