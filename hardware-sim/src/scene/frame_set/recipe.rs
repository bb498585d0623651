//! The recipe of a frame, and the frame that a seed makes of it.
//!
//! ```text
//!   larva ... dpf, fins, head, roll      lies: centred / moved / rests / wedged     bore: wide, or by the part it fills
//!   camera .. scale, ky / kx, tilt       light, lens, sensor, marks                 beside: bubbles, debris
//! ```

use super::item::{Item, Kind};
use super::labels::Labels;
use super::{Class, Difficulty, FrameSetError, FrameSpec, Realism};
use crate::scene::nuisance::{Drift, HotPixels, LightCentre, Marks, Motion};
use crate::scene::real;
use crate::scene::seeded::{Seeded, mixed};
use crate::scene::{Contents, Look, Placement, SceneSettings, Specimen};
use std::f64::consts::FRAC_PI_2;

/// The position of a single specimen across the bore.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lies {
    /// Moved down by this part of the free space. 0 is centred.
    Moved(f64),
    /// At rest on the lower wall.
    Rests,
    /// In its narrowest bore, seen from the side where it is widest. It touches both walls.
    Wedged,
}

/// Position of clutter along the capillary, relative to the specimen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Along {
    /// This far to the left of its left end, or to the right of its right end. A negative distance overlaps.
    Left(f64),
    Right(f64),
    /// At this part of its length from its left end.
    At(f64),
}

/// Clutter and its position. A plug is as wide as the bore permits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beside {
    pub kind: Kind,
    pub along: Along,
    /// Part of the free space between axis and wall. 1 touches the wall.
    pub out: f64,
    /// Direction in the frame, deg: 0 is down, 90 away from the camera, 180 up.
    pub towards_deg: f64,
}

#[derive(Debug, Clone)]
pub struct Recipe {
    name: String,
    difficulty: Difficulty,
    class: Class,
    specimens: Vec<(Kind, Placement)>,
    beside: Vec<Beside>,
    lies: Lies,
    fill: Option<f64>,
    angle_deg: f64,
    mono: bool,
    settings: SceneSettings,
    noise: f64,
    /// The frame is a crop of a VAST, whose bore has the same width in all frames.
    vast: bool,
}

/// A bore is wider than the narrowest one by at least this factor, because of rounding errors.
const SLACK: f64 = 1.0002;
/// Water around a plug of air, sum of both sides, um.
const FILM_UM: f64 = 10.0;
/// The largest part of the bore that specimens may fill if the recipe does not set it. The bore is widened for that.
const FULLEST: f64 = 0.96;

