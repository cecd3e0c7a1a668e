//! Proofs of facets, as they are remembered.

use crate::certify::Room;
use rustc_hash::FxBuildHasher;
use std::hash::BuildHasher as _;
use std::num::NonZeroU64;

/// What the proof of a facet begins with, beside the facet. A proof that is not tight may succeed from one triangle and fail from
/// another: one that was found from others does not count, or the surface would depend on what was remembered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Given {
    /// Triangles close to the leaves of its polygon.
    pub hints: [u32; 4],
    /// Whether none of these can be split.
    pub is_last: bool,
}

impl Given {
    /// 62 bits that hardly any others share.
    fn mark(&self) -> u64 {
        FxBuildHasher.hash_one(self) >> 2
    }
}

/// That a facet was proved to keep its distance: the mark of what that began with, above a bit that says whether the room below
/// it is ample and one that is always set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Proof(NonZeroU64);

impl Proof {
    pub fn new(room: Room, given: &Given) -> Self {
        let is_ample = u64::from(room == Room::Ample);
        Self(NonZeroU64::MIN | is_ample << 1 | given.mark() << 2)
    }

    /// Whether that is what it began with.
    pub fn is_from(self, given: &Given) -> bool {
        self.0.get() >> 2 == given.mark()
    }

    pub fn is_ample(self) -> bool {
        self.0.get() & 2 != 0
    }

    pub fn to_bits(proof: Option<Self>) -> u64 {
        proof.map_or(0, |proof| proof.0.get())
    }

    pub fn from_bits(bits: u64) -> Option<Self> {
        NonZeroU64::new(bits).map(Self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn proofs_keep_what_they_are_from_and_their_room() {
        let given = |i: u32| Given {
            hints: [i, i + 1, 7, 7],
            is_last: i.is_multiple_of(3),
        };
        for i in 0..100 {
            for room in [Room::Enough, Room::Ample] {
                let proof = Proof::new(room, &given(i));
                let again = Proof::from_bits(Proof::to_bits(Some(proof)));
                assert_eq!(again, Some(proof));
                assert_eq!(proof.is_ample(), room == Room::Ample);
                assert!((0..100).all(|j| proof.is_from(&given(j)) == (i == j)));
            }
        }
        assert_eq!(Proof::from_bits(Proof::to_bits(None)), None);
        assert_eq!(size_of::<Option<Proof>>(), 8);
    }
}
