//! An executor with its store.

use crate::{Executor, PartStore};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// An executor, and the store that its workers share with the coordinator.
pub struct Cluster {
    store: Arc<dyn PartStore>,
    executor: Mutex<Box<dyn Executor>>,
}

impl std::fmt::Debug for Cluster {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cluster").finish_non_exhaustive()
    }
}

impl Cluster {
    /// A cluster for one work. The store must have no parts.
    pub fn new(store: Arc<dyn PartStore>, executor: Box<dyn Executor>) -> Self {
        Self {
            store,
            executor: Mutex::new(executor),
        }
    }

    /// The store.
    pub fn store(&self) -> &Arc<dyn PartStore> {
        &self.store
    }

    /// The executor, for one coordinator at a time.
    pub fn executor(&self) -> MutexGuard<'_, Box<dyn Executor>> {
        self.executor.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
