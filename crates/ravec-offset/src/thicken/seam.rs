//! The seam: the sheet itself replaces the skin close above it.
//!
//! The surface of a slab that starts slightly above a sheet has a lower skin that follows the sheet. That skin is cut out, the
//! sheet takes its place, and a narrow strip joins the boundary of the sheet to that of the cut. The cut follows the lifted
//! boundary of the sheet and is moved onto it, so that the strip is upright; its triangles connect each edge of one boundary to
//! the nearest corner of the other.
//!
//! Does not guarantee anything about the strip: the caller checks the whole, exactly.

use crate::params::Coordinates;
use glam::DVec3;
use ravec_mesh::{Bvh, ClosestOnTriangle, TriMesh, closest_on_triangle};
use rustc_hash::{FxHashMap, FxHashSet};

/// Smallest step along the cut, in edges of the boundary.
const MIN_STEP: f64 = 1e-6;

/// A sheet joined to the rest of its solid.
pub(super) struct Sewn {
    /// The triangles of the sheet, then the strip, then the kept part of the surface.
    pub mesh: TriMesh,
    /// Triangles that the surface did not have in this form: the strip, and those at the cut.
    pub fresh: Vec<u32>,
}

/// Joins the reversed sheet, the strip and the triangles of a surface for which `is_kept` holds. Returns `None` if the
/// boundaries of the sheet and the kept part do not match loop by loop. `lifted` are the vertices of the sheet at the height of
/// the cut; vertices of the cut within `reach` of their position there are moved to it.
pub(super) fn sew(
    sheet: &TriMesh,
    lifted: &[DVec3],
    reach: f64,
    (surface, is_kept): (&TriMesh, &[bool]),
    coordinates: Coordinates,
) -> Option<Sewn> {
    let kept: Vec<[u32; 3]> = surface
        .triangles()
        .iter()
        .zip(is_kept)
        .filter_map(|(&triangle, &kept)| kept.then_some(triangle))
        .collect();
    let first = sheet.positions().len() as u32;
    let rims = loops(&sides_alone(sheet.triangles()))?;
    let cuts = loops(&sides_alone(&kept))?;
    if rims.len() != cuts.len() {
        return None;
    }
    let mut triangles: Vec<[u32; 3]> = sheet
        .triangles()
        .iter()
        .map(|&[a, b, c]| [a, c, b])
        .collect();
    let start = triangles.len() as u32;
    let mut places = surface.positions().to_vec();
    // vertices where the cut runs back are merged
    let mut merged: Vec<u32> = (0..places.len() as u32).collect();
    if !rims.is_empty() {
        let along = Along::new(lifted, &rims);
        let mut taken = vec![false; rims.len()];
        for cut in &cuts {
            let at: Vec<DVec3> = cut.iter().map(|&v| places[v as usize]).collect();
            let (rim, params, on_rim) = along.params(&at)?;
            let mut ring: Vec<u32> = Vec::with_capacity(cut.len());
            let mut at_ring: Vec<f64> = Vec::with_capacity(cut.len() + 1);
            for (i, (&v, place)) in cut.iter().zip(on_rim).enumerate() {
                let is_near = places[v as usize].distance(place) <= reach;
                let is_behind = i > 0 && params[i] - params[i - 1] <= MIN_STEP;
                if let (true, true, Some(&last)) = (is_near, is_behind, ring.last()) {
                    merged[v as usize] = last;
                    continue;
                }
                if is_near {
                    places[v as usize] = coordinates.nearest(place);
                }
                ring.push(v);
                at_ring.push(params[i]);
            }
            at_ring.push(params[cut.len()]);
            if std::mem::replace(&mut taken[rim], true) {
                return None;
            }
            strip(&rims[rim], &ring, &at_ring, first, &mut triangles);
        }
    }
    let end = triangles.len() as u32;
    let merged_kept = kept
        .iter()
        .map(|triangle| triangle.map(|v| merged[v as usize] + first));
    triangles.extend(merged_kept.filter(|[a, b, c]| a != b && b != c && c != a));
    let is_cut: FxHashSet<u32> = cuts.iter().flatten().map(|v| v + first).collect();
    let at_cut = (end..triangles.len() as u32)
        .filter(|&t| triangles[t as usize].iter().any(|v| is_cut.contains(v)));
    let fresh = (start..end).chain(at_cut).collect();
    let mut positions = sheet.positions().to_vec();
    positions.extend(places);
    Some(Sewn {
        mesh: TriMesh::new(positions, triangles).expect("corners of both have numbers"),
        fresh,
    })
}

