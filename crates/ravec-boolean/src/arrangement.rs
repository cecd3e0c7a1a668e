//! All triangles of all meshes, cut along each other, and the spaces between them.

mod cells;
mod contact;
mod cut;
mod edges;
mod exact;
mod interval;
mod places;
mod point;
mod soup;
mod triangulation;

pub(crate) use cells::{Cells, Side};
pub(crate) use cut::{Piece, Pieces, contacts, cut, uncut};
pub(crate) use edges::Edges;
pub(crate) use soup::Soup;
