//! The surface, mended until it is proved and does not meet itself.
//!
//! All of space is grown and cut into triangles; cells of triangles that are not proved, or meet others, are split; what
//! depends on these cells is done again. Every round sees the orders of the rounds before and no others, so that what comes
//! out does not depend on how space is cut.
//!
//! Trees are kept from round to round, and only the surface near what changed is cut anew. If the tree of all of space does not
//! fit in memory, tiles are grown one after the other, each cut into eight if it would take too much, and are kept in a storage,
//! from which those come back that changes concern.

use crate::extract::{CrossingPlaces, extract};
use crate::judge::{Bad, Judge, Wanted, separate};
use crate::params::OffsetError;
use crate::pieces::{Pieces, Visibility};
use crate::refine::{Halt, Refinement, Setting};
use crate::scope::Scope;
use crate::space::{Grown, Space, Tile, block, blocks};
use crate::store::{Block, NewStorage, Scratch, Store};
use crate::tile::{Orders, Patch};
use ravec_octree::{CellKey, Corner, NodeId};
use ravec_progress::Progress;

/// Rounds of mending after which what is left is reported.
const MOST_ROUNDS: u32 = 200;

/// As [`MOST_ROUNDS`] where the surface is made of the triangles themselves: what 40 rounds do not mend, more do not.
const MOST_ROUNDS_OF_SURFACE: u32 = 40;

/// Rounds after which cells are split by one more level at once.
const HASTE: u32 = 32;

/// A surface of more triangles than this, made of the input's triangles themselves, is given up if a round makes it larger
/// by this factor: that far from being mended, it would take minutes and end as crowded. Those that could be mended grew
/// by a third in a round at most.
const LARGE: usize = 500_000;
const MOST_GROWTH: f64 = 1.6;

/// Tiles of fewer cells along a side are not cut any more: they are hardly larger than what they depend on.
const LEAST_CELLS: f64 = 16.0;

/// How much may be in memory at once.
#[derive(Clone, Copy)]
pub(crate) struct Budget<'a> {
    /// Nodes of a tree.
    pub nodes: usize,
    /// Triangles of the surface, with all that is found out about them together.
    pub triangles: usize,
    /// Where there is room for more.
    pub storage: NewStorage<'a>,
}

/// What to mend, and how far.
pub(crate) struct Mending<'a> {
    pub setting: Setting<'a>,
    /// The least and the largest distance that a point of the surface may have.
    pub limits: [f64; 2],
    /// Whether to drop what cannot be reached from far away.
    pub outer_only: bool,
    pub budget: Budget<'a>,
}

/// The surface, and what it took.
pub(crate) struct Mended {
    pub surface: Pieces,
    /// Whether all is proved, and triangles meet nowhere.
    pub is_proved: bool,
    /// The nearest that triangles with ample room below them come.
    pub ample_distance: f64,
    /// Leaves of the tree, and their finest level.
    pub cells: u64,
    pub deepest_level: u8,
    pub tiles: u64,
    pub rounds: u32,
    /// Leaves that were split, and corners that were filled, to mend the surface.
    pub split: u64,
    pub filled: u64,
}

/// What a round is about.
#[derive(Clone, Copy)]
struct Round<'o> {
    /// All that was ordered before, and what of it is new.
    orders: &'o Orders,
    latest: &'o Orders,
    /// How many levels cells are split by at once.
    levels: u8,
}

