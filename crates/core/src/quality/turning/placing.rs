//! What the calibration of a turn says of its views and of its axis.

use super::TurnFinding;
use crate::calibration::{Exchanged, Placed};
use crate::statistics::upper_median;

/// Fewer views tell too little of each other: the model of three views lies 7 px from a fourth one of a good turn, and good turns of 6 and 7 views
/// had views that fit elsewhere.
const VIEWS_LEAST: usize = 8;
/// A view belongs elsewhere if its distance from the other views' model falls below this share at another angle, was more than this, px, and that
/// angle is further off than this, deg. In good turns of three larvae of the second renderer no view fell below 0.6.
const ELSEWHERE_SHARE: f64 = 0.55;
const ELSEWHERE_PX: f64 = 1.0;
const ELSEWHERE_DEG: f64 = 12.0;
/// Two views are exchanged if each lies farther than this from where the others expect it, px, and at the angle of the other nearer than a share of it.
/// Of 168 pairs of neighbours of four turns of 21 views, in both senses, exchanged views lay 0.64 to 3.9 px off and fell below 0.43 of it. As they are,
/// the distances of both grew by 2.3 times or more. Of 32 views, exchanged ones lay 0.39 and 0.43 px off. What is nearer hardly changes the volume:
/// two neighbours of 21 views lay 0.22 px off, and exchanging them changed it by 0.05 %.
const EXCHANGED_PX: f64 = 0.3;
/// Fins, which single views find or miss, may be the cause where half of the edges are within this distance of the others, px. A fin is beside less
/// than half of the edges. A wrong view is off along the whole body: of 140 wrong views of the second renderer none was within 0.8 px.
const HALF_PX: f64 = 0.5;
/// The same as a multiple of the median over the views, up to [`COMPROMISE_PX`]. In two good turns of 60 of the second renderer whose fins are often
/// missed the median was 0.32 and 0.35 px, and views with 0.67 and 0.72 px fitted within 0.44 px with the common fins.
const HALF_OF_USUAL: f64 = 2.5;
/// A view fits with the fins that all views have in common within this distance, px.
const FITS_WITH_FINS_PX: f64 = 0.75;
/// Least share of the views of a half that belong elsewhere, before the half is said to. The slices of the other half are less exact than those of
/// all views.
const ELSEWHERE_OF_HALF: f64 = 0.7;
/// Least number and least share of the views that fit at no angle, for more than single bad pictures.
const FOREIGN_LEAST: usize = 2;
const FOREIGN_SHARE: f64 = 0.1;
/// The same share of views that the calibration uses: two of 21.
const FOREIGN_USED_SHARE: f64 = 0.09;
/// Half of the edges of most views are within this distance, px. Where the two halves of a turn show two larvae, every view is a compromise. The
/// median of this distance was 1.3 px or more in 8 such turns, and at most 0.3 px in 66 measurements of good turns of 11 views or more; larvae whose fins are often missed
/// have up to 0.4 px.
const COMPROMISE_PX: f64 = 0.8;
const COMPROMISE_SHARE: f64 = 0.5;
/// Fewer views show another specimen if half of their edges are farther than this multiple of the median over the views from where the others expect
/// them. Of 12 views two showed another larva: these two, or their opposite views too, lay 1.1 to 1.4 px off, where the median was 0.3 and 0.4 px.
const FOREIGN_OF_USUAL: f64 = 2.5;
/// Largest distance of the axis from the middle of the bore, px: glass that is not round, and chucks that hold it off their axis.
pub(crate) const OFF_BORE_PX: f64 = 12.0;

/// Where the views of a turn fit the others.
///
/// Single views find or miss a fin, or a part of one, so the body of a view of a good turn may fit elsewhere. With the common fins it then lies
/// within 0.7 px of the others. These alone do not tell either: fins can also be found that explain what is wrong.
pub(crate) struct Places {
    /// Each body among all others.
    pub bodies: Vec<Option<Placed>>,
    /// The same with the common fins. `None` where none were searched.
    pub with_common_fins: Option<Vec<Option<Placed>>>,
    /// Pairs of bodies that may be exchanged, among all others.
    pub exchanged: Vec<Exchanged>,
    /// For several halves of the turn: each body of the rest among those of the half.
    pub by_halves: Vec<Vec<Option<Placed>>>,
}

impl Places {
    /// Median over the bodies of the distance within which half of the edges are, px.
    fn usual_half_px(&self) -> f64 {
        upper_median(self.bodies.iter().flatten().map(|p| p.half_px).collect())
    }

