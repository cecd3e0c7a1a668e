//! Step 7, finish: triangles are merged, the result is measured and checked.

mod collapse;
mod creases;
mod finisher;
mod measure;
mod roughness;
mod simplify;
mod simplify_chunks;
mod slivers;
mod smooth;

pub(crate) use finisher::{Finish, check_written};
pub(crate) use measure::{Ample, measure};
pub(crate) use simplify::{Simplifier, is_rough};

use collapse::FacetRules;
use creases::creases;
use roughness::roughness;
use simplify::indices;
use simplify_chunks::{Simplified, pairs};
use slivers::without_slivers;
use smooth::{Facets, min_divided_area, smooth};
