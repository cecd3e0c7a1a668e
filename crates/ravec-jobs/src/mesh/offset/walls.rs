//! Walls inside a solid: where shells overlap, contain one another or cross themselves, triangles that bound nothing.
//!
//! An offset to the inside is measured to all triangles, so such walls would divide the solid. They are removed beforehand by a
//! union of the mesh with itself, which keeps the boundary of what is inside.
//!
//! A shell without crossings bounds the inside everywhere or nowhere, so one triangle of each shows which: if the mesh winds 0
//! times around a point in front of it, it winds once around the solid behind it.

use crate::error::JobError;
use crate::report::Report;
use ravec::boolean::{BooleanError, BooleanParams, Expr, Inside, boolean};
use ravec::mesh::{Adjacency, BoxTree, Bvh, TriMesh, self_intersections};
use ravec::progress::Progress;
use std::path::Path;

/// Distance in front of a triangle at which winding is counted, as a share of the root of its area.
const IN_FRONT: f64 = 1e-6;

/// Direction of the rays that count winding, along no edge of usual designs.
const RAY: [f64; 3] = [0.0271, 0.0123, 1.0];

/// Findings about a closed mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Walls {
    /// Connected parts.
    parts: u64,
    /// Pairs of triangles that meet where they should not.
    crossings: u64,
    /// Parts that are inside others, without being the surface of a cavity.
    buried: u64,
    /// Parts that are inside out: what they enclose has a winding number of 0 or less, and what is around them less than that.
    reversed: u64,
}

impl Walls {
    /// Examines a mesh; `None` if it is not closed.
    fn of(mesh: &TriMesh, progress: &Progress) -> Result<Option<Self>, JobError> {
        let adjacency = Adjacency::try_new(mesh, progress)?;
        let is_closed = (0..adjacency.edges().len() as u32).all(|edge| {
            let uses = adjacency.uses(edge);
            2 * uses.iter().filter(|side| side.forward).count() == uses.len()
        });
        if !is_closed {
            return Ok(None);
        }
        let components = adjacency.try_components(mesh, progress)?;
        drop(adjacency);
        let mut walls = Self {
            parts: u64::from(components.count),
            crossings: self_intersections(&BoxTree::try_new(mesh, progress)?, 0, progress)?.count,
            ..Self::default()
        };
        if components.count > 1 {
            let bvh = Bvh::try_new(mesh, progress)?;
            for t in largest_of_each(mesh, components.count, &components.of_triangle) {
                progress.check()?;
                let [a, b, c] = mesh.corners(t);
                let normal = (b - a).cross(c - a);
                let step = IN_FRONT * normal.length().sqrt() * normal.normalize_or_zero();
                match bvh.ray_turns((a + b + c) / 3.0 + step, RAY.into()) {
                    0 => {}
                    below if below < 0 => walls.reversed += 1,
                    _ => walls.buried += 1,
                }
            }
        }
        Ok(Some(walls))
    }

    /// Returns whether all triangles bound what a rule calls inside.
    fn are_none(&self, inside: Inside) -> bool {
        let has_cavities = self.parts > 1 && inside == Inside::OuterHull;
        self.crossings == 0 && self.buried == 0 && self.reversed == 0 && !has_cavities
    }
}

/// The largest triangle of each part.
fn largest_of_each(mesh: &TriMesh, parts: u32, part_of: &[u32]) -> Vec<u32> {
    let mut largest = vec![(0, -1.0); parts as usize];
    for (t, &part) in (0u32..).zip(part_of) {
        let [a, b, c] = mesh.corners(t);
        let area = (b - a).cross(c - a).length_squared();
        if let Some(known) = largest.get_mut(part as usize)
            && area > known.1
        {
            *known = (t, area);
        }
    }
    largest.into_iter().map(|(t, _)| t).collect()
}

/// The boundary of what is inside a mesh.
pub(super) struct Resolved {
    pub mesh: TriMesh,
    /// True if parts were left out that were probably meant to be solid: the result does not pass.
    pub is_doubtful: bool,
}

/// Returns the boundary of what is inside a closed mesh, if some of its triangles are elsewhere. The report says so.
///
/// Figures, if there are such triangles: `crossing_pairs` of triangles, `buried_parts` and `reversed_parts`.
///
/// # Errors
/// [`JobError::Boolean`], [`JobError::NoTriangles`] if nothing is inside, [`JobError::Cancelled`].
pub(super) fn without_walls(
    mesh: &TriMesh,
    input: &Path,
    params: &BooleanParams,
    report: &mut Report,
    progress: &Progress,
) -> Result<Option<Resolved>, JobError> {
    let found = report.time("walls", || Walls::of(mesh, progress))?;
    let Some(walls) = found.filter(|walls| !walls.are_none(params.inside)) else {
        return Ok(None);
    };
    let meshes = std::slice::from_ref(mesh);
    let union = report.time("union", || {
        boolean(meshes, &Expr::Mesh(0), params, progress)
    });
    let union = union.map_err(|cause| match cause {
        BooleanError::Cancelled => JobError::Cancelled,
        cause => JobError::Boolean { cause },
    })?;
    report.figures.extend([
        ("crossing_pairs", walls.crossings as f64),
        ("buried_parts", walls.buried as f64),
        ("reversed_parts", walls.reversed as f64),
    ]);
    let (file, rule) = (input.display(), name(params.inside));
    if walls.crossings > 0 || walls.buried > 0 {
        report.record_assumed(format!(
            "{file} has walls inside the solid ({} pairs of triangles cross, {} of {} parts are inside others): the distance is \
             measured to the boundary of what is inside (`inside` {rule})",
            walls.crossings, walls.buried, walls.parts
        ));
    }
    for operand in &union.report.operands {
        for assumption in &operand.assumptions {
            report.record_assumed(format!("{file}: {assumption}"));
        }
    }
    let doubts = union.report.operands.iter().map(|operand| &operand.doubts);
    let doubts = doubts.chain([&union.report.doubts]).flatten();
    let mut is_doubtful = false;
    for doubt in doubts {
        is_doubtful = true;
        report.record_dropped(format!("{file}: {doubt}"));
    }
    if !union.report.solid {
        report.warn(format!(
            "{file}: the boundary of what is inside is not closed, not manifold or meets itself: see `ravec mesh check`"
        ));
    }
    if union.mesh.triangles().is_empty() {
        return Err(JobError::NoTriangles {
            path: input.to_owned(),
        });
    }
    Ok(Some(Resolved {
        mesh: union.mesh,
        is_doubtful,
    }))
}

