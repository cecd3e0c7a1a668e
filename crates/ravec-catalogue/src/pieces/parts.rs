//! Reading of parts with scaled photos: neighboring tiles have their photos in one part.

use super::part_name;
use ravec_pieces::PartStore;
use std::collections::VecDeque;
use std::io::Result;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Maximum size of a part that is read as a whole: the latency of a request to an object store is that of some megabytes.
const MAX_WHOLE_BYTES: u64 = 4 << 20;

/// Capacity of the cache of parts, in bytes.
const MAX_KEPT_BYTES: u64 = 4 * MAX_WHOLE_BYTES;

/// The bytes of a part, once a thread has read them.
type PartBytes = Arc<Mutex<Option<Arc<Vec<u8>>>>>;

/// A cache of parts that evicts the least recently used ones.
#[derive(Default)]
pub(super) struct PartCache {
    parts: Mutex<Parts>,
}

/// Number, size and bytes of each part, the most recently used one last.
#[derive(Default)]
struct Parts(VecDeque<(u64, u64, PartBytes)>);

impl Parts {
    /// The entry of a part of this many bytes.
    fn entry(&mut self, part: u64, bytes: u64) -> PartBytes {
        let known = self.0.iter().position(|(other, ..)| *other == part);
        let found = known.and_then(|at| self.0.remove(at));
        let found = found.unwrap_or_else(|| (part, bytes, PartBytes::default()));
        let entry = Arc::clone(&found.2);
        self.0.push_back(found);
        let kept = |parts: &VecDeque<_>| parts.iter().map(|(_, bytes, _)| bytes).sum::<u64>();
        while kept(&self.0) > MAX_KEPT_BYTES {
            self.0.pop_front();
        }
        entry
    }
}

impl PartCache {
    /// Calls `with` with a range of the bytes of a part that has `part_bytes` bytes in all.
    ///
    /// # Errors
    /// Those of the store.
    pub fn read(
        &self,
        store: &dyn PartStore,
        (part, part_bytes): (u64, u64),
        range: &Range<u64>,
        with: impl FnOnce(&[u8]),
    ) -> Result<()> {
        if part_bytes > MAX_WHOLE_BYTES {
            with(&store.read(&part_name(part), range.clone())?);
            return Ok(());
        }
        let whole = self.whole(store, part, part_bytes)?;
        let range = range.start as usize..range.end as usize;
        with(whole.get(range).ok_or_else(super::damaged)?);
        Ok(())
    }

    fn whole(&self, store: &dyn PartStore, part: u64, bytes: u64) -> Result<Arc<Vec<u8>>> {
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = parts.entry(part, bytes);
        drop(parts);
        // other threads that need the part wait for the one that reads it
        let mut entry = entry.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = &*entry {
            return Ok(Arc::clone(known));
        }
        let read = Arc::new(store.read(&part_name(part), 0..bytes)?);
        Ok(Arc::clone(entry.insert(read)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_parts_are_evicted() {
        let mut cache = Parts::default();
        let third = MAX_KEPT_BYTES / 3;
        let first = cache.entry(1, third);
        cache.entry(2, third);
        assert!(Arc::ptr_eq(&first, &cache.entry(1, third)));
        cache.entry(3, third);
        cache.entry(4, third);
        let kept: Vec<u64> = cache.0.iter().map(|(part, ..)| *part).collect();
        assert_eq!(kept, [1, 3, 4]);
        let empty = cache.entry(2, third);
        assert!(empty.lock().unwrap().is_none());
    }
}
