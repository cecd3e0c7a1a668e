//! Disjoint sets as a list of parents.

/// The smallest member of the set that holds `at`. Sets are joined by lowering a root, never split.
pub(crate) fn root(parents: &mut [u32], mut at: u32) -> u32 {
    while parents[at as usize] != at {
        let above = parents[parents[at as usize] as usize];
        parents[at as usize] = above;
        at = above;
    }
    at
}
