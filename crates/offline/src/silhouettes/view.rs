//! One silhouette.

use carved_core::carver::Leaves;
use carved_core::geometry::Camera;
use carved_core::profile::{Columns, Mask, WrongMaskSize};

/// A silhouette is not of the size of the camera's sensor.
#[derive(Debug, thiserror::Error)]
#[error("{name} is {width} x {height} px, but the camera gives the sensor as {sensor_width} x {sensor_height}")]
pub struct WrongSensor {
    /// Name of the view.
    pub name: String,
    /// Its width, px.
    pub width: usize,
    /// Its height, px.
    pub height: usize,
    /// Width of the sensor, px.
    pub sensor_width: u32,
    /// Height of the sensor, px.
    pub sensor_height: u32,
}

/// A picture is no silhouette.
#[derive(Debug, thiserror::Error)]
pub enum NoSilhouette {
    /// It is white where the object is not.
    #[error("it looks inverted: {border_percent} % of its border is inside; expected white (255) for the object on black (0). Invert it")]
    Inverted {
        /// Share of the border that is inside, %.
        border_percent: usize,
    },
    /// Its values are no coverage.
    #[error(
        "found {count} values from 0 to {largest} where 0 is outside and {full} inside; expected two values, or the covered share of each pixel up \
         to {full}. Save it with 0 and {full}"
    )]
    Values {
        /// Different values.
        count: usize,
        /// The largest one.
        largest: u16,
        /// The value of a covered pixel.
        full: u16,
    },
}

/// The coverage that the values of a picture mean, row by row. `full`: the largest value of its depth. Two values are outside and inside,
/// whatever they are: programs store masks as 0 and 1, or as 0 and 255 in 16 bits.
///
/// # Errors
/// Other values that are no share of `full`, or an object that is where the background should be.
pub fn coverage_of(values: &[u16], width: usize, full: u16) -> Result<Vec<u8>, NoSilhouette> {
    let mut seen = vec![false; usize::from(full) + 1];
    for value in values {
        seen[usize::from(*value)] = true;
    }
    let found: Vec<u16> = (0..=full).filter(|value| seen[usize::from(*value)]).collect();
    let coverage: Vec<u8> = match found[..] {
        [] | [0] => vec![0; values.len()],
        [_] => vec![255; values.len()],
        [_, inside] if found.len() == 2 => values.iter().map(|value| if *value == inside { 255 } else { 0 }).collect(),
        [.., largest] if largest <= full / 2 => return Err(NoSilhouette::Values { count: found.len(), largest, full }),
        _ => {
            let share = |value: u16| ((u32::from(value) * 255 + u32::from(full) / 2) / u32::from(full)) as u8;
            values.iter().map(|value| share(*value)).collect()
        }
    };
    let height = values.len() / width.max(1);
    let is_border = |at: usize| at.is_multiple_of(width) || at % width == width - 1 || at / width == 0 || at / width == height - 1;
    let (mut border, mut inside) = (0, 0);
    for at in (0..coverage.len()).filter(|at| is_border(*at)) {
        border += 1;
        inside += usize::from(coverage[at] >= 128);
    }
    // An object that leaves the picture on two sides covers a part of its border.
    if 2 * inside > border {
        return Err(NoSilhouette::Inverted { border_percent: 100 * inside / border });
    }
    Ok(coverage)
}

/// A silhouette with its edges.
#[derive(Debug, Clone)]
pub struct View {
    /// Name of its picture, for reports and errors.
    pub name: String,
    /// The pixels inside.
    pub mask: Mask,
    /// Columns of the coverage if the image is anti-aliased, else of the mask.
    pub columns: Columns,
}

