//! The cheapest assignment of photos to tiles under limits on their number alone: successive shortest paths.
//!
//! Each tile gets one photo, each photo at most as many tiles as it has capacity. Tiles that can have their cheapest photo
//! get it; each further one is put in along a shortest path of exchanges, found by Dijkstra's algorithm on costs that are
//! reduced by prices. The rule that a photo is used is enforced by a bonus on its first use that outweighs all costs.
//!
//! Source: Jonker, Volgenant, "A Shortest Augmenting Path Algorithm for Dense and Sparse Linear Assignment Problems", 1987,
//! with capacities. Guarantees: an optimum up to rounding of doubles. Cost: tiles² × photos at worst, far less as a rule;
//! memory that of the costs.

use ravec_progress::{Cancelled, Progress};

/// The cheapest assignment: for each tile its photo. `costs` has for each tile those of all photos; the capacities add up to
/// at least the number of tiles, and of photos that are `required` to be used there are at most as many as tiles.
pub(crate) fn cheapest(
    costs: &[f32],
    capacity: &[u32],
    required: &[bool],
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let photos = capacity.len();
    let tiles = costs.len() / photos;
    let largest = costs.iter().fold(0.0f32, |most, &cost| most.max(cost));
    let use_all = required.contains(&true);
    let bonus = f64::from(largest) * tiles as f64 + 1.0;
    // with a bonus, a photo is two columns: its first use and the others
    let mut room: Vec<usize> = capacity.iter().map(|&uses| uses as usize).collect();
    if use_all {
        for room in &mut room {
            *room = (*room).min(1);
        }
        room.extend(
            capacity
                .iter()
                .map(|&uses| (uses as usize).saturating_sub(1)),
        );
    }
    let columns = room.len();
    let mut first_use = vec![0.0; columns];
    if use_all {
        for (first_use, &required) in first_use.iter_mut().zip(required) {
            *first_use = if required { bonus } else { 0.0 };
        }
    }
    // the costs of a tile for all columns
    let costs_of = |tile: usize| {
        let row = &costs[tile * photos..][..photos];
        let both = row.iter().chain(if use_all { row } else { &[] });
        both.zip(&first_use)
            .map(|(&cost, bonus)| f64::from(cost) - bonus)
    };
    let mut solver = Solver {
        tile_price: vec![0.0; tiles],
        column_price: vec![0.0; columns],
        column_of: vec![usize::MAX; tiles],
        tiles_of: vec![Vec::new(); columns],
    };
    let phase = progress.phase("assign", tiles as u64);
    let mut later = Vec::new();
    for tile in 0..tiles {
        let cheapest = costs_of(tile)
            .enumerate()
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let (best, cost) = cheapest.unwrap_or((0, 0.0));
        solver.tile_price[tile] = cost;
        if solver.tiles_of[best].len() < room[best] {
            solver.tiles_of[best].push(tile as u32);
            solver.column_of[tile] = best;
            phase.advance(1);
        } else {
            later.push(tile);
        }
    }
    for tile in later {
        progress.check()?;
        solver.insert(tile, &costs_of, &room);
        phase.advance(1);
    }
    Ok(solver
        .column_of
        .iter()
        .map(|&column| (column % photos) as u32)
        .collect())
}

struct Solver {
    tile_price: Vec<f64>,
    /// Not above 0, and 0 where there is room.
    column_price: Vec<f64>,
    column_of: Vec<usize>,
    tiles_of: Vec<Vec<u32>>,
}

