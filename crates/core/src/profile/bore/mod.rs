//! The capillary in the picture: its walls, the rows between them, and how the bore would look without a specimen.

pub(super) mod background;
pub(super) mod empty_capillary;
mod rows;
pub(super) mod walls;

pub(super) use rows::{Bore, MARGIN_PX};