/// Returns the directed sides of triangles without a triangle in the opposite direction.
fn sides_alone(triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let mut sides: Vec<([u32; 2], bool)> = triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| ([a.min(b), a.max(b)], a < b))
        .collect();
    sides.sort_unstable();
    sides
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|uses| uses.len() == 1)
        .map(|uses| {
            let ([low, high], forward) = uses[0];
            if forward { [low, high] } else { [high, low] }
        })
        .collect()
}

/// Returns the closed loops of directed sides; `None` if a vertex has several continuations, or none.
fn loops(sides: &[[u32; 2]]) -> Option<Vec<Vec<u32>>> {
    let next: FxHashMap<u32, u32> = sides.iter().map(|&[a, b]| (a, b)).collect();
    if next.len() != sides.len() {
        return None;
    }
    let mut starts: Vec<u32> = sides.iter().map(|side| side[0]).collect();
    starts.sort_unstable();
    let mut left = next;
    let mut loops = Vec::new();
    for start in starts {
        let mut ring = Vec::new();
        let mut at = start;
        while let Some(to) = left.remove(&at) {
            ring.push(at);
            at = to;
        }
        if !ring.is_empty() {
            if at != start {
                return None;
            }
            loops.push(ring);
        }
    }
    Some(loops)
}

/// Parameters along the lifted boundary of a sheet.
struct Along {
    /// The edges of the boundary, as triangles without area.
    edges: Option<Bvh>,
    /// Loop and position in it, by edge.
    of_edge: Vec<(usize, u32)>,
    lengths: Vec<u32>,
}

impl Along {
    fn new(lifted: &[DVec3], rims: &[Vec<u32>]) -> Self {
        let mut triangles = Vec::new();
        let mut of_edge = Vec::new();
        for (number, rim) in rims.iter().enumerate() {
            for (i, &v) in (0u32..).zip(rim) {
                let to = rim[(i as usize + 1) % rim.len()];
                triangles.push([v, to, to]);
                of_edge.push((number, i));
            }
        }
        let mesh = TriMesh::new(lifted.to_vec(), triangles);
        Self {
            edges: mesh.ok().map(|mesh| Bvh::new(&mesh)),
            of_edge,
            lengths: rims.iter().map(|rim| rim.len() as u32).collect(),
        }
    }

    /// Returns the loop that all places follow, and for each place its parameter, in edges of the loop; parameters ascend from
    /// the first place around to the first again, which is added at the end. Then the closest points themselves.
    fn params(&self, places: &[DVec3]) -> Option<(usize, Vec<f64>, Vec<DVec3>)> {
        let edges = self.edges.as_ref()?;
        let mut rim = None;
        let mut params: Vec<f64> = Vec::with_capacity(places.len() + 1);
        let mut points = Vec::with_capacity(places.len());
        for &place in places {
            let edge = edges.closest(place)?.triangle;
            let (number, at) = self.of_edge[edge as usize];
            if *rim.get_or_insert(number) != number {
                return None;
            }
            let &[a, b, _] = edges.corners(edge);
            let ClosestOnTriangle { point, .. } = closest_on_triangle(place, &[a, b, b]);
            let share = point.distance(a) / b.distance(a);
            params.push(f64::from(at) + share.clamp(0.0, 1.0));
            points.push(point);
        }
        let rim = rim?;
        let length = f64::from(self.lengths[rim]);
        params.push(params[0]);
        for i in 1..params.len() {
            // the shorter way around; a step back is noise
            let step = (params[i] - params[i - 1]).rem_euclid(length);
            let step = if step > 0.5 * length && params.len() > 4 {
                0.0
            } else {
                step
            };
            params[i] = params[i - 1] + step;
        }
        let around = params[params.len() - 1] - params[0];
        ((around - length).abs() < 0.5).then_some((rim, params, points))
    }
}

/// Adds triangles between a loop of the sheet and one of the surface, whose vertices are numbered from `first`.
fn strip(rim: &[u32], cut: &[u32], params: &[f64], first: u32, triangles: &mut Vec<[u32; 3]>) {
    let n = rim.len();
    // the vertex of the rim that is nearest along it to the first of the cut
    let start = params[0].round() as usize;
    let at_rim = |i: usize| rim[(start + i) % n];
    let at_cut = |j: usize| cut[j % cut.len()] + first;
    let (mut i, mut j) = (0, 0);
    while i < n || j < cut.len() {
        let rim_middle = (start + i) as f64 + 0.5;
        let on_rim = j == cut.len() || (i < n && rim_middle <= 0.5 * (params[j] + params[j + 1]));
        if on_rim {
            triangles.push([at_rim(i), at_rim(i + 1), at_cut(j)]);
            i += 1;
        } else {
            triangles.push([at_rim(i), at_cut(j + 1), at_cut(j)]);
            j += 1;
        }
    }
}
