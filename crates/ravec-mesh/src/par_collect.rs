//! Loops of several threads that stop soon after a cancellation.

use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Number of things that are processed between two checks for cancellation: a few milliseconds, if one takes a
/// microsecond.
const AT_ONCE: u32 = 1 << 12;

/// Collects the items that `found` returns for each of `0..count`, in that order, on all threads of the caller's pool.
///
/// # Errors
/// [`Cancelled`] a few milliseconds after `progress` is cancelled, if `found` takes a microsecond.
pub fn par_collect<T: Send, I: IntoIterator<Item = T>>(
    count: usize,
    progress: &Progress,
    found: impl Fn(u32) -> I + Sync,
) -> Result<Vec<T>, Cancelled> {
    let count = count as u32;
    let blocks: Vec<Vec<T>> = (0..count.div_ceil(AT_ONCE))
        .into_par_iter()
        .map(|block| {
            progress.check()?;
            let start = block * AT_ONCE;
            let end = start.saturating_add(AT_ONCE).min(count);
            Ok((start..end).flat_map(&found).collect())
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut all = Vec::with_capacity(blocks.iter().map(Vec::len).sum());
    for (i, block) in blocks.into_iter().enumerate() {
        if i % 16 == 0 {
            progress.check()?;
        }
        all.extend(block);
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_is_gathered_in_order_or_nothing_after_a_cancellation() {
        let count = 3 * AT_ONCE as usize + 5;
        let found = par_collect(count, &Progress::none(), |i| (i % 3 == 0).then_some(i)).unwrap();
        let expected: Vec<u32> = (0..count as u32).filter(|i| i % 3 == 0).collect();
        assert_eq!(found, expected);
        for look in 1..=4 {
            let stopped = par_collect(count, &Progress::cancelled_at(look), |i| [i]);
            assert_eq!(stopped, Err(Cancelled));
        }
        assert_eq!(par_collect(0, &Progress::none(), |i| [i]), Ok(vec![]));
    }
}
