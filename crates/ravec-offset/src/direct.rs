//! Offsets that are small beside the features of a closed mesh: its faces, moved, with rounded edges and corners.
//!
//! The cells of an octree are cubes, so along a rounded edge there are as many as its length holds the radius: far too many for a
//! clearance of a hundredth of a millimeter around a hand-sized part. Here the number of triangles follows that of the mesh.
//! Every triangle moves along its normal; convex edges get strips around a cylinder and convex corners patches of a sphere;
//! concave edges and nearly flat ones are mitered, that is, their sheets share the points where the moved planes meet.
//!
//! That is right only where nothing else is near, and nothing here knows that. So the surface is built on trust, and then
//! examined as a whole: every facet is proved as those of an octree are, no two triangles may intersect, each component must
//! lie on its side of the mesh and enclose space as the part of the mesh does from which it comes. Where any of that fails, there
//! is no such surface, and an octree takes over.
//!
//! Does not cover: vertices with concave edges between more than two sectors, such as the foot of an edge that rises from a floor,
//! tips of cones, and triangles without area. One of these leaves the whole mesh to an octree.
//!
//! Guarantees: as for the surface of an octree. Every point of the true offset has a point of the surface near it, too: both
//! come from the mesh by a motion that stays within the distance plus the tolerance.
//!
//! Cost: a search for the closest triangle per vertex and a proof per facet.

mod assembly;
mod corner;
mod fans;
mod unfold;

use crate::domain::Field;
use crate::finish::{Finish, check_written};
use crate::params::{COARSE, OffsetError, OffsetParams, Side};
use crate::prove::proved;
use crate::repair::Repaired;
use crate::report::StoredOffset;
use crate::store::{ChunkedSurface, Store, Visibility, put_block};
use crate::surface::{Patch, VertexName};
use assembly::{Moved, moved};
use fans::Fans;
use glam::DVec3;
use ravec_mesh::{Adjacency, CheckParams, TriMesh};
use ravec_octree::{CellKey, Corner};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Share of the diagonal up to which a distance may be small. At larger distances an octree takes seconds at most.
const MAX_DISTANCE_REL: f64 = 0.008;

/// Number of cells along rounded edges and creases above which an octree is avoided: that many take it about three seconds.
const MANY_CELLS: f64 = 10_000.0;

/// Number of cells along edges, by triangle of the mesh, up to which an octree pays: the mesh itself has that much detail.
const CELLS_PER_TRIANGLE: f64 = 8.0;

/// Error of a facet on a cylinder between two points on it, as a share of the tolerance.
const SAGITTA: f64 = 0.5;

/// Angle of a strip around an edge by the limit of the tilt: a triangle on a cylinder is a sixth of its angle off at its center.
const STRIP_BY_TILT: f64 = 6.0;

/// Parameters of the construction.
#[derive(Debug, Clone, Copy)]
struct Shape {
    distance: f64,
    tolerance: f64,
    /// Largest angle of a facet around an edge or corner.
    max_angle: f64,
    side: Side,
}

impl Shape {
    fn of(params: &OffsetParams) -> Self {
        let of_error = 2.0 * (1.0 - SAGITTA * params.tolerance / params.distance).acos();
        let of_tilt = STRIP_BY_TILT * params.normal_deviation_deg().to_radians();
        Self {
            distance: params.distance,
            tolerance: params.tolerance,
            max_angle: of_error.min(of_tilt),
            side: params.side,
        }
    }

    /// Tolerance relative to the distance.
    fn slack(&self) -> f64 {
        self.tolerance / self.distance
    }

    /// The sides of the mesh to which it moves: each with whether its triangles are turned for that, and whether the moved ones
    /// are turned back.
    fn motions(&self) -> &'static [[bool; 2]] {
        match self.side {
            Side::Outer => &[[false, false]],
            Side::Inner | Side::Shell => &[[true, true]],
            Side::Both => &[[false, false], [true, false]],
        }
    }
}

/// Returns whether a distance is small beside a mesh.
pub(crate) fn is_small(mesh: &TriMesh, params: &OffsetParams) -> bool {
    params.distance <= MAX_DISTANCE_REL * mesh.bounds().diagonal()
}

/// Builds the surface and finishes it; `None` if an octree is better, or needed.
pub(crate) fn direct(
    mesh: &TriMesh,
    params: &OffsetParams,
    finish: &Finish<'_>,
    progress: &Progress,
) -> Result<Option<StoredOffset>, OffsetError> {
    let Some(fans) = Fans::of(mesh, progress)? else {
        return Ok(None);
    };
    if !is_worth_it(&fans, mesh, params) {
        return Ok(None);
    }
    let shape = Shape::of(params);
    let Some(surface) = proved_surface(mesh, &fans, &shape, finish.field, params, progress)? else {
        return Ok(None);
    };
    let repaired = repaired(surface, params.side, progress)?;
    let offset = finish.run(mesh, repaired, progress)?;
    let is_sound = offset.report.certified && offset.report.solid;
    Ok(is_sound.then_some(offset))
}

