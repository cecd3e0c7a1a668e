//! Adjacency: the triangles that meet at each edge and vertex.
//!
//! Works on indices alone: vertices are the same if they have the same index, wherever they are. Any soup will do; an
//! edge may have any number of triangles. A triangle that names a vertex twice has no place here: it has no edges, and
//! the two neighbors at its sides become neighbors of each other, as they would if it were taken out.
//!
//! Guarantees: edges ascend by their lower vertex, then by the higher one; the triangles of an edge or vertex ascend.
//! Cost: O(n) plus sorting within each vertex; 36 bytes a triangle and 12 bytes an edge and vertex.

use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};

use crate::TriMesh;
use crate::par_collect::par_collect;

/// Number of triangles or vertices that are processed between two checks for cancellation: some milliseconds.
const AT_ONCE: usize = 1 << 16;

/// Stands for "no edge" in the table of the triangles' sides.
const NONE: u32 = u32::MAX;

/// One triangle at an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct EdgeUse {
    /// The triangle.
    pub triangle: u32,
    /// Side of the triangle that the edge is: from corner 0, 1 or 2 to the next one.
    pub side: u8,
    /// `true` if that side runs from the lower to the higher vertex of the edge. Of two well oriented neighbors one
    /// does and the other does not.
    pub forward: bool,
}

/// The edges of a mesh, with their triangles, and the triangles at its vertices.
#[derive(Debug, Clone)]
pub struct Adjacency {
    edges: Vec<[u32; 2]>,
    /// Index of the first use of each edge, and the number of uses.
    first_use: Vec<u32>,
    uses: Vec<EdgeUse>,
    edge_of: Vec<[u32; 3]>,
    /// Index of the first edge whose lower vertex is this one, for each vertex, and the number of edges.
    first_edge: Vec<u32>,
    /// Index of the first triangle of each vertex, and their number.
    first_triangle: Vec<u32>,
    triangles: Vec<u32>,
}

/// The connected components of a mesh.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Components {
    /// The number of parts.
    pub count: u32,
    /// The part of each triangle, numbered in the order of their first triangles.
    pub of_triangle: Vec<u32>,
}

/// Sums counts in place, so that entry `i` is where the items of `i` begin. The last entry must be free.
fn counts_to_starts(counts: &mut [u32]) {
    let mut sum = 0;
    for count in counts {
        sum += std::mem::replace(count, sum);
    }
}

/// Returns `true` if a triangle names three vertices.
#[inline]
pub(crate) fn is_proper([a, b, c]: [u32; 3]) -> bool {
    a != b && b != c && c != a
}

impl Adjacency {
    /// The adjacency of `mesh`.
    ///
    /// # Panics
    /// If the mesh has more than 1 431 655 765 triangles, whose sides 32 bits cannot count.
    pub fn new(mesh: &TriMesh) -> Self {
        Self::try_new(mesh, &Progress::none()).expect("nobody can cancel it")
    }

