//! The triangles: polygons around edges with a change of sign, cut so that no two of them meet where they should not.
//!
//! Source: Ju and Udeshi, *Intersection-free Contouring on an Octree Grid*, Pacific Graphics 2006: a dual edge that does
//! not go through its minimal face gets a vertex in the face; a triangle that its edge does not pierce is replaced by a fan
//! around a vertex on that edge.
//!
//! Guarantees: closed, oriented, manifold by its indices. Intersections can be left only in cells with several vertices.

use crate::cell::{CornerValue, Sample, root};
use crate::field::Region;
use crate::refine::Refinement;
use crate::regions::reachable;
use glam::DVec3;
use ravec_mesh::{Sign, orient3d};
use ravec_octree::{CellKey, Contour, Corner, MinimalEdge, NodeId, Polygon, for_each_minimal_edge};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashSet;

/// The share of a face's side that a dual edge, or a vertex in the face, keeps away from the face's border.
const FACE_MARGIN: f64 = 1e-7;

/// A surface with, for each triangle, the leaves that it comes from.
pub(crate) struct Extracted {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// The polygon of each triangle.
    pub polygon_of: Vec<u32>,
    pub contour: Contour,
}

impl Extracted {
    /// The leaves around the polygon of a triangle.
    pub fn cells_of(&self, triangle: usize) -> &[NodeId] {
        self.contour.polygons[self.polygon_of[triangle] as usize].cells()
    }

    /// The leaves in which sheets have the same vertex, which no search for intersections tells from a common one.
    pub fn cells_with_equal_vertices(&self) -> Vec<NodeId> {
        let sheets: Vec<usize> = (0..self.contour.vertex_cells.len()).collect();
        sheets
            .chunk_by(|&a, &b| self.contour.vertex_cells[a] == self.contour.vertex_cells[b])
            .filter(|cell| {
                cell.iter().enumerate().any(|(i, &a)| {
                    let others = &cell[i + 1..];
                    others
                        .iter()
                        .any(|&b| self.positions[a] == self.positions[b])
                })
            })
            .map(|cell| self.contour.vertex_cells[cell[0]])
            .collect()
    }

    /// The triangles of polygons that have a corner in a leaf with several sheets, or share a leaf with such a polygon.
    pub fn near_crowded_cells(&self) -> Vec<u32> {
        let sheets = &self.contour.vertex_cells;
        let mut near: FxHashSet<NodeId> = sheets
            .windows(2)
            .filter(|pair| pair[0] == pair[1])
            .map(|pair| pair[0])
            .collect();
        if near.is_empty() {
            return vec![];
        }
        let touches = |polygon: &Polygon, cells: &FxHashSet<NodeId>| {
            polygon.cells().iter().any(|cell| cells.contains(cell))
        };
        let polygons = &self.contour.polygons;
        let beside: Vec<NodeId> = polygons
            .iter()
            .filter(|polygon| touches(polygon, &near))
            .flat_map(Polygon::cells)
            .copied()
            .collect();
        near.extend(beside);
        let is_near: Vec<bool> = polygons
            .iter()
            .map(|polygon| touches(polygon, &near))
            .collect();
        (0u32..)
            .zip(&self.polygon_of)
            .filter(|&(_, &polygon)| is_near[polygon as usize])
            .map(|(triangle, _)| triangle)
            .collect()
    }
}

/// The surface of a tree.
///
/// With `outer_only`, without what cannot be reached from far away.
pub(crate) fn extract(
    refinement: &Refinement<'_>,
    outer_only: bool,
    progress: &Progress,
) -> Result<Extracted, Cancelled> {
    let tree = &refinement.tree;
    let mut crossings: Vec<(MinimalEdge, bool)> = Vec::new();
    for_each_minimal_edge(tree, |edge| {
        let start = refinement.is_inside(edge.smallest, edge.start);
        if start != refinement.is_inside(edge.smallest, edge.end()) {
            crossings.push((edge, start));
        }
    });
    progress.check()?;
    let mut contour = Contour::new(tree, &crossings);
    if outer_only {
        contour = reachable(refinement, &crossings, contour);
    }
    let positions = vertices(refinement, &contour);
    progress.check()?;
    let cutter = Cutter {
        refinement,
        contour: &contour,
        positions,
    };
    let (positions, triangles, polygon_of) = cutter.cut();
    Ok(Extracted {
        positions,
        triangles,
        polygon_of,
        contour,
    })
}

