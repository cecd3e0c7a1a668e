//! Hash tables with a key of their own: nobody can make a file whose entries collide.
//!
//! The order of their entries differs from run to run, so results must not depend on it.

use foldhash::fast::RandomState;

/// A `HashMap` whose hash has a random key.
pub type KeyedMap<K, V> = std::collections::HashMap<K, V, RandomState>;
/// A `HashSet` whose hash has a random key.
pub type KeyedSet<K> = std::collections::HashSet<K, RandomState>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_that_were_chosen_to_collide_take_no_longer_than_others() {
        // the upper bits of the product are those that `rustc-hash` picks places by
        const FACTOR: u64 = 0xf135_7aea_2e62_a9c5;
        let inverse = (0..6).fold(FACTOR, |x, _| {
            x.wrapping_mul(2_u64.wrapping_sub(FACTOR.wrapping_mul(x)))
        });
        assert_eq!(FACTOR.wrapping_mul(inverse), 1);
        let filled = |key: &dyn Fn(u64) -> u64| {
            let start = std::time::Instant::now();
            let set: KeyedSet<u64> = (0..200_000).map(key).collect();
            assert_eq!(set.len(), 200_000);
            start.elapsed()
        };
        let random = filled(&|i| i.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let chosen = filled(&|i| i.wrapping_mul(inverse));
        // seconds if they collide
        assert!(chosen < 10 * random + std::time::Duration::from_millis(100));
    }
}
