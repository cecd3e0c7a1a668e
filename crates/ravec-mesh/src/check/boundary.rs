//! The chains that boundary edges form.

use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::{Adjacency, TriMesh};

/// A chain of boundary edges: the rim of a hole or of a sheet.
///
/// Edges follow one another where they belong to the same fan of triangles, so that holes which touch at a vertex stay
/// apart.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BoundaryLoop {
    /// The number of edges.
    pub edges: u32,
    /// The length.
    pub length: f64,
    /// `true` if the chain has no ends; it may have some where more than two triangles meet at an edge.
    pub closed: bool,
    /// The lowest of its vertices.
    pub vertex: u32,
}

/// The chains of the given edges, each of which has one triangle; the longest first.
pub(super) fn loops(
    mesh: &TriMesh,
    adjacency: &Adjacency,
    boundary: &[u32],
    progress: &Progress,
) -> Result<Vec<BoundaryLoop>, Cancelled> {
    const AT_ONCE: usize = 1 << 14;
    // the ends of boundary edges by vertex
    let mut ends: Vec<(u32, u32)> = Vec::with_capacity(2 * boundary.len());
    for (i, &edge) in (0_u32..).zip(boundary) {
        ends.extend(adjacency.edges()[edge as usize].map(|v| (v, i)));
    }
    progress.check()?;
    ends.par_sort_unstable();
    let mut sets = DisjointSets::new(boundary.len());
    let mut loose = vec![false; boundary.len()];
    for (i, around) in ends.chunk_by(|a, b| a.0 == b.0).enumerate() {
        if i % AT_ONCE == 0 {
            progress.check()?;
        }
        let v = around[0].0;
        let fans = adjacency.fans(v, mesh);
        let mut by_fan: Vec<(u32, u32)> = Vec::with_capacity(around.len());
        for &(_, i) in around {
            let triangle = adjacency.uses(boundary[i as usize])[0].triangle;
            // triangles at a vertex ascend, and that of an edge is at its ends
            if let Ok(at) = adjacency.triangles_at(v).binary_search(&triangle) {
                by_fan.push((fans.of[at], i));
            }
        }
        by_fan.sort_unstable();
        for edges in by_fan.chunk_by(|a, b| a.0 == b.0) {
            for &(_, other) in &edges[1..] {
                sets.join(edges[0].1, other);
            }
            if edges.len() != 2 {
                for &(_, i) in edges {
                    loose[i as usize] = true;
                }
            }
        }
    }
    let (count, of) = sets.numbered();
    let blank = BoundaryLoop {
        edges: 0,
        length: 0.0,
        closed: true,
        vertex: u32::MAX,
    };
    let mut loops = vec![blank; count as usize];
    for (i, &edge) in boundary.iter().enumerate() {
        if i % AT_ONCE == 0 {
            progress.check()?;
        }
        let [a, b] = adjacency.edges()[edge as usize];
        let chain = &mut loops[of[i] as usize];
        let [p, q] = [a, b].map(|v| mesh.positions()[v as usize]);
        chain.edges += 1;
        chain.length += p.distance(q);
        chain.closed &= !loose[i];
        chain.vertex = chain.vertex.min(a);
    }
    progress.check()?;
    loops.par_sort_by(|a, b| b.length.total_cmp(&a.length));
    Ok(loops)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn sheets_that_touch_at_a_vertex_have_a_rim_each() {
        // two squares that share a corner
        let at = |x: f64, y: f64| DVec3::new(x, y, 0.0);
        let positions = vec![
            at(0., 0.),
            at(1., 0.),
            at(1., 1.),
            at(0., 1.),
            at(3., 1.),
            at(3., 3.),
            at(1., 3.),
        ];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [2, 4, 5], [2, 5, 6]];
        let mesh = TriMesh::new(positions, triangles).unwrap();
        let adjacency = Adjacency::new(&mesh);
        let boundary: Vec<u32> = (0..adjacency.edges().len() as u32)
            .filter(|&edge| adjacency.uses(edge).len() == 1)
            .collect();
        let found = loops(&mesh, &adjacency, &boundary, &Progress::none()).unwrap();
        let rim = |length, vertex| BoundaryLoop {
            edges: 4,
            length,
            closed: true,
            vertex,
        };
        assert_eq!(found, [rim(8.0, 2), rim(4.0, 0)]);
    }
}