/// The word for a rule.
fn name(inside: Inside) -> &'static str {
    match inside {
        Inside::Positive => "positive",
        Inside::Nonzero => "nonzero",
        Inside::OuterHull => "outer-hull",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use ravec::mesh::measure;
    use ravec_scenes::solids::cuboid;

    /// Cubes, each with its side, its lowest corner along all axes, and whether it is inside out.
    fn cubes(of: &[(f64, f64, bool)]) -> TriMesh {
        let (mut positions, mut triangles) = (vec![], vec![]);
        for &(side, low, is_reversed) in of {
            let cube = cuboid(DVec3::splat(side)).mesh;
            let shift = DVec3::splat(low) - cube.bounds().min;
            let first = positions.len() as u32;
            positions.extend(cube.positions().iter().map(|&p| p + shift));
            triangles.extend(cube.triangles().iter().map(|&[a, b, c]| {
                let turned = if is_reversed { [a, c, b] } else { [a, b, c] };
                turned.map(|v| v + first)
            }));
        }
        TriMesh::new(positions, triangles).unwrap()
    }

    fn walls(mesh: &TriMesh) -> Walls {
        Walls::of(mesh, &Progress::none()).unwrap().unwrap()
    }

    fn resolved(mesh: &TriMesh, inside: Inside) -> (Option<TriMesh>, Report) {
        let mut report = Report::new("test", &());
        let params = BooleanParams {
            inside,
            ..BooleanParams::default()
        };
        let file = Path::new("file.off");
        let found = without_walls(mesh, file, &params, &mut report, &Progress::none()).unwrap();
        (found.map(|found| found.mesh), report)
    }

    #[test]
    fn bodies_and_cavities_are_no_walls() {
        // a body, a cavity in it, an island in that, and a body beside them
        let mesh = cubes(&[
            (4.0, 0.0, false),
            (3.0, 0.5, true),
            (2.0, 1.0, false),
            (1.0, 9.0, false),
        ]);
        let expected = Walls {
            parts: 4,
            ..Walls::default()
        };
        assert_eq!(walls(&mesh), expected);
        assert_eq!(resolved(&mesh, Inside::Positive).0, None);
        assert_eq!(resolved(&mesh, Inside::Nonzero).0, None);
        let (hull, report) = resolved(&mesh, Inside::OuterHull);
        assert!((measure(&hull.unwrap()).volume - 65.0).abs() < 1e-9);
        assert!(report.warnings.is_empty());
    }

    #[test]
    fn nested_and_overlapping_bodies_are_one() {
        for (mesh, volume, [crossings, buried]) in [
            (
                cubes(&[(4.0, 0.0, false), (2.0, 1.0, false)]),
                64.0,
                [false, true],
            ),
            (
                cubes(&[(4.0, 0.0, false), (4.0, 2.0, false)]),
                120.0,
                [true, false],
            ),
        ] {
            let found = walls(&mesh);
            assert_eq!([found.crossings > 0, found.buried > 0], [crossings, buried]);
            let (whole, report) = resolved(&mesh, Inside::Positive);
            assert!((measure(&whole.unwrap()).volume - volume).abs() < 1e-9);
            assert!(
                report.warnings[0].contains("has walls inside"),
                "{:?}",
                report.warnings
            );
        }
    }

    #[test]
    fn parts_inside_out_are_named() {
        let mesh = cubes(&[(4.0, 0.0, false), (2.0, 9.0, true), (1.0, 20.0, true)]);
        assert_eq!(walls(&mesh).reversed, 2);
        let (all, report) = resolved(&mesh, Inside::Positive);
        assert!((measure(&all.unwrap()).volume - 73.0).abs() < 1e-9);
        assert!(report.verdict.assumed[0].contains("2 parts"), "{report:?}");
        // one that reaches into another cannot be told from a cut
        let mesh = cubes(&[(4.0, 0.0, false), (2.0, 3.0, true)]);
        let (left, report) = resolved(&mesh, Inside::Positive);
        let volume = measure(&left.unwrap()).volume;
        assert!((volume - 63.0).abs() < 1e-9, "{volume}");
        assert!(!report.verdict.dropped.is_empty(), "{report:?}");
        let (kept, _) = resolved(&mesh, Inside::Nonzero);
        assert!((measure(&kept.unwrap()).volume - 70.0).abs() < 1e-9);
    }
}
