//! The triangles: polygons around edges with a change of sign, cut so that no two of them meet where they should not.
//!
//! Source: Ju and Udeshi, *Intersection-free Contouring on an Octree Grid*, Pacific Graphics 2006: a dual edge that does
//! not go through its minimal face gets a vertex in the face; a triangle that its edge does not pierce is replaced by a fan
//! around a vertex on that edge.
//!
//! Guarantees: closed, oriented, manifold by its indices. Intersections can be left only in cells with several vertices.

use crate::cell::{CornerValue, Ends, ON_SURFACE, Sample, root};
use crate::field::Region;
use crate::refine::Refinement;
use crate::tile::{Edge, Patch, TRIANGLES_AT_ONCE, VertexName};
use glam::DVec3;
use ravec_mesh::{Sign, orient3d};
use ravec_octree::{
    CellKey, Contour, Corner, DualEdge, MinimalEdge, NodeId, Polygon, minimal_edges,
};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::{FxBuildHasher, FxHashMap, FxHashSet};
use std::hash::BuildHasher as _;
use std::ops::Range;

/// The share of a face's side that a dual edge, or a vertex in the face, keeps away from the face's border.
const FACE_MARGIN: f64 = 1e-7;

/// A surface with, for each triangle, the leaves that it comes from.
pub(crate) struct Extracted {
    pub positions: Vec<DVec3>,
    /// What the positions after those of the contour's vertices are called.
    added: Vec<VertexName>,
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

    /// The vertices of each leaf that has several sheets and was looked at with all around it.
    fn crowds(&self, refinement: &Refinement<'_>) -> impl Iterator<Item = Range<usize>> {
        let cells = &self.contour.vertex_cells;
        let mut start = 0;
        cells
            .chunk_by(|a, b| a == b)
            .map(move |crowd| {
                start += crowd.len();
                start - crowd.len()..start
            })
            .filter(|crowd| crowd.len() > 1 && refinement.is_core(cells[crowd.start]))
    }

    /// The leaves in which sheets have the same vertex, which no search for intersections tells from a common one.
    pub fn cells_with_equal_vertices(&self, refinement: &Refinement<'_>) -> Vec<NodeId> {
        self.crowds(refinement)
            .filter(|crowd| {
                crowd
                    .clone()
                    .any(|a| (a + 1..crowd.end).any(|b| self.positions[a] == self.positions[b]))
            })
            .map(|crowd| self.contour.vertex_cells[crowd.start])
            .collect()
    }

