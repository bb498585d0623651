//! Faults of the instrument that a picture shows, as distinguished from faults of a specimen. A specimen that does not turn is found in
//! `specimen.rs`.
//!
//! ```text
//! finding                                                  cause                    reaction (retry.rs)
//! black, over-exposed                                      light                    retried, then the run is held
//! too dim for preflight, and nothing to measure            light                    retried, then the run is held
//! light out of preflight's range, and no or crooked walls  light                    retried, then the run is held
//! no walls, walls upright, too little beside the walls     position of capillary    retried, then the run is held
//! a damaged part of the picture, at the bore              camera                   retried, then the run is held
//! crooked walls in nine of ten views                       position of capillary    retried, then the run is held
//! crooked walls in fewer views                             the specimen             the well fails
//! a bore that contradicts the scale or the empty picture   scale                    retried, then the run is held
//! wrong frame size; unusable plan, box, reference picture  setup                    the run is held
//! anything else                                            the specimen             the well fails
//! ```
//! A specimen lies inside the bore. It cannot hide the outer lines of both walls or the light beside them. A specimen can look like a
//! crooked wall from some sides. A fault of the instrument looks so from all sides.

use super::retry::retaken_most;
use super::skip;
use crate::session::preflight;
use carved_core::pipeline::{Pipeline, PipelineError, SegmentedFrame};
use carved_core::profile::{Profile, ProfileError};
use carved_devices::acquisition::PlanError;
use carved_records::Light;
use carved_records::{CameraTooNear, Method, Policy};
use std::collections::BTreeMap;

/// Median pixel value below which a picture has no light. A lit picture has at least 100 of 255.
const NO_LIGHT: f64 = 8.0;
/// Range of the width of the bore, as a share of the width of the box: `BORE_LEAST` to `BORE_MOST`. The box is drawn around the bore.
const BORE_LEAST: f64 = 0.1;
const BORE_MOST: f64 = 2.0;
/// Allowed relative deviation of the measured bore from the configured one. Glass around water may make it look up to 10 % wider
/// (docs/calibration.md). Another lens changes it by 50 % and more.
const BORE_SHARE: f64 = 0.2;
/// Allowed relative deviation of the bore from its width in the empty-capillary picture, with the same capillary and lens.
const ZOOM_SHARE: f64 = 0.1;

/// Why no specimen can be judged or measured.
#[derive(Debug, thiserror::Error)]
pub enum OpticsFault {
    #[error("{0}")]
    Level(String),
    #[error(transparent)]
    Light(ProfileError),
    #[error(transparent)]
    Capillary(ProfileError),
    #[error(
        "the capillary's bore measures {bore_um:.0} um by ky_px_per_um = {ky}; with a box_um of {box_um:.0} um across, {least_um:.0} to {most_um:.0} um are expected"
    )]
    Scale { bore_um: f64, ky: f64, box_um: f64, least_um: f64, most_um: f64 },
    #[error(
        "the capillary's bore measures {found_um:.0} um by ky_px_per_um = {ky}, and optics.bore_um is {bore_um:.0} um; they may differ by {percent:.0} %. \
         If lens and capillary are the right ones, measure the scale again"
    )]
    Bore { found_um: f64, ky: f64, bore_um: f64, percent: f64 },
    #[error(
        "the capillary's bore is {found_px:.0} px wide, in the picture of the empty capillary {expected_px:.0} px; they may differ by {percent:.0} %"
    )]
    Zoom { found_px: f64, expected_px: f64, percent: f64 },
    #[error(transparent)]
    Frame(ProfileError),
    #[error(transparent)]
    Near(#[from] CameraTooNear),
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error(transparent)]
    Pipeline(Box<PipelineError>),
}

impl OpticsFault {
    /// Whether another picture may be free of this fault.
    pub fn may_pass(&self) -> bool {
        match self {
            Self::Level(_) | Self::Light(_) | Self::Capillary(_) | Self::Scale { .. } | Self::Bore { .. } | Self::Zoom { .. } => true,
            Self::Frame(_) | Self::Near(_) | Self::Plan(_) | Self::Pipeline(_) => false,
        }
    }

    /// The instrument's fault behind an error of the pipeline.
    ///
    /// # Errors
    /// Returns an error that the specimen may have caused.
    pub fn of_pipeline(error: PipelineError) -> Result<Self, PipelineError> {
        if error.is_of_setup() { Ok(Self::Pipeline(Box::new(error))) } else { Err(error) }
    }

