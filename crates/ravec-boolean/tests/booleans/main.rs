//! Guarantees of Booleans, judged without their own code.

mod boxes;
mod degenerate;
mod solids;
mod support;
