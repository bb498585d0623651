//! From the parts of a specimen to what it lets through, on a fine lattice that is aligned with the capillary.
//!
//! ```text
//!   parts ── chords along the line of sight ──> absorption, optical path ── Beer and Lambert ──> intensity
//!                        │                                                         │ transport of intensity
//!                        └──> coverage (truth)                     blurred by a disc <┘
//! ```
//! The line of sight is that of a telecentric lens: all rays are parallel.

use crate::shape::{Kind, Section, Specimen};
use rayon::prelude::*;

/// Cells of the lattice per px.
pub const FINE: usize = 3;

/// How the specimen is imaged.
#[derive(Debug, Clone, Copy)]
pub struct Optics {
    /// Distance from the middle of the specimen to the focus, um, positive towards the lens. Positive values gather light in dense parts.
    pub defocus_um: f64,
    /// Steepest ray that the lens accepts, rad. What a specimen bends further is lost, which makes a dark rim of its own.
    pub aperture_rad: f64,
    /// Half angle of the cone of light before the specimen, rad: between `aperture - cone` and `aperture + cone` the loss grows.
    pub cone_rad: f64,
    /// Radius of the disc that blurs the picture, px.
    pub disc_px: f64,
}

/// Values in the cells of a lattice, column by column. Cell (0, 0) lies at slice `first_column` and `first_row` steps below the axis.
#[derive(Debug, Clone)]
pub struct Lattice {
    pub first_column: isize,
    pub first_row: isize,
    pub rows: usize,
    pub data: Vec<f32>,
}

impl Lattice {
    fn like(other: &Self, value: f32) -> Self {
        Self { data: vec![value; other.data.len()], ..*other }
    }

    /// Mean over a square of `FINE` x `FINE` cells around a position given in steps; `beyond` outside the lattice.
    pub fn mean(&self, column: f64, row: f64, beyond: f32) -> f32 {
        let taps = |at: f64, first: isize| {
            let from = at - first as f64 - FINE as f64 / 2.0 + 0.5;
            let share = (from - from.floor()) as f32;
            (from.floor() as isize, [1.0 - share, share])
        };
        let ((c0, cs), (r0, rs)) = (taps(column, self.first_column), taps(row, self.first_row));
        let columns = (self.data.len() / self.rows) as isize;
        if c0 < 0 || r0 < 0 || c0 + FINE as isize >= columns || r0 + FINE as isize >= self.rows as isize {
            return beyond;
        }
        let weight = |i: usize, ends: [f32; 2]| {
            if i == 0 {
                ends[0]
            } else if i == FINE {
                ends[1]
            } else {
                1.0
            }
        };
        let mut sum = 0.0;
        for i in 0..=FINE {
            let start = (c0 as usize + i) * self.rows + r0 as usize;
            let column: f32 = self.data[start..=start + FINE].iter().enumerate().map(|(j, value)| weight(j, rs) * value).sum();
            sum += weight(i, cs) * column;
        }
        sum / (FINE * FINE) as f32
    }
}

/// What a specimen at one angle does to the light, and where it is.
pub struct SpecimenImage {
    /// Intensity of red, green and blue; 1 without a specimen.
    pub intensity: [Lattice; 3],
    /// Share of each cell that the specimen covers, fins included.
    pub covered: Lattice,
    /// The same without the fins.
    pub body: Lattice,
}

