//! Boolean expressions over any triangle meshes, exact where they meet.
//!
//! Each mesh stands for the places that it winds around. All triangles are cut along their intersections with exact
//! arithmetic; each piece then has the winding numbers of all meshes on its two sides, the expression says which sides are
//! inside, and the pieces between inside and outside are the result. Triangles that meet no others come out as they
//! went in, bit for bit.

mod arrangement;
mod boolean;
mod closing;
mod examine;
mod expr;
mod finish;
mod near;
mod params;
mod repair;
mod select;
mod separate;

pub use boolean::boolean;
pub use expr::{Expr, Known, ParseExprError};
pub use params::{
    Boolean, BooleanError, BooleanParams, BooleanReport, CloseRule, DroppedPart, Inside, OpenRule,
    OperandReport, Origin,
};
