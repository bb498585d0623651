//! Settings of a scene that looks like the frames of a real VAST BioImager.
//!
//! ```text
//!   seed --> light, blur, noise   walls (each side for itself)   dust      camera: 1024 x 200 px, bore 112 px wide
//! ```
//! Every range brackets what was measured on lossless VAST frames (`docs/frames.md`).

use super::capillary::{Capillary, Wall};
use super::nuisance::{Dust, Nuisances};
use super::optics::Optics;
use super::phantom::{Larva, LarvaError, Look, Specimen};
use super::seeded::{Seeded, mixed};
use super::{Camera, SceneSettings};

/// A capillary of 600 um is 112 px wide in VAST frames.
const BORE_PX: f64 = 112.0;
const BORE_UM: f64 = 5.4 * BORE_PX;
/// Height of a VAST frame.
const HEIGHT: u32 = 200;
/// Level of the empty field. The light of a VAST is yellowish: blue is 10 levels below red.
const LIGHT_RGB: [f64; 3] = [222.0, 226.0, 213.0];
/// Noise of a VAST camera over that of the default optics.
pub const NOISE: f64 = 1.24;
/// Frames have at most this factor more or less dust than usual.
const DUSTINESS: f64 = 1.3;

impl SceneSettings {
    /// A scene as a real VAST shows it. The seed draws light, walls and dust. The camera takes frames of 1024 x 200 px with a bore of
    /// 112 px.
    pub fn real(seed: u64) -> Self {
        Self {
            camera: camera(BORE_UM, &Camera::default()),
            capillary: Capillary { bore_diameter_um: BORE_UM, ..Capillary::default() }.with_real_walls(seed),
            optics: Optics::default().with_real_light(seed).with_noise(NOISE),
            nuisances: Nuisances { seed, ..Nuisances::default() }.with_real_dust(seed),
        }
    }

    /// The same seen by another camera, in the bore of the reference scene.
    pub fn real_in(camera: &Camera, seed: u64) -> Self {
        let real = Self::real(seed);
        let capillary = Capillary { bore_diameter_um: Capillary::default().bore_diameter_um, ..real.capillary };
        Self { camera: camera.clone(), capillary, ..real }
    }
}

impl Specimen {
    /// A healthy larva as VAST frames show it. It nearly fills the bore, so it lies in the middle.
    ///
    /// # Errors
    /// Refuses an age that no larva has.
    pub fn as_on_a_vast(dpf: u8, seed: u64) -> Result<Self, LarvaError> {
        Ok(Larva::new(dpf, seed)?.with_look(Look::healthy(dpf, seed)).specimen().centred())
    }
}

/// The walls at the scale of [`camera`]: as many px wide as they are at a bore of 600 um.
pub fn scaled_walls(capillary: &Capillary) -> Capillary {
    let scale = capillary.bore_diameter_um / BORE_UM;
    let lower = capillary.lower.map(|wall| Wall { glass_um: scale * wall.glass_um, ..wall });
    Capillary { glass_um: scale * capillary.glass_um, lower, ..capillary.clone() }
}

/// The camera of a VAST: 1024 x 200 px, at a scale at which the bore is 112 px wide. Angles and the position of the axis relative to
/// the pixels are those of `of`.
pub fn camera(bore_um: f64, of: &Camera) -> Camera {
    let px_per_um = BORE_PX / bore_um;
    let uy_px = f64::from(HEIGHT) / 2.0 - (f64::from(of.height) / 2.0 - of.uy_px);
    Camera { kx_px_per_um: px_per_um, ky_px_per_um: px_per_um, uy_px, height: HEIGHT, ..of.clone() }
}

/// An independent stream of numbers for one part of the settings.
fn stream(seed: u64, part: u64) -> Seeded {
    Seeded::new(mixed(seed ^ (0x4EA1_0000 | part)))
}