    /// The fault in the detection frame, on which the well is judged. `None` if it shows none.
    ///
    /// `bore_um` is the configured inner diameter of the capillary, um. Without it, the bore is compared only with the box of the method.
    pub fn of_judged(light: &Light, seen: &SegmentedFrame, pipeline: &Pipeline, method: &Method, bore_um: Option<f64>) -> Option<Self> {
        let shows_nothing = |profile: &Profile, policy: &Policy| skip::reason(profile, policy).is_some();
        Self::of_picture(light, &seen.profile, |profile| shows_nothing(profile, &method.policy)).or_else(|| {
            let (profile, settings) = (seen.profile.as_ref().ok()?, pipeline.settings());
            let (ux, ky) = (settings.camera.ux, settings.camera.ky);
            let empty_px = settings.empty_capillary.as_deref().map(|empty| empty.walls().bore_px(ux));
            of_scale(profile.walls.bore_px(ux), ky, method, KnownBore { um: bore_um, empty_px })
        })
    }

    /// The fault in a picture. `None` if the picture is sound, or if the specimen may have caused the error.
    fn of_picture(light: &Light, profile: &Result<Profile, ProfileError>, shows_nothing: impl Fn(&Profile) -> bool) -> Option<Self> {
        let level = || preflight::light(light).err().map(|(found, way_out)| Self::Level(format!("{found}; {way_out}")));
        match profile {
            Err(e @ (ProfileError::Black { .. } | ProfileError::OverExposed { .. })) => Some(Self::Light(e.clone())),
            Err(e @ (ProfileError::TooSmall { .. } | ProfileError::EmptyCapillarySize { .. })) => Some(Self::Frame(e.clone())),
            // Another picture may be whole.
            Err(e @ ProfileError::Damaged { .. }) => Some(Self::Capillary(e.clone())),
            Err(e @ (ProfileError::NoWalls { .. } | ProfileError::OnItsSide | ProfileError::TooTight { .. })) => {
                level().or_else(|| Some(Self::Capillary(e.clone())))
            }
            Err(ProfileError::CrookedWalls { .. }) => level(),
            // A lamp that saturates the background still shows whether something is in front of it.
            Ok(profile) => {
                let least = if shows_nothing(profile) { preflight::DARK } else { NO_LIGHT };
                (light.background < least).then(level).flatten()
            }
        }
    }
}

/// The expected width of the bore, as far as it is configured.
#[derive(Debug, Clone, Copy, Default)]
struct KnownBore {
    /// Inner diameter of the capillary, um.
    um: Option<f64>,
    /// Width of the bore in the picture of the empty capillary, px.
    empty_px: Option<f64>,
}

/// The fault of a scale that contradicts the bore.
fn of_scale(bore_px: f64, ky: f64, method: &Method, known: KnownBore) -> Option<OpticsFault> {
    let bore_um = bore_px / ky;
    if let Some(known_um) = known.um.filter(|known_um| (bore_um / known_um - 1.0).abs() > BORE_SHARE) {
        return Some(OpticsFault::Bore { found_um: bore_um, ky, bore_um: known_um, percent: 100.0 * BORE_SHARE });
    }
    let bounds = &method.box_um;
    let box_um = (bounds.max[1] - bounds.min[1]).min(bounds.max[2] - bounds.min[2]);
    let (least_um, most_um) = (BORE_LEAST * box_um, BORE_MOST * box_um);
    if !(least_um..=most_um).contains(&bore_um) {
        return Some(OpticsFault::Scale { bore_um, ky, box_um, least_um, most_um });
    }
    let expected_px = known.empty_px.filter(|expected| (bore_px / expected - 1.0).abs() > ZOOM_SHARE)?;
    Some(OpticsFault::Zoom { found_px: bore_px, expected_px, percent: 100.0 * ZOOM_SHARE })
}

/// The views of one turn that are unusable because of the instrument.
#[derive(Debug, Default)]
pub struct Blind {
    views: BTreeMap<u32, OpticsFault>,
    /// Views with crooked walls, which the specimen may have caused.
    crooked: BTreeMap<u32, ProfileError>,
}

impl Blind {
    /// Takes a view or a retake of it. Returns the fault once more views are unusable than may be retaken.
    pub fn take(&mut self, view: u32, light: &Light, profile: &Result<Profile, ProfileError>, planned_views: u32) -> Option<OpticsFault> {
        self.views.remove(&view);
        self.crooked.remove(&view);
        if let Some(fault) = OpticsFault::of_picture(light, profile, |profile| profile.mask.area_px() == 0) {
            self.views.insert(view, fault);
        } else if let Err(crooked @ ProfileError::CrookedWalls { .. }) = profile {
            self.crooked.insert(view, crooked.clone());
        }
        if self.views.len() > retaken_most(planned_views) { self.views.pop_last().map(|(_, fault)| fault) } else { None }
    }

