//! Nodes of the tree.

use crate::domain::Region;
use glam::DVec3;
use std::num::NonZeroU32;

/// State of a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) enum State {
    /// Not examined.
    New,
    /// Outside of the reach.
    Beyond,
    /// The cell lies on one side of the surface.
    Empty { is_inside: bool },
    /// The cell may hold the surface. It has a vertex if its corners have both signs; `inside` has a bit for each corner
    /// inside.
    Full {
        vertex: Option<VertexNumber>,
        inside: u8,
    },
}

/// Index of the vertex of a leaf, counted from 1: with the position itself, nodes would be half as large again.
#[derive(Debug, Clone, Copy)]
pub(crate) struct VertexNumber(NonZeroU32);

/// Data of a node of the tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    /// A triangle close to the cell; for a leaf with a vertex, the one closest to the vertex.
    pub hint: u32,
    pub region: Region,
    /// Signed distance of the triangles from the center of the cell; before the cell is probed, that of its parent.
    pub middle: f64,
    pub state: State,
}

impl VertexNumber {
    pub fn add(vertices: &mut Vec<DVec3>, place: DVec3) -> Self {
        vertices.push(place);
        let count = u32::try_from(vertices.len()).ok();
        Self(
            count
                .and_then(NonZeroU32::new)
                .expect("fewer than 2^32 vertices"),
        )
    }

    pub fn place(self, vertices: &[DVec3]) -> DVec3 {
        vertices[self.0.get() as usize - 1]
    }
}
