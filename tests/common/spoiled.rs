//! A sight that shows wrong pictures at some angles of the first turn.

use hardware_sim::scene::{Exposure, Scene};
use hardware_sim::{PixelFormat, Pixels, Sight};
use std::ops::Range;
use std::sync::{Arc, Mutex};

type Look = Box<dyn Fn(&Exposure, PixelFormat) -> Pixels + Send + Sync>;

/// A sight that is wrong within a range of angles. A lost frame that is triggered again is wrong again.
pub struct Spoiled {
    sight: Arc<dyn Sight>,
    /// The range of angles, rad from the first exposure.
    at_rad: Range<f64>,
    shows: Look,
    turn: Mutex<Turn>,
}

#[derive(Default)]
struct Turn {
    first_rad: Option<f64>,
    furthest_rad: f64,
    /// The first turn has ended: the shaft has gone back.
    is_over: bool,
}

impl Spoiled {
    pub fn new(
        sight: Arc<dyn Sight>,
        at_rad: Range<f64>,
        shows: impl Fn(&Exposure, PixelFormat) -> Pixels + Send + Sync + 'static,
    ) -> Self {
        Self { sight, at_rad, shows: Box::new(shows), turn: Mutex::default() }
    }

    /// The wrong pictures show the specimen turned by `by_rad`.
    pub fn bent(scene: &Arc<Scene>, at_rad: Range<f64>, by_rad: f64) -> Self {
        let seen = scene.clone();
        let bent = move |exposure: &Exposure, format| seen.look(&Exposure { angle_rad: exposure.angle_rad + by_rad, ..*exposure }, format);
        Self::new(scene.clone(), at_rad, bent)
    }
}

impl Sight for Spoiled {
    fn size(&self) -> (u32, u32) {
        self.sight.size()
    }

    fn look(&self, exposure: &Exposure, format: PixelFormat) -> Pixels {
        let is_spoiled = {
            let mut turn = self.turn.lock().unwrap();
            let from_first = exposure.angle_rad - *turn.first_rad.get_or_insert(exposure.angle_rad);
            turn.is_over |= from_first < turn.furthest_rad - 0.01;
            turn.furthest_rad = turn.furthest_rad.max(from_first);
            self.at_rad.contains(&from_first) && !turn.is_over
        };
        if is_spoiled { (self.shows)(exposure, format) } else { self.sight.look(exposure, format) }
    }
}
