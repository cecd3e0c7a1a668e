//! Patches as bytes.

use crate::surface::{Bytes, Edge, Patch, Proof, VertexName};
use bytemuck::cast_slice;
use glam::DVec3;
use ravec_mesh::ErrorSample;
use ravec_octree::Corner;

/// Codes of names.
const SHEET: u32 = 0;
const IN_FACE: u32 = 1;
const ON_EDGE: u32 = 2;

/// Encodes the arrays of a patch: their lengths, and then their numbers as they are in memory.
pub(crate) fn encoded(patch: &Patch) -> Vec<u8> {
    let lengths = [
        patch.positions.len(),
        patch.triangles.len(),
        patch.edges.len(),
        patch.ample.len(),
        patch.leaves.len(),
        patch.proofs.len(),
    ];
    let positions: Vec<[f64; 3]> = patch.positions.iter().map(DVec3::to_array).collect();
    let names: Vec<[u32; 6]> = patch.names.iter().map(|&name| name_row(name)).collect();
    let edge = |edge: &Edge| {
        let [x, y, z] = edge.start.0;
        [x, y, z, edge.length, edge.axis.into()]
    };
    let edges: Vec<[u32; 5]> = patch.edges.iter().map(edge).collect();
    let proofs: Vec<u64> = patch.proofs.iter().map(|&p| Proof::to_bits(p)).collect();
    let ample: Vec<u8> = patch.ample.iter().map(|&is| is.into()).collect();
    [
        cast_slice(&lengths.map(|length| length as u64)),
        cast_slice(&positions),
        cast_slice(&names),
        cast_slice(&patch.triangles),
        cast_slice(&patch.edge_of),
        cast_slice(&edges),
        cast_slice(&patch.leaves),
        cast_slice(&proofs),
        &ample,
    ]
    .concat()
}

/// Encodes error samples: places, and then triangles.
pub(crate) fn encoded_samples(samples: &[ErrorSample]) -> Vec<u8> {
    let places: Vec<[f64; 3]> = samples
        .iter()
        .map(|sample| sample.place.to_array())
        .collect();
    let triangles: Vec<u32> = samples.iter().map(|sample| sample.triangle).collect();
    [cast_slice::<_, u8>(&places), cast_slice(&triangles)].concat()
}

pub(super) fn decoded_samples(bytes: &[u8]) -> Option<Vec<ErrorSample>> {
    let count = (bytes.len() / (3 * size_of::<f64>() + size_of::<u32>())) as u64;
    let mut bytes = Bytes(bytes);
    let places: Vec<[f64; 3]> = bytes.take(count)?;
    let triangles: Vec<u32> = bytes.take(count)?;
    let samples = places.into_iter().zip(triangles);
    let samples = samples.map(|(place, triangle)| ErrorSample {
        place: place.into(),
        triangle,
    });
    bytes.0.is_empty().then(|| samples.collect())
}

pub(super) fn decoded(bytes: &[u8]) -> Option<Patch> {
    let mut bytes = Bytes(bytes);
    let lengths: Vec<u64> = bytes.take(6)?;
    let lengths: [u64; 6] = lengths.try_into().ok()?;
    let [vertices, triangles, edges, ample, leaves, proofs] = lengths;
    let positions: Vec<[f64; 3]> = bytes.take(vertices)?;
    let names: Vec<[u32; 6]> = bytes.take(vertices)?;
    let triangles_of: Vec<[u32; 3]> = bytes.take(triangles)?;
    let edge_of: Vec<u32> = bytes.take(triangles)?;
    let edges: Vec<[u32; 5]> = bytes.take(edges)?;
    let leaves = bytes.take(leaves)?;
    let proofs: Vec<u64> = bytes.take(proofs)?;
    let ample: Vec<u8> = bytes.take(ample)?;
    let edges = edges.into_iter().map(|[x, y, z, length, axis]| Edge {
        start: Corner([x, y, z]),
        length,
        axis: axis as u8,
    });
    Some(Patch {
        positions: positions.into_iter().map(DVec3::from).collect(),
        names: names.into_iter().map(named).collect::<Option<_>>()?,
        triangles: triangles_of,
        edge_of,
        edges: edges.collect(),
        ample: ample.into_iter().map(|is| is != 0).collect(),
        leaves,
        proofs: proofs.into_iter().map(Proof::from_bits).collect(),
    })
}

