//! A sheet made thick on one side.
//!
//! The solid is the union of what stands over each triangle on its front, up to the distance: prisms, wedges between them at
//! convex creases and cones at convex corners (`directions`, `slab`), cut off upright at the boundary of the sheet. They are
//! closed polyhedra that may overlap, so their union is told by the winding number, and its border is extracted, proved and
//! mended like an offset surface of distance 0. If the sheet allows it, the union starts a little above it, and the sheet
//! itself takes the place of the lower skin (`seam`).
//!
//! Guarantees: as for all offsets, for what the report says; `certified` says that each triangle is within the tolerance of
//! the border of that union or of the sheet. Does not guarantee: that the sheet is kept triangle for triangle
//! (`sheet_kept` says so); it is not where it meets itself, is not manifold or oriented, or lies in what stands over it, as is
//! the rule on scans. Nor that edges of the solid that are more acute than a right angle are followed to their ends. Parts and
//! cavities of less volume than a cube whose side is the tolerance are left out (`slivers`).

mod directions;
mod seam;
mod skins;
mod slab;
mod slivers;

use crate::certify::keeps_distance;
use crate::field::{Field, Region, Solid};
use crate::finish::check_written;
use crate::offset::{Offset, wound};
use crate::outermost::compact;
use crate::params::{OffsetError, OffsetParams, OpenRule, Side};
use directions::Directed;
use glam::DVec3;
use ravec_mesh::{
    Aabb, Adjacency, BoxTree, Bvh, CheckParams, TriMesh, check, self_intersections, weld,
};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashSet;
use slab::Slab;
pub(crate) use slivers::without_slivers;

/// The share of the tolerance by which polyhedra may be off from prisms, cylinders and spheres.
const SLACK: f64 = 0.1;

/// The share of the tolerance by which the surface may be off from the polyhedra.
const OFF: f64 = 0.85;

/// The share of the tolerance at which the slab starts above a sheet that is kept, and by which the surface may be off from
/// that: so little less that it never gets to the sheet, nor more than the tolerance away from it.
const LIFT: f64 = 0.5;
const OFF_LIFTED: f64 = 0.4;

/// Rounds in which the seam may give way where it meets itself.
const MOST_ROUNDS: usize = 6;

pub(crate) fn thicken(
    mesh: &TriMesh,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Offset, OffsetError> {
    if params.side != Side::Both {
        return Err(OffsetError::SideOfSheet { side: params.side });
    }
    let height = params.distance.abs();
    let checked = OffsetParams {
        distance: height,
        ..params.clone()
    };
    check_tolerance(&checked, &mesh.bounds())?;
    progress.check()?;
    let sheet = cleaned(mesh, params.distance < 0.0);
    if sheet.triangles().is_empty() {
        let triangles = mesh.triangles().len() as u64;
        return Err(OffsetError::NoArea { triangles });
    }
    progress.check()?;
    let adjacency = Adjacency::new(&sheet);
    progress.check()?;
    if let Some(place) = one_sided(&sheet, &adjacency) {
        return Err(OffsetError::OneSided { place });
    }
    progress.check()?;
    let thickener = Thickener {
        adjacency,
        sheet: &sheet,
        height,
        params: &checked,
    };
    if thickener.is_clean(progress)? {
        match thickener.around_sheet(progress) {
            Ok(Some(kept)) => return Ok(kept),
            // without the sheet as a skin there is more of the tolerance left
            Ok(None) | Err(OffsetError::TooRough { .. } | OffsetError::SinglePrecision { .. }) => {}
            Err(error) => return Err(error),
        }
    }
    let slab = thickener.slab([0.0, height], progress)?;
    let around = thickener.around(&slab, OFF, progress);
    let mut offset = around.map_err(|error| match error {
        OffsetError::TooRough { .. } => OffsetError::TooRough {
            tolerance: params.tolerance,
        },
        OffsetError::SinglePrecision { least, .. } => OffsetError::SinglePrecision {
            got: params.tolerance,
            least: least / OFF,
        },
        other => other,
    })?;
    offset.report.sheet_kept = Some(false);
    Ok(offset)
}

/// A sheet, and how it is made thick.
struct Thickener<'a> {
    sheet: &'a TriMesh,
    adjacency: Adjacency,
    height: f64,
    params: &'a OffsetParams,
}

