//! Lists whose memory is reserved before it is allocated.
//!
//! A list that grows holds its old and its new place for a moment, so both are reserved. It doubles where the budget allows
//! that and takes smaller steps where it does not, so that a file is refused only if an eighth more is too much.

use crate::{MemoryBudget, OverBudget, Reservation};

/// A list that only grows, and whose memory is reserved of a [`MemoryBudget`].
///
/// It is read as a slice.
#[derive(Debug)]
pub struct ReservedVec<T> {
    items: Vec<T>,
    memory: Reservation,
    /// The number of items that a file claims to have. A list does not grow beyond that at once, and takes no memory for the claim.
    expected: usize,
}

/// The bytes that `count` items take.
pub fn bytes_of<T>(count: usize) -> u64 {
    (count as u64).saturating_mul(size_of::<T>() as u64)
}

/// A vector with room for `count` items, a number that is known and not claimed, and its reservation.
///
/// # Errors
/// [`OverBudget`] if the budget has less.
pub fn with_room<T>(
    budget: &MemoryBudget,
    count: usize,
) -> Result<(Vec<T>, Reservation), OverBudget> {
    let memory = budget.reserve(bytes_of::<T>(count))?;
    Ok((Vec::with_capacity(count), memory))
}

impl<T> ReservedVec<T> {
    /// An empty list, which takes no memory.
    pub fn new(budget: &MemoryBudget) -> Self {
        Self {
            items: Vec::new(),
            memory: budget.reserve_nothing(),
            expected: 0,
        }
    }

    /// A list of `items`, whose memory is that of `memory`.
    pub fn from_parts(items: Vec<T>, memory: Reservation) -> Self {
        let expected = items.len();
        Self {
            items,
            memory,
            expected,
        }
    }

    /// Announces that there will be `count` items, if what a file claims is true.
    pub fn expect(&mut self, count: u64) {
        self.expected = usize::try_from(count).unwrap_or(usize::MAX);
    }

    /// Adds an item.
    ///
    /// # Errors
    /// [`OverBudget`] if the list has to grow and the budget has too little; the list is then as it was.
    #[inline]
    pub fn push(&mut self, item: T) -> Result<(), OverBudget> {
        if self.items.len() == self.items.capacity() {
            self.grow(1)?;
        }
        self.items.push(item);
        Ok(())
    }

    /// Adds copies of `items`.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn extend_from_slice(&mut self, items: &[T]) -> Result<(), OverBudget>
    where
        T: Copy,
    {
        self.make_room(items.len())?;
        self.items.extend_from_slice(items);
        Ok(())
    }

    /// Appends copies of `item` until there are `count`.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn fill_up_to(&mut self, count: usize, item: T) -> Result<(), OverBudget>
    where
        T: Copy,
    {
        if count > self.items.len() {
            self.make_room(count - self.items.len())?;
            self.items.resize(count, item);
        }
        Ok(())
    }

    /// Removes the last item. The memory stays reserved.
    pub fn pop(&mut self) -> Option<T> {
        self.items.pop()
    }

    /// Makes room for `more` items.
    ///
    /// # Errors
    /// As [`Self::push`].
    pub fn make_room(&mut self, more: usize) -> Result<(), OverBudget> {
        if more > self.items.capacity() - self.items.len() {
            self.grow(more)?;
        }
        Ok(())
    }

    /// Removes the items that `keep` does not want. The memory stays reserved.
    pub fn retain(&mut self, keep: impl FnMut(&T) -> bool) {
        self.items.retain(keep);
    }

    /// Removes all items. The memory stays reserved.
    pub fn clear(&mut self) {
        self.items.clear();
    }

    #[cold]
    fn grow(&mut self, more: usize) -> Result<(), OverBudget> {
        const MIN: usize = 4;
        let capacity = self.items.capacity();
        let needed = self.items.len().saturating_add(more).max(MIN);
        let mut outcome = Ok(());
        for step in [capacity, capacity / 4, capacity / 8] {
            let mut wanted = capacity.saturating_add(step).max(needed);
            // a step less if the next one would be small
            if (needed..=wanted.saturating_add(wanted / 4)).contains(&self.expected) {
                wanted = self.expected;
            }
            outcome = self.memory.grow(bytes_of::<T>(wanted));
            if outcome.is_ok() {
                self.items.reserve_exact(wanted - self.items.len());
                self.memory.shrink_to(bytes_of::<T>(wanted));
                break;
            }
        }
        outcome
    }

    /// The items with their reservation. Room that was not needed is given back if there is memory for the smaller list.
    pub fn into_parts(self) -> (Vec<T>, Reservation) {
        let Self {
            mut items,
            mut memory,
            ..
        } = self;
        let bytes = bytes_of::<T>(items.len());
        if items.capacity() - items.len() > items.len() / 8 && memory.grow(bytes).is_ok() {
            items.shrink_to_fit();
            memory.shrink_to(bytes_of::<T>(items.capacity()));
        }
        (items, memory)
    }
}

impl<T> std::ops::Deref for ReservedVec<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.items
    }
}

impl<T> std::ops::DerefMut for ReservedVec<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.items
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_reserves_what_it_holds_and_while_it_grows_both_places() {
        let budget = MemoryBudget::new(4000);
        let mut list = ReservedVec::new(&budget);
        for i in 0..400_u32 {
            list.push(i).unwrap();
            assert_eq!(budget.used(), 4 * list.items.capacity() as u64);
        }
        // 256 items and the 512 that follow
        assert_eq!(budget.peak(), 4 * (256 + 512));
        let (items, memory) = list.into_parts();
        assert_eq!((items.capacity(), memory.bytes()), (400, 1600));
    }

    #[test]
    fn a_list_takes_small_steps_where_large_ones_are_too_much_and_ends_at_the_limit() {
        let budget = MemoryBudget::new(1000);
        let mut list = ReservedVec::new(&budget);
        let over = loop {
            if let Err(over) = list.push(0_u8) {
                break over;
            }
            assert!(budget.peak() <= 1000);
        };
        assert!(list.len() >= 1000 * 8 / 17 - 64, "{}", list.len());
        assert_eq!(over.limit, 1000);
    }

    #[test]
    fn a_claim_takes_no_memory_and_ends_the_growth() {
        let budget = MemoryBudget::new(1 << 20);
        let mut list = ReservedVec::new(&budget);
        list.expect(1 << 50);
        list.push(1_u8).unwrap();
        assert!(budget.peak() < 64);
        let mut list = ReservedVec::new(&budget);
        list.expect(300);
        for _ in 0..300 {
            list.push(1_u8).unwrap();
        }
        assert_eq!(list.items.capacity(), 300);
    }
}