fn name_row(name: VertexName) -> [u32; 6] {
    let row = |kind, at: Corner, a, b| [kind, at.0[0], at.0[1], at.0[2], a, b];
    match name {
        VertexName::Sheet { leaf, number } => row(SHEET, leaf, number, 0),
        VertexName::InFace { start, axis, side } => row(IN_FACE, start, axis.into(), side.into()),
        VertexName::OnEdge { start, axis } => row(ON_EDGE, start, axis.into(), 0),
    }
}

fn named([kind, x, y, z, a, b]: [u32; 6]) -> Option<VertexName> {
    let start = Corner([x, y, z]);
    match kind {
        SHEET => Some(VertexName::Sheet {
            leaf: start,
            number: a,
        }),
        IN_FACE => Some(VertexName::InFace {
            start,
            axis: a as u8,
            side: b as u8,
        }),
        ON_EDGE => Some(VertexName::OnEdge {
            start,
            axis: a as u8,
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Scratch, Store, in_memory};

    fn patch() -> Patch {
        let start = Corner([1, 1 << 20, 77]);
        Patch {
            positions: vec![DVec3::new(0.1, -2.0, 3e40), DVec3::X, DVec3::Y, DVec3::Z],
            names: vec![
                VertexName::Sheet {
                    leaf: start,
                    number: 3,
                },
                VertexName::InFace {
                    start,
                    axis: 2,
                    side: 1,
                },
                VertexName::OnEdge { start, axis: 1 },
                VertexName::OnEdge { start, axis: 0 },
            ],
            triangles: vec![[0, 1, 2], [2, 1, 3]],
            edge_of: vec![0, 1],
            edges: [4, 8]
                .map(|length| Edge {
                    start,
                    length,
                    axis: 2,
                })
                .to_vec(),
            ample: vec![true, false],
            leaves: vec![],
            proofs: vec![],
        }
    }

    #[test]
    fn patches_are_read_as_they_were_written() {
        let store = Store::Storage(Scratch::new(&in_memory).unwrap());
        let first = store.put(patch()).unwrap();
        let none = store.put(Patch::default()).unwrap();
        let other = || Patch {
            ample: vec![],
            leaves: vec![[1, 2, 3, 4], [5, 6, 7, u32::MAX]],
            proofs: vec![Proof::from_bits(77), None],
            ..patch()
        };
        let second = store.put(other()).unwrap();
        assert_eq!(*store.get(&first).unwrap(), patch());
        assert_eq!(*store.get(&none).unwrap(), Patch::default());
        assert_eq!(*store.get(&second).unwrap(), other());
    }

    #[test]
    fn samples_are_read_as_they_were_written() {
        let sample = |at: f64, triangle| ErrorSample {
            place: DVec3::new(at, -2.0 * at, 1e-9),
            triangle,
        };
        for samples in [
            vec![],
            vec![sample(0.1, 7)],
            vec![sample(3e7, 0), sample(-1.0, u32::MAX)],
        ] {
            let bytes = encoded_samples(&samples);
            assert_eq!(decoded_samples(&bytes), Some(samples));
            assert_eq!(decoded_samples(&[&bytes[..], &[0]].concat()), None);
        }
    }

    #[test]
    fn bytes_that_are_no_patch_are_refused() {
        let bytes = encoded(&patch());
        for cut in 0..bytes.len() {
            assert!(decoded(&bytes[..cut]).is_none(), "{cut} bytes");
        }
        let mut bytes = bytes;
        bytes[..8].fill(255);
        assert!(decoded(&bytes).is_none());
    }
}