    /// Whether a view fits with the fins that all views have in common. `None` where none were searched.
    fn fits_with_fins(&self, at: usize) -> Option<bool> {
        let placed = self.with_common_fins.as_ref()?;
        Some(placed[at].is_some_and(|p| p.own_px <= FITS_WITH_FINS_PX))
    }
}

/// What the calibration of a turn shows. `numbers` are those of the placed views, `bad` the places of the views that it left out;
/// `axis_off_px` is the axis minus the middle of the bore.
pub(crate) fn of_calibration(places: &Places, numbers: &[u32], bad: &[usize], axis_off_px: Option<f64>) -> Vec<TurnFinding> {
    let number = |at: usize| numbers.get(at).copied().unwrap_or(at as u32);
    let are_enough = places.bodies.len() >= VIEWS_LEAST;
    let misplaced = are_enough
        .then(|| elsewhere(places, number).or_else(|| two_exchanged(places, number)).or_else(|| foreign(places, number, bad)))
        .flatten();
    let off_bore =
        axis_off_px.filter(|px| px.abs() > OFF_BORE_PX).map(|px| TurnFinding::OffBore { found_px: px.abs(), most_px: OFF_BORE_PX });
    misplaced.into_iter().chain(off_bore).collect()
}

/// The views that fit the others at another angle.
fn elsewhere(places: &Places, number: impl Fn(usize) -> u32) -> Option<TurnFinding> {
    let belongs_elsewhere =
        |p: &Placed| p.own_px > ELSEWHERE_PX && p.best_px < ELSEWHERE_SHARE * p.own_px && p.off_rad.to_degrees().abs() >= ELSEWHERE_DEG;
    let of = |placed: &[Option<Placed>]| -> Vec<(usize, Placed)> {
        placed.iter().enumerate().filter_map(|(i, p)| Some((i, (*p).filter(belongs_elsewhere)?))).collect()
    };
    let mut elsewhere = of(&places.bodies);
    let is_alone = elsewhere.len() == 1;
    let half_px = (HALF_OF_USUAL * places.usual_half_px()).clamp(HALF_PX, COMPROMISE_PX);
    let is_by_fins = |(i, body): &(usize, Placed)| places.fits_with_fins(*i).unwrap_or(is_alone) && body.half_px < half_px;
    if elsewhere.iter().all(is_by_fins) {
        let is_wrong = |half: &&Vec<Option<Placed>>| of(half).len() as f64 >= ELSEWHERE_OF_HALF * half.iter().flatten().count() as f64;
        elsewhere = places.by_halves.iter().find(is_wrong).map(|half| of(half)).unwrap_or_default();
    }
    elsewhere.iter().max_by(|a, b| a.1.own_px.total_cmp(&b.1.own_px)).map(|(i, p)| TurnFinding::Elsewhere {
        view: number(*i),
        off_deg: p.off_rad.to_degrees(),
        own_px: p.own_px,
        best_px: p.best_px,
        others: elsewhere.len() - 1,
    })
}

/// Two views of which each fits the others at the angle of the other one. A fin that a view misses is missing at every angle.
fn two_exchanged(places: &Places, number: impl Fn(usize) -> u32) -> Option<TurnFinding> {
    let is_each = |e: &&Exchanged| {
        let mut both = e.own_px.iter().zip(e.swapped_px);
        both.all(|(&own_px, swapped_px)| own_px > EXCHANGED_PX && swapped_px < ELSEWHERE_SHARE * own_px)
    };
    let gain_px = |e: &Exchanged| e.own_px.iter().sum::<f64>() - e.swapped_px.iter().sum::<f64>();
    let found = places.exchanged.iter().filter(is_each).max_by(|a, b| gain_px(a).total_cmp(&gain_px(b)))?;
    Some(TurnFinding::Exchanged {
        view: number(found.views[0]),
        other: number(found.views[1]),
        apart_deg: found.apart_rad.to_degrees().abs(),
        own_px: found.own_px[0].max(found.own_px[1]),
        exchanged_px: found.swapped_px[0].max(found.swapped_px[1]),
    })
}

