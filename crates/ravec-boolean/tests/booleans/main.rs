//! Guarantees of Booleans, judged without their own code.

mod boxes;
mod degenerate;
mod far;
mod open;
mod single;
mod solids;
mod support;
