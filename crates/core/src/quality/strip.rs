//! The residual strip of a turn, one entry per view, and the views that spoil the model.

/// One view in the strip.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct ViewStrip {
    pub view: u32,
    /// Whether it counts in the model.
    pub used: bool,
    /// Why it does not count.
    pub reason: Option<String>,
    /// Robust distance between its edges and those that all other views make expected, px.
    pub residual_px: Option<f64>,
    /// Share of its profile that the projected hull that no view misses (VRV) covers, %.
    pub overlap_percent: Option<f64>,
}

/// A view that should be taken again.
#[derive(Debug, Clone, PartialEq)]
pub struct Spoiled {
    /// Number of the view in the plan.
    pub view: u32,
    /// Why it spoils the model.
    pub reason: String,
}

/// The views that spoil the model, ordered by number: those that gave no profile or do not belong to the turn, and those that
/// were kept although their residual exceeds the limit.
pub(crate) fn spoiled(strip: &[ViewStrip], residual_view_px: f64) -> Vec<Spoiled> {
    let mut found: Vec<Spoiled> = strip
        .iter()
        .filter_map(|v| {
            let over = v.residual_px.filter(|px| *px > residual_view_px);
            let reason = match (v.used, over) {
                (false, _) => v.reason.clone().unwrap_or_else(|| "it was left out".to_owned()),
                (true, Some(px)) => {
                    format!("its edges lie {px:.1} px from what the other views make expected; {residual_view_px} are allowed")
                }
                (true, None) => return None,
            };
            Some(Spoiled { view: v.view, reason })
        })
        .collect();
    found.sort_by_key(|s| s.view);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_do_not_count_or_are_far_off_are_to_be_taken_again() {
        let view = |view, used, residual_px| ViewStrip { view, used, residual_px, ..ViewStrip::default() };
        let strip = [
            view(3, true, Some(3.1)),
            view(1, true, Some(0.4)),
            ViewStrip { reason: Some("blank".into()), ..view(2, false, None) },
            view(0, true, None),
            view(4, false, Some(0.2)),
        ];
        let found = spoiled(&strip, 3.0);
        assert_eq!(found.iter().map(|s| s.view).collect::<Vec<_>>(), [2, 3, 4]);
        assert_eq!(found[0].reason, "blank");
        assert!(found[1].reason.contains("3.1 px") && found[1].reason.contains("3 are allowed"), "{}", found[1].reason);
        assert!(spoiled(&strip[1..2], 3.0).is_empty());
    }
}