impl Recipe {
    pub fn empty(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            difficulty: Difficulty::Easy,
            class: Class::Empty,
            specimens: Vec::new(),
            beside: Vec::new(),
            lies: Lies::Moved(0.0),
            fill: None,
            angle_deg: 0.0,
            mono: false,
            settings: SceneSettings::default(),
            noise: 1.0,
            vast: false,
        }
    }

    pub fn of(name: impl Into<String>, class: Class, kind: Kind) -> Self {
        Self { class, ..Self::empty(name) }.with(kind, Placement::default())
    }

    pub fn larva(name: impl Into<String>, dpf: u8) -> Self {
        Self::of(name, Class::Larva, Kind::Larva { dpf, fins: true })
    }

    pub fn bare_larva(name: impl Into<String>, dpf: u8) -> Self {
        Self::of(name, Class::Larva, Kind::Larva { dpf, fins: false })
    }

    pub fn bead(name: impl Into<String>, diameter_um: f64) -> Self {
        Self::of(name, Class::Bead, Kind::Bead { diameter_um })
    }

    /// Adds a specimen. If there are several, each is at its own placement.
    pub fn with(mut self, kind: Kind, placement: Placement) -> Self {
        self.specimens.push((kind, placement));
        self
    }

    pub fn difficulty(self, difficulty: Difficulty) -> Self {
        Self { difficulty, ..self }
    }

    pub fn class(self, class: Class) -> Self {
        Self { class, ..self }
    }

    pub fn right(mut self) -> Self {
        self.specimens.iter_mut().for_each(|(_, p)| p.faces_right = !p.faces_right);
        self
    }

    /// Turns the specimen about its own axis, deg. At 0 a larva is seen from its side, at 90 from below, at -90 from above.
    pub fn roll(mut self, deg: f64) -> Self {
        self.specimens.iter_mut().for_each(|(_, p)| p.roll_rad += deg.to_radians());
        self
    }

    pub fn x(mut self, um: f64) -> Self {
        self.specimens.iter_mut().for_each(|(_, p)| p.x_um += um);
        self
    }

    pub fn angle(self, angle_deg: f64) -> Self {
        Self { angle_deg, ..self }
    }

    pub fn lies(self, lies: Lies) -> Self {
        Self { lies, ..self }
    }

    /// Sets the bore so that the narrowest bore of the specimen is this part of it.
    pub fn fill(self, part: f64) -> Self {
        Self { fill: Some(part), ..self }
    }

    /// As `fill`, unless the recipe has set it already.
    pub fn fill_by_default(self, part: f64) -> Self {
        Self { fill: self.fill.or(Some(part)), ..self }
    }

    pub fn is_of(&self, class: Class) -> bool {
        self.class == class
    }

    pub fn bore(mut self, diameter_um: f64) -> Self {
        self.settings.capillary.bore_diameter_um = diameter_um;
        self
    }

    pub fn beside(mut self, kind: Kind, along: Along, out: f64, towards_deg: f64) -> Self {
        self.beside.push(Beside { kind, along, out, towards_deg });
        self
    }

    pub fn tilt(mut self, deg: f64) -> Self {
        self.settings.camera.gamma_rad = deg.to_radians();
        self
    }

    pub fn scale(mut self, um_per_px: f64) -> Self {
        let across = self.settings.camera.ky_px_per_um / self.settings.camera.kx_px_per_um;
        self.settings.camera.kx_px_per_um = 1.0 / um_per_px;
        self.settings.camera.ky_px_per_um = across / um_per_px;
        self
    }

    /// Air around the glass, which stretches the image across.
    pub fn in_air(mut self) -> Self {
        self.settings.camera.ky_px_per_um = 1.333 * self.settings.camera.kx_px_per_um;
        self
    }

    pub fn blur(mut self, px: f64) -> Self {
        self.settings.optics.blur_px = px;
        self
    }

    pub fn moving(mut self, u_px: f64, v_px: f64) -> Self {
        self.settings.nuisances.motion = Motion { u_px, v_px };
        self
    }

    pub fn noise(self, factor: f64) -> Self {
        Self { noise: factor, ..self }
    }

    /// Sets the final drift of the lamp. The drawn exposures are near the end of the drift.
    pub fn drift(mut self, level: f64, colour: f64) -> Self {
        self.settings.nuisances.drift = Drift { level, colour, exposures: 10.0, flicker: 0.01 };
        self
    }

    pub fn vignetting(mut self, part: f64) -> Self {
        self.settings.optics.vignetting = part;
        self
    }

    pub fn light_at(mut self, u_px: f64, v_px: f64, falloff: f64) -> Self {
        self.settings.nuisances.light_centre = LightCentre { u_px, v_px, falloff };
        self
    }

    pub fn glass(mut self, scratches: u32, dust: u32, contrast: f64) -> Self {
        self.settings.nuisances.glass = Marks { scratches, dust, contrast };
        self
    }

    pub fn window(mut self, scratches: u32, dust: u32, contrast: f64) -> Self {
        self.settings.nuisances.window = Marks { scratches, dust, contrast };
        self
    }

    pub fn hot_pixels(mut self, count: u32) -> Self {
        self.settings.nuisances.hot_pixels = HotPixels { count, ..HotPixels::default() };
        self
    }

    /// A frame of a VAST: 1024 x 200 px, with a bore of 112 px.
    pub fn vast(self) -> Self {
        Self { vast: true, ..self }
    }

    pub fn mono(self) -> Self {
        Self { mono: true, ..self }
    }

    /// The frame for the seed of a list and a position in the list.
    pub(super) fn spec(self, list_seed: u64, index: u64, realism: Realism) -> Result<FrameSpec, FrameSetError> {
        // 32 bits, so that readers that store numbers as f64 do not change the seed.
        let seed = mixed(mixed(list_seed) ^ index) & 0xFFFF_FFFF;
        let mut draw = Seeded::new(seed);
        let mut spec = FrameSpec {
            name: self.name,
            difficulty: self.difficulty,
            class: self.class,
            specimens: Vec::new(),
            clutter: Vec::new(),
            settings: self.settings,
            angle_rad: self.angle_deg.to_radians() + draw.between(-0.06, 0.06),
            number: draw.between(20.0, 40.0) as u64,
            seed,
            mono: self.mono,
            demosaicked: realism == Realism::Real,
            labels: Labels::default(),
        };
        // A random position of the axis relative to the pixels.
        spec.settings.camera.ux_px += draw.between(-0.5, 0.5);
        spec.settings.camera.uy_px += draw.between(-0.5, 0.5);
        spec.settings.optics = spec.settings.optics.with_noise(self.noise);
        spec.settings.optics.noise_seed = seed;
        spec.settings.nuisances.seed = seed;
        spec.settings = realism.applied(spec.settings, seed);
        let mut contents = Contents::default();
        for (i, (kind, mut placement)) in self.specimens.into_iter().enumerate() {
            placement.x_um += draw.between(-30.0, 30.0);
            placement.roll_rad += draw.between(-0.12, 0.12);
            let individual = mixed(seed + i as u64) & 0xFFFF_FFFF;
            let look = realism.look(kind, individual);
            let item = Item { kind, seed: individual, placement, look };
            contents.specimens.push(item.specimen(&spec.name)?);
            spec.specimens.push(item);
        }
        match (contents.specimens.as_mut_slice(), spec.specimens.as_mut_slice()) {
            ([one], [item]) => {
                lay(one, self.lies, self.fill, &mut spec.settings.capillary.bore_diameter_um, &mut spec.angle_rad);
                item.placement = one.placement();
            }
            (several, _) => widen(several, &mut spec.settings.capillary.bore_diameter_um),
        }
        if self.vast {
            spec.settings.capillary = real::scaled_walls(&spec.settings.capillary);
            spec.settings.camera = real::camera(spec.settings.capillary.bore_diameter_um, &spec.settings.camera);
        }
        for (i, beside) in self.beside.iter().enumerate() {
            let kind = match beside.kind {
                Kind::Plug { length_um, .. } => Kind::Plug { length_um, diameter_um: spec.settings.capillary.bore_diameter_um - FILM_UM },
                kind => kind,
            };
            let mut item =
                Item { kind, seed: mixed(seed ^ (0xC1 + i as u64)) & 0xFFFF_FFFF, placement: Placement::default(), look: Look::default() };
            let clutter = item.specimen(&spec.name)?;
            item.placement = beside.placement(&clutter, contents.specimens.first(), &spec);
            contents.clutter.push(clutter.placed(item.placement));
            spec.clutter.push(item);
        }
        let settled = contents
            .settled(spec.settings.capillary.bore_radius_um())
            .map_err(|source| FrameSetError::Placement { name: spec.name.clone(), source })?;
        spec.labels = Labels::measured(&settled, &spec.settings, spec.angle_rad);
        Ok(spec)
    }
}

