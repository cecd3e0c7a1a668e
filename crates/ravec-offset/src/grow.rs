//! Step 2, grow: the octree is split until one vertex per cell represents the surface in it.

mod cell;
mod corners;
mod encode;
mod foot_points;
mod node;
mod pocket;
mod probe;
mod refinement;
mod root;
mod setting;
mod settle;

pub(crate) use cell::ON_SURFACE;
pub(crate) use corners::{CornerValue, Sample};
pub(crate) use refinement::{Halt, Refinement};
pub(crate) use root::{Ends, root};
pub(crate) use setting::Setting;

use cell::{Cell, Fit, MAX_TRIANGLES, MAX_TRIANGLES_OF_SHEET, MAX_TRIANGLES_OF_SURFACE, is_sheet};
use corners::{EdgeKey, Roots, crossed_edges, inside_of};
use node::{Node, State, VertexNumber};
use probe::Probe;
