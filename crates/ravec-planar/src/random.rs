//! A small generator of random numbers with a seed.
//!
//! Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators", 2014.

/// A stream of random numbers: equal seeds give equal numbers.
#[derive(Debug, Clone)]
pub(crate) struct SplitMix(u64);

impl SplitMix {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `end`, which is at least 1. Its bias is below `end` / 2³².
    pub(crate) fn below(&mut self, end: usize) -> usize {
        (((self.next() >> 32) * end as u64) >> 32) as usize
    }

    /// `N` different numbers below `end`, which is at least `N`.
    pub(crate) fn distinct<const N: usize>(&mut self, end: usize) -> [usize; N] {
        let mut chosen = [0; N];
        for index in 0..N {
            chosen[index] = loop {
                let next = self.below(end);
                if !chosen[..index].contains(&next) {
                    break next;
                }
            };
        }
        chosen
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chosen_numbers_are_different_below_the_end_and_even() {
        let mut random = SplitMix::new(1);
        let mut counts = [0; 6];
        for _ in 0..6000 {
            let chosen: [usize; 4] = random.distinct(6);
            for (index, &one) in chosen.iter().enumerate() {
                assert!(!chosen[..index].contains(&one));
                counts[one] += 1;
            }
        }
        // 4000 each, with a standard deviation of √(6000 · ⅔ · ⅓) = 37
        assert!(
            counts.iter().all(|count| (3800..4200).contains(count)),
            "{counts:?}"
        );
    }
}
