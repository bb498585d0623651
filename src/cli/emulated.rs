//! Converts between the camera models of the emulated rig and of carved. Both describe the same projection, but share no code.

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
        glass: None,
    }
}

/// The emulated camera with carved's model.
pub fn scene_camera(c: &Camera) -> scene::Camera {
    scene::Camera {
        f_um: c.f,
        kx_px_per_um: c.kx,
        ky_px_per_um: c.ky,
        ux_px: c.ux,
        uy_px: c.uy,
        skew: c.s,
        alpha_rad: c.alpha,
        gamma_rad: c.gamma,
        phi_rad: c.phi,
        width: c.width,
        height: c.height,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_and_back_is_the_same_camera() {
        let own = Camera {
            f: 1.0,
            kx: 2.0,
            ky: 3.0,
            ux: 4.0,
            uy: 5.0,
            s: 6.0,
            alpha: 7.0,
            gamma: 8.0,
            phi: 9.0,
            width: 10,
            height: 11,
            glass: None,
        };
        assert_eq!(camera(&scene_camera(&own)), own);
        assert_eq!(camera(&scene::Camera::default()), Camera::published(1024, 1024), "the rig that is emulated is the published one");
    }
}
