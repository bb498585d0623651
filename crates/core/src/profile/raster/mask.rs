//! A binary mask: the pixels that a profile covers.

use crate::profile::Columns;

/// A mask. Pixel (u, v) is at `v * width + u`; inside is 255, outside 0.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    width: usize,
    height: usize,
    data: Vec<u8>,
}

/// The data do not fit the mask's size, or the mask has no pixel.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("a mask of {width} x {height} px needs {expected} values, and at least one; found {found}")]
pub struct WrongMaskSize {
    /// Width of the mask, px.
    pub width: usize,
    /// Height of the mask, px.
    pub height: usize,
    /// Pixels that the mask has.
    pub expected: usize,
    /// Values given.
    pub found: usize,
}

impl Mask {
    /// A mask without a pixel inside.
    pub fn empty(width: usize, height: usize) -> Self {
        Self { width, height, data: vec![0; width * height] }
    }

    /// The mask of 8-bit coverage, row by row. A pixel is inside from 128 on.
    ///
    /// # Errors
    /// Data that is not `width * height` long, or empty.
    pub fn from_coverage(width: usize, height: usize, mut data: Vec<u8>) -> Result<Self, WrongMaskSize> {
        if data.len() != width * height || data.is_empty() {
            return Err(WrongMaskSize { width, height, expected: width * height, found: data.len() });
        }
        for p in &mut data {
            *p = if *p >= 128 { 255 } else { 0 };
        }
        Ok(Self { width, height, data })
    }

    /// Width, px.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row: 0 or 255.
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// The pixels of row `v`.
    pub fn row(&self, v: usize) -> &[u8] {
        &self.data[v * self.width..(v + 1) * self.width]
    }

    /// The mask with other edges: what lies beyond `new` is removed, and what lies between `old` and `new` is added.
    pub(crate) fn with_edges(&self, old: &Columns, new: &Columns) -> Self {
        let mut mask = self.clone();
        for u in 0..self.width {
            let (old, Some(new)) = (old.get(u), new.get(u)) else { continue };
            if old == Some(new) {
                continue;
            }
            for v in 0..self.height {
                let row = v as f64;
                let within = new.upper <= row && row <= new.lower;
                let kept = self.get(u, v) || old.is_none_or(|old| row < old.upper || row > old.lower);
                mask.set(u, v, within && kept);
            }
        }
        mask
    }

    /// Whether the pixel whose centre is nearest to `(u, v)` is inside. Outside the image none is.
    pub fn covers(&self, u: f64, v: f64) -> bool {
        let (u, v) = ((u + 0.5).floor(), (v + 0.5).floor());
        u >= 0.0 && v >= 0.0 && u < self.width as f64 && v < self.height as f64 && self.get(u as usize, v as usize)
    }

    /// Whether pixel (u, v) is inside.
    ///
    /// # Panics
    ///
    /// For a pixel outside the mask.
    pub fn get(&self, u: usize, v: usize) -> bool {
        self.data[v * self.width + u] != 0
    }

    /// Sets whether pixel (u, v) is inside.
    ///
    /// # Panics
    ///
    /// For a pixel outside the mask.
    pub fn set(&mut self, u: usize, v: usize, inside: bool) {
        self.data[v * self.width + u] = if inside { 255 } else { 0 };
    }

    /// Number of pixels inside.
    pub fn area_px(&self) -> usize {
        self.data.iter().filter(|&&p| p != 0).count()
    }

    /// Intersection over union. 1 for two empty masks.
    pub fn iou(&self, other: &Self) -> f64 {
        let (mut both, mut either) = (0usize, 0usize);
        for (a, b) in self.data.iter().zip(&other.data) {
            both += usize::from(*a != 0 && *b != 0);
            either += usize::from(*a != 0 || *b != 0);
        }
        if either == 0 { 1.0 } else { both as f64 / either as f64 }
    }

    /// Mean position of the pixels inside, `[u, v]`, px. `None` where there is none.
    pub fn centroid(&self) -> Option<[f64; 2]> {
        let (mut n, mut su, mut sv) = (0u64, 0u64, 0u64);
        for v in 0..self.height {
            for (u, _) in self.row(v).iter().enumerate().filter(|(_, p)| **p != 0) {
                n += 1;
                su += u as u64;
                sv += v as u64;
            }
        }
        (n > 0).then(|| [su as f64 / n as f64, sv as f64 / n as f64])
    }
}