impl Thickener<'_> {
    /// The border of a slab, off by a share of the tolerance.
    fn around(&self, slab: &Slab, off: f64, progress: &Progress) -> Result<Offset, OffsetError> {
        let inner = OffsetParams {
            distance: 0.0,
            tolerance: off * self.params.tolerance,
            open: OpenRule::Refuse,
            ..self.params.clone()
        };
        wound(&slab.polyhedra, &inner, progress)
    }

    /// The slab between two heights.
    fn slab(&self, heights: [f64; 2], progress: &Progress) -> Result<Slab, Cancelled> {
        let slack = SLACK * self.params.tolerance;
        let directed = Directed::new(self.sheet, &self.adjacency, heights[1], slack, progress)?;
        slab::slab(&directed, heights, slack, progress)
    }

    /// Whether the sheet can be a skin as it is.
    fn is_clean(&self, progress: &Progress) -> Result<bool, Cancelled> {
        let full = CheckParams {
            self_intersections: true,
            list_limit: 0,
        };
        let found = check(self.sheet, &full, progress)?;
        let meets_itself = found.self_intersections.is_none_or(|found| found.count > 0);
        Ok(found.manifold && found.oriented && !meets_itself)
    }

    /// Whether some of the sheet lies inside a slab that starts above it. At narrow folds what stands over one flank comes out
    /// behind the other, which is the rule on scans; their sheet can be no skin, and it takes rays to know, not the surface.
    fn is_inside(&self, slab: &Slab, progress: &Progress) -> Result<bool, Cancelled> {
        let polyhedra = Bvh::try_new(&slab.polyhedra, progress)?;
        let field = Field::new(&polyhedra, Solid::Closed, 0.0, progress)?;
        let is_inside = |p: DVec3| !progress.is_cancelled() && field.region(p) == Region::Inside;
        let found = (0..self.sheet.triangles().len() as u32)
            .into_par_iter()
            .any(|t| is_inside(self.sheet.corners(t).into_iter().sum::<DVec3>() / 3.0));
        progress.check()?;
        Ok(found)
    }

    /// The solid with the sheet itself as one skin, if that can be.
    fn around_sheet(&self, progress: &Progress) -> Result<Option<Offset>, OffsetError> {
        let (tolerance, coordinates) = (self.params.tolerance, self.params.coordinates);
        let heights = [LIFT * tolerance, self.height];
        let slab = self.slab(heights, progress)?;
        if self.is_inside(&slab, progress)? {
            return Ok(None);
        }
        let mut offset = self.around(&slab, OFF_LIFTED, progress)?;
        let surface = &offset.mesh;
        let parts = self.adjacency.patches(self.sheet).count as usize;
        let mut is_upper = skins::upper(surface, &slab, OFF_LIFTED * tolerance, parts, progress)?;
        let around = Adjacency::new(surface);
        let whole = self.slab([0.0, self.height], progress)?.polyhedra;
        let whole = Bvh::try_new(&whole, progress)?;
        let near_whole = Field::new(&whole, Solid::No, tolerance, progress)?;
        let mut round = 0;
        let mesh = loop {
            let reach = 2.0 * OFF_LIFTED * tolerance;
            let kept = (surface, &is_upper[..]);
            let Some(sewn) = seam::sew(self.sheet, &slab.lifted, reach, kept, coordinates) else {
                return Ok(None);
            };
            let mesh = &sewn.mesh;
            let tree = BoxTree::try_new(mesh, progress)?;
            let pairs = self_intersections(&tree, usize::MAX, progress)?.pairs;
            let is_loose = |t: &u32| {
                let corners = mesh.corners(*t);
                !keeps_distance(&near_whole, corners, [0.0, tolerance], [0; 3])
            };
            let loose = sewn.fresh.iter().copied().filter(is_loose);
            let meeting = pairs.iter().flat_map(|pair| [pair.first, pair.second]);
            let bad: Vec<u32> = loose.chain(meeting).collect();
            if bad.is_empty() {
                break compact(mesh.positions(), mesh.triangles(), progress)?;
            }
            // move the cut away from there, into the lower skin
            let first = self.sheet.positions().len() as u32;
            let mut changed = false;
            for v in bad.iter().flat_map(|&t| mesh.triangles()[t as usize]) {
                for &t in v
                    .checked_sub(first)
                    .map_or(&[][..], |v| around.triangles_at(v))
                {
                    changed |= !std::mem::replace(&mut is_upper[t as usize], true);
                }
            }
            round += 1;
            if !changed || round == MOST_ROUNDS {
                return Ok(None);
            }
        };
        let quick = CheckParams {
            self_intersections: false,
            list_limit: 0,
        };
        let found = check_written(&mesh, &quick, progress)?;
        if !(found.closed && found.manifold && found.oriented) {
            return Ok(None);
        }
        let report = &mut offset.report;
        report.solid = true;
        report.self_intersections = 0;
        report.triangles = mesh.triangles().len() as u64;
        report.sheet_kept = Some(true);
        offset.mesh = mesh;
        Ok(Some(offset))
    }
}