/// The point where an edge of the lattice goes through the surface.
fn edge_root(refinement: &Refinement<'_>, ends: [Corner; 2], cells: &[NodeId]) -> Sample {
    let points = ends.map(|end| refinement.frame.point(end));
    let region = cells
        .iter()
        .map(|&cell| refinement.tree.data(cell).region)
        .find(|&region| region != Region::Unknown)
        .unwrap_or(Region::Unknown);
    let hint = refinement.tree.data(cells[0]).hint;
    let mut values = [0, 1].map(|i| {
        refinement.corner(ends[i]).copied().unwrap_or_else(|| {
            // a corner of finer, empty cells: only its sign is known
            let near = refinement.field.near(points[i], hint);
            let value = refinement.field.radius() - near.distance;
            let inside = if i == 0 { -1.0 } else { 1.0 };
            CornerValue {
                triangle: near.triangle,
                value: inside * value.abs(),
            }
        })
    });
    // a filled corner: the surface goes as close to it as it can
    values[0].value = values[0].value.min(-1e-9 * refinement.tolerance);
    let enough = 0.02 * refinement.tolerance;
    let mut sample = root(refinement.field, region, points, values, enough);
    // off the ends, where other edges begin
    let along = points[1] - points[0];
    let t = (sample.point - points[0]).dot(along) / along.length_squared();
    sample.point = points[0] + t.clamp(1e-6, 1.0 - 1e-6) * along;
    sample
}

/// The places of the contour's vertices.
fn vertices(refinement: &Refinement<'_>, contour: &Contour) -> Vec<DVec3> {
    let cells = &contour.vertex_cells;
    let is_alone = |i: usize| {
        (i == 0 || cells[i - 1] != cells[i]) && (i + 1 == cells.len() || cells[i + 1] != cells[i])
    };
    let placed: Vec<Option<DVec3>> = (0..cells.len())
        .map(|i| refinement.leaf_vertex(cells[i]).filter(|_| is_alone(i)))
        .collect();
    // the others stand for where their own polygons' edges go through the surface
    let mut polygons_of: Vec<(u32, u32)> = (0u32..)
        .zip(&contour.polygons)
        .flat_map(|(number, polygon)| polygon.vertices().iter().map(move |&v| (v, number)))
        .filter(|&(vertex, _)| placed[vertex as usize].is_none())
        .collect();
    polygons_of.sort_unstable();
    let groups: Vec<&[(u32, u32)]> = polygons_of.chunk_by(|a, b| a.0 == b.0).collect();
    let found: Vec<(u32, DVec3)> = groups
        .into_par_iter()
        .map(|group| {
            let samples: Vec<Sample> = group
                .iter()
                .map(|&(_, polygon)| {
                    let polygon = &contour.polygons[polygon as usize];
                    edge_root(refinement, polygon.ends(), polygon.cells())
                })
                .collect();
            let vertex = group[0].0;
            let key = refinement.tree.key(cells[vertex as usize]);
            (vertex, refinement.cell(key).vertex(&samples).0)
        })
        .collect();
    let mut positions: Vec<DVec3> = placed.into_iter().map(Option::unwrap_or_default).collect();
    for (vertex, position) in found {
        positions[vertex as usize] = position;
    }
    positions
}

/// Cuts polygons into triangles.
struct Cutter<'a> {
    refinement: &'a Refinement<'a>,
    contour: &'a Contour,
    positions: Vec<DVec3>,
}

/// A polygon's triangles before vertices on edges have numbers.
enum Cut {
    /// Corners of the polygon.
    Triangles(Vec<[u32; 3]>),
    /// Around a vertex on the polygon's edge.
    Fan(DVec3),
}