impl Realism {
    /// The appearance of an object.
    fn look(self, kind: Kind, seed: u64) -> Look {
        match (self, kind) {
            (Self::Real, Kind::Larva { dpf, .. }) => Look::drawn(dpf, seed),
            _ => Look::default(),
        }
    }

    /// The settings of a clean frame, made as real as this.
    fn applied(self, clean: SceneSettings, seed: u64) -> SceneSettings {
        match self {
            Self::Clean => clean,
            Self::Dust => SceneSettings { nuisances: clean.nuisances.with_real_dust(seed), ..clean },
            Self::Real => SceneSettings {
                capillary: clean.capillary.with_real_walls(seed),
                optics: clean.optics.with_real_light(seed).with_noise(real::NOISE),
                nuisances: clean.nuisances.with_real_dust(seed),
                ..clean
            },
        }
    }
}

/// Chooses the bore for a specimen, and its position across the bore.
fn lay(specimen: &mut Specimen, lies: Lies, fill: Option<f64>, bore_um: &mut f64, angle_rad: &mut f64) {
    *specimen = specimen.clone().centred();
    let needed_um = specimen.narrowest_bore().diameter_um * SLACK;
    *bore_um = match (lies, fill) {
        (Lies::Wedged, _) => needed_um,
        (_, Some(part)) => needed_um / part,
        (_, None) => bore_um.max(needed_um / FULLEST),
    };
    let mut placement = specimen.placement();
    match lies {
        Lies::Moved(part) => placement.y_um += part * (*bore_um - needed_um) / 2.0,
        Lies::Rests => placement.rests_on_wall = true,
        Lies::Wedged => *angle_rad = widest_from(&placed_points(specimen)),
    }
    *specimen = specimen.clone().placed(placement);
}

