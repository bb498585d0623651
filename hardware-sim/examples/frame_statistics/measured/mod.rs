//! Statistics of frames of a larva in a capillary, from the pixels alone. They tell how near emulated frames are to real ones.
//!
//! ```text
//!   frame --> walls (upright) --> light (level without dust and body) --> body --> specks, noise, edges
//!             bore, lines, shade                                          mask beside the frame, or found
//! ```
//! Lengths are px of the frame, levels are of 8 bits. Depths and shades are parts of the local light. Everything that needs one colour
//! uses green.

mod body;
mod edges;
mod light;
mod specks;
mod walls;

use body::Body;
use hardware_sim::scene::Rgb;
use light::Light;
use walls::Walls;

/// A frame to measure.
#[derive(Debug, Clone)]
pub struct Frame {
    pub picture: Rgb,
    /// The pixels of the specimen with its fins, row by row, if they are known.
    pub mask: Option<Vec<bool>>,
}

/// The statistics of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameStatistics {
    /// Distance between the darkest points of both wall lines.
    pub bore_px: f64,
    /// Level of the bore without body, mean of the colours.
    pub level: f64,
    /// The level of blue minus that of red.
    pub blue_minus_red: f64,
    /// The level in the bore over that outside the capillary.
    pub bore_over_outside: f64,
    /// Standard deviation of the noise, mean of the colours.
    pub noise_sd: f64,
    /// Correlation of the noise of horizontal neighbours.
    pub noise_green: f64,
    pub noise_red: f64,
    /// Specks that absorb at least 2 % of the light, per 1000 px of length of the whole bore.
    pub specks_per_1000px: f64,
    /// Of these, specks of 2 to 4 %, and deeper ones.
    pub shallow_per_1000px: f64,
    pub deep_per_1000px: f64,
    /// Quantiles of the depth of specks: 50 and 90 %. `None` without specks.
    pub speck_depth: Option<[f64; 2]>,
    /// Quantiles of the full width at half maximum of specks: 10, 50 and 90 %.
    pub speck_fwhm_px: Option<[f64; 3]>,
    /// Specks nearer than 25 px to the body.
    pub specks_near_body: Option<f64>,
    /// Depth and full width at half maximum of the line of the upper and of the lower wall.
    pub wall_depth: [f64; 2],
    pub wall_fwhm_px: [f64; 2],
    /// Loss of light at 6 and at 10 px from the wall against the light at 14 to 20 px, mean of both walls.
    pub shade: [f64; 2],
    /// Distance over which the sharpest edges of the body rise from 10 to 90 %.
    pub edge_px: Option<f64>,
    pub body: Option<BodyStatistics>,
}

/// The statistics of the specimen.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyStatistics {
    /// Median of the light that passes through the body, as a part of the light beside it.
    pub median: f64,
    /// Share of the body that is darker than a quarter of the light.
    pub dark_share: f64,
    /// Standard deviation of the level against the mean of 9 x 9 px.
    pub texture_sd: f64,
    /// Least distance of the body from the line of the upper and of the lower wall.
    pub gap_px: [f64; 2],
    /// Area of the fins over that of the body, and their mean darkness. Only with a mask.
    pub fins: Option<[f64; 2]>,
}

#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum StatisticsError {
    #[error("the frame is {width} x {height} px; at least 100 x 60 px are needed")]
    Small { width: u32, height: u32 },
    #[error("the mask has {found} pixels and the frame {expected}")]
    Mask { expected: usize, found: usize },
    #[error("no two walls of a capillary were found")]
    NoWalls,
}

impl FrameStatistics {
    /// # Errors
    /// The frame is too small, its mask has another size, or it shows no capillary.
    pub fn measured(frame: &Frame) -> Result<Self, StatisticsError> {
        let Rgb { width, height, .. } = frame.picture;
        if width < 100 || height < 60 {
            return Err(StatisticsError::Small { width, height });
        }
        let pixels = (width * height) as usize;
        if let Some(found) = frame.mask.as_ref().map(Vec::len).filter(|&found| found != pixels) {
            return Err(StatisticsError::Mask { expected: pixels, found });
        }
        let [red, green, blue] = [0, 1, 2].map(|k| Plane::of(&frame.picture, k));
        let walls = Walls::found(&green).ok_or(StatisticsError::NoWalls)?;
        let body = Body::found(&green, &walls, frame.mask.as_deref());
        let lights = [&red, &green, &blue].map(|plane| Light::of(plane, &walls, &body));
        let [of_red, of_green, of_blue] = &lights;
        let levels = lights.each_ref().map(|light| light.bore_level);
        let specks = specks::found(of_green, &walls, &body);
        let per_1000px = |least: f64, most: f64| specks.per_1000px(|depth| (least..most).contains(&depth));
        Ok(Self {
            bore_px: walls.bore_px(),
            level: levels.iter().sum::<f64>() / 3.0,
            blue_minus_red: levels[2] - levels[0],
            bore_over_outside: of_green.bore_level / of_green.outside_level,
            noise_sd: (of_red.noise_sd + of_green.noise_sd + of_blue.noise_sd) / 3.0,
            noise_green: of_green.noise_correlation,
            noise_red: of_red.noise_correlation,
            specks_per_1000px: per_1000px(0.02, 1.0),
            shallow_per_1000px: per_1000px(0.02, 0.04),
            deep_per_1000px: per_1000px(0.04, 1.0),
            speck_depth: specks.depths().map(|depths| [0.5, 0.9].map(|part| quantile(&depths, part))),
            speck_fwhm_px: specks.widths().map(|widths| [0.1, 0.5, 0.9].map(|part| quantile(&widths, part))),
            specks_near_body: (!body.is_empty()).then_some(specks.near_body as f64),
            wall_depth: walls.lines.map(|line| line.depth),
            wall_fwhm_px: walls.lines.map(|line| line.fwhm_px),
            shade: of_green.shade,
            edge_px: edges::sharpest_px(&green, &body, of_green.bore_level),
            body: body.statistics(&green, of_green, &walls),
        })
    }
}

/// One colour of a frame.
#[derive(Debug, Clone)]
struct Plane {
    width: usize,
    height: usize,
    data: Vec<f32>,
}

impl Plane {
    fn of(picture: &Rgb, colour: usize) -> Self {
        let data = picture.data.iter().skip(colour).step_by(3).map(|&level| f32::from(level)).collect();
        Self { width: picture.width as usize, height: picture.height as usize, data }
    }

    fn at(&self, u: usize, v: usize) -> f64 {
        f64::from(self.data[v * self.width + u])
    }

    /// Linear interpolation between pixel centres. `None` outside.
    fn between(&self, u: f64, v: f64) -> Option<f64> {
        if u < 0.0 || v < 0.0 || u > (self.width - 1) as f64 || v > (self.height - 1) as f64 {
            return None;
        }
        let (i, j) = ((u as usize).min(self.width - 2), (v as usize).min(self.height - 2));
        let (du, dv) = (u - i as f64, v - j as f64);
        let row = |j: usize| self.at(i, j) * (1.0 - du) + self.at(i + 1, j) * du;
        Some(row(j) * (1.0 - dv) + row(j + 1) * dv)
    }
}

/// The value below which `part` of the values lie. The values need no order.
pub fn quantile(values: &[f64], part: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = part * (sorted.len().saturating_sub(1)) as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    match (sorted.get(low), sorted.get(high)) {
        (Some(a), Some(b)) => a + (b - a) * (at - low as f64),
        _ => f64::NAN,
    }
}

#[cfg(test)]
mod tests;
