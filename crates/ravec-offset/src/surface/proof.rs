//! Proofs of facets, as cached between rounds.

use rustc_hash::FxBuildHasher;
use std::hash::BuildHasher as _;
use std::num::NonZeroU64;

/// Proved room below a facet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Room {
    /// The facet keeps the minimum distance.
    Enough,
    /// The facet also keeps the larger distance that was requested.
    Ample,
}

/// Starting point of a proof, apart from the facet. Proofs are not tight: one may succeed from one triangle and fail from
/// another. A proof from another start does not count, since otherwise the surface would depend on the cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct ProofStart {
    /// Triangles close to the leaves of the polygon.
    pub hints: [u32; 4],
    /// None of these leaves can be split.
    pub is_last: bool,
}

impl ProofStart {
    /// Hash of 62 bits.
    fn mark(&self) -> u64 {
        FxBuildHasher.hash_one(self) >> 2
    }
}

/// The fact that a facet is proved to keep its distance: the hash of the starting point, a bit for ample room, and a bit that
/// is always set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Proof(NonZeroU64);

impl Proof {
    pub fn new(room: Room, given: &ProofStart) -> Self {
        let is_ample = u64::from(room == Room::Ample);
        Self(NonZeroU64::MIN | is_ample << 1 | given.mark() << 2)
    }

    /// Returns whether the proof started from `given`.
    pub fn is_from(self, given: &ProofStart) -> bool {
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
    fn proofs_record_their_start_and_their_room() {
        let given = |i: u32| ProofStart {
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