/// Makes the bore wide enough for several specimens at their placements.
fn widen(specimens: &[Specimen], bore_um: &mut f64) {
    let reach_um = specimens.iter().flat_map(placed_points).map(|[_, y, z]| y.hypot(z)).fold(0.0, f64::max);
    *bore_um = bore_um.max(2.0 * reach_um / FULLEST);
}

fn placed_points(specimen: &Specimen) -> Vec<[f64; 3]> {
    let placement = specimen.placement();
    specimen.points().map(|&point| placement.place(point)).collect()
}

/// Angle of the axis from which points reach furthest across.
fn widest_from(points: &[[f64; 3]]) -> f64 {
    let width = |angle: f64| {
        let (sin, cos) = angle.sin_cos();
        let (low, high) = extent(points.iter().map(|p| p[1] * cos - p[2] * sin));
        high - low
    };
    let degrees = (0..180).map(|deg| f64::from(deg).to_radians() - FRAC_PI_2);
    degrees.map(|angle| (angle, width(angle))).fold((0.0, 0.0), |best, one| if one.1 > best.1 { one } else { best }).0
}

fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

impl Beside {
    fn placement(&self, clutter: &Specimen, specimen: Option<&Specimen>, spec: &FrameSpec) -> Placement {
        let (low, high) = extent(clutter.points().map(|p| p[0]));
        let (left, right) = specimen.map_or((0.0, 0.0), |s| extent(placed_points(s).into_iter().map(|p| p[0])));
        let x_um = match self.along {
            Along::Left(gap) => left - gap - high,
            Along::Right(gap) => right + gap - low,
            Along::At(part) => left + part * (right - left),
        };
        let needs = clutter.narrowest_bore();
        let room_um = (spec.settings.capillary.bore_radius_um() - needs.diameter_um * SLACK / 2.0).max(0.0);
        // Down in the image is +y at axis angle 0. It turns with the axis.
        let (sin, cos) = (self.towards_deg.to_radians() - spec.angle_rad).sin_cos();
        let out_um = self.out * room_um;
        Placement { x_um, y_um: out_um * cos - needs.y_um, z_um: out_um * sin - needs.z_um, ..Placement::default() }
    }
}
