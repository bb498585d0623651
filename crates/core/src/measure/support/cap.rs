//! What lies beyond the last slice that the views agree on: a paraboloid.

use std::f64::consts::{FRAC_PI_2, PI};

#[derive(Debug, Clone, Copy)]
pub(super) struct Cap {
    /// Of the radius at its base.
    pub square_um2: f64,
    pub length_um: f64,
}

impl Cap {
    pub fn volume_um3(self) -> f64 {
        FRAC_PI_2 * self.square_um2 * self.length_um
    }

    pub fn area_um2(self) -> f64 {
        let (r2, d) = (self.square_um2, self.length_um);
        if d <= 1e-9 {
            return PI * r2;
        }
        let r = r2.sqrt();
        PI * r / (6.0 * d * d) * ((r2 + 4.0 * d * d).powf(1.5) - r2 * r)
    }
}
