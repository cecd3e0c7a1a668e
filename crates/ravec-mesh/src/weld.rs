//! Vertices at the same place made one.
//!
//! STL and other triangle lists repeat each vertex in every triangle around it; welding finds the connections again.
//! Exactly equal places are found by a hash table of indices with open addressing, places within a tolerance by a hash
//! of grid cells as wide as the tolerance.
//!
//! Guarantees: triangles stay in their order and none is dropped, so that data that go with them stay aligned; the first
//! vertex of each place, in the order of the input, is the one that stays; −0 equals 0. With a tolerance no vertex moves
//! farther than it, and those that stay are farther than it from one another. Does not guarantee: that a chain of
//! vertices, each near the next, becomes one. Cost: O(vertices), about 50 ns each. The hash has a key of its own in each
//! run, so that no file can be made of places that collide; the result does not depend on it.

use std::hash::{BuildHasher, RandomState};

use glam::DVec3;
use ravec_memory::{MemoryBudget, OverBudget, Reservation, ReservedVec, bytes_of, with_room};
use ravec_progress::{Cancelled, Progress};

use crate::TriMesh;

/// Why vertices were not welded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WeldError {
    /// Welding takes more memory than the budget has.
    #[error(transparent)]
    OverBudget(#[from] OverBudget),
    /// The caller does not want the result any more.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A mesh whose vertices were welded.
#[derive(Debug, Clone, PartialEq)]
pub struct Welded {
    /// The mesh. Vertices that no triangle uses are kept as well.
    pub mesh: TriMesh,
    /// Number of vertices that were merged into an earlier one.
    pub merged: usize,
    /// Number of triangles that lost a corner thereby: two of their corners are the same vertex now and were not
    /// before.
    pub collapsed: usize,
}

/// Makes vertices of `mesh` one that lie at the same place, or within `tolerance` of it.
///
/// `tolerance` is a length in units of the mesh; 0 (and anything that is not a positive number) welds vertices at
/// exactly equal places only. More closes wider cracks and collapses small triangles.
#[expect(clippy::missing_panics_doc, reason = "nobody cancels")]
pub fn weld(mesh: &TriMesh, tolerance: f64) -> Welded {
    let welded = try_weld(mesh, tolerance, &Progress::none());
    welded.expect("a progress of its own is never cancelled")
}

/// Welds `mesh` as [`weld`] does.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
#[expect(clippy::missing_panics_doc, reason = "there is no limit")]
pub fn try_weld(mesh: &TriMesh, tolerance: f64, progress: &Progress) -> Result<Welded, Cancelled> {
    match weld_within(mesh, tolerance, &MemoryBudget::unlimited(), progress) {
        Ok((welded, _)) => Ok(welded),
        Err(WeldError::Cancelled(cancelled)) => Err(cancelled),
        Err(WeldError::OverBudget(over)) => panic!("there is no limit: {over}"),
    }
}

/// Number of vertices or triangles that are processed between two checks for cancellation: about a millisecond.
const AT_ONCE: usize = 1 << 14;

/// Welds `mesh` as [`weld`] does with memory of `budget`, and returns the reservation of the result along with it.
///
/// # Errors
/// [`WeldError::OverBudget`] if the budget has too little, [`WeldError::Cancelled`] soon after `progress` is cancelled.
#[expect(clippy::missing_panics_doc, reason = "the parts of a mesh make a mesh")]
pub fn weld_within(
    mesh: &TriMesh,
    tolerance: f64,
    budget: &MemoryBudget,
    progress: &Progress,
) -> Result<(Welded, Reservation), WeldError> {
    let positions = mesh.positions();
    let (mut new_from_old, _numbers) = with_room(budget, positions.len())?;
    let kept = if tolerance > 0.0 && tolerance.is_finite() {
        let mut cells = Cells::new(tolerance, budget)?;
        for block in positions.chunks(AT_ONCE) {
            progress.check()?;
            for &at in block {
                new_from_old.push(cells.index_of(at)?);
            }
        }
        cells.kept
    } else {
        let mut places = PlaceTable::new(budget)?;
        for block in positions.chunks(AT_ONCE) {
            progress.check()?;
            for &at in block {
                new_from_old.push(places.index_of(place_key(at))?);
            }
        }
        places.into_positions(|key| key.map(f64::from_bits), progress)?
    };
    let merged = positions.len() - kept.len();
    let mut collapsed = 0;
    let corners_differ = |t: [u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    let (mut triangles, of_triangles) = with_room(budget, mesh.triangles().len())?;
    for block in mesh.triangles().chunks(AT_ONCE) {
        progress.check()?;
        triangles.extend(block.iter().map(|&old| {
            let new = old.map(|v| new_from_old[v as usize]);
            collapsed += usize::from(corners_differ(old) && !corners_differ(new));
            new
        }));
    }
    let (kept, mut memory) = kept.into_parts();
    memory.absorb(of_triangles);
    let mesh = TriMesh::try_new(kept, triangles, progress)?;
    let welded = Welded {
        mesh: mesh.expect("the parts of a mesh make a mesh"),
        merged,
        collapsed,
    };
    Ok((welded, memory))
}

/// The bits of a place, the same for 0 and −0.
pub fn place_key(at: DVec3) -> [u64; 3] {
    at.to_array().map(|x| (x + 0.0).to_bits())
}

/// Stands for "no vertex".
const NONE: u32 = u32::MAX;

/// Vertices that are kept, by the cells of a grid as wide as the tolerance.
struct Cells {
    tolerance: f64,
    kept: ReservedVec<DVec3>,
    numbers: PlaceTable<[u64; 3]>,
    /// The last vertex of each cell; those before it are chained.
    last: ReservedVec<u32>,
    earlier: ReservedVec<u32>,
}

/// The number of the cell that a coordinate is in, and that of the cell `step` further. Where neighboring numbers are more
/// than a tolerance apart, each is a cell of its own: the numbers of cells would not be exact there, or infinite.
fn cell(x: f64, tolerance: f64, step: f64) -> u64 {
    let number = x / tolerance;
    if number.abs() < 18014398509481984.0 {
        (number.floor() + step + 0.0).to_bits()
    } else {
        (x + 0.0).to_bits()
    }
}

impl Cells {
    fn new(tolerance: f64, budget: &MemoryBudget) -> Result<Self, OverBudget> {
        Ok(Self {
            tolerance,
            kept: ReservedVec::new(budget),
            numbers: PlaceTable::new(budget)?,
            last: ReservedVec::new(budget),
            earlier: ReservedVec::new(budget),
        })
    }

    /// The index of the first vertex within the tolerance of `at`, which is kept if there is none.
    fn index_of(&mut self, at: DVec3) -> Result<u32, OverBudget> {
        let tolerance = self.tolerance;
        let numbers = [-1.0, 0.0, 1.0].map(|step| at.to_array().map(|x| cell(x, tolerance, step)));
        let mut found = NONE;
        for step in 0..27 {
            let [x, y, z] = [step % 3, step / 3 % 3, step / 9];
            let Some(cell) = self
                .numbers
                .find([numbers[x][0], numbers[y][1], numbers[z][2]])
            else {
                continue;
            };
            let mut candidate = self.last[cell as usize];
            while candidate != NONE {
                let near = || self.kept[candidate as usize].distance(at) <= tolerance;
                if candidate < found && near() {
                    found = candidate;
                }
                candidate = self.earlier[candidate as usize];
            }
        }
        if found == NONE {
            found = self.kept.len() as u32;
            self.kept.push(at)?;
            let cell = self.numbers.index_of(numbers[1])? as usize;
            self.last.fill_up_to(cell + 1, NONE)?;
            self.earlier
                .push(std::mem::replace(&mut self.last[cell], found))?;
        }
        Ok(found)
    }
}

/// A place as bits that can be hashed: three 32-bit or 64-bit words.
pub trait PlaceKey: Copy + Eq {
    /// The words, made 64 bits wide.
    fn words(self) -> [u64; 3];
}

impl PlaceKey for [u32; 3] {
    #[inline]
    fn words(self) -> [u64; 3] {
        self.map(u64::from)
    }
}

impl PlaceKey for [u64; 3] {
    #[inline]
    fn words(self) -> [u64; 3] {
        self
    }
}

/// A hash with a key: nobody who does not know the key can choose places that collide. The product of 128 bits folded is
/// that of wyhash.
#[derive(Clone, Copy)]
struct Keyed([u64; 4]);

impl Keyed {
    fn new() -> Self {
        let random = RandomState::new();
        Self(std::array::from_fn(|i| random.hash_one(i)))
    }

    #[inline]
    fn hash(self, [x, y, z]: [u64; 3]) -> u64 {
        let folded = |a: u64, b: u64| {
            let product = u128::from(a) * u128::from(b);
            product as u64 ^ (product >> 64) as u64
        };
        let [a, b, c, d] = self.0;
        folded(folded(x ^ a, y ^ b) ^ z ^ c, d | 1)
    }
}

/// Distinct places in the order of their first appearance, found by their exact bits.
///
/// A slot holds the index of a key in its low half and a part of the key's hash in its high half, so that most probes
/// need not look at the keys.
pub struct PlaceTable<K> {
    slots: Vec<u64>,
    memory: Reservation,
    keys: ReservedVec<K>,
    hash: Keyed,
    /// The number of slots that were looked at.
    #[cfg(test)]
    probes: u64,
}

const FREE: u64 = u64::MAX;

impl<K: PlaceKey> PlaceTable<K> {
    /// An empty table with memory of `budget`.
    ///
    /// # Errors
    /// [`OverBudget`] if the budget has less than 8 KiB.
    pub fn new(budget: &MemoryBudget) -> Result<Self, OverBudget> {
        const FIRST: usize = 1024;
        let memory = budget.reserve(bytes_of::<u64>(FIRST))?;
        Ok(Self {
            slots: vec![FREE; FIRST],
            memory,
            keys: ReservedVec::new(budget),
            hash: Keyed::new(),
            #[cfg(test)]
            probes: 0,
        })
    }

    /// The number of places.
    pub fn len(&self) -> usize {
        self.keys.len()
    }

    /// True if there are no places.
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// The slot of `key` or the free one where it belongs, and the part of its hash that goes there.
    #[inline]
    fn slot_of(&self, key: K) -> (usize, u64) {
        let hash = self.hash.hash(key.words());
        let mask = self.slots.len() - 1;
        let tag = hash & !0xffff_ffff;
        let mut slot = hash as usize & mask;
        loop {
            let entry = self.slots[slot];
            let same = || entry & !0xffff_ffff == tag && self.keys[entry as u32 as usize] == key;
            if entry == FREE || same() {
                return (slot, tag);
            }
            slot = (slot + 1) & mask;
        }
    }

    /// The index of `key` if it is there.
    fn find(&self, key: K) -> Option<u32> {
        let entry = self.slots[self.slot_of(key).0];
        (entry != FREE).then_some(entry as u32)
    }

    /// The index of `key`, which is added if it is new. At most `u32::MAX` keys may be added.
    ///
    /// # Errors
    /// [`OverBudget`] if the table has to grow and the budget has too little.
    #[inline]
    pub fn index_of(&mut self, key: K) -> Result<u32, OverBudget> {
        if self.keys.len() * 2 >= self.slots.len() {
            self.grow()?;
        }
        let (slot, tag) = self.slot_of(key);
        #[cfg(test)]
        {
            let first = self.hash.hash(key.words()) as usize & (self.slots.len() - 1);
            self.probes += 1 + (slot.wrapping_sub(first) & (self.slots.len() - 1)) as u64;
        }
        let entry = self.slots[slot];
        if entry != FREE {
            return Ok(entry as u32);
        }
        let index = self.keys.len() as u32;
        self.keys.push(key)?;
        self.slots[slot] = tag | u64::from(index);
        Ok(index)
    }

    #[cold]
    fn grow(&mut self) -> Result<(), OverBudget> {
        let count = self.slots.len() * 2;
        // the old slots can be found again from the keys
        self.slots = Vec::new();
        self.memory.shrink_to(0);
        self.memory.grow(bytes_of::<u64>(count))?;
        self.slots = vec![FREE; count];
        for (index, &key) in self.keys.iter().enumerate() {
            let hash = self.hash.hash(key.words());
            let mut slot = hash as usize & (count - 1);
            while self.slots[slot] != FREE {
                slot = (slot + 1) & (count - 1);
            }
            self.slots[slot] = hash & !0xffff_ffff | index as u64;
        }
        Ok(())
    }

    /// The places, as what `position` makes of their keys.
    ///
    /// # Errors
    /// As [`weld_within`].
    pub fn into_positions(
        self,
        position: impl Fn(K) -> [f64; 3],
        progress: &Progress,
    ) -> Result<ReservedVec<DVec3>, WeldError> {
        let Self {
            slots,
            mut memory,
            keys,
            ..
        } = self;
        drop(slots);
        memory.shrink_to(0);
        memory.grow(bytes_of::<DVec3>(keys.len()))?;
        let mut positions = Vec::with_capacity(keys.len());
        for block in keys.chunks(AT_ONCE) {
            progress.check()?;
            positions.extend(block.iter().map(|&key| DVec3::from_array(position(key))));
        }
        Ok(ReservedVec::from_parts(positions, memory))
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

    #[test]
    fn numbers_that_are_farther_apart_than_the_tolerance_are_cells_of_their_own() {
        // all in one cell, or in infinite ones, if cells were numbered as those of other places
        let positions: Vec<DVec3> = (0..50_000_u64)
            .map(|i| DVec3::splat(f64::from_bits(1e300_f64.to_bits() + i)))
            .collect();
        for tolerance in [1e-9, 1e270] {
            let mut cells = Cells::new(tolerance, &MemoryBudget::unlimited()).unwrap();
            for &at in &positions {
                cells.index_of(at).unwrap();
            }
            assert_eq!(cells.kept.len(), positions.len());
            assert_eq!(cells.last.len(), positions.len(), "one vertex a cell");
        }
        let far = soup(&[DVec3::X * 1e300, DVec3::new(1e300, 0.0, 0.25), DVec3::Y]);
        assert_eq!(weld(&far, 0.5).merged, 1);
    }

    /// Places that have the same hash if the words of a place are mixed one after the other with known constants.
    fn colliding(count: u64) -> Vec<[u64; 3]> {
        const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
        let stir = |hash: u64, word: u64| (hash.rotate_left(23) ^ word).wrapping_mul(SPREAD);
        let places = (0..count).map(|i| {
            let (x, y) = ((1.0 + i as f64).to_bits(), 0.5_f64.to_bits());
            let before = stir(stir(0, x), y).rotate_left(23);
            // the last word undoes what those before it did
            [x, y, before ^ 0x4d]
        });
        let places: Vec<[u64; 3]> = places.collect();
        let hash = |place: &[u64; 3]| place.iter().fold(0, |hash, &word| stir(hash, word));
        assert!(places.iter().all(|place| hash(place) == hash(&places[0])));
        places
    }

    #[test]
    fn places_that_were_chosen_to_collide_take_no_more_probes_than_others() {
        for places in [
            colliding(200_000),
            (0..200_000).map(|i| [i << 40, 0, 0]).collect(),
            (0..200_000).map(|i| [0, i << 52 | 1, i]).collect(),
        ] {
            let mut table = PlaceTable::new(&MemoryBudget::unlimited()).unwrap();
            for (i, &place) in (0..).zip(&places) {
                assert_eq!(table.index_of(place).unwrap(), i);
            }
            // about 1.25 for each at this load
            assert!(table.probes < 2 * 200_000, "{} probes", table.probes);
        }
    }

    #[test]
    fn welding_stops_at_a_cancellation_and_at_the_limit_of_memory() {
        let positions: Vec<DVec3> = (0..60_000).map(|i| DVec3::X * f64::from(i)).collect();
        let mesh = soup(&positions);
        for tolerance in [0.0, 0.25] {
            for look in 1..=8 {
                let stopped = try_weld(&mesh, tolerance, &Progress::cancelled_at(look));
                assert_eq!(stopped, Err(Cancelled), "look {look}");
            }
            let outcome = weld_within(
                &mesh,
                tolerance,
                &MemoryBudget::new(1_000_000),
                &Progress::none(),
            );
            assert!(matches!(outcome, Err(WeldError::OverBudget(_))));
        }
    }
}
