//! Polygons are cut into triangles that do not intersect.

use super::{CrossingCache, Extracted, Face, Selection};
use crate::grow::Refinement;
use crate::surface::{TRIANGLES_AT_ONCE, VertexName};
use glam::DVec3;
use ravec_mesh::{Sign, orient3d};
use ravec_octree::{Contour, DualEdge, NodeId, Polygon};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::{FxBuildHasher, FxHashSet};
use std::hash::BuildHasher as _;

/// Triangles without the contour that they come from.
pub(super) struct CutPolygons {
    positions: Vec<DVec3>,
    added: Vec<VertexName>,
    triangles: Vec<[u32; 3]>,
    polygon_of: Vec<u32>,
}

impl CutPolygons {
    pub fn with(self, contour: Contour) -> Extracted {
        Extracted {
            positions: self.positions,
            added: self.added,
            triangles: self.triangles,
            polygon_of: self.polygon_of,
            contour,
        }
    }
}

/// Cuts polygons into triangles.
pub(super) struct Cutter<'a> {
    refinement: &'a Refinement<'a>,
    selection: &'a Selection,
    contour: &'a Contour,
    positions: Vec<DVec3>,
    added: Vec<VertexName>,
}

/// Triangulation of a polygon.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Cut {
    /// Its surroundings are not known.
    Unknown,
    /// The polygon is a triangle.
    Whole,
    /// Along the diagonal from the first or the second corner.
    Diagonal(usize),
    /// Around a vertex on its edge.
    Fan,
}

impl<'a> Cutter<'a> {
    /// Creates a cutter; `positions` are those of the contour's vertices.
    pub fn new(
        refinement: &'a Refinement<'a>,
        selection: &'a Selection,
        contour: &'a Contour,
        positions: Vec<DVec3>,
    ) -> Self {
        Self {
            refinement,
            selection,
            contour,
            positions,
            added: Vec::new(),
        }
    }

    pub fn cut(
        mut self,
        places: &mut CrossingCache,
        progress: &Progress,
    ) -> Result<CutPolygons, Cancelled> {
        let contour = self.contour;
        let is_core = |cells: &[NodeId]| {
            let mut cells = cells.iter();
            cells.all(|&cell| self.selection.is_core(self.refinement, cell))
        };
        let is_bent: Vec<bool> = contour
            .duals
            .par_iter()
            .map(|dual| {
                progress.check()?;
                Ok(is_core(&dual.cells) && self.is_bent(dual))
            })
            .collect::<Result<_, Cancelled>>()?;
        let cuts = self.cuts(&is_bent, progress)?;
        let polygons = contour.polygons.par_iter().zip(&cuts);
        let fans = polygons.filter(|(polygon, cut)| {
            let mut duals = polygon.duals().iter();
            **cut == Cut::Fan || duals.any(|&dual| is_bent.get(dual as usize) == Some(&true))
        });
        places.fill(self.refinement, fans.map(|(polygon, _)| polygon), progress)?;
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
        self.triangulated(cuts, &face_numbers, places, progress)
    }

    /// Chooses the triangulation of each polygon.
    fn cuts(&self, is_bent: &[bool], progress: &Progress) -> Result<Vec<Cut>, Cancelled> {
        let contour = self.contour;
        let is_core = |cells: &[NodeId]| {
            let mut cells = cells.iter();
            cells.all(|&cell| self.selection.is_core(self.refinement, cell))
        };
        let mut cuts: Vec<Cut> = contour
            .polygons
            .par_iter()
            .map(|polygon| {
                progress.check()?;
                Ok(if is_core(polygon.cells()) {
                    self.cut_polygon(polygon, is_bent)
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
        Ok(cuts)
    }

    /// Triangulates all polygons; `face_numbers` are the vertices in faces, by dual edge.
    fn triangulated(
        mut self,
        cuts: Vec<Cut>,
        face_numbers: &[Option<u32>],
        places: &CrossingCache,
        progress: &Progress,
    ) -> Result<CutPolygons, Cancelled> {
        let contour = self.contour;
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
        Ok(CutPolygons {
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

    /// Names a vertex in a face after the first of the two polygons.
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
        Face::between(keys, &self.refinement.setting.frame)
    }

    /// Returns whether a dual edge needs a vertex in its minimal face: the segment does not pass through the face, or another
    /// dual edge does.
    fn is_bent(&self, dual: &DualEdge) -> bool {
        let ends = dual.vertices.map(|vertex| self.positions[vertex as usize]);
        dual.is_ambiguous || !self.face_of(dual).is_crossed(ends)
    }

    /// Returns the vertex in the minimal face of a dual edge, and a hash of its inputs.
    fn face_vertex(&self, dual: &DualEdge, places: &CrossingCache) -> (u64, DVec3) {
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
        let grid = self.refinement.setting.grid;
        let size = (face.high - face.low).max_element();
        let margin = grid.margin(1e-4, size) * size;
        let mut place = 0.5 * (roots[0] + roots[1]);
        if !dual.is_ambiguous {
            // onto the surface, without leaving the face
            let field = self.refinement.setting.field;
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
                if step.abs() <= 0.02 * self.refinement.setting.tolerance {
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
        let [inside, outside] = polygon
            .ends()
            .map(|end| self.refinement.setting.frame.point(end));
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

/// Returns whether a segment passes through the interior of a triangle, exactly.
fn pierces([from, to]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let around = [(a, b), (b, c), (c, a)].map(|(p, q)| orient3d(from, to, p, q));
    let same = around[0] != Sign::Zero && around.iter().all(|&sign| sign == around[0]);
    if !same {
        return false;
    }
    let [below, above] = [from, to].map(|end| orient3d(a, b, c, end));
    below != Sign::Zero && above != Sign::Zero && below != above
}