/// Share of the angle of a cell beyond which an edge counts as an edge.
const MIN_TURN: f64 = 0.1;

/// Returns whether an octree would have many cells that follow the lengths of edges.
fn is_worth_it(fans: &Fans, mesh: &TriMesh, params: &OffsetParams) -> bool {
    let cell = (8.0 * params.distance * params.tolerance.min(COARSE * params.distance)).sqrt();
    let cells: f64 = (fans.edges.iter())
        .filter(|edge| edge.angle.abs() > MIN_TURN * cell / params.distance)
        .map(|edge| edge.length / cell)
        .sum();
    cells > MANY_CELLS.max(CELLS_PER_TRIANGLE * mesh.triangles().len() as f64)
}

/// Builds the surface, if all of it can be proved.
fn proved_surface(
    mesh: &TriMesh,
    fans: &Fans,
    shape: &Shape,
    field: &Field<'_>,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Option<TriMesh>, Cancelled> {
    let part_of = Adjacency::try_new(mesh, progress)?.try_components(mesh, progress)?;
    let parts = part_of.count as usize;
    let volumes = volumes(mesh, |t| part_of.of_triangle[t], parts);
    let mut whole = Moved::default();
    for &[turned, turned_back] in shape.motions() {
        let reversed = if turned {
            reversed(mesh, progress)?
        } else {
            None
        };
        let (mesh, fans) = match &reversed {
            Some((mesh, fans)) => (mesh, fans),
            None => (mesh, fans),
        };
        let Some(mut moved) = moved(mesh, fans, shape, field, params.coordinates, progress)? else {
            return Ok(None);
        };
        let Ok(surface) = TriMesh::new(moved.positions.clone(), moved.triangles.clone()) else {
            return Ok(None);
        };
        let after = self::volumes(
            &surface,
            |t| part_of.of_triangle[moved.bases[t] as usize],
            parts,
        );
        let sign = if turned { -1.0 } else { 1.0 };
        let keep_their_sides = volumes.iter().zip(&after).all(|(a, b)| a * b * sign > 0.0);
        if !keep_their_sides
            || !is_on_side(&surface, &moved.bases, &part_of.of_triangle, turned, field)
        {
            return Ok(None);
        }
        if turned_back {
            for [_, b, c] in &mut moved.triangles {
                std::mem::swap(b, c);
            }
        }
        whole.add(moved);
    }
    progress.check()?;
    if !is_proved(&whole, field, params, progress)? {
        return Ok(None);
    }
    let Ok(surface) = TriMesh::new(whole.positions, whole.triangles) else {
        return Ok(None);
    };
    let checks = CheckParams {
        self_intersections: true,
        list_limit: 0,
    };
    let is_solid = check_written(&surface, &checks, progress)?.is_solid();
    Ok(is_solid.then_some(surface))
}

/// The mesh with its triangles turned.
fn reversed(mesh: &TriMesh, progress: &Progress) -> Result<Option<(TriMesh, Fans)>, Cancelled> {
    let triangles = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]);
    let Ok(mesh) = TriMesh::new(mesh.positions().to_vec(), triangles.collect()) else {
        return Ok(None);
    };
    Ok(Fans::of(&mesh, progress)?.map(|fans| (mesh, fans)))
}

/// Volume of the triangles of each part, as seen from the center of all.
fn volumes(mesh: &TriMesh, part_of: impl Fn(usize) -> u32, parts: usize) -> Vec<f64> {
    let center = mesh.bounds().center();
    let mut volumes = vec![0.0; parts];
    for t in 0..mesh.triangles().len() {
        let [a, b, c] = mesh.corners(t as u32).map(|corner| corner - center);
        if let Some(volume) = volumes.get_mut(part_of(t) as usize) {
            *volume += a.dot(b.cross(c)) / 6.0;
        }
    }
    volumes
}

/// Returns whether a facet of each part is inside the mesh, or outside. As no facet touches the mesh, the part is there, too.
fn is_on_side(
    surface: &TriMesh,
    bases: &[u32],
    part_of: &[u32],
    is_inward: bool,
    field: &Field<'_>,
) -> bool {
    let mut seen: Vec<u32> = Vec::new();
    (0..surface.triangles().len()).all(|t| {
        let part = part_of[bases[t] as usize];
        if seen.contains(&part) {
            return true;
        }
        seen.push(part);
        let [a, b, c] = surface.corners(t as u32);
        let middle = (a + b + c) / 3.0;
        (field
            .bvh()
            .ray_turns(middle, DVec3::new(0.0271, 0.0123, 1.0))
            > 0)
            == is_inward
    })
}

