//! Silhouettes and angles in, volume with its standard deviation out.
//!
//! The specimen is an ellipsoid. Its image in a pinhole camera is an ellipse that is known exactly, so the example makes its own
//! input and knows the answer.
//!
//! ```sh
//! cargo run --release -p carved-core --example volume
//! ```

use carved_core::carver::Leaves;
use carved_core::geometry::{BoxUm, Camera, Projection, VoxelGrid};
use carved_core::profile::{Mask, Polygon};
use carved_core::reconstruction::{Reconstruction, ReconstructionSettings};
use std::f64::consts::{PI, TAU};

/// Half axes along x (along the capillary), y and z at the angle 0, um.
const HALF_AXES_UM: [f64; 3] = [1200.0, 260.0, 190.0];
/// Centre, um from the axis of rotation.
const CENTRE_UM: [f64; 3] = [60.0, 35.0, -20.0];
const VIEWS: u32 = 21;

/// An ellipse in the image: its centre, px, and the lower triangular matrix that makes it of the unit circle.
struct Ellipse {
    centre: [f64; 2],
    root: [[f64; 2]; 2],
}

impl Ellipse {
    /// The image of the ellipsoid. With `P = (p_0, p_1, p_2)` the dual conic of the outline is
    /// `C_ij = sum_k a_k^2 p_ik p_jk - y_i y_j`, where `y` is the image of the centre (Hartley and Zisserman, Multiple View Geometry,
    /// section 8.3).
    fn of(projection: &Projection) -> Self {
        let rows = projection.rows();
        let y = rows.map(|r| (0..3).map(|k| r[k] * CENTRE_UM[k]).sum::<f64>() + r[3]);
        let dual = |i: usize, j: usize| (0..3).map(|k| HALF_AXES_UM[k].powi(2) * rows[i][k] * rows[j][k]).sum::<f64>() - y[i] * y[j];
        let scale = -dual(2, 2);
        let centre = [-dual(0, 2) / scale, -dual(1, 2) / scale];
        let shape = |i: usize, j: usize| dual(i, j) / scale + centre[i] * centre[j];
        let l00 = shape(0, 0).sqrt();
        let l10 = shape(1, 0) / l00;
        let l11 = (shape(1, 1) - l10 * l10).sqrt();
        Self { centre, root: [[l00, 0.0], [l10, l11]] }
    }

    fn outline(&self) -> Polygon {
        let at = |i: u32| {
            let (sin, cos) = (TAU * f64::from(i) / 720.0).sin_cos();
            [self.centre[0] + self.root[0][0] * cos, self.centre[1] + self.root[1][0] * cos + self.root[1][1] * sin]
        };
        Polygon { vertices: (0..720).map(at).collect() }
    }

    /// The pixels whose centres lie inside.
    fn mask(&self, width: usize, height: usize) -> Mask {
        let mut mask = Mask::empty(width, height);
        for v in 0..height {
            for u in 0..width {
                let cos = (u as f64 - self.centre[0]) / self.root[0][0];
                let sin = (v as f64 - self.centre[1] - self.root[1][0] * cos) / self.root[1][1];
                mask.set(u, v, cos * cos + sin * sin <= 1.0);
            }
        }
        mask
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let camera = Camera::published(512, 256);
    let grid = VoxelGrid::new(BoxUm { min: [-1300.0, -400.0, -400.0], max: [1400.0, 400.0, 400.0] }, 10.0)?;
    let mut turn = Reconstruction::new(&camera, grid, VIEWS as usize, ReconstructionSettings::default())?;
    for view in 0..VIEWS {
        let omega = TAU * f64::from(view) / f64::from(VIEWS);
        let ellipse = Ellipse::of(&camera.projection(omega));
        let live = turn.observe(&ellipse.mask(512, 256), &[ellipse.outline()], omega, Leaves::default())?;
        println!("view {view:2} at {:5.1} deg: {:.4e} um^3 are left", omega.to_degrees(), live.volume_um3);
    }
    let measured = turn.finish(false)?.model.measurement;
    let truth_um3 = 4.0 / 3.0 * PI * HALF_AXES_UM.iter().product::<f64>();
    let sd_um3 = measured.volume_sd_um3.ok_or("the turn has no slices in common")?;
    println!("volume {:.4e} um^3, standard deviation {sd_um3:.1e} um^3", measured.volume_um3);
    println!("truth  {truth_um3:.4e} um^3, off by {:+.2} %", 100.0 * (measured.volume_um3 / truth_um3 - 1.0));
    Ok(())
}
