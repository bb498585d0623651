//! The emulated camera as carved's science describes it. Both describe the same projection, but share no code.

use carved_core::geometry::Camera;
use hardware_sim::scene;

/// carved's model of the emulated camera.
pub fn camera(c: &scene::Camera) -> Camera {
    Camera {
        f: c.f_um,
        kx: c.kx_px_per_um,
        ky: c.ky_px_per_um,
        ux: c.ux_px,
        uy: c.uy_px,
        s: c.skew,
        alpha: c.alpha_rad,
        gamma: c.gamma_rad,
        phi: c.phi_rad,
        width: c.width,
        height: c.height,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_emulated_camera_is_the_published_one() {
        assert_eq!(camera(&scene::Camera::default()), Camera::published(1024, 1024));
    }
}
