//! Alpha matting: with a known background, or with a trimap or strokes alone.

mod approximate;
mod field;
mod half;
mod light;
mod matte;
mod plate;
mod posterior;
mod texture;

pub use light::PlateLight;
pub use matte::{Colors, Constraint, Constraints, Matte, MattingError};
pub use plate::{PlateFrame, PlateMatte, PlateParams, plate_matte};
