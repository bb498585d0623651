//! Makes cargo look for the data that tests need.

#[path = "../tests/common/needs.rs"]
mod needs;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=../tests/common/needs.rs");
    needs::tell(&[needs::Need::Shared]);
}