/// Images a specimen turned by `omega` (rad) about the axis: a point `(y, z)` is seen at `y cos - z sin`.
pub fn image(specimen: &Specimen, omega: f64, optics: &Optics) -> SpecimenImage {
    let way = optics.defocus_um.abs() * (optics.aperture_rad + optics.cone_rad) / specimen.step_um;
    let margin = (way + optics.disc_px * FINE as f64).ceil() as isize + 2 * FINE as isize;
    let slices = specimen.slices();
    let half = (specimen.radius_um() / specimen.step_um).ceil() as isize + margin;
    let rows = (2 * half + 1) as usize;
    let columns = (slices.end - slices.start + 2 * margin) as usize;
    let empty = Lattice { first_column: slices.start - margin, first_row: -half, rows, data: vec![0.0; rows * columns] };
    let (mut path, mut covered, mut body) = (empty.clone(), empty.clone(), empty.clone());
    let mut depths: [Lattice; 3] = std::array::from_fn(|_| empty.clone());
    let [red, green, blue] = &mut depths;
    (path.data.par_chunks_mut(rows), covered.data.par_chunks_mut(rows), body.data.par_chunks_mut(rows))
        .into_par_iter()
        .zip(red.data.par_chunks_mut(rows).zip(green.data.par_chunks_mut(rows)).zip(blue.data.par_chunks_mut(rows)))
        .enumerate()
        .for_each_init(
            || vec![0.0f32; rows],
            |chord, (column, ((path, covered, body), ((red, green), blue)))| {
                let slice = empty.first_column + column as isize;
                for part in &specimen.parts {
                    let Some(section) = part.section(slice) else { continue };
                    chord.fill(0.0);
                    let span = chords(section, omega, specimen.step_um, empty.first_row, chord);
                    cover(span, covered);
                    if part.kind != Kind::Fin {
                        cover(span, body);
                    }
                    let Some((first, last)) = clamped(span, rows) else { continue };
                    let [r, g, b] = part.material.absorption_per_um;
                    for row in first..=last {
                        let um = chord[row].abs();
                        path[row] += part.material.index * um;
                        red[row] += r * um;
                        green[row] += g * um;
                        blue[row] += b * um;
                    }
                }
            },
        );
    depths.par_iter_mut().for_each(|light| {
        light.data.iter_mut().for_each(|depth| *depth = (-*depth).exp());
        *light = blurred(&transported(light, &path, &covered, optics, specimen.step_um), optics.disc_px * FINE as f64);
    });
    SpecimenImage { intensity: depths, covered, body }
}

/// Adds the lengths (um, signed by the polygon's sense) of the chords through the middles of the rows. Returns the polygon's extent in rows.
fn chords(section: &Section, omega: f64, step_um: f64, first_row: isize, out: &mut [f32]) -> [f64; 2] {
    let (sin, cos) = omega.sin_cos();
    let turned = |[y, z]: [f64; 2]| [(y * cos - z * sin) / step_um - first_row as f64, y * sin + z * cos];
    let mut extent = [f64::INFINITY, f64::NEG_INFINITY];
    let mut a = turned(section[section.len() - 1]);
    for corner in section {
        let b = turned(*corner);
        extent = [extent[0].min(b[0]), extent[1].max(b[0])];
        let (low, high, sign) = if a[0] < b[0] { (a, b, 1.0) } else { (b, a, -1.0) };
        let slope = (high[1] - low[1]) / (high[0] - low[0]);
        for row in low[0].ceil().max(0.0) as usize..(high[0].ceil().max(0.0) as usize).min(out.len()) {
            out[row] += (sign * (low[1] + slope * (row as f64 - low[0]))) as f32;
        }
        a = b;
    }
    extent
}

fn clamped([from, to]: [f64; 2], rows: usize) -> Option<(usize, usize)> {
    let (first, last) = (from.ceil().max(0.0), to.floor().min(rows as f64 - 1.0));
    (first <= last).then_some((first as usize, last as usize))
}

/// Raises each cell to the share of it that lies in the extent.
fn cover([from, to]: [f64; 2], out: &mut [f32]) {
    let Some((first, last)) = clamped([from - 0.5, to + 0.5], out.len()) else { return };
    for (row, cell) in out.iter_mut().enumerate().take(last + 1).skip(first) {
        let share = (to.min(row as f64 + 0.5) - from.max(row as f64 - 0.5)).clamp(0.0, 1.0) as f32;
        *cell = cell.max(share);
    }
}