impl<'a> Mending<'a> {
    pub fn run(&self, progress: &Progress) -> Result<Mended, OffsetError> {
        let mut space = Space::Nothing;
        let mut orders = Orders::default();
        let mut latest = Orders::default();
        let mut rounds = 0;
        let mut size = 0;
        let most_rounds = if self.setting.field.level == 0.0 {
            MOST_ROUNDS_OF_SURFACE
        } else {
            MOST_ROUNDS
        };
        loop {
            let levels = self.levels(rounds);
            let round = Round {
                orders: &orders,
                latest: &latest,
                levels,
            };
            let mut wanted = Wanted::default();
            space = self.advance(space, round, &mut wanted, progress)?;
            let mut next = wanted.orders(&self.setting, levels);
            let extracted = space.triangles();
            let before = std::mem::replace(&mut size, extracted);
            let grows = before > 0 && extracted as f64 > MOST_GROWTH * before as f64;
            if self.setting.field.level == 0.0 && extracted > LARGE && grows {
                return Err(OffsetError::TooRough {
                    tolerance: self.setting.tolerance,
                });
            }
            if next.is_empty() || rounds == most_rounds {
                let (cells, deepest_level) = space.counted();
                let tiles = space.tiles();
                let blocks;
                (space, blocks) = self.finished(space, progress)?;
                let visibility = if self.outer_only {
                    Visibility::Reachable
                } else {
                    Visibility::All
                };
                let (store, blocks) = blocks;
                let most_triangles = self.budget.triangles;
                let surface = Pieces::new(store, blocks, most_triangles, visibility, progress)?;
                let mut is_proved = surface.blocks().iter().all(|block| block.is_proved);
                if is_proved {
                    // only crowded cells let triangles meet, and these were searched: this is to be sure
                    let bad = surface.meeting(progress)?;
                    is_proved = bad.is_empty();
                    next = self.separation(&surface, &space, &bad, round, progress)?;
                }
                if next.is_empty() || rounds == most_rounds {
                    return Ok(Mended {
                        surface,
                        is_proved,
                        ample_distance: self.judge().ample_distance(),
                        cells,
                        deepest_level,
                        tiles,
                        rounds,
                        split: orders.split.len() as u64,
                        filled: orders.filled.len() as u64,
                    });
                }
            }
            rounds += 1;
            orders.extend(&next);
            latest = next;
        }
    }