    /// The triangles of polygons that have a corner in a leaf with several sheets, or share a leaf with such a polygon.
    pub fn near_crowded_cells(&self, refinement: &Refinement<'_>) -> Vec<u32> {
        let mut near: FxHashSet<NodeId> = self
            .crowds(refinement)
            .map(|crowd| self.contour.vertex_cells[crowd.start])
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

    /// What belongs to a tile.
    pub fn patch(
        &self,
        refinement: &Refinement<'_>,
        tile: CellKey,
        progress: &Progress,
    ) -> Result<Patch, Cancelled> {
        let mut patch = Patch::default();
        let mut numbers = vec![u32::MAX; self.positions.len()];
        let mut last = None;
        for (t, (triangle, &polygon_number)) in
            (0u32..).zip(self.triangles.iter().zip(&self.polygon_of))
        {
            if t.is_multiple_of(TRIANGLES_AT_ONCE) {
                progress.check()?;
            }
            let polygon = &self.contour.polygons[polygon_number as usize];
            if !tile.owns(polygon.start) {
                continue;
            }
            if last != Some(polygon_number) {
                last = Some(polygon_number);
                patch.edges.push(edge_of(polygon));
            }
            patch.edge_of.push(patch.edges.len() as u32 - 1);
            patch.triangles.push(triangle.map(|v| {
                let number = &mut numbers[v as usize];
                if *number == u32::MAX {
                    *number = patch.positions.len() as u32;
                    patch.positions.push(self.positions[v as usize]);
                    patch.names.push(self.name(refinement, v as usize));
                }
                *number
            }));
        }
        Ok(patch)
    }

    fn name(&self, refinement: &Refinement<'_>, vertex: usize) -> VertexName {
        let cells = &self.contour.vertex_cells;
        let Some(&leaf) = cells.get(vertex) else {
            return self.added[vertex - cells.len()];
        };
        let before = cells[..vertex].iter().rev();
        VertexName::Sheet {
            leaf: refinement.tree.key(leaf).at,
            number: before.take_while(|&&cell| cell == leaf).count() as u32,
        }
    }

    /// Whether the polygon of a triangle belongs to a tile.
    pub fn is_owned(&self, triangle: usize, tile: CellKey) -> bool {
        tile.owns(self.contour.polygons[self.polygon_of[triangle] as usize].start)
    }
}

fn edge_of(polygon: &Polygon) -> Edge {
    Edge {
        start: polygon.start,
        length: polygon.length,
        axis: polygon.axis,
    }
}

/// The surface of what was looked at.
pub(crate) fn extract(
    refinement: &Refinement<'_>,
    places: &mut CrossingPlaces,
    progress: &Progress,
) -> Result<Extracted, Cancelled> {
    let tree = &refinement.tree;
    let mut crossings: Vec<(MinimalEdge, bool)> = minimal_edges(tree, |edge| {
        let is_crossed = !progress.is_cancelled() && refinement.is_crossed(&edge);
        is_crossed.then(|| (edge, refinement.is_inside(edge.smallest, edge.start)))
    });
    progress.check()?;
    // an order that all tiles agree on
    crossings.par_sort_unstable_by_key(|(edge, _)| (edge.start.morton(), edge.axis));
    progress.check()?;
    let is_core = |cell| refinement.is_core(cell);
    let contour = Contour::within(tree, &crossings, is_core, || progress.check())?;
    drop(crossings);
    progress.check()?;
    let positions = vertices(refinement, &contour, places, progress)?;
    let cutter = Cutter {
        refinement,
        contour: &contour,
        positions,
        added: Vec::new(),
    };
    Ok(cutter.cut(places, progress)?.with(contour))
}

/// Triangles before they are joined with the contour that they come from.
struct Pieces {
    positions: Vec<DVec3>,
    added: Vec<VertexName>,
    triangles: Vec<[u32; 3]>,
    polygon_of: Vec<u32>,
}

impl Pieces {
    fn with(self, contour: Contour) -> Extracted {
        Extracted {
            positions: self.positions,
            added: self.added,
            triangles: self.triangles,
            polygon_of: self.polygon_of,
            contour,
        }
    }
}

/// What the place where an edge goes through the surface depends on: its ends, the one inside first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Crossing {
    ends: [Corner; 2],
    region: Region,
    values: [CornerValue; 2],
    /// Whether the end inside is a filled corner, outside by its value.
    is_filled: bool,
}

impl Crossing {
    fn of(refinement: &Refinement<'_>, polygon: &Polygon) -> Self {
        let (ends, cells) = (polygon.ends(), polygon.cells());
        let region = cells
            .iter()
            .map(|&cell| refinement.tree.data(cell).region)
            .find(|&region| region != Region::Unknown)
            .unwrap_or(Region::Unknown);
        let hint = refinement.tree.data(cells[0]).hint;
        let mut values = [0, 1].map(|i| {
            refinement.corner(ends[i]).copied().unwrap_or_else(|| {
                // a corner of finer, empty cells: only its sign is known
                let near = refinement.field.near(refinement.frame.point(ends[i]), hint);
                let value = refinement.field.radius() - near.distance;
                let inside = if i == 0 { -1.0 } else { 1.0 };
                CornerValue {
                    triangle: near.triangle,
                    value: inside * value.abs(),
                }
            })
        });
        // a filled corner: the surface goes as close to it as it can
        let is_filled = values[0].value > 0.0;
        values[0].value = values[0].value.min(-1e-9 * refinement.tolerance);
        Self {
            ends,
            region,
            values,
            is_filled,
        }
    }

    fn root(&self, refinement: &Refinement<'_>) -> Sample {
        let points = self.ends.map(|end| refinement.frame.point(end));
        let enough = ON_SURFACE * refinement.tolerance;
        let mut sample = if self.is_filled {
            let near = refinement.field.near(points[0], self.values[0].triangle);
            Sample {
                point: points[0],
                away: near.away,
                triangle: near.triangle,
            }
        } else {
            let ends = Ends {
                points,
                values: self.values,
                // of some ends it is known only whether they are inside
                known: &[],
            };
            root(refinement.field, self.region, ends, enough)
        };
        // off the ends, where other edges begin
        let along = points[1] - points[0];
        let t = (sample.point - points[0]).dot(along) / along.length_squared();
        let margin = refinement.grid.margin(1e-6, along.length());
        let place = points[0] + t.clamp(margin, 1.0 - margin) * along;
        sample.point = refinement.grid.nearest(place);
        sample
    }
}

