//! Groups of positions at the same place.
//!
//! The plain idea is a table of all places. For a million of them it is read from memory at every step; so positions are first
//! dealt out by a hash into parts of which each has a table that stays in the cache.
//!
//! Cost: linear; 12 bytes a position.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};

/// Positions of a part, about: its table and its list are some hundred kilobytes.
const PART: usize = 1 << 13;

/// Positions between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 16;

/// No entry.
const NONE: u32 = u32::MAX;

/// Bits of which the upper ones depend on all bits of a place.
fn hash(p: DVec3) -> u64 {
    let [x, y, z] = p.to_array().map(f64::to_bits);
    // multiplication carries bits upward only, and coordinates often end in zeros: they are brought down in between
    let mix = |h: u64, x: u64| {
        let h = (h ^ x).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        h ^ h >> 32
    };
    mix(mix(mix(0, x), y), z).wrapping_mul(0x9E37_79B9_7F4A_7C15)
}

/// For each position the first one with the same coordinates, bit for bit.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn first_at_place(
    positions: &[DVec3],
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let parts = (positions.len() / PART).max(1).next_power_of_two();
    let part_of = |hash: u64| ((u128::from(hash) * parts as u128) >> 64) as usize;
    // where the next entry of each part goes; in the end, where each part ends
    let mut next = vec![0_u32; parts];
    for chunk in positions.chunks(STRIDE) {
        progress.check()?;
        for &p in chunk {
            next[part_of(hash(p))] += 1;
        }
    }
    let mut sum = 0;
    for next in &mut next {
        sum += std::mem::replace(next, sum);
    }
    // the lower half of the hash, and the index
    let mut entries = vec![(0_u32, 0_u32); positions.len()];
    let mut index = 0;
    for chunk in positions.chunks(STRIDE) {
        progress.check()?;
        for &p in chunk {
            let hash = hash(p);
            let next = &mut next[part_of(hash)];
            entries[*next as usize] = (hash as u32, index);
            *next += 1;
            index += 1;
        }
    }
    let mut first = vec![0_u32; positions.len()];
    let mut table = Vec::new();
    let mut begin = 0;
    for end in next {
        progress.check()?;
        let entries = &entries[begin as usize..end as usize];
        begin = end;
        table.clear();
        table.resize((2 * entries.len()).next_power_of_two(), NONE);
        let mask = table.len() - 1;
        for (at, &(tag, index)) in (0_u32..).zip(entries) {
            let mut slot = tag as usize & mask;
            first[index as usize] = loop {
                if table[slot] == NONE {
                    table[slot] = at;
                    break index;
                }
                let (other_tag, other) = entries[table[slot] as usize];
                let places = || [index, other].map(|i| positions[i as usize]);
                if other_tag == tag && are_one(places()) {
                    break other;
                }
                slot = (slot + 1) & mask;
            };
        }
    }
    Ok(first)
}

/// Returns `true` if two places are the same, bit for bit.
fn are_one(places: [DVec3; 2]) -> bool {
    let [a, b] = places.map(|p| p.to_array().map(f64::to_bits));
    a == b
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn the_first_at_each_place_is_that_of_a_table() {
        for (count, step) in [(0, 1.0), (1, 1.0), (1000, 0.5), (200_000, 1.0)] {
            // a grid with few places, most of them named several times
            let at = |k: u64| {
                let [x, y, z] = [k * 7919 % 41, k * 104_729 % 37, k * 1_299_709 % 31];
                step * DVec3::new(x as f64, y as f64, z as f64)
            };
            let positions: Vec<DVec3> = (0..count).map(at).collect();
            let mut table = HashMap::new();
            let expected: Vec<u32> = (0..)
                .zip(&positions)
                .map(|(i, p)| *table.entry(p.to_array().map(f64::to_bits)).or_insert(i))
                .collect();
            assert_eq!(first_at_place(&positions, &Progress::none()), Ok(expected));
        }
    }
}
