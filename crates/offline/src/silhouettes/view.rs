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
