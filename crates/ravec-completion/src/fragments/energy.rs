//! Visibility of the seams of a retouched picture.
//!
//! For two neighbors from different sources: what the one source shows against what the other shows, at both of them. It is
//! what the cut of a step keeps small, summed over a rectangle.

use super::paste::{Way, neighbors};
use super::retouch::{NOBODY, Retouch};
use crate::canvas::{HOLE, Ink};
use crate::error::CompleteError;
use crate::sheet::ink_distance_sq;
use ravec_raster::Rect;
use rustc_hash::FxHashMap;

impl Retouch<'_> {
    /// The sum of what seams cost in a rectangle.
    pub(super) fn energy(&self, bounds: Rect) -> Result<f64, CompleteError> {
        let mut ways: FxHashMap<u32, Way> = FxHashMap::default();
        let mut sum = 0.0f64;
        for row in bounds.row..bounds.bottom() {
            for col in bounds.col..bounds.right() {
                let place = (col, row);
                let owner = self.owners[place];
                for other in neighbors(place, &self.canvas).filter(|other| *other > place) {
                    let owners = [owner, self.owners[other]];
                    let open = |place| self.canvas.states[place] & HOLE != 0;
                    if owners[0] == owners[1] || open(place) || open(other) {
                        continue;
                    }
                    for owner in owners.into_iter().filter(|&owner| owner != NOBODY) {
                        if let std::collections::hash_map::Entry::Vacant(entry) = ways.entry(owner)
                        {
                            entry.insert(self.way_of(owner)?);
                        }
                    }
                    let shown = |owner: u32, at: (usize, usize)| -> Option<Ink> {
                        ways.get(&owner).and_then(|way| way.ink(at))
                    };
                    // what was known from the first shows itself only
                    let off = |at: (usize, usize), own: u32, other: u32| -> Option<f32> {
                        let here = if own == NOBODY {
                            Some(self.canvas.inks[at])
                        } else {
                            shown(own, at)
                        };
                        let there = if other == NOBODY {
                            None
                        } else {
                            shown(other, at)
                        };
                        Some(ink_distance_sq(&here?, &there?))
                    };
                    let first = off(place, owners[0], owners[1]);
                    let second = off(other, owners[1], owners[0]);
                    sum += f64::from(match (first, second) {
                        (Some(a), Some(b)) => a + b,
                        (Some(a), None) | (None, Some(a)) => 2.0 * a,
                        (None, None) => 0.0,
                    });
                }
            }
        }
        Ok(sum)
    }
}