    /// As [`Self::new`], for meshes of which that takes more than a moment.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn try_new(mesh: &TriMesh, progress: &Progress) -> Result<Self, Cancelled> {
        let (vertices, corners) = (mesh.positions().len(), mesh.triangles());
        assert!(
            corners.len() <= (u32::MAX / 3) as usize,
            "too many sides to be counted"
        );
        let proper = || (0_usize..).zip(corners).filter(|(_, t)| is_proper(**t));
        let check = |i: usize| match i % AT_ONCE {
            0 => progress.check(),
            _ => Ok(()),
        };
        // Twice the same linear sort: count, sum up, put in place.
        let mut first_triangle = vec![0_u32; vertices + 1];
        let mut first_side = vec![0_u32; vertices + 1];
        for (triangle, t) in proper() {
            check(triangle)?;
            for i in 0..3 {
                first_triangle[t[i] as usize] += 1;
                first_side[t[i].min(t[(i + 1) % 3]) as usize] += 1;
            }
        }
        counts_to_starts(&mut first_triangle);
        counts_to_starts(&mut first_side);
        let sides = first_side[vertices] as usize;
        let mut triangles = vec![0; sides];
        let blank = EdgeUse {
            triangle: 0,
            side: 0,
            forward: false,
        };
        let mut by_low: Vec<(u32, EdgeUse)> = vec![(0, blank); sides];
        let (mut next_triangle, mut next_side) = (first_triangle.clone(), first_side.clone());
        for (triangle, t) in proper() {
            check(triangle)?;
            let triangle = triangle as u32;
            for side in 0..3_u8 {
                let (from, to) = (t[side as usize], t[(side as usize + 1) % 3]);
                let at = &mut next_triangle[from as usize];
                triangles[*at as usize] = triangle;
                *at += 1;
                let at = &mut next_side[from.min(to) as usize];
                let forward = from < to;
                let edge_use = EdgeUse {
                    triangle,
                    side,
                    forward,
                };
                by_low[*at as usize] = (from.max(to), edge_use);
                *at += 1;
            }
        }
        drop((next_triangle, next_side));
        let mut edges = Vec::with_capacity(sides / 2 + 1);
        let mut first_use = Vec::with_capacity(sides / 2 + 2);
        let mut first_edge = Vec::with_capacity(vertices + 1);
        let mut edge_of = vec![[NONE; 3]; corners.len()];
        for low in 0..vertices {
            check(low)?;
            first_edge.push(edges.len() as u32);
            let range = first_side[low] as usize..first_side[low + 1] as usize;
            let start = range.start;
            let sides = &mut by_low[range];
            sides.sort_unstable();
            for (i, &(high, edge_use)) in sides.iter().enumerate() {
                if i == 0 || sides[i - 1].0 != high {
                    edges.push([low as u32, high]);
                    first_use.push((start + i) as u32);
                }
                edge_of[edge_use.triangle as usize][edge_use.side as usize] =
                    edges.len() as u32 - 1;
            }
        }
        first_edge.push(edges.len() as u32);
        first_use.push(sides as u32);
        let mut uses = Vec::with_capacity(sides);
        for block in by_low.chunks(AT_ONCE) {
            progress.check()?;
            uses.extend(block.iter().map(|&(_, edge_use)| edge_use));
        }
        Ok(Self {
            edges,
            first_use,
            uses,
            edge_of,
            first_edge,
            first_triangle,
            triangles,
        })
    }

    /// All edges, each with its lower vertex first, in ascending order. An edge is named by its place in this list.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// The triangles at `edge`.
    ///
    /// # Panics
    /// If there is no such edge.
    #[inline]
    pub fn uses(&self, edge: u32) -> &[EdgeUse] {
        let edge = edge as usize;
        &self.uses[self.first_use[edge] as usize..self.first_use[edge + 1] as usize]
    }

    /// The edge from corner `side` of `triangle` to the next; `None` if the triangle names a vertex twice.
    ///
    /// # Panics
    /// If there is no such triangle or side.
    #[inline]
    pub fn edge_of(&self, triangle: u32, side: u8) -> Option<u32> {
        let edge = self.edge_of[triangle as usize][side as usize];
        (edge != NONE).then_some(edge)
    }

    /// The edge between two vertices, in either order, if there is one. O(log of the edges at the lower vertex).
    pub fn edge_between(&self, a: u32, b: u32) -> Option<u32> {
        let (low, high) = (a.min(b) as usize, a.max(b));
        let start = *self.first_edge.get(low)?;
        let end = *self.first_edge.get(low + 1)?;
        let edges = &self.edges[start as usize..end as usize];
        let at = edges.binary_search_by_key(&high, |edge| edge[1]).ok()?;
        Some(start + at as u32)
    }

    /// The triangles at vertex `v`.
    ///
    /// # Panics
    /// If there is no such vertex.
    #[inline]
    pub fn triangles_at(&self, v: u32) -> &[u32] {
        let v = v as usize;
        &self.triangles[self.first_triangle[v] as usize..self.first_triangle[v + 1] as usize]
    }

    /// The fan of each triangle at vertex `v`, as in [`Self::triangles_at`]: triangles are in one fan if one can be
    /// reached from the other across edges at `v`. Fans are numbered from 0; a manifold vertex has one.
    pub fn fans(&self, v: u32, mesh: &TriMesh) -> Fans {
        let around = self.triangles_at(v);
        // the other end of each edge at `v`, with the triangle that has it
        let mut spokes: Vec<(u32, u32)> = Vec::with_capacity(2 * around.len());
        for (i, &t) in around.iter().enumerate() {
            let others = mesh.triangles()[t as usize].into_iter().filter(|&w| w != v);
            spokes.extend(others.map(|w| (w, i as u32)));
        }
        spokes.sort_unstable();
        let mut sets = DisjointSets::new(around.len());
        for pair in spokes.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
            sets.join(pair[0].1, pair[1].1);
        }
        let (count, of) = sets.numbered();
        Fans { count, of }
    }

    /// The parts of the mesh: two triangles are in one part if one can be reached from the other through vertices that
    /// triangles have in common.
    #[expect(clippy::missing_panics_doc, reason = "nobody cancels")]
    pub fn components(&self, mesh: &TriMesh) -> Components {
        let found = self.try_components(mesh, &Progress::none());
        found.expect("nobody can cancel it")
    }

    /// As [`Self::components`], for meshes of which that takes more than a moment.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn try_components(
        &self,
        mesh: &TriMesh,
        progress: &Progress,
    ) -> Result<Components, Cancelled> {
        let mut sets = DisjointSets::new(mesh.positions().len());
        for block in mesh.triangles().chunks(AT_ONCE) {
            progress.check()?;
            for &[a, b, c] in block {
                sets.join(a, b);
                sets.join(b, c);
            }
        }
        let mut number = vec![NONE; mesh.positions().len()];
        let mut count = 0;
        let mut of_triangle = Vec::with_capacity(mesh.triangles().len());
        for block in mesh.triangles().chunks(AT_ONCE) {
            progress.check()?;
            of_triangle.extend(block.iter().map(|t| {
                let number = &mut number[sets.root(t[0]) as usize];
                if *number == NONE {
                    *number = count;
                    count += 1;
                }
                *number
            }));
        }
        Ok(Components { count, of_triangle })
    }

    /// As [`Self::components`], but parts that meet in single vertices are apart: two triangles are in one part if one
    /// can be reached from the other across edges. A triangle that names a vertex twice is a part of its own.
    pub fn patches(&self, mesh: &TriMesh) -> Components {
        let mut sets = DisjointSets::new(mesh.triangles().len());
        for edge in 0..self.edges.len() as u32 {
            let uses = self.uses(edge);
            for other in &uses[1..] {
                sets.join(uses[0].triangle, other.triangle);
            }
        }
        let (count, of_triangle) = sets.numbered();
        Components { count, of_triangle }
    }

    /// The vertices at which triangles form more than one fan, ascending.
    #[expect(clippy::missing_panics_doc, reason = "nobody cancels")]
    pub fn pinched_vertices(&self, mesh: &TriMesh) -> Vec<u32> {
        let found = self.try_pinched_vertices(mesh, &Progress::none());
        found.expect("nobody can cancel it")
    }

    /// As [`Self::pinched_vertices`], for meshes of which that takes more than a moment.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn try_pinched_vertices(
        &self,
        mesh: &TriMesh,
        progress: &Progress,
    ) -> Result<Vec<u32>, Cancelled> {
        par_collect(mesh.positions().len(), progress, |v| {
            (self.fans(v, mesh).count > 1).then_some(v)
        })
    }
}

