//! A crew with its store.

use crate::{Crew, PartStore};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A crew, and the store that its workers share with the coordinator.
pub struct Team {
    store: Arc<dyn PartStore>,
    crew: Mutex<Box<dyn Crew>>,
}

impl std::fmt::Debug for Team {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Team").finish_non_exhaustive()
    }
}

impl Team {
    /// A team for one work. The store must have no parts.
    pub fn new(store: Arc<dyn PartStore>, crew: Box<dyn Crew>) -> Self {
        Self {
            store,
            crew: Mutex::new(crew),
        }
    }

    /// The store.
    pub fn store(&self) -> &Arc<dyn PartStore> {
        &self.store
    }

    /// The crew, for one coordinator at a time.
    pub fn crew(&self) -> MutexGuard<'_, Box<dyn Crew>> {
        self.crew.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
