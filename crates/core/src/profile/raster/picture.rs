//! A frame as colours: the input of segmentation, whatever the sensor's layout was.

use crate::frame::{PixelFormat, RawFrame};

/// Three planes of 8-bit colour, row by row: red, green, blue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    width: usize,
    height: usize,
    planes: [Vec<u8>; 3],
    /// Column and row of the first red pixel of a mosaic.
    first_red: Option<[usize; 2]>,
}

impl Picture {
    /// The colours of a frame. Mono frames give three equal planes; Bayer frames are demosaiced bilinearly.
    pub fn from_frame(frame: &RawFrame) -> Self {
        let (width, height) = (frame.width() as usize, frame.height() as usize);
        let planes = match frame.format().first_red() {
            Some(first_red) => super::bayer::demosaic(frame.bytes(), width, height, first_red),
            None if frame.format() == PixelFormat::Mono8 => std::array::from_fn(|_| frame.bytes().to_vec()),
            None => std::array::from_fn(|c| frame.bytes().iter().skip(c).step_by(3).copied().collect()),
        };
        Self { width, height, planes, first_red: frame.format().first_red() }
    }

    /// Three equal planes.
    pub(in crate::profile) fn from_grey(width: usize, grey: Vec<u8>) -> Self {
        Self { width, height: grey.len() / width.max(1), planes: [grey.clone(), grey.clone(), grey], first_red: None }
    }

    /// Width, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Red, green and blue, each row by row.
    pub fn planes(&self) -> &[Vec<u8>; 3] {
        &self.planes
    }

    /// Distance of the nearest pixel of the same colour along a row or a column.
    pub(in crate::profile) fn period(&self) -> usize {
        if self.first_red.is_some() { 2 } else { 1 }
    }

    /// Fills `taken` with each pixel in the colour in which the camera took it, or in green where it took all three.
    pub(in crate::profile) fn taken(&self, taken: &mut Vec<u8>) {
        let [red, green, blue] = &self.planes;
        taken.clear();
        taken.extend_from_slice(green);
        let Some([u0, v0]) = self.first_red else { return };
        for (v, row) in taken.chunks_exact_mut(self.width.max(1)).enumerate() {
            let (own, first) = if v % 2 == v0 { (red, u0) } else { (blue, 1 - u0) };
            for u in (first..self.width).step_by(2) {
                row[u] = own[v * self.width + u];
            }
        }
    }

    /// Rows for columns: what lies along one side of the picture then lies along the other.
    pub(in crate::profile) fn transposed(&self) -> Self {
        let (w, h) = (self.width, self.height);
        let planes = self.planes.each_ref().map(|plane| (0..w * h).map(|i| plane[i % h * w + i / h]).collect());
        Self { width: h, height: w, planes, first_red: self.first_red.map(|[u, v]| [v, u]) }
    }

    /// Number of planes that differ: 1 where all are equal, else 3.
    pub fn colours(&self) -> usize {
        let [red, green, blue] = &self.planes;
        if red == green && green == blue { 1 } else { 3 }
    }

    /// Interleaved bytes, red first.
    pub fn to_rgb(&self) -> Vec<u8> {
        let [r, g, b] = &self.planes;
        r.iter().zip(g).zip(b).flat_map(|((r, g), b)| [*r, *g, *b]).collect()
    }
}