/// Refuses what makes no sense for a mesh in a box; of the tolerance only a share is left for the surface.
fn check_tolerance(params: &OffsetParams, bounds: &Aabb) -> Result<(), OffsetError> {
    params.check(bounds)?;
    let shared = OffsetParams {
        tolerance: OFF_LIFTED * params.tolerance,
        ..params.clone()
    };
    shared.check(bounds).map_err(|error| match error {
        OffsetError::Tolerance { least, most, .. } => OffsetError::Tolerance {
            got: params.tolerance,
            least: least / OFF_LIFTED,
            most,
        },
        other => other,
    })
}

/// A place at which a part of a sheet cannot be oriented, if there is one. Edges of more than two triangles are left out.
fn one_sided(sheet: &TriMesh, adjacency: &Adjacency) -> Option<DVec3> {
    let mut is_turned: Vec<Option<bool>> = vec![None; sheet.triangles().len()];
    for start in 0..sheet.triangles().len() as u32 {
        let mut front = vec![start];
        is_turned[start as usize].get_or_insert(false);
        while let Some(t) = front.pop() {
            let own = is_turned[t as usize]?;
            for edge in (0..3).filter_map(|side| adjacency.edge_of(t, side)) {
                let [a, b] = adjacency.uses(edge) else {
                    continue;
                };
                let other = if a.triangle == t { b } else { a };
                let expected = own ^ (a.forward == b.forward);
                match &mut is_turned[other.triangle as usize] {
                    Some(turned) if *turned != expected => {
                        let [a, b] = adjacency.edges()[edge as usize];
                        let at = |v: u32| sheet.positions()[v as usize];
                        return Some(at(a).midpoint(at(b)));
                    }
                    Some(_) => {}
                    unknown => {
                        *unknown = Some(expected);
                        front.push(other.triangle);
                    }
                }
            }
        }
    }
    None
}

/// The sheet with vertices at the same place made one, without triangles that have no area or are there twice; turned if the
/// other side is the front.
fn cleaned(mesh: &TriMesh, turn: bool) -> TriMesh {
    let welded = weld(mesh, 0.0).mesh;
    let mut seen = FxHashSet::default();
    let triangles = welded.triangles().iter().filter_map(|&[a, b, c]| {
        let corners = [a, b, c].map(|v| welded.positions()[v as usize]);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        let turned = if turn { [a, c, b] } else { [a, b, c] };
        let least = turned
            .iter()
            .position(|v| *v == a.min(b).min(c))
            .unwrap_or(0);
        let key = [0, 1, 2].map(|i| turned[(least + i) % 3]);
        (normal.normalize_or_zero() != DVec3::ZERO && seen.insert(key)).then_some(turned)
    });
    let triangles = triangles.collect();
    TriMesh::new(welded.positions().to_vec(), triangles).expect("some of a mesh's triangles")
}
