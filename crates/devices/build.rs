//! Has cargo look for the camera that tests need.

#[path = "../../tests/common/needs.rs"]
mod needs;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=../../tests/common/needs.rs");
    needs::tell(&[needs::Need::Program { name: "arv-fake-gv-camera-0.8", cfg: "has_fake_camera" }]);
}