impl Solver {
    fn insert<I: Iterator<Item = f64>>(
        &mut self,
        tile: usize,
        costs_of: &impl Fn(usize) -> I,
        room: &[usize],
    ) {
        let columns = self.column_price.len();
        let mut distance = vec![f64::INFINITY; columns];
        let mut from = vec![usize::MAX; columns];
        // the distance where it may still fall; closed columns cannot be reached on a shorter way. A column without room for
        // anything leads nowhere.
        let mut open = distance.clone();
        for (open, &room) in open.iter_mut().zip(room) {
            if room == 0 {
                *open = f64::NEG_INFINITY;
            }
        }
        let mut closed = Vec::new();
        let mut scanned = vec![(tile, 0.0)];
        let mut next = 0;
        let last = loop {
            for &(row, base) in &scanned[next..] {
                let base: f64 = base - self.tile_price[row];
                let prices = self.column_price.iter();
                let ways = open.iter_mut().zip(from.iter_mut());
                for ((cost, price), (open, from)) in costs_of(row).zip(prices).zip(ways) {
                    let through = base + cost - price;
                    if through < *open {
                        *open = through;
                        *from = row;
                    }
                }
            }
            next = scanned.len();
            let mut nearest = (f64::INFINITY, usize::MAX);
            for (column, &open) in open.iter().enumerate() {
                if open < nearest.0 && open != f64::NEG_INFINITY {
                    nearest = (open, column);
                }
            }
            let (length, column) = nearest;
            // some column has room, as the caller knows; were there none, the tile would stay without
            if column == usize::MAX {
                return;
            }
            distance[column] = length;
            open[column] = f64::NEG_INFINITY;
            closed.push(column);
            if self.tiles_of[column].len() < room[column] {
                break column;
            }
            scanned.extend(
                self.tiles_of[column]
                    .iter()
                    .map(|&row| (row as usize, length)),
            );
        };
        let length = distance[last];
        for column in closed {
            self.column_price[column] += (distance[column] - length).min(0.0);
        }
        for (row, base) in scanned {
            self.tile_price[row] += (length - base).max(0.0);
        }
        let mut column = last;
        loop {
            let row = from[column];
            let old = std::mem::replace(&mut self.column_of[row], column);
            self.tiles_of[column].push(row as u32);
            if row == tile {
                return;
            }
            self.tiles_of[old].retain(|&other| other as usize != row);
            column = old;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The least total of all assignments.
    fn brute_force(costs: &[f32], capacity: &[u32], required: &[bool]) -> Option<f64> {
        fn go(
            costs: &[f32],
            left: &mut [u32],
            used: &mut [bool],
            required: &[bool],
        ) -> Option<f64> {
            if costs.is_empty() {
                let mut missing = required
                    .iter()
                    .zip(used)
                    .filter(|(required, used)| **required && !**used);
                return missing.next().is_none().then_some(0.0);
            }
            let (row, rest) = costs.split_at(left.len());
            let mut best: Option<f64> = None;
            for photo in 0..left.len() {
                if left[photo] == 0 {
                    continue;
                }
                left[photo] -= 1;
                let before = std::mem::replace(&mut used[photo], true);
                if let Some(total) = go(rest, left, used, required) {
                    let total = total + f64::from(row[photo]);
                    best = Some(best.map_or(total, |best| best.min(total)));
                }
                used[photo] = before;
                left[photo] += 1;
            }
            best
        }
        let mut left = capacity.to_vec();
        go(costs, &mut left, &mut vec![false; capacity.len()], required)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]
        #[test]
        fn the_total_is_that_of_brute_force(
            photos in 1usize..5, tiles in 1usize..6, numbers in proptest::collection::vec(0u32..20, 25),
            capacities in proptest::collection::vec(0u32..4, 5), required in proptest::collection::vec(proptest::bool::ANY, 5),
        ) {
            let costs: Vec<f32> = numbers.iter().cycle().take(photos * tiles).map(|&n| n as f32).collect();
            let capacity = &capacities[..photos];
            prop_assume!(capacity.iter().sum::<u32>() as usize >= tiles);
            let required: Vec<bool> = required[..photos].iter().zip(capacity).map(|(&required, &uses)| required && uses > 0).collect();
            prop_assume!(required.iter().filter(|&&required| required).count() <= tiles);
            let found = cheapest(&costs, capacity, &required, &Progress::none()).unwrap();
            let mut uses = vec![0; photos];
            let mut total = 0.0;
            for (tile, &photo) in found.iter().enumerate() {
                uses[photo as usize] += 1;
                total += f64::from(costs[tile * photos + photo as usize]);
            }
            prop_assert!(uses.iter().zip(capacity).all(|(uses, most)| uses <= most));
            prop_assert!(uses.iter().zip(&required).all(|(&uses, &required)| uses > 0 || !required));
            // whole numbers add without rounding
            prop_assert_eq!(Some(total), brute_force(&costs, capacity, &required));
        }
    }
}
