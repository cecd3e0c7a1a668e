//! Photos side by side, each on a thread of its own.
//!
//! A photo takes its share of the memory budget, and waits until others have released enough. While it is decoded and scaled,
//! its thread must not take up the work of another photo, which could wait for the very memory that the first one holds, as
//! threads of a common pool do. So there are plain threads, and each runs what is parallel within a photo in a pool of one.

use crate::error::CatalogueError;
use rayon::{ThreadPool, ThreadPoolBuilder, current_num_threads};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A pool with as many threads as the pool in which it is made.
pub(crate) struct Workers {
    pools: Vec<ThreadPool>,
}

impl Workers {
    pub fn new() -> Result<Self, CatalogueError> {
        let pool = |_| ThreadPoolBuilder::new().num_threads(1).build();
        let pools = (0..current_num_threads()).map(pool);
        let pools = pools.collect::<Result<_, _>>();
        pools
            .map(|pools| Self { pools })
            .map_err(|error| CatalogueError::Threads {
                reason: error.to_string(),
            })
    }

    /// The results of `work` on all items, in their order. After an error, no further item is begun; of several errors, any is
    /// returned.
    pub fn map<T: Sync, R: Send, E: Send>(
        &self,
        items: &[T],
        work: impl Fn(&T) -> Result<R, E> + Sync,
    ) -> Result<Vec<R>, E> {
        let (next, failed) = (AtomicUsize::new(0), AtomicBool::new(false));
        let run = || -> Result<Vec<(usize, R)>, E> {
            let mut results = Vec::new();
            while !failed.load(Ordering::Relaxed) {
                let at = next.fetch_add(1, Ordering::Relaxed);
                let Some(item) = items.get(at) else { break };
                match work(item) {
                    Ok(result) => results.push((at, result)),
                    Err(error) => {
                        failed.store(true, Ordering::Relaxed);
                        return Err(error);
                    }
                }
            }
            Ok(results)
        };
        let parts: Vec<Result<Vec<(usize, R)>, E>> = std::thread::scope(|scope| {
            let threads: Vec<_> = self
                .pools
                .iter()
                .map(|pool| scope.spawn(|| pool.install(run)))
                .collect();
            let join = |thread: std::thread::ScopedJoinHandle<'_, _>| {
                thread
                    .join()
                    .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            };
            threads.into_iter().map(join).collect()
        });
        let mut results: Vec<(usize, R)> = Vec::with_capacity(items.len());
        for part in parts {
            results.extend(part?);
        }
        results.sort_unstable_by_key(|(at, _)| *at);
        Ok(results.into_iter().map(|(_, result)| result).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_memory::MemoryBudget;
    use ravec_progress::Progress;
    use rayon::prelude::*;

    fn in_pool<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(work)
    }

    #[test]
    fn results_come_in_order_on_any_number_of_threads() {
        for threads in [1, 2, 5] {
            let workers = in_pool(threads, Workers::new).unwrap();
            let items: Vec<u64> = (0..1000).collect();
            let doubled = workers.map(&items, |item| Ok::<_, ()>(2 * item)).unwrap();
            assert_eq!(
                doubled,
                items.iter().map(|item| 2 * item).collect::<Vec<_>>()
            );
            let error = workers.map(&items, |&item| if item == 7 { Err(item) } else { Ok(item) });
            assert_eq!(error, Err(7));
            assert_eq!(
                workers.map(&[], |item: &u64| Ok::<_, ()>(*item)),
                Ok(vec![])
            );
        }
    }

    /// Can only fail by hanging.
    #[test]
    fn whoever_holds_memory_does_not_wait_for_others_in_its_parallel_work() {
        let (budget, progress) = (MemoryBudget::new(10), Progress::none());
        let workers = in_pool(4, Workers::new).unwrap();
        let sums = workers.map(&[0u64; 200], |_| {
            let _share = budget.reserve_when_free(6, &progress).map_err(drop)?;
            Ok::<u64, ()>((0..10_000u64).into_par_iter().sum())
        });
        assert_eq!(sums, Ok(vec![49_995_000; 200]));
        assert_eq!(budget.peak(), 6);
    }
}
