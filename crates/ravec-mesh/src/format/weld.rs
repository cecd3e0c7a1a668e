//! Vertices at the same place made one.
//!
//! STL and other triangle lists repeat each vertex in every triangle around it; welding finds the connections again.
//! Exactly equal places are found by a hash table of indices with open addressing, places within a tolerance by a hash
//! of grid cells as wide as the tolerance.
//!
//! Guarantees: triangles stay in their order and none is dropped, so that data that go with them stay aligned; the first
//! vertex of each place, in the order of the input, is the one that stays; −0 equals 0. With a tolerance no vertex moves
//! farther than it, and those that stay are farther than it from one another. Does not guarantee: that a chain of
//! vertices, each near the next, becomes one. Cost: O(vertices), about 50 ns each.

use glam::DVec3;
use rustc_hash::FxHashMap;

use crate::TriMesh;

/// A mesh whose vertices were welded.
#[derive(Debug, Clone, PartialEq)]
pub struct Welded {
    /// The mesh. Vertices that no triangle uses are kept as well.
    pub mesh: TriMesh,
    /// How many vertices became one with an earlier one.
    pub merged: usize,
    /// How many triangles lost a corner thereby: two of their corners are the same vertex now and were not before.
    pub collapsed: usize,
}

/// Makes vertices of `mesh` one that lie at the same place, or within `tolerance` of it.
///
/// `tolerance` is a length in units of the mesh; 0 (and anything that is not a positive number) welds vertices at
/// exactly equal places only. More closes wider cracks and collapses small triangles.
#[expect(clippy::missing_panics_doc, reason = "the parts of a mesh make a mesh")]
pub fn weld(mesh: &TriMesh, tolerance: f64) -> Welded {
    let positions = mesh.positions();
    let (kept, new_from_old) = if tolerance > 0.0 && tolerance.is_finite() {
        within(positions, tolerance)
    } else {
        let mut places = Places::<[u64; 3]>::default();
        let new_from_old = positions.iter().map(|&at| places.index_of(bits(at)));
        let new_from_old: Vec<u32> = new_from_old.collect();
        let kept = places
            .keys
            .into_iter()
            .map(|key| DVec3::from_array(key.map(f64::from_bits)));
        (kept.collect(), new_from_old)
    };
    let merged = positions.len() - kept.len();
    let mut collapsed = 0;
    let corners_differ = |t: [u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    let triangles = mesh.triangles().iter().map(|&old| {
        let new = old.map(|v| new_from_old[v as usize]);
        collapsed += usize::from(corners_differ(old) && !corners_differ(new));
        new
    });
    let triangles = triangles.collect();
    let mesh = TriMesh::new(kept, triangles).expect("the vertices are some of a mesh's vertices");
    Welded {
        mesh,
        merged,
        collapsed,
    }
}

/// The bits of a place, the same for 0 and −0.
pub(super) fn bits(at: DVec3) -> [u64; 3] {
    at.to_array().map(|x| (x + 0.0).to_bits())
}

fn within(positions: &[DVec3], tolerance: f64) -> (Vec<DVec3>, Vec<u32>) {
    const NONE: u32 = u32::MAX;
    let mut kept: Vec<DVec3> = Vec::new();
    // Vertices of one cell are chained from the last to the first.
    let mut last_in_cell: FxHashMap<[u64; 3], u32> = FxHashMap::default();
    let mut earlier_in_cell: Vec<u32> = Vec::new();
    let new_from_old = positions.iter().map(|&at| {
        let cell = (at / tolerance).floor();
        let mut found = NONE;
        for step in 0..27 {
            let step = DVec3::new(
                f64::from(step % 3),
                f64::from(step / 3 % 3),
                f64::from(step / 9),
            );
            let Some(&last) = last_in_cell.get(&bits(cell + step - 1.0)) else {
                continue;
            };
            let mut candidate = last;
            while candidate != NONE {
                if candidate < found && kept[candidate as usize].distance(at) <= tolerance {
                    found = candidate;
                }
                candidate = earlier_in_cell[candidate as usize];
            }
        }
        if found == NONE {
            found = kept.len() as u32;
            kept.push(at);
            let last = last_in_cell.insert(bits(cell), found);
            earlier_in_cell.push(last.unwrap_or(NONE));
        }
        found
    });
    let new_from_old = new_from_old.collect();
    (kept, new_from_old)
}

/// A place as bits that can be hashed.
pub(super) trait Key: Copy + Eq {
    fn hash(self) -> u64;
}

/// An odd constant with well-spread bits (that of Fibonacci hashing).
const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;

fn mixed(words: [u64; 3]) -> u64 {
    let hash = words.into_iter().fold(0_u64, |hash, word| {
        (hash.rotate_left(23) ^ word).wrapping_mul(SPREAD)
    });
    hash ^ (hash >> 32)
}

impl Key for [u32; 3] {
    #[inline]
    fn hash(self) -> u64 {
        mixed(self.map(u64::from))
    }
}

impl Key for [u64; 3] {
    #[inline]
    fn hash(self) -> u64 {
        mixed(self)
    }
}

/// Distinct places in the order of their first appearance.
///
/// A slot holds the index of a key in its low half and a part of the key's hash in its high half, so that most probes
/// need not look at the keys.
pub(super) struct Places<K> {
    slots: Vec<u64>,
    pub(super) keys: Vec<K>,
}

const FREE: u64 = u64::MAX;

impl<K> Default for Places<K> {
    fn default() -> Self {
        Self {
            slots: vec![FREE; 1024],
            keys: Vec::new(),
        }
    }
}

impl<K: Key> Places<K> {
    /// The index of `key`, which is added if it is new. At most `u32::MAX` keys may be added.
    #[inline]
    pub(super) fn index_of(&mut self, key: K) -> u32 {
        if self.keys.len() * 2 >= self.slots.len() {
            self.grow();
        }
        let hash = key.hash();
        let mask = self.slots.len() - 1;
        let tag = hash & !0xffff_ffff;
        let mut slot = hash as usize & mask;
        loop {
            let entry = self.slots[slot];
            if entry == FREE {
                let index = self.keys.len() as u32;
                self.keys.push(key);
                self.slots[slot] = tag | u64::from(index);
                return index;
            }
            let index = entry as u32;
            if entry & !0xffff_ffff == tag && self.keys[index as usize] == key {
                return index;
            }
            slot = (slot + 1) & mask;
        }
    }

    #[cold]
    fn grow(&mut self) {
        let count = self.slots.len() * 4;
        self.slots.clear();
        self.slots.resize(count, FREE);
        for (index, key) in self.keys.iter().enumerate() {
            let hash = key.hash();
            let mut slot = hash as usize & (count - 1);
            while self.slots[slot] != FREE {
                slot = (slot + 1) & (count - 1);
            }
            self.slots[slot] = hash & !0xffff_ffff | index as u64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn soup(places: &[DVec3]) -> TriMesh {
        let whole = places.len() / 3 * 3;
        let triangles = (0..whole as u32).step_by(3).map(|i| [i, i + 1, i + 2]);
        TriMesh::new(places[..whole].to_vec(), triangles.collect()).unwrap()
    }

    /// The definition: each vertex joins the first kept one within the tolerance.
    fn weld_naive(mesh: &TriMesh, tolerance: f64) -> (Vec<DVec3>, Vec<u32>) {
        let mut kept: Vec<DVec3> = Vec::new();
        let new_from_old = mesh.positions().iter().map(|&at| {
            let near = kept
                .iter()
                .position(|other| other.distance(at) <= tolerance);
            near.unwrap_or_else(|| {
                kept.push(at);
                kept.len() - 1
            }) as u32
        });
        let new_from_old = new_from_old.collect();
        (kept, new_from_old)
    }

    proptest! {
        #[test]
        fn welding_matches_the_definition(
            raw in prop::collection::vec(prop::array::uniform3(-6_i8..7), 3..300),
            tolerance in prop::sample::select(vec![0.0, 0.3, 1.0, 1.5, 4.0]),
        ) {
            let places: Vec<DVec3> = raw.iter().map(|&p| DVec3::from_array(p.map(f64::from)) * 0.7).collect();
            let mesh = soup(&places);
            let welded = weld(&mesh, tolerance);
            let (kept, new_from_old) = weld_naive(&mesh, tolerance);
            prop_assert_eq!(welded.mesh.positions(), &kept[..]);
            let triangles: Vec<[u32; 3]> =
                mesh.triangles().iter().map(|t| t.map(|v| new_from_old[v as usize])).collect();
            prop_assert_eq!(welded.mesh.triangles(), &triangles[..]);
            prop_assert_eq!(welded.merged, mesh.positions().len() - kept.len());
        }
    }

    #[test]
    fn the_two_zeros_are_one_place() {
        let mesh = soup(&[DVec3::ZERO, DVec3::new(-0.0, 0.0, -0.0), DVec3::X]);
        let welded = weld(&mesh, 0.0);
        assert_eq!(welded.mesh.triangles(), [[0, 0, 1]]);
        assert_eq!((welded.merged, welded.collapsed), (1, 1));
    }

    #[test]
    fn a_tolerance_below_the_spacing_of_the_numbers_welds_equal_places_only() {
        let far = DVec3::splat(1e300);
        let mesh = soup(&[far, far, DVec3::X]);
        assert_eq!(weld(&mesh, 1e-9).merged, 1);
        assert_eq!(weld(&mesh, f64::NAN).merged, 1);
    }
}
