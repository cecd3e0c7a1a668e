//! Edges in the order of their costs, nearly.
//!
//! A cost is put into a bucket by its exponent and its first five binary digits, so that edges come out in order up to 3 %.
//! That is as good as exact order for the result, and unlike a heap it takes a cache miss and not twenty. Entries are
//! never removed: one that is out of date is known by its stamp when it comes out.

/// Bits of an `f32` that do not matter for the order.
const COARSE: u32 = 18;

/// An edge that waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Entry {
    pub bucket: u32,
    /// The two ends.
    pub ends: [u32; 2],
    /// Stamp by which the caller recognizes outdated entries.
    pub stamp: u32,
}

impl Entry {
    /// The cost must not be negative.
    #[inline]
    pub fn new(cost: f64, ends: [u32; 2], stamp: u32) -> Self {
        Self {
            // the bits of numbers that are not negative are in their order
            bucket: ((cost as f32).to_bits() & 0x7fff_ffff) >> COARSE,
            ends,
            stamp,
        }
    }
}

/// Entries by bucket; of one bucket the latest comes out first.
#[derive(Debug, Clone)]
pub(super) struct Queue {
    buckets: Vec<Vec<([u32; 2], u32)>>,
    /// No bucket below this one holds anything.
    lowest: usize,
}

impl Queue {
    pub fn new() -> Self {
        Self {
            buckets: vec![Vec::new(); 1 << (31 - COARSE)],
            lowest: 0,
        }
    }

    #[inline]
    pub fn push(&mut self, entry: Entry) {
        let bucket = entry.bucket as usize;
        self.buckets[bucket].push((entry.ends, entry.stamp));
        self.lowest = self.lowest.min(bucket);
    }

    #[inline]
    pub fn pop(&mut self) -> Option<Entry> {
        self.pop_up_to(u32::MAX, 0)
    }

    /// The next one, unless it is of a bucket above this one, or one of the first `old` of this one.
    #[inline]
    pub fn pop_up_to(&mut self, highest: u32, old: usize) -> Option<Entry> {
        let highest = highest as usize;
        while self.lowest < self.buckets.len() && self.lowest <= highest {
            let bucket = &mut self.buckets[self.lowest];
            if self.lowest == highest && bucket.len() <= old {
                return None;
            }
            if let Some((ends, stamp)) = bucket.pop() {
                return Some(Entry {
                    bucket: self.lowest as u32,
                    ends,
                    stamp,
                });
            }
            self.lowest += 1;
        }
        None
    }

    /// Number of entries in a bucket.
    pub fn count_in(&self, bucket: u32) -> usize {
        self.buckets[bucket as usize].len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn costs_come_out_in_order_up_to_their_sixth_digit(logs in prop::collection::vec(-40.0..30.0_f64, 1..60)) {
            let mut queue = Queue::new();
            for (i, log) in (0_u32..).zip(&logs) {
                queue.push(Entry::new(log.exp(), [i, i + 1], 2 * i));
            }
            let mut seen = Vec::new();
            while let Some(entry) = queue.pop() {
                prop_assert_eq!(entry.stamp, 2 * entry.ends[0]);
                seen.push(entry.ends[0]);
            }
            for pair in seen.windows(2) {
                prop_assert!(logs[pair[1] as usize] > logs[pair[0] as usize] - 0.0313);
            }
            seen.sort_unstable();
            prop_assert!(seen.into_iter().eq(0..logs.len() as u32));
        }
    }

    #[test]
    fn what_was_there_before_may_be_left() {
        let mut queue = Queue::new();
        for (ends, cost) in [([0, 1], 1.0), ([2, 3], 1.0), ([4, 5], 9.0), ([6, 7], 0.5)] {
            queue.push(Entry::new(cost, ends, 0));
        }
        let bucket = Entry::new(1.0, [0, 0], 0).bucket;
        let next = |queue: &mut Queue| queue.pop_up_to(bucket, 1).map(|e| e.ends);
        assert_eq!(next(&mut queue), Some([6, 7]));
        assert_eq!(next(&mut queue), Some([2, 3]));
        assert_eq!((next(&mut queue), queue.count_in(bucket)), (None, 1));
        assert_eq!(queue.pop_up_to(bucket, 0).map(|e| e.ends), Some([0, 1]));
        assert_eq!(queue.pop_up_to(bucket, 0), None);
        assert_eq!(queue.pop().map(|e| e.ends), Some([4, 5]));
    }

    #[test]
    fn something_cheaper_that_comes_late_comes_out_first() {
        let mut queue = Queue::new();
        queue.push(Entry::new(1.0, [0, 1], 0));
        queue.push(Entry::new(0.0, [2, 3], 0));
        assert_eq!(queue.pop().map(|e| e.ends), Some([2, 3]));
        queue.push(Entry::new(1e-9, [4, 5], 0));
        assert_eq!(queue.pop().map(|e| e.ends), Some([4, 5]));
        assert_eq!(queue.pop().map(|e| e.ends), Some([0, 1]));
        assert_eq!(queue.pop(), None);
    }
}