/// Transport of intensity from the middle of the specimen to the focus. The light of each cell leaves in the direction `grad W` of the
/// optical path W and moves by `defocus * grad W`. It is shared out among the four cells nearest to where it arrives, so none is lost but
/// what the aperture stops. For short ways this is `I - defocus * div(I grad W)`, for even light the Laplacian of W.
fn transported(light: &Lattice, path: &Lattice, covered: &Lattice, optics: &Optics, step_um: f64) -> Lattice {
    let rows = light.rows;
    let defocus_cells = (optics.defocus_um / step_um) as f32;
    let (aperture, cone) = (optics.aperture_rad as f32, optics.cone_rad as f32);
    let mut out = Lattice::like(light, 0.0);
    for (cell, &value) in light.data.iter().enumerate() {
        // Beside the specimen nothing bends the light. The specimen does not reach the border of the lattice.
        if covered.data[cell] < 0.5 {
            out.data[cell] += value;
            continue;
        }
        let slope = |step: usize| (path.data[cell + step] - path.data[cell - step]) / (2.0 * step_um as f32);
        let (along, across) = (slope(rows), slope(1));
        let value = value * ((aperture + cone - along.hypot(across)) / (2.0 * cone)).clamp(0.0, 1.0);
        if value == 0.0 {
            continue;
        }
        let (along, across) = (along * defocus_cells, across * defocus_cells);
        let (column_part, row_part) = (along - along.floor(), across - across.floor());
        // The margin of the lattice is wider than the longest way.
        let to = (cell as isize + along.floor() as isize * rows as isize + across.floor() as isize) as usize;
        let (near, far) = (value * (1.0 - column_part), value * column_part);
        out.data[to] += near * (1.0 - row_part);
        out.data[to + 1] += near * row_part;
        out.data[to + rows] += far * (1.0 - row_part);
        out.data[to + rows + 1] += far * row_part;
    }
    out
}

/// The mean over a disc. Beyond the lattice the light is 1.
fn blurred(light: &Lattice, radius: f64) -> Lattice {
    let reach = radius.floor() as isize;
    let pad = reach as usize + 2;
    let (rows, columns) = (light.rows, light.data.len() / light.rows);
    // Sums from the top of each column, with a margin of light 1.
    let stride = rows + 2 * pad + 1;
    let mut sums = vec![0.0f32; columns * stride];
    sums.par_chunks_mut(stride).zip(light.data.par_chunks(rows)).for_each(|(sums, column)| {
        for row in 0..rows + 2 * pad {
            let value = row.checked_sub(pad).and_then(|r| column.get(r)).copied().unwrap_or(1.0);
            // The margin is left out of the sums' size: they keep more digits.
            sums[row + 1] = sums[row] + (value - 1.0);
        }
    });
    let halves: Vec<f64> = (-reach..=reach).map(|d| (radius * radius - (d * d) as f64).sqrt().max(0.5)).collect();
    let weight = (1.0 / halves.iter().map(|h| 2.0 * h).sum::<f64>()) as f32;
    let mut out = Lattice::like(light, 1.0);
    out.data.par_chunks_mut(rows).enumerate().for_each(|(column, out)| {
        for (i, half) in halves.iter().enumerate() {
            let Some(from) = usize::try_from(column as isize + i as isize - reach).ok().filter(|c| *c < columns) else { continue };
            let sums = &sums[from * stride..(from + 1) * stride];
            // The interval `row - half .. row + half` of unit cells centred at integers.
            let edge = half - 0.5;
            let (whole, part) = (edge.floor() as usize, (edge - edge.floor()) as f32);
            let from = |start: usize| &sums[start..start + rows];
            let (upper, next) = (from(pad + whole + 1), from(pad + whole + 2));
            let (lower, previous) = (from(pad - whole), from(pad - whole - 1));
            for ((((value, u), n), l), p) in out.iter_mut().zip(upper).zip(next).zip(lower).zip(previous) {
                *value += weight * ((u - l) + part * ((n - u) + (l - p)));
            }
        }
    });
    out
}