/// The views that fit the others at no angle: single ones, or most of them.
fn foreign(places: &Places, number: impl Fn(usize) -> u32, bad: &[usize]) -> Option<TurnFinding> {
    let of = places.bodies.len();
    let compromise: Vec<usize> = (0..of).filter(|&i| places.bodies[i].is_some_and(|p| p.half_px > COMPROMISE_PX)).collect();
    let apart_px = (FOREIGN_OF_USUAL * places.usual_half_px()).max(COMPROMISE_PX);
    // A view with a wrong fin, or without a part of one, is left out too, and its body fits.
    let fits_nowhere = |i: usize| places.bodies[i].is_none_or(|p| p.best_px > ELSEWHERE_PX);
    // Where no common fins were searched, fins may be the cause.
    let is_apart = |i: usize| places.bodies[i].is_some_and(|p| p.half_px > apart_px) && places.fits_with_fins(i) == Some(false);
    let single: Vec<usize> = (0..of).filter(|&i| fits_nowhere(i) && (bad.contains(&i) || is_apart(i))).collect();
    let used: Vec<usize> = single.iter().copied().filter(|i| !bad.contains(i)).collect();
    let is_share = |views: &[usize], share: f64| views.len() >= FOREIGN_LEAST && views.len() as f64 >= share * of as f64;
    let kinds = [(compromise, COMPROMISE_SHARE), (single, FOREIGN_SHARE), (used, FOREIGN_USED_SHARE)];
    let views = kinds.into_iter().find(|(views, share)| is_share(views, *share))?.0;
    Some(TurnFinding::Foreign { view: number(views[0]), views: views.len(), of })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: Placed = Placed { own_px: 0.4, half_px: 0.2, best_px: 0.4, off_rad: 0.0 };

    fn placed_elsewhere(own_px: f64, half_px: f64) -> Placed {
        Placed { own_px, half_px, best_px: 0.3 * own_px, off_rad: 0.26 }
    }

    fn found(elsewhere: &[Placed], with_common_fins_px: f64) -> Vec<TurnFinding> {
        let bodies: Vec<_> = elsewhere.iter().copied().chain([GOOD; 19]).map(Some).collect();
        let with_fins = bodies.iter().map(|_| Some(Placed { own_px: with_common_fins_px, best_px: with_common_fins_px, ..GOOD })).collect();
        let places = Places { by_halves: Vec::new(), exchanged: Vec::new(), with_common_fins: Some(with_fins), bodies };
        let numbers: Vec<u32> = (0..places.bodies.len() as u32).collect();
        of_calibration(&places, &numbers, &[], None)
    }

    /// Two views of a path-traced larva miss a part of a fin: their bodies lie 3 px from the others there, and 0.3 px along the rest. A wrong view is
    /// off along the whole body, by 0.8 px or more.
    #[test]
    fn a_fin_that_views_miss_is_told_from_views_that_belong_elsewhere() {
        assert_eq!(found(&[placed_elsewhere(2.6, 0.32), placed_elsewhere(3.0, 0.34)], 0.23), []);
        let is_elsewhere = |elsewhere: &[Placed], fins_px| matches!(found(elsewhere, fins_px)[..], [TurnFinding::Elsewhere { .. }]);
        assert!(is_elsewhere(&[placed_elsewhere(2.7, 0.85), placed_elsewhere(2.5, 0.82)], 0.54), "exchanged");
        assert!(is_elsewhere(&[placed_elsewhere(2.7, 0.85)], 0.54), "a single one");
        assert!(is_elsewhere(&[placed_elsewhere(3.0, 0.34)], 1.2), "the common fins do not explain it");
    }

    /// The pair of views of a larva whose outline changes least from view to view, as it is and exchanged; a view that misses a fin beside a good one;
    /// and neighbours that differ by no more than the edges' errors.
    #[test]
    fn exchanged_neighbours_are_named_by_both_of_them() {
        let of = |own_px, swapped_px| {
            let pair = Exchanged { views: [10, 11], own_px, swapped_px, apart_rad: 0.3 };
            let bodies = vec![Some(GOOD); 21];
            let places = Places { by_halves: Vec::new(), exchanged: vec![pair], with_common_fins: None, bodies };
            of_calibration(&places, &(0..21).collect::<Vec<u32>>(), &[], None)
        };
        assert!(matches!(of([0.69, 0.68], [0.12, 0.13])[..], [TurnFinding::Exchanged { view: 10, other: 11, .. }]));
        assert_eq!(of([0.12, 0.13], [0.69, 0.68]), []);
        assert_eq!(of([3.0, 0.2], [1.2, 0.3]), []);
        assert!(matches!(of([0.39, 0.43], [0.09, 0.1])[..], [TurnFinding::Exchanged { .. }]));
        assert_eq!(of([0.22, 0.23], [0.11, 0.12]), []);
    }

    /// Two of 12 views show another larva, and the calibration leaves none out: these views and their opposite ones fit nowhere. A good turn whose
    /// views miss fins has bodies nearly as far off, and fits with the common fins.
    #[test]
    fn views_of_another_larva_are_named_where_all_views_are_used() {
        let good = Placed { own_px: 0.4, half_px: 0.3, best_px: 0.4, off_rad: 0.0 };
        let of = |apart: Placed, fins_px: f64| {
            let bodies: Vec<_> = [apart; 4].into_iter().chain([good; 8]).map(Some).collect();
            let with_fins = bodies.iter().map(|_| Some(Placed { own_px: fins_px, ..good })).collect();
            let places = Places { by_halves: Vec::new(), exchanged: Vec::new(), with_common_fins: Some(with_fins), bodies };
            of_calibration(&places, &(0..12).collect::<Vec<u32>>(), &[], None)
        };
        let apart = Placed { own_px: 1.75, half_px: 1.2, best_px: 1.75, off_rad: 0.0 };
        assert!(matches!(of(apart, 1.4)[..], [TurnFinding::Foreign { views: 4, of: 12, .. }]));
        assert_eq!(of(apart, 0.5), []);
        assert_eq!(of(Placed { half_px: 0.75, ..apart }, 1.4), []);
    }

    /// Two views of 21 that are used suffice. What is usual in the turn counts, and without common fins nothing is said.
    #[test]
    fn few_views_of_another_larva_are_held_against_what_is_usual() {
        let of = |apart: usize, of: usize, half_px: f64, usual_half_px: f64, fins_px: Option<f64>| {
            let usual = Placed { own_px: 0.6, half_px: usual_half_px, best_px: 0.6, off_rad: 0.0 };
            let foreign = Placed { own_px: 1.8, half_px, best_px: 1.8, off_rad: 0.0 };
            let bodies: Vec<_> = (0..of).map(|i| Some(if i < apart { foreign } else { usual })).collect();
            let with_common_fins = fins_px.map(|own_px| vec![Some(Placed { own_px, ..usual }); of]);
            let places = Places { by_halves: Vec::new(), exchanged: Vec::new(), with_common_fins, bodies };
            !of_calibration(&places, &(0..of as u32).collect::<Vec<u32>>(), &[], None).is_empty()
        };
        assert_eq!([of(2, 21, 1.2, 0.3, Some(1.4)), of(1, 12, 1.2, 0.3, Some(1.4)), of(2, 23, 1.2, 0.3, Some(1.4))], [true, false, false]);
        assert_eq!([of(2, 12, 1.05, 0.4, Some(1.4)), of(2, 12, 0.95, 0.4, Some(1.4))], [true, false]);
        assert_eq!([of(2, 12, 1.2, 0.3, Some(0.5)), of(2, 12, 1.2, 0.3, None)], [false, false]);
    }

    /// All views miss fins, and two of them most. All fit with the common fins.
    #[test]
    fn views_of_a_larva_whose_fins_are_often_missed_belong_where_they_are() {
        let of = |elsewhere_half_px: f64, usual_half_px: f64| {
            let usual = Placed { own_px: 2.0, half_px: usual_half_px, best_px: 1.5, off_rad: 0.0 };
            let bodies: Vec<_> = [placed_elsewhere(3.6, elsewhere_half_px); 2].into_iter().chain([usual; 19]).map(Some).collect();
            let with_fins = bodies.iter().map(|_| Some(GOOD)).collect();
            let places = Places { by_halves: Vec::new(), exchanged: Vec::new(), with_common_fins: Some(with_fins), bodies };
            of_calibration(&places, &(0..21).collect::<Vec<u32>>(), &[], None)
        };
        assert_eq!(of(0.67, 0.32), []);
        assert!(matches!(of(0.67, 0.2)[..], [TurnFinding::Elsewhere { .. }]));
        assert!(matches!(of(0.82, 0.4)[..], [TurnFinding::Elsewhere { .. }]));
    }

    /// Half of the views are a compromise of two larvae. Fewer are no finding.
    #[test]
    fn views_that_are_all_a_compromise_are_named() {
        let between = Placed { own_px: 2.2, half_px: 1.3, best_px: 2.0, off_rad: 0.1 };
        assert!(matches!(found(&[between; 20], 0.2)[..], [TurnFinding::Foreign { views: 20, of: 39, .. }]));
        assert_eq!(found(&[between; 18], 0.2), []);
    }
}