impl Capillary {
    /// Walls as on real frames. Upper and lower wall are drawn separately.
    #[must_use]
    pub fn with_real_walls(self, seed: u64) -> Self {
        let mut draw = stream(seed, 1);
        let [upper, lower] = [(); 2].map(|()| {
            // Half of the walls show one line, the others two that blend.
            let (glass, line) = if draw.between(0.0, 1.0) < 0.5 { ([14.0, 18.0], [1.2, 1.7]) } else { ([26.0, 34.0], [0.8, 1.1]) };
            Wall {
                glass_um: draw.between(glass[0], glass[1]),
                line_px: draw.between(line[0], line[1]),
                bore_shade: draw.between(0.12, 0.25),
            }
        });
        Self {
            glass_um: upper.glass_um,
            wall_line_px: upper.line_px,
            bore_shade: upper.bore_shade,
            lower: Some(lower),
            lower_share: draw.between(0.85, 1.15),
            bore_loss: draw.between(0.012, 0.03),
            ..self
        }
    }
}

impl Optics {
    /// Light and blur as on real frames. The blur is added to that of these optics.
    #[must_use]
    pub fn with_real_light(self, seed: u64) -> Self {
        let mut draw = stream(seed, 2);
        let level = draw.between(0.99, 1.05);
        let more_blur_px = draw.between(1.05, 1.3) - Self::default().blur_px;
        Self {
            light_rgb: LIGHT_RGB.map(|light| light * level),
            blur_px: self.blur_px + more_blur_px,
            vignetting: 0.4 * self.vignetting,
            ..self
        }
    }
}

impl Nuisances {
    /// Dust as on real frames. Individual frames have a little more or less of it than usual.
    #[must_use]
    pub fn with_real_dust(self, seed: u64) -> Self {
        let density = DUSTINESS.powf(stream(seed, 3).between(-1.0, 1.0));
        self.with_dust(Dust::USUAL.times(density))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Exposure, Scene};

    /// Green level of each row of an empty scene without dust and noise: the median of the row.
    fn rows(settings: SceneSettings) -> Vec<f64> {
        let optics = settings.optics.with_noise(0.0);
        let nuisances = Nuisances::default();
        let frame = Scene::new(SceneSettings { optics, nuisances, ..settings }).render(&Exposure { angle_rad: 0.0, number: 0 });
        let row = |row: &[u8]| {
            let mut green: Vec<u8> = row.iter().skip(1).step_by(3).copied().collect();
            green.sort_unstable();
            f64::from(green[green.len() / 2])
        };
        frame.data.chunks(3 * frame.width as usize).map(row).collect()
    }

    #[test]
    fn the_two_walls_differ_and_the_bore_is_darker_than_the_field() {
        for seed in 0..8 {
            let settings = SceneSettings::real(seed);
            assert_ne!(settings.capillary.walls()[0], settings.capillary.walls()[1]);
            let rows = rows(settings);
            let bore = rows[95..105].iter().sum::<f64>() / 10.0;
            let field = rows[3..13].iter().chain(&rows[187..197]).sum::<f64>() / 20.0;
            // The whole bore of real frames has 0.96. Its middle is lighter than the parts beside the walls.
            assert!((0.955..0.992).contains(&(bore / field)), "seed {seed}: {bore} of {field}");
            // The upper and the lower wall are 56 px from the middle.
            for line in [&rows[36..50], &rows[150..164]] {
                let darkest = line.iter().copied().fold(f64::INFINITY, f64::min);
                assert!((0.35..0.85).contains(&(1.0 - darkest / bore)), "seed {seed}: {darkest} of {bore}");
            }
        }
    }

    #[test]
    fn the_default_scene_is_the_clean_one() {
        let default = SceneSettings::default();
        assert_eq!(default.capillary.walls()[0], default.capillary.walls()[1]);
        assert!(default.nuisances.glass_dust.none() && default.nuisances.water_dust.none() && default.nuisances.window_dust.none());
    }
}