    fn judge(&self) -> Judge<'a> {
        Judge {
            setting: self.setting,
            limits: self.limits,
        }
    }

    /// How many levels a cell is split by at once. Each round costs as much as thousands of cells, and what several did not
    /// mend are gaps that close along a front: one level at a time, it stops at every cell for as many rounds as it is large.
    /// Where triangles of the input meet, one halving rarely parts them.
    fn levels(&self, rounds: u32) -> u8 {
        if self.setting.field.level == 0.0 {
            2
        } else {
            1 + (rounds / HASTE).min(2) as u8
        }
    }

    /// Makes what is not there yet, and does again what the latest orders concern.
    fn advance(
        &self,
        space: Space<'a>,
        round: Round<'_>,
        wanted: &mut Wanted,
        progress: &Progress,
    ) -> Result<Space<'a>, OffsetError> {
        let root = CellKey::ROOT;
        let whole = match space {
            Space::Nothing => self
                .grown(root, self.budget.nodes, round, wanted, progress)
                .map(Box::new),
            Space::Whole(whole) => self.mended(whole, round, wanted, progress),
            Space::Cut(scratch, tiles) => {
                let mut done = Vec::with_capacity(tiles.len());
                for tile in tiles {
                    self.redo(tile, &scratch, &mut done, round, wanted, progress)?;
                }
                return Ok(Space::Cut(scratch, done));
            }
        };
        match whole {
            Ok(whole) => Ok(Space::Whole(whole)),
            Err(Halt::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(Halt::TooLarge) => {
                let scratch = Scratch::new(self.budget.storage)?;
                let mut tiles = vec![];
                self.add_parts(root, &scratch, &mut tiles, round, wanted, progress)?;
                Ok(Space::Cut(scratch, tiles))
            }
        }
    }

    /// Grows a tile, cuts it into triangles and judges these.
    fn grown(
        &self,
        key: CellKey,
        most_nodes: usize,
        round: Round<'_>,
        wanted: &mut Wanted,
        progress: &Progress,
    ) -> Result<Grown<'a>, Halt> {
        let refinement = Refinement::grow(self.setting, key, round.orders, most_nodes, progress)?;
        let mut grown = Grown {
            key,
            refinement,
            places: CrossingPlaces::default(),
            bad: Bad::default(),
            patch: Patch::default(),
        };
        self.cut(&mut grown, Scope::Tile(key), round.levels, wanted, progress)?;
        Ok(grown)
    }

    /// Does what is new, cuts the surface around it into triangles and judges these.
    fn mended(
        &self,
        mut grown: Box<Grown<'a>>,
        round: Round<'_>,
        wanted: &mut Wanted,
        progress: &Progress,
    ) -> Result<Box<Grown<'a>>, Halt> {
        let key = grown.key;
        let mut changed = grown
            .refinement
            .mend(key, round.orders, round.latest, progress)?;
        changed.append(&mut grown.bad.leaves);
        let scope = Scope::around(key, changed, &grown.refinement, progress)?;
        self.cut(&mut grown, scope, round.levels, wanted, progress)?;
        Ok(grown)
    }

    /// Cuts what is asked for into triangles and judges these.
    fn cut(
        &self,
        grown: &mut Grown<'a>,
        mut scope: Scope,
        levels: u8,
        wanted: &mut Wanted,
        progress: &Progress,
    ) -> Result<(), Halt> {
        let refinement = &grown.refinement;
        let extracted = extract(refinement, &mut scope, &mut grown.places, progress)?;
        let mut patch = extracted.patch(refinement, &scope, progress)?;
        (grown.bad, patch.proofs) = self.judge().judge(
            &grown.patch,
            refinement,
            (&extracted, &scope),
            levels,
            wanted,
            progress,
        )?;
        drop(extracted);
        match &scope {
            Scope::Tile(_) => grown.patch = patch,
            Scope::Changes(near) => {
                let tree = &refinement.tree;
                let is_gone = |&leaf: &NodeId| !tree.is_leaf(leaf) || near.is_affected(leaf);
                let is_gone = |leaves: &[NodeId; 4]| leaves.iter().any(is_gone);
                grown.patch.replace(is_gone, patch, progress)?;
            }
        }
        Ok(())
    }

    /// How many nodes a tile may have: any number if it is hardly larger than what it depends on.
    fn most_nodes(&self, tile: CellKey) -> usize {
        // the chords of a facet of this size leave a sphere by the tolerance
        let cell = (8.0 * self.setting.field.radius() * self.setting.tolerance).sqrt();
        let may_be_cut = self.setting.frame.side_at(tile.level) >= LEAST_CELLS * cell;
        if may_be_cut {
            self.budget.nodes
        } else {
            usize::MAX
        }
    }

    /// Grows a tile, or its parts if it would take too much, and puts them in the storage.
    fn add_tiles(
        &self,
        tile: CellKey,
        scratch: &Scratch,
        tiles: &mut Vec<Tile>,
        round: Round<'_>,
        wanted: &mut Wanted,
        progress: &Progress,
    ) -> Result<(), OffsetError> {
        let mut of_tile = Wanted::default();
        match self.grown(tile, self.most_nodes(tile), round, &mut of_tile, progress) {
            Ok(grown) => {
                wanted.extend(of_tile);
                tiles.push(Tile::put(grown, scratch, None)?);
            }
            Err(Halt::Cancelled(cancelled)) => return Err(cancelled.into()),
            Err(Halt::TooLarge) => {
                self.add_parts(tile, scratch, tiles, round, wanted, progress)?;
            }
        }
        Ok(())
    }

    /// [`Self::add_tiles`] for the eight parts of a tile.
    fn add_parts(
        &self,
        tile: CellKey,
        scratch: &Scratch,
        tiles: &mut Vec<Tile>,
        round: Round<'_>,
        wanted: &mut Wanted,
        progress: &Progress,
    ) -> Result<(), OffsetError> {
        for part in (0..8).map(|octant| tile.child(octant)) {
            self.add_tiles(part, scratch, tiles, round, wanted, progress)?;
        }
        Ok(())
    }

    /// Mends a tile if the latest orders concern it.
    fn redo(
        &self,
        tile: Tile,
        scratch: &Scratch,
        done: &mut Vec<Tile>,
        round: Round<'_>,
        wanted: &mut Wanted,
        progress: &Progress,
    ) -> Result<(), OffsetError> {
        progress.check()?;
        if !round.latest.concern(&tile.reach) {
            done.push(tile);
            return Ok(());
        }
        let places = [tile.tree, tile.patch];
        let key = tile.key;
        let most_nodes = self.most_nodes(key);
        // it is better to keep a tile that has grown a little
        let most_nodes = most_nodes.saturating_add(most_nodes / 4);
        let grown = tile.get(self.setting, most_nodes, scratch)?;
        let mut of_tile = Wanted::default();
        match self.mended(Box::new(grown), round, &mut of_tile, progress) {
            Ok(grown) => {
                wanted.extend(of_tile);
                done.push(Tile::put(*grown, scratch, Some(places))?);
                Ok(())
            }
            Err(Halt::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(Halt::TooLarge) => self.add_parts(key, scratch, done, round, wanted, progress),
        }
    }

    /// The surface in blocks, one if it fits in memory; and the space without what can be grown again.
    fn finished(
        &self,
        space: Space<'a>,
        progress: &Progress,
    ) -> Result<(Space<'a>, (Store, Vec<Block>)), OffsetError> {
        match space {
            Space::Nothing => unreachable!("there was a round"),
            Space::Whole(whole) => {
                let (key, bad, patch) = whole.without_tree();
                let patch = patch.finished();
                let made = if patch.triangles.len() > self.budget.triangles {
                    let store = Store::Storage(Scratch::new(self.budget.storage)?);
                    let blocks = blocks(key, &patch, &bad, &store, progress)?;
                    (store, blocks)
                } else {
                    let mut block = block(key, patch, &Store::Memory)?;
                    block.is_proved = bad.starts.is_empty();
                    (Store::Memory, vec![block])
                };
                Ok((Space::Nothing, made))
            }
            Space::Cut(scratch, tiles) => {
                let store = Store::Storage(Scratch::new(self.budget.storage)?);
                let mut all = vec![];
                for tile in &tiles {
                    progress.check()?;
                    let patch = scratch.patch(tile.patch)?.finished();
                    all.extend(blocks(tile.key, &patch, &tile.bad, &store, progress)?);
                }
                Ok((Space::Cut(scratch, tiles), (store, all)))
            }
        }
    }

    /// Orders what separates triangles from others that they meet, given by their blocks and their numbers there, in order.
    fn separation(
        &self,
        surface: &Pieces,
        space: &Space<'a>,
        triangles: &[[u32; 2]],
        round: Round<'_>,
        progress: &Progress,
    ) -> Result<Orders, OffsetError> {
        let mut next = Orders::default();
        let mut last: Option<(CellKey, Refinement<'a>)> = None;
        for of_block in triangles.chunk_by(|a, b| a[0] == b[0]) {
            let block = of_block[0][0] as usize;
            let start = surface.blocks()[block].key.at;
            let known = last.take_if(|(key, _)| key.owns(start));
            let (key, refinement) = match known {
                Some(known) => known,
                None => self.tree_around(start, space, round, progress)?,
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

    /// The tree of the tile that holds a place.
    fn tree_around(
        &self,
        place: Corner,
        space: &Space<'a>,
        round: Round<'_>,
        progress: &Progress,
    ) -> Result<(CellKey, Refinement<'a>), OffsetError> {
        if let Space::Cut(scratch, tiles) = space {
            let tile = tiles.iter().find(|tile| tile.key.owns(place));
            let tile = tile.expect("tiles cover all of space");
            let refinement = tile.refinement(self.setting, usize::MAX, scratch)?;
            return Ok((tile.key, refinement));
        }
        let key = CellKey::ROOT;
        match Refinement::grow(self.setting, key, round.orders, usize::MAX, progress) {
            Ok(refinement) => Ok((key, refinement)),
            Err(Halt::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(Halt::TooLarge) => unreachable!("any number of nodes is allowed"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::enclosed::Enclosed;
    use crate::field::{Field, Solid};
    use crate::grid::Grid;
    use crate::measure::{Ample, measure};
    use crate::params::{Coordinates, Side};
    use crate::store::in_memory;
    use glam::{DMat3, DVec3, EulerRot};
    use ravec_mesh::{Bvh, TriMesh};
    use ravec_octree::Frame;
    use ravec_scenes::solids::{comb, wedge};

    /// Overlapping plates and needles, some of them repeated or without area.
    fn soup(seed: u64) -> TriMesh {
        let mut state = seed;
        let mut random = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1u32 << 31)
        };
        let mut positions: Vec<DVec3> = (0..24)
            .map(|_| DVec3::new(random(), random(), random()))
            .collect();
        positions[7] = positions[6];
        let triangles = (0..8).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        TriMesh::new(positions, triangles.chain([[3, 4, 5]]).collect()).unwrap()
    }

    /// The surface on both sides of triangles, or its outermost part, or that inside a solid.
    fn mended(mesh: &TriMesh, side: Side, budget: Budget<'_>) -> Mended {
        let bvh = Bvh::new(mesh);
        let (distance, tolerance) = (0.05, 0.004);
        let bounds = mesh.bounds().grown(distance + 4.0 * tolerance);
        let mut frame = Frame {
            origin: bounds.min,
            side: 1.01 * bounds.size().max_element(),
        };
        let (solid, level) = match side {
            Side::Inner => (Solid::Closed, -distance),
            _ => (Solid::No, distance),
        };
        let field = Field::new(&bvh, solid, level, &Progress::none()).unwrap();
        let outer_only = side == Side::Outer;
        let enclosed = if outer_only {
            Enclosed::find(&field, &frame, usize::MAX, &Progress::none()).unwrap()
        } else {
            Enclosed::default()
        };
        let mending = Mending {
            setting: Setting {
                field: &field,
                enclosed: &enclosed,
                grid: Grid::fit(Coordinates::Double, &mut frame, tolerance).unwrap(),
                frame,
                tolerance,
            },
            limits: [distance - tolerance, distance + tolerance],
            outer_only,
            budget,
        };
        mending.run(&Progress::none()).unwrap()
    }

    fn turned(solid: &TriMesh) -> TriMesh {
        let turn = DMat3::from_euler(EulerRot::XYZ, 0.5, 0.8, 0.3);
        let positions = solid.positions().iter().map(|&p| turn * p).collect();
        TriMesh::new(positions, solid.triangles().to_vec()).unwrap()
    }

    fn limited(nodes: usize, triangles: usize) -> Budget<'static> {
        Budget {
            nodes,
            triangles,
            storage: &in_memory,
        }
    }

    #[test]
    fn the_surface_is_the_same_bit_by_bit_however_space_is_cut() {
        let cut_in_tiles = limited(12_000, usize::MAX);
        let cut_in_pieces = [limited(5000, 3000), limited(usize::MAX, 3000)];
        let cut_more = [limited(2000, usize::MAX), limited(4000, usize::MAX)];
        let (knife, comb) = (wedge(0.35, 1.0, 1.0), comb(2, 0.3, 0.3, 0.8));
        for (mesh, side, budgets) in [
            (soup(1), Side::Both, &[cut_in_tiles][..]),
            (soup(2), Side::Outer, &cut_in_pieces[..]),
            // cells with triangles in them, beside others that have none
            (turned(&knife.mesh), Side::Inner, &cut_more[..]),
            (turned(&comb.mesh), Side::Inner, &cut_more[1..]),
        ] {
            let whole = mended(&mesh, side, limited(usize::MAX, usize::MAX));

            assert!(whole.is_proved && whole.tiles == 1);
            assert!(whole.rounds > 1, "{} rounds", whole.rounds);
            let counts = |m: &Mended| (m.cells, m.deepest_level, m.rounds, m.split);
            let counted = counts(&whole);
            let whole = whole.surface.into_mesh(&Progress::none()).unwrap();
            assert!(!whole.triangles().is_empty());
            for budget in budgets.iter().copied() {
                let is_grown_whole = budget.nodes == usize::MAX;
                let cut = mended(&mesh, side, budget);
                assert!(cut.is_proved && (cut.tiles == 1) == is_grown_whole);
                assert!(cut.tiles == 1 || cut.tiles >= 8);
                assert_eq!(counts(&cut), counted);
                let cut = cut.surface.into_mesh(&Progress::none()).unwrap();
                assert!(cut == whole);
            }
        }
    }

    #[test]
    fn facets_that_are_known_to_have_ample_room_are_measured_as_others() {
        let mesh = soup(3);
        let mended = mended(&mesh, Side::Both, limited(usize::MAX, usize::MAX));
        let bvh = Bvh::new(&mesh);
        let field = Field::new(&bvh, Solid::No, 0.05, &Progress::none()).unwrap();
        let piece = mended.surface.piece(0, &Progress::none()).unwrap();
        let facets = piece.mesh.triangles().len();
        let known = piece.ample.iter().filter(|&&is| is).count();
        assert!(known > facets / 2, "{known} of {facets}");
        let limits = [0.046, 0.054];
        let distance = 0.05 - 0.65 * 0.004;
        let measured = |facets: &[bool]| {
            let ample = Ample { distance, facets };
            let found = measure(&field, &piece.mesh, limits, ample, &Progress::none()).unwrap();
            assert_eq!(found.unproved, 0);
            [found.least, found.most, found.most_found]
        };
        let [least, most, most_found] = measured(&piece.ample);
        let [plain_least, plain_most, plain_most_found] = measured(&[]);
        assert!((least - plain_least).abs() <= 1e-3 * 0.004);
        assert_eq!([most, most_found], [plain_most, plain_most_found]);
    }
}
