//! All triangles of all meshes, cut along each other, and the spaces between them.

mod cells;
mod contact;
mod crossings;
mod cut;
mod edges;
mod exact;
mod group;
mod interval;
mod places;
mod point;
mod rays;
mod same_place;
mod soup;
mod triangulation;

pub(crate) use cells::{Cells, Side};
pub(crate) use cut::{Pieces, contacts, cut, uncut};
pub(crate) use edges::{Edges, Turned, Use};
pub(crate) use soup::{Soup, one_for_each_place, testable};
