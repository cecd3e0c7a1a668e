//! Photos for all tiles where taking the cheapest led into a dead end.
//!
//! A search with steps back: of the empty tiles that with the fewest photos left is filled, the cheapest photo first. Photos
//! that are nowhere yet are as good as one another for what can be done at all, so only the cheapest of them is tried,
//! unless some are banned at single tiles.
//!
//! Source: the order is that of Brélaz, "New Methods to Color the Vertices of a Graph", 1979.
//!
//! Guarantees: if all photos fit under the rules and the steps suffice, a way is found. Does not guarantee: a cheap one; the
//! improvement comes afterwards.

use crate::choose::Problem;
use crate::rules::Placement;
use crate::search::Near;
use ravec_progress::{Cancelled, Progress};

/// Tiles times photos up to which it is tried: the costs of a step grow with both.
const MAX_PAIRS: usize = 4096;

/// Photos that are put into a tile before the search is given up. Ten tiles that are all too near for ten photos are settled
/// in a hundredth of that.
const MAX_STEPS: usize = 20_000;

/// Fills all tiles anew but those that are pinned. Returns whether that was possible; if not, tiles are empty.
pub(crate) fn fill(
    problem: &Problem<'_>,
    placement: &mut Placement<'_>,
    progress: &Progress,
) -> Result<bool, Cancelled> {
    let tiles = problem.tiles.len();
    for tile in (0..tiles).filter(|&tile| problem.hand.pinned(tile).is_none()) {
        placement.put(tile, None);
    }
    let different = problem.photos.different();
    if tiles.saturating_mul(different) > MAX_PAIRS {
        return Ok(false);
    }
    let mut search = Search {
        options: (0..tiles).map(|tile| problem.everything(tile)).collect(),
        different,
        alike: !problem.hand.has_bans_of_tiles(),
        steps: 0,
        progress,
    };
    search.go(placement)
}

struct Search<'a> {
    /// For each tile the nearest photo of each group.
    options: Vec<Vec<Near>>,
    different: usize,
    /// True if photos that are nowhere yet are as good as one another.
    alike: bool,
    steps: usize,
    progress: &'a Progress,
}

impl Search<'_> {
    fn go(&mut self, placement: &mut Placement<'_>) -> Result<bool, Cancelled> {
        self.progress.check()?;
        let empty: Vec<usize> = (0..self.options.len())
            .filter(|&tile| placement.photo(tile).is_none())
            .collect();
        if placement.rules.use_all {
            let unused = (0..self.different).filter(|&group| {
                placement.tiles_of(group).is_empty() && !placement.is_banned_everywhere(group)
            });
            if unused.count() > empty.len() {
                return Ok(false);
            }
        }
        let left = |&tile: &usize| {
            let options = self.options[tile].iter();
            options
                .filter(|near| placement.allows(tile, near.photo))
                .count()
        };
        let Some(tile) = empty.into_iter().min_by_key(left) else {
            return Ok(true);
        };
        let mut tried_new = false;
        for option in 0..self.options[tile].len() {
            let photo = self.options[tile][option].photo;
            let new = placement.tiles_of(placement.group(photo)).is_empty();
            if (new && tried_new && self.alike) || !placement.allows(tile, photo) {
                continue;
            }
            tried_new |= new;
            if self.steps == MAX_STEPS {
                return Ok(false);
            }
            self.steps += 1;
            placement.put(tile, Some(photo));
            if self.go(placement)? {
                return Ok(true);
            }
            placement.put(tile, None);
        }
        Ok(false)
    }
}
