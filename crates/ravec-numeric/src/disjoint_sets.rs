//! Sets that are joined but never split.

/// Disjoint sets of the numbers below a count, by Tarjan's union-find with path halving.
///
/// ```
/// use ravec_numeric::DisjointSets;
///
/// let mut sets = DisjointSets::new(5);
/// sets.join(3, 1);
/// sets.join(4, 3);
/// assert_eq!([0, 1, 2, 3, 4].map(|i| sets.root(i)), [0, 1, 2, 1, 1]);
/// assert_eq!(sets.numbered(), (3, vec![0, 1, 2, 1, 1]));
/// ```
///
/// Guarantees: the smallest member of a set is its root, in whatever order sets were joined, unless
/// [`DisjointSets::join_into`] chose another one.
///
/// Cost: 4 bytes a number; nearly constant time for each call.
#[derive(Debug, Clone, Default)]
pub struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    /// Each number below `len` alone.
    pub fn new(len: usize) -> Self {
        Self {
            parent: (0..len as u32).collect(),
        }
    }

    /// Count of the numbers.
    pub fn len(&self) -> usize {
        self.parent.len()
    }

    /// True if there are no numbers.
    pub fn is_empty(&self) -> bool {
        self.parent.is_empty()
    }

    /// Adds the next number, alone, and returns it.
    pub fn push(&mut self) -> u32 {
        let next = self.parent.len() as u32;
        self.parent.push(next);
        next
    }

    /// The number that stands for the set of `i`.
    ///
    /// # Panics
    /// If `i` is not below the count.
    pub fn root(&mut self, mut i: u32) -> u32 {
        while self.parent[i as usize] != i {
            let up = self.parent[self.parent[i as usize] as usize];
            self.parent[i as usize] = up;
            i = up;
        }
        i
    }

    /// Makes one set of those of `i` and `j`; the smaller of both roots stands for it.
    ///
    /// # Panics
    /// If one of them is not below the count.
    pub fn join(&mut self, i: u32, j: u32) {
        let (i, j) = (self.root(i), self.root(j));
        self.parent[i.max(j) as usize] = i.min(j);
    }

    /// Makes one set of those of `i` and `leader`; the root of `leader` stands for it.
    ///
    /// # Panics
    /// If one of them is not below the count.
    pub fn join_into(&mut self, i: u32, leader: u32) {
        let (i, leader) = (self.root(i), self.root(leader));
        self.parent[i as usize] = leader;
    }

    /// The number of sets, and for each member the number of its set; sets are in the order of their first members.
    pub fn numbered(mut self) -> (u32, Vec<u32>) {
        let mut number = vec![u32::MAX; self.parent.len()];
        let mut count = 0;
        for i in 0..self.parent.len() as u32 {
            let root = self.root(i) as usize;
            if number[root] == u32::MAX {
                number[root] = count;
                count += 1;
            }
            number[i as usize] = number[root];
        }
        (count, number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn sets_are_those_of_the_definition(joins in prop::collection::vec((0u32..24, 0u32..24, any::<bool>()), 0..30)) {
            let mut sets = DisjointSets::new(20);
            for _ in 20..24 {
                sets.push();
            }
            // the set of each number, renamed as a whole with each join
            let mut truth: Vec<u32> = (0..24).collect();
            for (i, j, into) in joins {
                let (a, b) = (truth[i as usize], truth[j as usize]);
                let stays = if into { b } else { a.min(b) };
                for set in truth.iter_mut().filter(|set| **set == a || **set == b) {
                    *set = stays;
                }
                if into { sets.join_into(i, j) } else { sets.join(i, j) }
            }
            for (i, &set) in truth.iter().enumerate() {
                prop_assert_eq!(sets.root(i as u32), set);
            }
            let (count, numbers) = sets.numbered();
            let mut first: Vec<u32> = Vec::new();
            for (&set, &number) in truth.iter().zip(&numbers) {
                let at = first.iter().position(|&other| other == set).unwrap_or_else(|| {
                    first.push(set);
                    first.len() - 1
                });
                prop_assert_eq!(number as usize, at);
            }
            prop_assert_eq!(count as usize, first.len());
        }
    }
}
