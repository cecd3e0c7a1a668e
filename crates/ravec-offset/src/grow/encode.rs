//! Trees as bytes.

use super::{CornerValue, Node, Refinement, Setting, State, VertexNumber};
use crate::domain::Region;
use crate::surface::{Bytes, Reach};
use bytemuck::cast_slice;
use glam::DVec3;
use ravec_octree::{CellKey, Corner, MAX_LEVEL, Octree};

/// Codes of states.
const NEW: u8 = 0;
const BEYOND: u8 = 1;
const EMPTY: u8 = 2;
const FULL: u8 = 3;
const FULL_WITH_VERTEX: u8 = 4;

impl<'a> Refinement<'a> {
    /// Encodes the tree and its data.
    pub fn to_bytes(&self) -> Vec<u8> {
        let nodes = 0..self.tree.len() as u32;
        let node = |node| self.tree.data(node);
        let links: Vec<[u32; 2]> = (nodes.clone())
            .map(|at| [self.tree.first_child(at), node(at).hint])
            .collect();
        let flags: Vec<[u8; 4]> = nodes.clone().map(|at| flags(node(at))).collect();
        let middles: Vec<f64> = nodes.clone().map(|at| node(at).middle).collect();
        let vertices: Vec<[f64; 3]> = nodes
            .filter_map(|at| self.leaf_vertex(at))
            .map(|vertex| vertex.to_array())
            .collect();
        let (places, values): (Vec<[u64; 2]>, Vec<f64>) = (self.corners.iter())
            .map(|(&code, corner)| ([code, corner.triangle.into()], corner.value))
            .unzip();
        let filled: Vec<[u32; 3]> = self.filled.iter().map(|corner| corner.0).collect();
        let reach: Vec<[u32; 4]> = (self.reach.leaves().into_iter())
            .map(|CellKey { at, level }| [at.0[0], at.0[1], at.0[2], level.into()])
            .collect();
        let lengths = [
            links.len(),
            vertices.len(),
            places.len(),
            filled.len(),
            reach.len(),
        ];
        [
            cast_slice(&lengths.map(|length| length as u64)),
            cast_slice(&reach),
            cast_slice(&links),
            cast_slice(&flags),
            cast_slice(&middles),
            cast_slice(&vertices),
            cast_slice(&places),
            cast_slice(&values),
            cast_slice(&filled),
        ]
        .concat()
    }

    /// Decodes the bytes of [`Self::to_bytes`] for the same setting and tile; returns `None` for other bytes.
    pub fn from_bytes(
        setting: Setting<'a>,
        tile: CellKey,
        max_nodes: usize,
        bytes: &mut Bytes<'_>,
    ) -> Option<Self> {
        let lengths: Vec<u64> = bytes.take(5)?;
        let [nodes, vertices, corners, filled, leaves] = [0, 1, 2, 3, 4].map(|i| lengths[i]);
        let mut reach = Reach::of(tile);
        for [x, y, z, level] in bytes.take::<[u32; 4]>(leaves)? {
            let at = Corner([x, y, z]);
            let level = u8::try_from(level)
                .ok()
                .filter(|&level| level <= MAX_LEVEL)?;
            reach.include(CellKey { at, level });
        }
        let links: Vec<[u32; 2]> = bytes.take(nodes)?;
        let flags: Vec<[u8; 4]> = bytes.take(nodes)?;
        let middles: Vec<f64> = bytes.take(nodes)?;
        let vertices: Vec<[f64; 3]> = bytes.take(vertices)?;
        let places: Vec<[u64; 2]> = bytes.take(corners)?;
        let values: Vec<f64> = bytes.take(corners)?;
        let filled: Vec<[u32; 3]> = bytes.take(filled)?;
        let mut given = vertices.into_iter().map(DVec3::from);
        let mut vertices = Vec::with_capacity(given.len());
        let rows = links.into_iter().zip(flags).zip(middles);
        let rows = rows.map(|(([first_child, hint], flags), middle)| {
            let node = Node {
                hint,
                region: region(flags[0])?,
                middle,
                state: state(flags, || {
                    Some(VertexNumber::add(&mut vertices, given.next()?))
                })?,
            };
            Some((first_child, node))
        });
        let tree = Octree::from_nodes(rows.collect::<Option<_>>()?)?;
        let corners = places.into_iter().zip(values);
        let corners = corners.map(|([code, triangle], value)| {
            let triangle = triangle as u32;
            (code, CornerValue { triangle, value })
        });
        Some(Self {
            setting,
            floor: setting.floor(),
            tree,
            vertices,
            corners: corners.collect(),
            filled: filled.into_iter().map(Corner).collect(),
            reach,
            max_nodes,
        })
    }
}

fn flags(node: &Node) -> [u8; 4] {
    let region = match node.region {
        Region::Unknown => 0,
        Region::Outside => 1,
        Region::Inside => 2,
    };
    let [kind, inside] = match node.state {
        State::New => [NEW, 0],
        State::Beyond => [BEYOND, 0],
        State::Empty { is_inside } => [EMPTY, is_inside.into()],
        State::Full {
            vertex: None,
            inside,
        } => [FULL, inside],
        State::Full {
            vertex: Some(_),
            inside,
        } => [FULL_WITH_VERTEX, inside],
    };
    [region, kind, inside, 0]
}

fn region(flag: u8) -> Option<Region> {
    match flag {
        0 => Some(Region::Unknown),
        1 => Some(Region::Outside),
        2 => Some(Region::Inside),
        _ => None,
    }
}

fn state(
    [_, kind, inside, _]: [u8; 4],
    vertex: impl FnOnce() -> Option<VertexNumber>,
) -> Option<State> {
    match kind {
        NEW => Some(State::New),
        BEYOND => Some(State::Beyond),
        EMPTY => Some(State::Empty {
            is_inside: inside != 0,
        }),
        FULL => Some(State::Full {
            vertex: None,
            inside,
        }),
        FULL_WITH_VERTEX => Some(State::Full {
            vertex: Some(vertex()?),
            inside,
        }),
        _ => None,
    }
}