/// Where edges go through the surface, as far as that was asked for, and where that puts the vertices of leaves that have
/// several: rounds of mending ask again and again.
#[derive(Debug, Default)]
pub(crate) struct CrossingPlaces {
    crossings: FxHashMap<[Corner; 2], (Crossing, Sample)>,
    /// By a hash of the leaf and of where its edges go through the surface.
    vertices: FxHashMap<u64, DVec3>,
    /// Vertices in faces, by a hash of the leaves on both sides and of where the edges of both polygons go through the surface.
    in_faces: FxHashMap<u64, DVec3>,
}

impl CrossingPlaces {
    /// Works out the places of some polygons' edges.
    fn look_up<'p>(
        &mut self,
        refinement: &Refinement<'_>,
        polygons: impl ParallelIterator<Item = &'p Polygon>,
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        let missing: Vec<(Crossing, Sample)> = polygons
            .map(|polygon| Crossing::of(refinement, polygon))
            .filter(|crossing| {
                let known = self.crossings.get(&crossing.ends);
                known.is_none_or(|(known, _)| known != crossing)
            })
            .map(|crossing| {
                progress.check()?;
                Ok((crossing, crossing.root(refinement)))
            })
            .collect::<Result<_, Cancelled>>()?;
        self.crossings.reserve(missing.len());
        for some in missing.chunks(TRIANGLES_AT_ONCE as usize) {
            progress.check()?;
            let named = some.iter().map(|place| (place.0.ends, *place));
            self.crossings.extend(named);
        }
        Ok(())
    }

    fn of(&self, polygon: &Polygon) -> Sample {
        self.crossings[&polygon.ends()].1
    }
}

/// The places of the contour's vertices.
fn vertices(
    refinement: &Refinement<'_>,
    contour: &Contour,
    places: &mut CrossingPlaces,
    progress: &Progress,
) -> Result<Vec<DVec3>, Cancelled> {
    let cells = &contour.vertex_cells;
    let is_alone = |i: usize| {
        (i == 0 || cells[i - 1] != cells[i]) && (i + 1 == cells.len() || cells[i + 1] != cells[i])
    };
    let placed: Vec<Option<DVec3>> = (0..cells.len())
        .map(|i| refinement.leaf_vertex(cells[i]).filter(|_| is_alone(i)))
        .collect();
    progress.check()?;
    // the others stand for where their own polygons' edges go through the surface
    let mut polygons_of: Vec<(u32, u32)> = (0u32..)
        .zip(&contour.polygons)
        .flat_map(|(number, polygon)| polygon.vertices().iter().map(move |&v| (v, number)))
        .filter(|&(vertex, _)| {
            placed[vertex as usize].is_none() && refinement.is_core(cells[vertex as usize])
        })
        .collect();
    progress.check()?;
    polygons_of.sort_unstable();
    progress.check()?;
    let mut numbers: Vec<u32> = polygons_of.iter().map(|&(_, polygon)| polygon).collect();
    numbers.par_sort_unstable();
    numbers.dedup();
    let polygons = numbers.par_iter().map(|&n| &contour.polygons[n as usize]);
    places.look_up(refinement, polygons, progress)?;
    let groups: Vec<&[(u32, u32)]> = polygons_of.chunk_by(|a, b| a.0 == b.0).collect();
    let known = &places.vertices;
    let found: Vec<(u32, u64, DVec3)> = groups
        .into_par_iter()
        .map(|group| {
            progress.check()?;
            let samples: Vec<Sample> = group
                .iter()
                .map(|&(_, polygon)| places.of(&contour.polygons[polygon as usize]))
                .collect();
            let vertex = group[0].0;
            let key = refinement.tree.key(cells[vertex as usize]);
            let points = samples.iter().map(|s| s.point.to_array().map(f64::to_bits));
            let hash = FxBuildHasher.hash_one((key, points.collect::<Vec<_>>()));
            let position = known.get(&hash).copied();
            let position = position.unwrap_or_else(|| {
                let placed = refinement.cell(key).vertex(&samples).0;
                refinement
                    .grid
                    .apart(placed, samples.iter().map(|s| s.point))
            });
            Ok((vertex, hash, position))
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut positions: Vec<DVec3> = placed.into_iter().map(Option::unwrap_or_default).collect();
    places.vertices.clear();
    for (vertex, hash, position) in found {
        positions[vertex as usize] = position;
        places.vertices.insert(hash, position);
    }
    Ok(positions)
}

/// Cuts polygons into triangles.
struct Cutter<'a> {
    refinement: &'a Refinement<'a>,
    contour: &'a Contour,
    positions: Vec<DVec3>,
    added: Vec<VertexName>,
}

/// How a polygon is cut.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cut {
    /// Not all around it was looked at.
    Unknown,
    /// It is a triangle.
    Whole,
    /// Along the diagonal from a corner, the first or the second one.
    Diagonal(usize),
    /// Around a vertex on its edge.
    Fan,
}

