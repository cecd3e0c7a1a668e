//! Bytes that are read as numbers.

use bytemuck::{Pod, pod_collect_to_vec};

/// A reader of numbers from bytes, in order.
pub(crate) struct Bytes<'a>(pub &'a [u8]);

impl Bytes<'_> {
    /// Reads the next `count` numbers; `None` if there are fewer.
    pub fn take<T: Pod>(&mut self, count: u64) -> Option<Vec<T>> {
        let bytes = usize::try_from(count).ok()?.checked_mul(size_of::<T>())?;
        let (taken, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(pod_collect_to_vec(taken))
    }
}
