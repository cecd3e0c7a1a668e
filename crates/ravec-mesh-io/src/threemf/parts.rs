//! The names of the parts that a model is in, each with a number.

use std::collections::HashMap;

use ravec_memory::{MemoryBudget, OverBudget, Reservation};

use ravec_memory::ReservedVec;

/// All parts that are needed, the root first.
pub(super) struct Parts {
    names: ReservedVec<String>,
    numbers: HashMap<String, u32>,
    memory: Reservation,
}

impl Parts {
    pub(super) fn new(budget: &MemoryBudget) -> Self {
        Self {
            names: ReservedVec::new(budget),
            numbers: HashMap::new(),
            memory: budget.reserve_nothing(),
        }
    }

    /// The number of the part at `path`, which is added if it is new.
    pub(super) fn number(&mut self, path: &str) -> Result<u32, OverBudget> {
        // the name twice, and 33 bytes for each of up to 3.5 places of a table that grows
        const EACH: u64 = 160;
        self.memory.grow(2 * path.len() as u64 + EACH)?;
        let key = path.trim_start_matches('/').to_ascii_lowercase();
        if let Some(&number) = self.numbers.get(&key) {
            self.memory
                .shrink_to(self.memory.bytes() - 2 * path.len() as u64 - EACH);
            return Ok(number);
        }
        let number = self.names.len() as u32;
        self.names.push(path.to_owned())?;
        self.numbers.insert(key, number);
        Ok(number)
    }

    /// The path of part `number`.
    pub(super) fn path(&self, number: usize) -> Option<&str> {
        self.names.get(number).map(String::as_str)
    }
}