/// Returns whether all facets keep the distance.
fn is_proved(
    surface: &Moved,
    field: &Field<'_>,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<bool, Cancelled> {
    let limits = [
        params.distance - params.tolerance,
        params.distance + params.tolerance,
    ];
    let mut hints = vec![0; surface.positions.len()];
    for (t, base) in surface.triangles.iter().zip(&surface.bases) {
        for &v in t {
            hints[v as usize] = *base;
        }
    }
    let near: Vec<_> = (surface.positions.par_iter().zip(&hints))
        .map(|(&p, &hint)| {
            progress.check()?;
            Ok(field.near(p, hint))
        })
        .collect::<Result<_, Cancelled>>()?;
    let unproved = (surface.triangles.par_iter())
        .map(|t| {
            progress.check()?;
            let facet = t.map(|v| surface.positions[v as usize]);
            Ok(u64::from(!proved(
                field,
                facet,
                limits,
                t.map(|v| near[v as usize]),
            )))
        })
        .try_reduce(|| 0, |a, b| Ok(a + b))?;
    Ok(unproved == 0)
}

/// Wraps a proved surface as repair does.
fn repaired(surface: TriMesh, side: Side, progress: &Progress) -> Result<Repaired, OffsetError> {
    let (positions, triangles) = surface.into_parts();
    let names = (0..positions.len() as u32).map(|number| VertexName::Sheet {
        leaf: Corner([0; 3]),
        number,
    });
    let patch = Patch {
        names: names.collect(),
        edge_of: vec![0; triangles.len()],
        ample: vec![false; triangles.len()],
        positions,
        triangles,
        ..Patch::default()
    };
    let store = Store::Memory;
    let block = put_block(CellKey::ROOT, patch, &store)?;
    let visibility = if side == Side::Outer {
        Visibility::Reachable
    } else {
        Visibility::All
    };
    Ok(Repaired {
        surface: ChunkedSurface::new(store, vec![block], usize::MAX, visibility, progress)?,
        is_proved: true,
        ample_distance: 0.0,
        cells: 0,
        deepest_level: 0,
        tiles: 0,
        rounds: 0,
        split: 0,
        filled: 0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::in_memory;
    use crate::task::Task;
    use ravec_scenes::solids::cuboid;

    /// Boxes, each with its size and its lowest corner.
    fn boxes(of: &[([f64; 3], [f64; 3])]) -> TriMesh {
        let (mut positions, mut triangles) = (vec![], vec![]);
        for &(size, low) in of {
            let one = cuboid(size.into()).mesh;
            let shift = DVec3::from(low) - one.bounds().min;
            let first = positions.len() as u32;
            positions.extend(one.positions().iter().map(|&p| p + shift));
            triangles.extend(one.triangles().iter().map(|t| t.map(|v| v + first)));
        }
        TriMesh::new(positions, triangles).unwrap()
    }

    fn is_direct(mesh: &TriMesh, side: Side) -> bool {
        let params = OffsetParams {
            distance: 1e-3,
            tolerance: 5e-5,
            side,
            ..OffsetParams::default()
        };
        let task = Task::new(mesh, &params, &Progress::none()).unwrap();
        let mut field = task.field(&Progress::none()).unwrap();
        field.has_large_facets = true;
        let finish = task.finish(mesh, &params, &field, &in_memory).unwrap();
        direct(mesh, &params, &finish, &Progress::none())
            .unwrap()
            .is_some()
    }

    #[test]
    fn surfaces_that_meet_or_change_sides_are_left_to_an_octree() {
        let big = ([2.0, 1.5, 1.0], [0.0; 3]);
        for side in [Side::Outer, Side::Inner, Side::Both, Side::Shell] {
            assert!(is_direct(&boxes(&[big]), side), "{side:?}");
            let apart = boxes(&[big, (big.0, [2.1, 0.0, 0.0])]);
            assert!(is_direct(&apart, side), "{side:?}");
        }
        for gap in [1e-5, 1e-3, 1.5e-3, 1.99e-3] {
            let near = boxes(&[big, (big.0, [2.0 + gap, 0.0, 0.0])]);
            assert!(!is_direct(&near, Side::Outer), "gap {gap}");
            let thin = boxes(&[([2.0, 1.5, gap], [0.0; 3])]);
            assert!(!is_direct(&thin, Side::Inner), "thickness {gap}");
        }
        let nested = boxes(&[big, ([0.5; 3], [0.2; 3])]);
        assert!(!is_direct(&nested, Side::Both));
    }
}
