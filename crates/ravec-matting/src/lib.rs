//! Alpha matting: with a known background, or with a trimap or strokes alone.

mod matte;

pub use matte::{Colors, Constraint, Constraints, Matte, MattingError};
