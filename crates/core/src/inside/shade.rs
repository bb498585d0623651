//! The light that passes a specimen in one view.

use crate::profile::{Mask, Picture};

/// Pixels around the profile that are kept.
const MARGIN_PX: usize = 6;
/// The light beside the specimen is at least this grey value. Less is no light.
const LEAST_LIGHT: u8 = 20;

/// Transmission of the pixels around a profile: the light of each over that beside the specimen. 200 is all light.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shade {
    left: usize,
    top: usize,
    width: usize,
    light: Vec<u8>,
}

impl Shade {
    /// Transmission 1 in the values that are kept. Brighter pixels, as behind a lens, have up to 255.
    const ALL: f64 = 200.0;

    /// From a picture and the profile in it. `None` without a profile, and without light beside it.
    pub(crate) fn of(picture: &Picture, mask: &Mask) -> Option<Self> {
        let rows: Vec<usize> = (0..mask.height()).filter(|&v| mask.row(v).iter().any(|&p| p != 0)).collect();
        let (&first, &last) = rows.first().zip(rows.last())?;
        let columns = |row: usize| {
            let row = mask.row(row);
            row.iter().position(|&p| p != 0).zip(row.iter().rposition(|&p| p != 0))
        };
        let (low, high) = rows.iter().filter_map(|&v| columns(v)).fold((usize::MAX, 0), |(a, b), (l, h)| (a.min(l), b.max(h)));
        let (top, bottom) = (first.saturating_sub(MARGIN_PX), (last + MARGIN_PX + 1).min(mask.height()));
        let (left, right) = (low.saturating_sub(MARGIN_PX), (high + MARGIN_PX + 1).min(mask.width()));
        // Green is the plane of which a colour sensor has most pixels.
        let green = &picture.planes()[1];
        let mut histogram = [0usize; 256];
        for v in first..=last {
            for u in left..right {
                if !mask.get(u, v) {
                    histogram[usize::from(green[v * picture.width() + u])] += 1;
                }
            }
        }
        let half = histogram.iter().sum::<usize>() / 2;
        let mut below = 0;
        let light = histogram.iter().position(|&n| {
            below += n;
            below > half
        })? as u8;
        if light < LEAST_LIGHT {
            return None;
        }
        let value: [u8; 256] = std::array::from_fn(|g| (Self::ALL * g as f64 / f64::from(light)).round().min(255.0) as u8);
        let light = (top..bottom)
            .flat_map(|v| green[v * picture.width() + left..v * picture.width() + right].iter().map(|&g| value[usize::from(g)]))
            .collect();
        Some(Self { left, top, width: right - left, light })
    }

    /// Transmission at a place (u, v) in px, linear between pixels. `None` beyond what is kept.
    pub(crate) fn at(&self, (u, v): (f64, f64)) -> Option<f64> {
        let (u, v) = (u - self.left as f64, v - self.top as f64);
        let height = self.light.len() / self.width;
        if !(u >= 0.0 && v >= 0.0 && u <= self.width as f64 - 1.0 && v <= height as f64 - 1.0) {
            return None;
        }
        let (x, y) = (u as usize, v as usize);
        let (du, dv) = (u - x as f64, v - y as f64);
        let (right, below) = ((x + 1).min(self.width - 1), (y + 1).min(height - 1));
        let value = |x: usize, y: usize| f64::from(self.light[y * self.width + x]);
        let upper = (1.0 - du) * value(x, y) + du * value(right, y);
        let lower = (1.0 - du) * value(x, below) + du * value(right, below);
        Some(((1.0 - dv) * upper + dv * lower) / Self::ALL)
    }
}
