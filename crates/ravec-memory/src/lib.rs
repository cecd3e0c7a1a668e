//! One budget of memory for a run, shared by all readers and threads.
//!
//! A file decides how much memory it takes to read it, so a file must not be trusted with that decision. Every reader
//! reserves memory from a [`MemoryBudget`] before it allocates in proportion to what a file claims, and holds the
//! [`Reservation`] for as long as the memory. Clones of a budget share one account: ten photos that are decoded at once take
//! no more together than the budget has.
//!
//! ```
//! use ravec_memory::MemoryBudget;
//!
//! let budget = MemoryBudget::new(1000);
//! let mut pixels = budget.reserve(600)?;
//! assert!(budget.reserve(600).is_err());
//! pixels.shrink_to(300);
//! let more = budget.reserve(600)?;
//! assert_eq!(budget.used(), 900);
//! drop((pixels, more));
//! assert_eq!((budget.used(), budget.peak()), (0, 900));
//! # Ok::<(), ravec_memory::OverBudget>(())
//! ```
//!
//! A [`ReservedVec`] is a list that reserves before it grows.
//!
//! Guarantees: the reservations of a budget never exceed its limit together; a reservation is given back when it is dropped,
//! also by a panic. Does not guarantee: that the system has the memory; anything about memory that nobody reserves.
//!
//! Words: a *budget* is a limit with an account of what is in use; a *reservation* is a part of it that somebody holds.

mod machine;
mod reserved_vec;

pub use machine::machine_bytes;
pub use reserved_vec::{ReservedVec, bytes_of, with_room};

use ravec_progress::{Cancelled, Progress};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Pause between checks for cancellation while a reservation waits.
const CANCEL_POLL: Duration = Duration::from_millis(10);

/// A limit on memory and the account of what is in use. Clones share the account.
///
/// Two budgets are equal if they have the same limit.
#[derive(Clone)]
pub struct MemoryBudget {
    shared: Arc<Shared>,
}

struct Shared {
    limit: u64,
    /// The reservation that this budget divides, if it is a part of another.
    _whole: Option<Reservation>,
    account: Mutex<Account>,
    released: Condvar,
}

#[derive(Default)]
struct Account {
    used: u64,
    peak: u64,
}

/// A need for memory that exceeds its budget.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{needed} bytes are needed, {used} of {limit} bytes are in use")]
pub struct OverBudget {
    /// Requested bytes.
    pub needed: u64,
    /// Bytes that others held at that moment.
    pub used: u64,
    /// The limit of the budget in bytes.
    pub limit: u64,
}

