//! Step 4, prove: facets keep the distance, and triangles do not intersect; the defects become edits of the tree.

mod clip;
mod crest;
mod facet;
mod inspector;

pub(crate) use crest::spread;
pub(crate) use facet::{MAX_CUTS, Tilt, keeps_distance, likely_tilt, proved, tilt};
pub(crate) use inspector::{Defects, EditRequests, Inspector, separate};

use crest::{near_corner, tightened};
use facet::room_kept;