impl Cutter<'_> {
    /// Positions, triangles, and the polygon of each triangle.
    fn cut(mut self) -> (Vec<DVec3>, Vec<[u32; 3]>, Vec<u32>) {
        let contour = self.contour;
        let in_faces: Vec<Option<DVec3>> = (0..contour.duals.len())
            .into_par_iter()
            .map(|dual| self.face_vertex(dual))
            .collect();
        let cuts: Vec<Cut> = contour
            .polygons
            .par_iter()
            .map(|polygon| self.cut_polygon(polygon, &in_faces))
            .collect();
        let face_numbers: Vec<Option<u32>> = in_faces
            .into_iter()
            .map(|place| place.map(|place| self.push(place)))
            .collect();
        let mut triangles = Vec::with_capacity(2 * cuts.len());
        let mut polygon_of = Vec::with_capacity(2 * cuts.len());
        // a diagonal may be used by one polygon only
        let mut diagonals: FxHashSet<[u32; 2]> = FxHashSet::default();
        for (number, (polygon, cut)) in (0u32..).zip(contour.polygons.iter().zip(cuts)) {
            let cut = match cut {
                Cut::Triangles(cut) if cut.len() == 2 => {
                    let (a, b) = (cut[0][0], cut[0][2]);
                    if diagonals.insert([a.min(b), a.max(b)]) {
                        Cut::Triangles(cut)
                    } else {
                        Cut::Fan(self.on_edge(polygon))
                    }
                }
                other => other,
            };
            let before = triangles.len();
            match cut {
                Cut::Triangles(cut) => triangles.extend(cut),
                Cut::Fan(center) => {
                    let center = self.push(center);
                    let ring: Vec<u32> = polygon
                        .vertices()
                        .iter()
                        .zip(polygon.duals())
                        .flat_map(|(&vertex, &dual)| {
                            [Some(vertex), face_numbers[dual as usize]]
                                .into_iter()
                                .flatten()
                        })
                        .collect();
                    let next = |i: usize| ring[(i + 1) % ring.len()];
                    triangles.extend((0..ring.len()).map(|i| [center, ring[i], next(i)]));
                }
            }
            polygon_of.resize(polygon_of.len() + triangles.len() - before, number);
        }
        (self.positions, triangles, polygon_of)
    }

    fn push(&mut self, place: DVec3) -> u32 {
        self.positions.push(place);
        (self.positions.len() - 1) as u32
    }

    /// A vertex in the minimal face of a dual edge, if the straight way does not go through the face.
    fn face_vertex(&self, dual: usize) -> Option<DVec3> {
        let dual = &self.contour.duals[dual];
        let keys = dual.cells.map(|cell| self.refinement.tree.key(cell));
        let face = Face::between(keys, &self.refinement.frame);
        let ends = dual.vertices.map(|vertex| self.positions[vertex as usize]);
        if !dual.is_ambiguous && face.is_crossed(ends) {
            return None;
        }
        let roots = dual
            .polygons
            .map(|polygon| self.on_edge(&self.contour.polygons[polygon as usize]));
        let mut place = 0.5 * (roots[0] + roots[1]);
        if !dual.is_ambiguous {
            // onto the surface, without leaving the face
            let field = self.refinement.field;
            let mut hint = self.refinement.tree.data(dual.cells[0]).hint;
            for _ in 0..4 {
                let near = field.near(place, hint);
                hint = near.triangle;
                let mut along = near.away;
                along[face.axis] = 0.0;
                let slope = along.length_squared();
                if slope < 0.01 {
                    break;
                }
                let step = (field.foot(place, &near) - place).dot(near.away) / slope;
                place = face.clamp(place + step * along);
                if step.abs() <= 0.02 * self.refinement.tolerance {
                    break;
                }
            }
        }
        place = face.clamp(place);
        Some(place)
    }

    fn on_edge(&self, polygon: &Polygon) -> DVec3 {
        edge_root(self.refinement, polygon.ends(), polygon.cells()).point
    }

    fn cut_polygon(&self, polygon: &Polygon, in_faces: &[Option<DVec3>]) -> Cut {
        let vertices = polygon.vertices();
        let fan = || Cut::Fan(self.on_edge(polygon));
        if polygon
            .duals()
            .iter()
            .any(|&dual| in_faces[dual as usize].is_some())
        {
            return fan();
        }
        let [inside, outside] = polygon.ends().map(|end| self.refinement.frame.point(end));
        let edge = [inside, outside];
        let p: Vec<DVec3> = vertices
            .iter()
            .map(|&v| self.positions[v as usize])
            .collect();
        if let &[a, b, c] = vertices {
            return if pierces(edge, [p[0], p[1], p[2]]) {
                Cut::Triangles(vec![[a, b, c]])
            } else {
                fan()
            };
        }
        // the diagonal from corner `i` to the one across
        let allows = |i: usize| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| p[(i + k) % 4]);
            (pierces(edge, [a, b, c]) && pierces([a, c], [inside, outside, d]))
                || (pierces(edge, [a, c, d]) && pierces([a, c], [inside, outside, b]))
        };
        let length = |i: usize| p[i].distance_squared(p[i + 2]);
        let first = usize::from(length(1) < length(0));
        for i in [first, 1 - first] {
            if allows(i) {
                let v = |k: usize| vertices[(i + k) % 4];
                return Cut::Triangles(vec![[v(0), v(1), v(2)], [v(2), v(3), v(0)]]);
            }
        }
        fan()
    }
}