impl Cutter<'_> {
    fn cut(
        mut self,
        places: &mut CrossingPlaces,
        progress: &Progress,
    ) -> Result<Pieces, Cancelled> {
        let contour = self.contour;
        let is_core = |cells: &[NodeId]| cells.iter().all(|&cell| self.refinement.is_core(cell));
        let is_bent: Vec<bool> = contour
            .duals
            .par_iter()
            .map(|dual| {
                progress.check()?;
                Ok(is_core(&dual.cells) && self.is_bent(dual))
            })
            .collect::<Result<_, Cancelled>>()?;
        let mut cuts: Vec<Cut> = contour
            .polygons
            .par_iter()
            .map(|polygon| {
                progress.check()?;
                Ok(if is_core(polygon.cells()) {
                    self.cut_polygon(polygon, &is_bent)
                } else {
                    Cut::Unknown
                })
            })
            .collect::<Result<_, Cancelled>>()?;
        // a diagonal may be used by one polygon only
        let mut diagonals: FxHashSet<[u32; 2]> = FxHashSet::default();
        for (number, (polygon, cut)) in (0u32..).zip(contour.polygons.iter().zip(&mut cuts)) {
            if number.is_multiple_of(TRIANGLES_AT_ONCE) {
                progress.check()?;
            }
            if let Cut::Diagonal(first) = *cut {
                let (a, b) = (polygon.vertices()[first], polygon.vertices()[first + 2]);
                if !diagonals.insert([a.min(b), a.max(b)]) {
                    *cut = Cut::Fan;
                }
            }
        }
        drop(diagonals);
        let polygons = contour.polygons.par_iter().zip(&cuts);
        let fans = polygons.filter(|(polygon, cut)| {
            let mut duals = polygon.duals().iter();
            **cut == Cut::Fan || duals.any(|&dual| is_bent.get(dual as usize) == Some(&true))
        });
        places.look_up(self.refinement, fans.map(|(polygon, _)| polygon), progress)?;
        let known = &*places;
        let in_faces: Vec<Option<(u64, DVec3)>> = contour
            .duals
            .par_iter()
            .zip(&is_bent)
            .map(|(dual, &is_bent)| {
                progress.check()?;
                Ok(is_bent.then(|| self.face_vertex(dual, known)))
            })
            .collect::<Result<_, Cancelled>>()?;
        places.in_faces.clear();
        let face_numbers: Vec<Option<u32>> = in_faces
            .into_iter()
            .zip(&contour.duals)
            .map(|(found, dual)| {
                found.map(|(hash, place)| {
                    places.in_faces.insert(hash, place);
                    self.push(place, self.name_in_face(dual))
                })
            })
            .collect();
        progress.check()?;
        let mut triangles: Vec<[u32; 3]> = Vec::with_capacity(2 * cuts.len());
        let mut polygon_of = Vec::with_capacity(2 * cuts.len());
        for (number, (polygon, cut)) in (0u32..).zip(contour.polygons.iter().zip(cuts)) {
            if number.is_multiple_of(TRIANGLES_AT_ONCE) {
                progress.check()?;
            }
            let v = |k: usize| polygon.vertices()[k % polygon.vertices().len()];
            match cut {
                Cut::Unknown => {}
                Cut::Whole => triangles.push([v(0), v(1), v(2)]),
                Cut::Diagonal(i) => {
                    triangles.push([v(i), v(i + 1), v(i + 2)]);
                    triangles.push([v(i + 2), v(i + 3), v(i)]);
                }
                Cut::Fan => {
                    let name = VertexName::OnEdge {
                        start: polygon.start,
                        axis: polygon.axis,
                    };
                    let center = self.push(places.of(polygon).point, name);
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
            polygon_of.resize(triangles.len(), number);
        }
        Ok(Pieces {
            positions: self.positions,
            added: self.added,
            triangles,
            polygon_of,
        })
    }

    fn push(&mut self, place: DVec3, name: VertexName) -> u32 {
        self.positions.push(place);
        self.added.push(name);
        (self.positions.len() - 1) as u32
    }

    /// A vertex in a face is called after the first of the two polygons.
    fn name_in_face(&self, dual: &DualEdge) -> VertexName {
        let number = dual.polygons[0].min(dual.polygons[1]);
        let polygon = &self.contour.polygons[number as usize];
        let joins = |side: usize| {
            let cells = polygon.cells();
            let [a, b] = [cells[side], cells[(side + 1) % cells.len()]];
            [a.min(b), a.max(b)] == dual.cells
        };
        let side = (0..polygon.cells().len()).find(|&side| joins(side));
        VertexName::InFace {
            start: polygon.start,
            axis: polygon.axis,
            side: side.expect("a dual edge joins corners of its polygons") as u8,
        }
    }

    fn face_of(&self, dual: &DualEdge) -> Face {
        let keys = dual.cells.map(|cell| self.refinement.tree.key(cell));
        Face::between(keys, &self.refinement.frame)
    }

    /// Whether a dual edge takes a vertex in its minimal face: the straight way does not go through the face, or there is
    /// another one through it.
    fn is_bent(&self, dual: &DualEdge) -> bool {
        let ends = dual.vertices.map(|vertex| self.positions[vertex as usize]);
        dual.is_ambiguous || !self.face_of(dual).is_crossed(ends)
    }

    /// The vertex in the minimal face of a dual edge, and a hash of all that it depends on.
    fn face_vertex(&self, dual: &DualEdge, places: &CrossingPlaces) -> (u64, DVec3) {
        let roots = dual
            .polygons
            .map(|polygon| places.of(&self.contour.polygons[polygon as usize]).point);
        let keys = dual.cells.map(|cell| self.refinement.tree.key(cell));
        let bits = roots.map(|root| root.to_array().map(f64::to_bits));
        let hash = FxBuildHasher.hash_one((keys, bits, dual.is_ambiguous));
        let known = places.in_faces.get(&hash).copied();
        (
            hash,
            known.unwrap_or_else(|| self.new_face_vertex(dual, roots)),
        )
    }

    fn new_face_vertex(&self, dual: &DualEdge, roots: [DVec3; 2]) -> DVec3 {
        let face = self.face_of(dual);
        let grid = self.refinement.grid;
        let size = (face.high - face.low).max_element();
        let margin = grid.margin(1e-4, size) * size;
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
                place = face.clamp(place + step * along, margin);
                if step.abs() <= 0.02 * self.refinement.tolerance {
                    break;
                }
            }
        }
        grid.nearest(face.clamp(place, margin))
    }

    fn cut_polygon(&self, polygon: &Polygon, is_bent: &[bool]) -> Cut {
        let vertices = polygon.vertices();
        if polygon.duals().iter().any(|&dual| is_bent[dual as usize]) {
            return Cut::Fan;
        }
        let [inside, outside] = polygon.ends().map(|end| self.refinement.frame.point(end));
        let edge = [inside, outside];
        let p: Vec<DVec3> = vertices
            .iter()
            .map(|&v| self.positions[v as usize])
            .collect();
        if vertices.len() == 3 {
            return if pierces(edge, [p[0], p[1], p[2]]) {
                Cut::Whole
            } else {
                Cut::Fan
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
        let mut diagonals = [first, 1 - first].into_iter();
        diagonals
            .find(|&i| allows(i))
            .map_or(Cut::Fan, Cut::Diagonal)
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

    /// The point of the face that is nearest to `p`, some way from its border.
    fn clamp(&self, p: DVec3, margin: f64) -> DVec3 {
        let mut margin = DVec3::splat(margin);
        margin[self.axis] = 0.0;
        p.clamp(self.low + margin, self.high - margin)
    }
}