    /// The fault of a whole turn: nearly all views have crooked walls.
    pub fn at_end(&mut self, views: usize) -> Option<OpticsFault> {
        let blind = self.views.len() + self.crooked.len();
        if 10 * blind < 9 * views.max(1) {
            return None;
        }
        self.crooked.pop_last().map(|(_, crooked)| OpticsFault::Capillary(crooked))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    const SOUND: Light = Light { background: 190.0, saturated: 0.0, focus: 0.01 };
    const DIM: Light = Light { background: 16.0, ..SOUND };

    fn no_walls() -> Result<Profile, ProfileError> {
        Err(ProfileError::NoWalls { lines: 0, needed_support: 0.35 })
    }

    fn crooked() -> Result<Profile, ProfileError> {
        Err(ProfileError::CrookedWalls { straight_share: 0.3, needed_share: 0.45 })
    }

    fn of(light: &Light, profile: &Result<Profile, ProfileError>) -> Option<OpticsFault> {
        OpticsFault::of_picture(light, profile, |_| false)
    }

    #[test]
    fn light_is_blamed_before_the_capillary_and_the_specimen_for_crooked_walls_alone() {
        assert!(matches!(of(&SOUND, &Err(ProfileError::Black { brightest: 9, needed: 30 })), Some(OpticsFault::Light(_))));
        assert!(matches!(of(&SOUND, &no_walls()), Some(OpticsFault::Capillary(_))));
        assert!(matches!(of(&DIM, &no_walls()), Some(OpticsFault::Level(why)) if why.contains("16 of 255") && why.contains("lamp")));
        assert!(matches!(of(&DIM, &crooked()), Some(OpticsFault::Level(_))));
        assert!(of(&SOUND, &crooked()).is_none());
        let frame = of(&SOUND, &Err(ProfileError::TooSmall { width: 9, height: 9, least: 48 })).unwrap();
        assert!(!frame.may_pass() && of(&SOUND, &no_walls()).unwrap().may_pass());
    }

    /// Of 21 views, three may be retaken at the end of a turn. A fourth unusable view ends the turn. A view whose retake is good does not
    /// count.
    #[test]
    fn a_turn_ends_once_more_views_are_blind_than_are_taken_again() {
        let mut blind = Blind::default();
        for view in 0..3 {
            assert!(blind.take(view, &SOUND, &no_walls(), 21).is_none(), "view {view}");
        }
        assert!(blind.take(1, &SOUND, &crooked(), 21).is_none(), "taken again");
        assert!(blind.take(3, &SOUND, &no_walls(), 21).is_none());
        assert!(matches!(blind.take(4, &SOUND, &no_walls(), 21), Some(OpticsFault::Capillary(_))));
    }

    #[test]
    fn crooked_walls_are_the_instruments_from_nearly_every_side_only() {
        for (views, held) in [(18, false), (19, true)] {
            let mut blind = Blind::default();
            for view in 0..views {
                assert!(blind.take(view, &SOUND, &crooked(), 21).is_none());
            }
            assert_eq!(blind.at_end(21).is_some(), held, "{views} of 21 views");
        }
    }

    /// At 5.5 um per px, 118 px are the emulated bore of 650 um. Its box is 1000 um wide.
    #[test]
    fn a_scale_is_off_where_bore_and_box_cannot_be_of_one_rig_or_the_empty_picture_shows_another_width() {
        let config = Config::parse(include_str!("../../../config/simulated.toml"), std::path::Path::new("simulated.toml")).unwrap();
        let method = &config.methods["standard"];
        let of = |k: f64, empty_px| of_scale(118.0, k, method, KnownBore { um: None, empty_px });
        let k = config.optics.ky;
        assert!(of(k, None).is_none() && of(k, Some(110.0)).is_none());
        assert!(matches!(of(10.0 * k, None), Some(OpticsFault::Scale { bore_um, .. }) if (bore_um - 64.9).abs() < 0.1));
        assert!(matches!(of(k / 10.0, None), Some(OpticsFault::Scale { .. })));
        assert!(matches!(of(k, Some(150.0)), Some(OpticsFault::Zoom { .. })));
        assert!(of(k / 2.0, None).is_none(), "1298 um are not too wide for a box of 1000 um");
    }

    /// A lens of 2x shows the bore twice as wide in px. Glass that shows a bore of 590 um as 649 um holds no run.
    #[test]
    fn a_known_bore_tells_a_lens_of_twice_the_scale() {
        let config = Config::parse(include_str!("../../../config/simulated.toml"), std::path::Path::new("simulated.toml")).unwrap();
        let (method, ky) = (&config.methods["standard"], config.optics.ky);
        let of = |bore_px: f64, um: f64| of_scale(bore_px, ky, method, KnownBore { um: Some(um), empty_px: None });
        assert!([590.0, 650.0, 780.0].iter().all(|um| of(118.0, *um).is_none()));
        for bore_px in [236.0, 59.0] {
            let fault = of(bore_px, 650.0).unwrap();
            assert!(fault.may_pass() && matches!(fault, OpticsFault::Bore { bore_um: 650.0, .. }));
            let said = fault.to_string();
            for word in [&format!("{:.0} um", bore_px / ky), "optics.bore_um is 650 um", "20 %", "scale again"] {
                assert!(said.contains(word), "{word}: {said}");
            }
        }
    }
}