/// The fans at one vertex.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fans {
    /// The number of fans.
    pub count: u32,
    /// The fan of each triangle at the vertex, in the order of [`Adjacency::triangles_at`].
    pub of: Vec<u32>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use proptest::prelude::*;

    fn mesh(vertices: usize, triangles: Vec<[u32; 3]>) -> TriMesh {
        TriMesh::new(vec![DVec3::ZERO; vertices], triangles).unwrap()
    }

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    #[test]
    fn each_edge_of_a_tetrahedron_has_one_triangle_in_each_direction() {
        let mesh = mesh(4, TETRAHEDRON.to_vec());
        let found = Adjacency::new(&mesh);
        assert_eq!(found.edges().len(), 6);
        for edge in 0..6 {
            let uses = found.uses(edge);
            assert_eq!(uses.len(), 2);
            assert_ne!(uses[0].forward, uses[1].forward);
        }
        assert!(found.pinched_vertices(&mesh).is_empty());
        assert_eq!(found.components(&mesh).count, 1);
    }

    #[test]
    fn two_tetrahedra_at_one_vertex_pinch_it_and_are_two_patches_of_one_part() {
        let other = TETRAHEDRON.map(|t| t.map(|v| if v == 0 { 0 } else { v + 3 }));
        let mesh = mesh(7, [TETRAHEDRON, other].concat());
        let found = Adjacency::new(&mesh);
        assert_eq!(found.pinched_vertices(&mesh), [0]);
        assert_eq!(found.fans(0, &mesh).of, [0, 0, 0, 1, 1, 1]);
        assert_eq!(found.components(&mesh).of_triangle, [0; 8]);
        let patches = found.patches(&mesh);
        assert_eq!(patches.of_triangle, [0, 0, 0, 0, 1, 1, 1, 1]);
    }

    #[test]
    fn a_triangle_that_names_a_vertex_twice_has_no_edges() {
        let mesh = mesh(4, vec![[0, 1, 2], [0, 1, 1], [1, 0, 3]]);
        let found = Adjacency::new(&mesh);
        assert_eq!(found.edge_of(1, 0), None);
        let shared = found.edge_between(1, 0).unwrap();
        let triangles: Vec<u32> = found.uses(shared).iter().map(|u| u.triangle).collect();
        assert_eq!(triangles, [0, 2]);
        assert_eq!(found.components(&mesh).of_triangle, [0, 0, 0]);
    }

    proptest! {
        #[test]
        fn tables_agree_with_scans(triangles in prop::collection::vec(prop::array::uniform3(0_u32..8), 0..30)) {
            let mesh = mesh(8, triangles.clone());
            let found = Adjacency::new(&mesh);
            prop_assert!(found.edges().is_sorted());
            for a in 0..8 {
                let at: Vec<u32> = (0_u32..).zip(&triangles)
                    .filter(|(_, t)| is_proper(**t) && t.contains(&a)).map(|(i, _)| i).collect();
                prop_assert_eq!(found.triangles_at(a), &at[..]);
                for b in a + 1..8 {
                    let at: Vec<EdgeUse> = (0_u32..).zip(&triangles).filter(|(_, t)| is_proper(**t)).flat_map(|(i, t)| {
                        (0..3_u8).filter_map(move |side| {
                            let (from, to) = (t[side as usize], t[(side as usize + 1) % 3]);
                            let this = (from.min(to), from.max(to)) == (a, b);
                            this.then_some(EdgeUse { triangle: i, side, forward: from < to })
                        })
                    }).collect();
                    match found.edge_between(b, a) {
                        Some(edge) => {
                            prop_assert_eq!(found.uses(edge), &at[..]);
                            prop_assert_eq!(found.edges()[edge as usize], [a, b]);
                            for u in &at {
                                prop_assert_eq!(found.edge_of(u.triangle, u.side), Some(edge));
                            }
                        }
                        None => prop_assert!(at.is_empty()),
                    }
                }
            }
        }
    }
}
