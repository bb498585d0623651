//! Units of exported coordinates.

use carved_core::surface::Mesh;

/// Unit of the coordinates of an exported file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Unit {
    /// Micrometres, the unit of carved
    Um,
    /// Millimetres, the unit of printers and of 3D Slicer
    Mm,
    /// Metres, the unit of glTF and of Blender
    M,
}

impl Unit {
    /// Its symbol.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Um => "um",
            Self::Mm => "mm",
            Self::M => "m",
        }
    }

    /// A length in this unit.
    pub fn of_um(self, um: f64) -> f64 {
        match self {
            Self::Um => um,
            Self::Mm => um / 1e3,
            Self::M => um / 1e6,
        }
    }

    /// A mesh in this unit, of one in um.
    pub fn mesh(self, mesh: &Mesh) -> Mesh {
        Mesh { vertices: mesh.vertices.iter().map(|v| v.map(|x| self.of_um(x))).collect(), triangles: mesh.triangles.clone() }
    }
}