/// The reason why a reservation that may wait was not made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ReserveError {
    /// The need exceeds the limit of the budget, whatever others hold.
    #[error(transparent)]
    OverBudget(#[from] OverBudget),
    /// The caller cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl MemoryBudget {
    /// A budget of `limit` bytes.
    pub fn new(limit: u64) -> Self {
        Self::dividing(limit, None)
    }

    fn dividing(limit: u64, whole: Option<Reservation>) -> Self {
        Self {
            shared: Arc::new(Shared {
                limit,
                _whole: whole,
                account: Mutex::default(),
                released: Condvar::new(),
            }),
        }
    }

    /// A budget without a limit, for data that is trusted.
    pub fn unlimited() -> Self {
        Self::new(u64::MAX)
    }

    /// A budget of half of the memory that this process may use (see [`machine_bytes`]).
    pub fn half_of_machine() -> Self {
        Self::new(machine_bytes() / 2)
    }

    /// The limit in bytes.
    pub fn limit(&self) -> u64 {
        self.shared.limit
    }

    /// Bytes that are reserved now.
    pub fn used(&self) -> u64 {
        self.account().used
    }

    /// Bytes that can be reserved now.
    pub fn available(&self) -> u64 {
        self.limit() - self.used()
    }

    /// The most bytes that were reserved at one time.
    pub fn peak(&self) -> u64 {
        self.account().peak
    }

    /// Reserves `bytes` at once.
    ///
    /// # Errors
    /// [`OverBudget`] if less is available; nothing is reserved then.
    pub fn reserve(&self, bytes: u64) -> Result<Reservation, OverBudget> {
        self.take(&mut self.account(), bytes)?;
        Ok(self.reservation(bytes))
    }

    /// Reserves `bytes` as soon as others have released enough.
    ///
    /// A caller that waits must hold no other reservation of this budget, nor run on a thread that may take up work of a caller
    /// that does: two that wait for one another wait forever.
    ///
    /// # Errors
    /// [`ReserveError::OverBudget`] if `bytes` exceeds the limit of the budget, [`ReserveError::Cancelled`] soon after
    /// `progress` is cancelled.
    pub fn reserve_when_free(
        &self,
        bytes: u64,
        progress: &Progress,
    ) -> Result<Reservation, ReserveError> {
        let mut account = self.account();
        loop {
            progress.check()?;
            match self.take(&mut account, bytes) {
                Ok(()) => return Ok(self.reservation(bytes)),
                Err(over) if bytes > self.limit() => return Err(over.into()),
                Err(_) => {}
            }
            let wait = self.shared.released.wait_timeout(account, CANCEL_POLL);
            account = wait.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// A reservation of nothing, to be grown.
    pub fn reserve_nothing(&self) -> Reservation {
        self.reservation(0)
    }

    fn reservation(&self, bytes: u64) -> Reservation {
        Reservation {
            budget: self.clone(),
            bytes,
        }
    }

    fn account(&self) -> MutexGuard<'_, Account> {
        // the account is two numbers that are always consistent
        let account = self.shared.account.lock();
        account.unwrap_or_else(PoisonError::into_inner)
    }

    fn take(&self, account: &mut Account, bytes: u64) -> Result<(), OverBudget> {
        let limit = self.limit();
        let used = account.used;
        let total = used.checked_add(bytes).filter(|&total| total <= limit);
        let Some(total) = total else {
            return Err(OverBudget {
                needed: bytes,
                used,
                limit,
            });
        };
        account.used = total;
        account.peak = account.peak.max(total);
        Ok(())
    }

    fn release(&self, bytes: u64) {
        if bytes > 0 {
            self.account().used -= bytes;
            self.shared.released.notify_all();
        }
    }
}

/// Half of the memory of the machine.
impl Default for MemoryBudget {
    fn default() -> Self {
        Self::half_of_machine()
    }
}

impl PartialEq for MemoryBudget {
    fn eq(&self, other: &Self) -> bool {
        self.limit() == other.limit()
    }
}

impl Eq for MemoryBudget {}

impl std::fmt::Debug for MemoryBudget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MemoryBudget")
            .field("limit", &self.limit())
            .field("used", &self.used())
            .finish()
    }
}

/// A part of a budget that is in use until this is dropped.
#[derive(Debug)]
#[must_use = "the memory is given back as soon as the reservation is dropped"]
pub struct Reservation {
    budget: MemoryBudget,
    bytes: u64,
}

impl Reservation {
    /// Bytes that this holds.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Reserves `more` bytes in addition.
    ///
    /// # Errors
    /// [`OverBudget`] if less is available; what was reserved stays reserved.
    pub fn grow(&mut self, more: u64) -> Result<(), OverBudget> {
        self.budget.take(&mut self.budget.account(), more)?;
        self.bytes += more;
        Ok(())
    }

    /// Grows to `bytes` if that is more than this holds.
    ///
    /// # Errors
    /// As for [`grow`](Self::grow).
    pub fn grow_to(&mut self, bytes: u64) -> Result<(), OverBudget> {
        self.grow(bytes.saturating_sub(self.bytes))
    }

    /// Gives back all above `bytes`.
    pub fn shrink_to(&mut self, bytes: u64) {
        let surplus = self.bytes.saturating_sub(bytes);
        self.bytes -= surplus;
        self.budget.release(surplus);
    }