impl View {
    /// The silhouette of 8-bit coverage, row by row. Grey values are the covered share of a pixel; from 128 on a pixel is inside.
    ///
    /// # Errors
    /// Data that is not `width * height` long, or empty.
    pub fn from_coverage(name: String, width: usize, height: usize, coverage: &[u8]) -> Result<Self, WrongMaskSize> {
        let mask = Mask::from_coverage(width, height, coverage.to_vec())?;
        let columns =
            if is_anti_aliased(coverage, &mask) { Columns::from_coverage(width, height, coverage) } else { Columns::from_mask(&mask) };
        Ok(Self { name, mask, columns })
    }

    /// Checks that the silhouette has the size of the camera's sensor.
    ///
    /// # Errors
    /// Both sizes.
    pub fn fits(&self, camera: &Camera) -> Result<(), WrongSensor> {
        let (width, height, sensor_width, sensor_height) = (self.mask.width(), self.mask.height(), camera.width, camera.height);
        if (sensor_width as usize, sensor_height as usize) == (width, height) {
            return Ok(());
        }
        Err(WrongSensor { name: self.name.clone(), width, height, sensor_width, sensor_height })
    }

    /// Whether the silhouette reaches the first or last column of the image, where the specimen continues.
    pub fn leaves(&self) -> Leaves {
        let reaches = |u: usize| self.columns.get(u).is_some();
        Leaves { left: reaches(0), right: reaches(self.mask.width() - 1) }
    }

    /// Whether it shows nothing.
    pub fn is_blank(&self) -> bool {
        self.columns.extent().is_none()
    }
}

/// Whether grey values are the covered share of a pixel: they then occur only along edges, and all other pixels are black or white.
fn is_anti_aliased(coverage: &[u8], mask: &Mask) -> bool {
    let grey = coverage.iter().filter(|&&c| c != 0 && c != 255).count();
    let (width, data) = (mask.width(), mask.data());
    let edges = data.chunks_exact(width).map(|row| row.windows(2).filter(|w| w[0] != w[1]).count()).sum::<usize>()
        + data.iter().zip(data.iter().skip(width)).filter(|(a, b)| a != b).count();
    grey <= 3 * edges
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 8 x 6 px with an object that reaches the left border.
    fn picture(outside: u16, inside: u16) -> Vec<u16> {
        (0..48).map(|at| if (2..4).contains(&(at / 8)) && at % 8 < 5 { inside } else { outside }).collect()
    }

    #[test]
    fn two_values_are_outside_and_inside_in_every_depth() {
        let expected = coverage_of(&picture(0, 255), 8, 255).unwrap();
        assert_eq!(expected.iter().map(|value| u32::from(*value)).sum::<u32>(), 10 * 255);
        for (outside, inside, full) in [(0, 1, 255), (0, 1, 65535), (0, 255, 65535), (0, 65535, 65535), (1, 2, 255), (0, 100, 255)] {
            assert_eq!(coverage_of(&picture(outside, inside), 8, full).unwrap(), expected, "{outside}, {inside}, {full}");
        }
        assert_eq!(coverage_of(&[0; 48], 8, 255).unwrap(), [0; 48], "a view may be blank");
    }

    #[test]
    fn what_is_no_silhouette_is_reported_by_what_was_found() {
        for values in [picture(255, 0), vec![255; 48], vec![1; 48]] {
            let error = coverage_of(&values, 8, 255).unwrap_err().to_string();
            assert!(error.contains("inverted"), "{error}");
        }
        let mut labels = picture(0, 1);
        labels[16] = 2;
        let error = coverage_of(&labels, 8, 255).unwrap_err().to_string();
        assert!(error.contains("3 values from 0 to 2"), "{error}");
        // The share of a covered pixel, in both depths.
        let mut smooth = picture(0, 255);
        smooth[21] = 128;
        let deep: Vec<u16> = smooth.iter().map(|value| value * 257).collect();
        assert_eq!(coverage_of(&smooth, 8, 255).unwrap()[21], 128);
        assert_eq!(coverage_of(&deep, 8, 65535).unwrap(), coverage_of(&smooth, 8, 255).unwrap());
    }
}
