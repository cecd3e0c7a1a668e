//! Thickening of a sheet on one side.
//!
//! The solid is the union of prisms over the front of each triangle up to the distance, wedges between them at convex creases
//! and cones at convex corners (`directions`, `slab`), cut off upright at the boundary of the sheet. These closed polyhedra may
//! overlap, so the winding number defines their union, and its border is extracted, proved and repaired like an offset surface
//! of distance 0. If possible, the union starts slightly above the sheet, and the sheet itself takes the place of the lower
//! skin (`seam`).
//!
//! Guarantees: as for all offsets, as far as the report states; `certified` means that each triangle is within the tolerance of
//! the border of that union or of the sheet. Does not guarantee: that the sheet is kept triangle for triangle (see
//! `sheet_kept`); it is not where it intersects itself, is not manifold or oriented, or lies inside the solid over it, as is
//! common for scans. Nor that edges of the solid more acute than a right angle are followed to their ends. Components and
//! cavities of less volume than a cube whose side is the tolerance are removed (`slivers`).

mod directions;
mod seam;
mod skins;
mod slab;

use crate::domain::{Field, Region, Solid};
use crate::finish::check_written;
use crate::params::{OffsetError, OffsetParams, OpenRule, Side};
use crate::prove::keeps_distance;
use crate::report::Offset;
use crate::surface::compact;
use crate::task::wound;
use directions::Directed;
use glam::DVec3;
use ravec_mesh::{
    Aabb, Adjacency, BoxTree, Bvh, CheckParams, TriMesh, check, self_intersections, weld,
};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashSet;
use slab::Slab;

/// Share of the tolerance by which polyhedra may deviate from prisms, cylinders and spheres.
const SLACK: f64 = 0.1;

/// Share of the tolerance by which the surface may deviate from the polyhedra.
const OFF: f64 = 0.85;

/// Share of the tolerance by which the slab starts above a kept sheet, and by which the surface may then deviate: slightly
/// less, so that the surface neither reaches the sheet nor is farther than the tolerance from it.
const LIFT: f64 = 0.5;
const OFF_LIFTED: f64 = 0.4;

/// Bound on the rounds in which the seam moves where it intersects itself.
const MAX_ROUNDS: usize = 6;

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
            // without the sheet as a skin, a larger share of the tolerance is available
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

/// A sheet and its thickness.
struct Thickener<'a> {
    sheet: &'a TriMesh,
    adjacency: Adjacency,
    height: f64,
    params: &'a OffsetParams,
}

impl Thickener<'_> {
    /// Computes the border of a slab, within a share of the tolerance.
    fn around(&self, slab: &Slab, off: f64, progress: &Progress) -> Result<Offset, OffsetError> {
        let inner = OffsetParams {
            distance: 0.0,
            tolerance: off * self.params.tolerance,
            open: OpenRule::Refuse,
            ..self.params.clone()
        };
        wound(&slab.polyhedra, &inner, progress)
    }

    /// Builds the slab between two heights.
    fn slab(&self, heights: [f64; 2], progress: &Progress) -> Result<Slab, Cancelled> {
        let slack = SLACK * self.params.tolerance;
        let directed = Directed::new(self.sheet, &self.adjacency, heights[1], slack, progress)?;
        slab::slab(&directed, heights, slack, progress)
    }

    /// Returns whether the sheet can be a skin as it is.
    fn is_clean(&self, progress: &Progress) -> Result<bool, Cancelled> {
        let full = CheckParams {
            self_intersections: true,
            list_limit: 0,
        };
        let found = check(self.sheet, &full, progress)?;
        let meets_itself = found.self_intersections.is_none_or(|found| found.count > 0);
        Ok(found.manifold && found.oriented && !meets_itself)
    }

    /// Returns whether some of the sheet lies inside a slab above it. At narrow folds the solid over one flank emerges behind
    /// the other, as is common for scans; such a sheet cannot be a skin, and rays show this without the surface.
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

    /// Computes the solid with the sheet itself as one skin, if possible.
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
            if !changed || round == MAX_ROUNDS {
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

/// Checks the parameters; only a share of the tolerance is available for the surface.
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

/// Returns a point at which a part of a sheet cannot be oriented, if any. Edges of more than two triangles are ignored.
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

/// Returns the sheet with vertices at equal positions merged, without triangles that have no area or occur twice; reversed if
/// the other side is the front.
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
