//! Edits for intersections that the final search finds.

use super::{Repair, Workspace, rounds::Round};
use crate::grow::{Halt, Refinement};
use crate::params::OffsetError;
use crate::prove::separate;
use crate::store::ChunkedSurface;
use crate::surface::Edits;
use ravec_octree::{CellKey, Corner};
use ravec_progress::Progress;

impl<'a> Repair<'a> {
    /// Returns edits that separate triangles from others that they intersect, given by block and number, sorted.
    pub(super) fn edits_to_separate(
        &self,
        surface: &ChunkedSurface,
        workspace: &Workspace<'a>,
        triangles: &[[u32; 2]],
        round: Round<'_>,
        progress: &Progress,
    ) -> Result<Edits, OffsetError> {
        let mut next = Edits::default();
        let mut last: Option<(CellKey, Refinement<'a>)> = None;
        for of_block in triangles.chunk_by(|a, b| a[0] == b[0]) {
            let block = of_block[0][0] as usize;
            let start = surface.blocks()[block].key.at;
            let known = last.take_if(|(key, _)| key.owns(start));
            let (key, refinement) = match known {
                Some(known) => known,
                None => self.tree_around(start, workspace, round, progress)?,
            };
            let patch = surface.patch(block)?;
            for &[_, t] in of_block {
                let edge = patch.edges[patch.edge_of[t as usize] as usize];
                let leaves = refinement.leaves_around(edge);
                separate(&refinement, &leaves, round.levels, &mut next);
            }
            last = Some((key, refinement));
        }
        Ok(next)
    }

    /// Returns the tree of the tile that holds a place.
    fn tree_around(
        &self,
        place: Corner,
        workspace: &Workspace<'a>,
        round: Round<'_>,
        progress: &Progress,
    ) -> Result<(CellKey, Refinement<'a>), OffsetError> {
        let mut key = CellKey::ROOT;
        if let Workspace::Tiled(scratch, tiles) = workspace {
            let tile = tiles.iter().find(|tile| tile.key.owns(place));
            let tile = tile.expect("tiles cover all of space");
            match tile.refinement(self.setting, usize::MAX, scratch) {
                // a lost tile is grown again
                Err(OffsetError::MissingPart { .. }) => key = tile.key,
                found => return Ok((tile.key, found?)),
            }
        }
        match Refinement::grow(self.setting, key, round.edits, usize::MAX, progress) {
            Ok(refinement) => Ok((key, refinement)),
            Err(Halt::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(Halt::TooLarge) => unreachable!("any number of nodes is allowed"),
        }
    }
}