/// Whether a segment goes through the inside of a triangle, decided exactly.
fn pierces([from, to]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let around = [(a, b), (b, c), (c, a)].map(|(p, q)| orient3d(from, to, p, q));
    let same = around[0] != Sign::Zero && around.iter().all(|&sign| sign == around[0]);
    if !same {
        return false;
    }
    let [below, above] = [from, to].map(|end| orient3d(a, b, c, end));
    below != Sign::Zero && above != Sign::Zero && below != above
}

/// The square in which two leaves touch.
struct Face {
    axis: usize,
    low: DVec3,
    high: DVec3,
}

impl Face {
    fn between([a, b]: [CellKey; 2], frame: &ravec_octree::Frame) -> Self {
        let small = if a.level >= b.level { a } else { b };
        let overlaps = |axis: usize| {
            a.at.0[axis] < b.at.0[axis] + b.side() && b.at.0[axis] < a.at.0[axis] + a.side()
        };
        let axis = (0..3)
            .find(|&axis| !overlaps(axis))
            .expect("leaves of a dual edge touch in a face");
        let plane = if a.at.0[axis] < b.at.0[axis] {
            b.at.0[axis]
        } else {
            a.at.0[axis]
        };
        let [mut low, mut high] = frame.bounds(small);
        let mut corner = small.at;
        corner.0[axis] = plane;
        low[axis] = frame.point(corner)[axis];
        high[axis] = low[axis];
        Self { axis, low, high }
    }

    /// The face without its border.
    fn inner(&self) -> [DVec3; 2] {
        let mut margin = FACE_MARGIN * (self.high - self.low);
        margin[self.axis] = 0.0;
        [self.low + margin, self.high - margin]
    }

    fn is_crossed(&self, [a, b]: [DVec3; 2]) -> bool {
        let plane = self.low[self.axis];
        let (from, to) = (a[self.axis] - plane, b[self.axis] - plane);
        if from * to >= 0.0 {
            return false;
        }
        let mut p = a.lerp(b, from / (from - to));
        p[self.axis] = plane;
        let [low, high] = self.inner();
        p.cmpge(low).all() && p.cmple(high).all()
    }

    fn clamp(&self, p: DVec3) -> DVec3 {
        let size = (self.high - self.low).max_element();
        let mut margin = DVec3::splat(1e-4 * size);
        margin[self.axis] = 0.0;
        p.clamp(self.low + margin, self.high - margin)
    }
}