    /// A budget that divides this reservation, which is given back with the last clone of that budget and the last of its
    /// reservations.
    ///
    /// ```
    /// use ravec_memory::MemoryBudget;
    ///
    /// let budget = MemoryBudget::new(1000);
    /// let part = budget.reserve(600)?.into_budget();
    /// let pixels = part.reserve(500)?;
    /// assert!(part.reserve(200).is_err());
    /// drop(part);
    /// assert_eq!(budget.used(), 600);
    /// drop(pixels);
    /// assert_eq!(budget.used(), 0);
    /// # Ok::<(), ravec_memory::OverBudget>(())
    /// ```
    pub fn into_budget(self) -> MemoryBudget {
        MemoryBudget::dividing(self.bytes, Some(self))
    }

    /// Joins `other`, which is of the same budget, to this.
    pub fn absorb(&mut self, mut other: Self) {
        debug_assert!(Arc::ptr_eq(&self.budget.shared, &other.budget.shared));
        self.bytes += std::mem::take(&mut other.bytes);
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        self.budget.release(self.bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn reservations_never_exceed_the_limit_together() {
        let budget = MemoryBudget::new(100);
        let mut a = budget.reserve(60).unwrap();
        let over = budget.clone().reserve(41).unwrap_err();
        assert_eq!((over.needed, over.used, over.limit), (41, 60, 100));
        let b = budget.reserve(40).unwrap();
        assert_eq!(budget.available(), 0);
        assert!(a.grow(1).is_err());
        assert_eq!(a.bytes(), 60);
        drop(b);
        a.grow_to(70).unwrap();
        a.grow_to(10).unwrap();
        assert_eq!(budget.used(), 70);
        a.absorb(budget.reserve(5).unwrap());
        a.shrink_to(90);
        assert_eq!((a.bytes(), budget.used()), (75, 75));
        drop(a);
        assert_eq!((budget.used(), budget.peak()), (0, 100));
        assert!(MemoryBudget::unlimited().reserve(u64::MAX).is_ok());
        let all = MemoryBudget::unlimited();
        let most = all.reserve(u64::MAX).unwrap();
        assert!(all.reserve(1).is_err(), "the sum does not wrap");
        drop(most);
    }

    #[test]
    fn a_panic_gives_a_reservation_back() {
        let budget = MemoryBudget::new(10);
        let clone = budget.clone();
        let result = std::panic::catch_unwind(move || {
            let _held = clone.reserve(10).unwrap();
            panic!("on purpose");
        });
        assert!(result.is_err());
        assert_eq!(budget.used(), 0);
    }

    #[test]
    fn threads_that_wait_for_their_share_all_get_it_and_stay_within_the_limit() {
        let (budget, progress) = (MemoryBudget::new(10), Progress::none());
        let (running, highest) = (AtomicU64::new(0), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let share = budget.reserve_when_free(4, &progress).unwrap();
                        let now = running.fetch_add(4, Ordering::SeqCst) + 4;
                        highest.fetch_max(now, Ordering::SeqCst);
                        running.fetch_sub(4, Ordering::SeqCst);
                        drop(share);
                    }
                });
            }
        });
        assert!(highest.into_inner() <= 8);
        assert_eq!(budget.used(), 0);
    }

    #[test]
    fn waiting_ends_for_what_can_never_be_had_and_after_a_cancellation() {
        let (budget, progress) = (MemoryBudget::new(10), Progress::none());
        let error = budget.reserve_when_free(11, &progress).unwrap_err();
        assert!(matches!(error, ReserveError::OverBudget(_)));
        let _held = budget.reserve(10).unwrap();
        progress.cancel();
        let error = budget.reserve_when_free(1, &progress).unwrap_err();
        assert_eq!(error, ReserveError::Cancelled(Cancelled));
    }
}
