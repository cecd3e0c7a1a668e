//! Rounds of repair, until the surface is proved and free of intersections.
//!
//! All of space is grown, extracted and inspected; cells of triangles with defects are split, and everything that depends on
//! these cells is done again. Every round sees the edits of all earlier rounds and no others, so the result does not depend on
//! the division into tiles.
//!
//! Trees are kept between rounds, and only the surface near changes is extracted again. If the tree of all of space does not
//! fit in memory, tiles are grown one after the other, divided into eight if too large, and kept in a storage, from which a
//! round loads those that changes affect.

use super::{GrownTile, Workspace};
use crate::extract::{CrossingCache, Selection, extract};
use crate::grow::{Halt, Refinement, Setting};
use crate::params::OffsetError;
use crate::prove::{Defects, EditRequests, Inspector};
use crate::remote::{Remote, TileOutcome, TileTask};
use crate::store::{
    Block, ChunkedSurface, NewStorage, Scratch, Store, StoredTile, Visibility, put_block,
    put_blocks,
};
use crate::surface::{Edits, Patch};
use ravec_octree::{CellKey, NodeId};
use ravec_progress::Progress;

/// Bound on the rounds of repair; remaining defects are reported.
const MAX_ROUNDS: u32 = 200;

/// [`MAX_ROUNDS`] where the surface consists of the triangles themselves, whose defects rarely disappear in more rounds.
const MAX_ROUNDS_OF_SURFACE: u32 = 40;

/// Rounds after which cells are split by one more level at once.
const ROUNDS_PER_LEVEL: u32 = 32;

/// Size in triangles above which a surface made of the triangles themselves is given up if a round enlarges it by
/// [`MAX_GROWTH`]: it is too far from being repaired. Surfaces that can be repaired grow by at most a third per round.
const LARGE: usize = 500_000;
const MAX_GROWTH: f64 = 1.6;

/// Number of cells along the side of a tile below which it is not divided: it is hardly larger than its reach.
const MIN_CELLS: f64 = 16.0;

/// Memory budget.
#[derive(Clone, Copy)]
pub(crate) struct Budget<'a> {
    /// Nodes of a tree.
    pub nodes: usize,
    /// Triangles of the surface, with all data about them.
    pub triangles: usize,
    /// Storage for data beyond the budget.
    pub storage: NewStorage<'a>,
    /// Other processes that run the steps.
    pub remote: Option<&'a dyn Remote>,
}

/// A surface to compute and repair.
pub(crate) struct Repair<'a> {
    pub setting: Setting<'a>,
    /// Minimum and maximum distance of the points of the surface.
    pub limits: [f64; 2],
    /// Drop components that cannot be reached from far away.
    pub outer_only: bool,
    pub budget: Budget<'a>,
}

/// The repaired surface, with counts for the report.
pub(crate) struct Repaired {
    pub surface: ChunkedSurface,
    /// All facets are proved, and no triangles intersect.
    pub is_proved: bool,
    /// Minimum distance of triangles with ample room below them.
    pub ample_distance: f64,
    /// Leaves of the tree.
    pub cells: u64,
    pub deepest_level: u8,
    pub tiles: u64,
    pub rounds: u32,
    /// Leaves split and corners filled by repair.
    pub split: u64,
    pub filled: u64,
}

/// Inputs of a round.
#[derive(Clone, Copy)]
pub(crate) struct Round<'o> {
    /// All edits so far, and the new ones among them.
    pub edits: &'o Edits,
    pub latest: &'o Edits,
    /// Number of levels by which cells are split at once.
    pub levels: u8,
}

impl<'a> Repair<'a> {
    /// Computes and repairs the surface.
    pub fn run(&self, progress: &Progress) -> Result<Repaired, OffsetError> {
        let mut workspace = Workspace::Empty;
        let mut edits = Edits::default();
        let mut latest = Edits::default();
        let mut rounds = 0;
        let mut size = 0;
        let max_rounds = if self.setting.field.level == 0.0 {
            MAX_ROUNDS_OF_SURFACE
        } else {
            MAX_ROUNDS
        };
        loop {
            let levels = self.levels(rounds);
            let round = Round {
                edits: &edits,
                latest: &latest,
                levels,
            };
            let mut requests = EditRequests::default();
            workspace = self.advance(workspace, round, &mut requests, progress)?;
            let mut next = requests.edits(&self.setting, levels);
            let extracted = workspace.triangles();
            let before = std::mem::replace(&mut size, extracted);
            let grows = before > 0 && extracted as f64 > MAX_GROWTH * before as f64;
            if self.setting.field.level == 0.0 && extracted > LARGE && grows {
                return Err(OffsetError::TooRough {
                    tolerance: self.setting.tolerance,
                });
            }
            if next.is_empty() || rounds == max_rounds {
                let (cells, deepest_level) = workspace.leaf_count_and_depth();
                let tiles = workspace.tiles();
                let blocks;
                (workspace, blocks) = self.finished(workspace, progress)?;
                let visibility = if self.outer_only {
                    Visibility::Reachable
                } else {
                    Visibility::All
                };
                let (store, blocks) = blocks;
                let max_triangles = self.budget.triangles;
                let surface =
                    ChunkedSurface::new(store, blocks, max_triangles, visibility, progress)?;
                let mut is_proved = surface.blocks().iter().all(|block| block.is_proved);
                if is_proved {
                    // inspections search crowded cells only: this search is complete
                    let defects = self.defects(&surface, progress)?;
                    is_proved = defects.is_empty();
                    next =
                        self.edits_to_separate(&surface, &workspace, &defects, round, progress)?;
                }
                if next.is_empty() || rounds == max_rounds {
                    return Ok(Repaired {
                        surface,
                        is_proved,
                        ample_distance: self.inspector().ample_distance(),
                        cells,
                        deepest_level,
                        tiles,
                        rounds,
                        split: edits.split.len() as u64,
                        filled: edits.filled.len() as u64,
                    });
                }
            }
            rounds += 1;
            edits.extend(&next);
            latest = next;
        }
    }

    /// Returns the triangles that intersect others, or have corners at the position of another vertex, each by its block and
    /// its number there, sorted.
    fn defects(
        &self,
        surface: &ChunkedSurface,
        progress: &Progress,
    ) -> Result<Vec<[u32; 2]>, OffsetError> {
        let found = match self.budget.remote {
            Some(remote) => remote.defects(surface, progress)?,
            None => (0..surface.count())
                .map(|chunk| surface.defects_in(chunk, progress))
                .collect::<Result<_, _>>()?,
        };
        let mut bad = found.concat();
        bad.sort_unstable();
        bad.dedup();
        Ok(bad)
    }

    fn inspector(&self) -> Inspector<'a> {
        Inspector {
            setting: self.setting,
            limits: self.limits,
        }
    }

    /// Number of levels by which cells are split at once. A round costs as much as thousands of cells, and the defects that
    /// survive several rounds are gaps that close along a front, which advances by one cell per level. Where triangles of the
    /// input intersect, one halving rarely separates them.
    fn levels(&self, rounds: u32) -> u8 {
        if self.setting.field.level == 0.0 {
            2
        } else {
            1 + (rounds / ROUNDS_PER_LEVEL).min(2) as u8
        }
    }

    /// Computes the parts that do not exist yet, and those that the latest edits affect.
    fn advance(
        &self,
        workspace: Workspace<'a>,
        round: Round<'_>,
        requests: &mut EditRequests,
        progress: &Progress,
    ) -> Result<Workspace<'a>, OffsetError> {
        let root = CellKey::ROOT;
        let whole = match workspace {
            Workspace::Empty if self.budget.remote.is_some() => {
                let tasks = vec![TileTask::Grow(root)];
                return self.advance_tiles(tasks, None, round, requests, progress);
            }
            Workspace::Empty => self
                .grown(root, self.budget.nodes, round, requests, progress)
                .map(Box::new),
            Workspace::Whole(whole) => self.repaired(whole, round, requests, progress),
            Workspace::Tiled(scratch, tiles) => {
                let is_affected = |tile: &StoredTile| round.latest.affect(&tile.reach);
                let (affected, kept): (Vec<_>, Vec<_>) = tiles.into_iter().partition(is_affected);
                let tasks = affected.into_iter().map(Box::new).map(TileTask::Repair);
                let kept = Some((scratch, kept));
                return self.advance_tiles(tasks.collect(), kept, round, requests, progress);
            }
        };
        match whole {
            Ok(whole) => Ok(Workspace::Whole(whole)),
            Err(Halt::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(Halt::TooLarge) => {
                let tasks = children(root).map(TileTask::Grow).collect();
                self.advance_tiles(tasks, None, round, requests, progress)
            }
        }
    }

    /// Advances tiles of which others are kept.
    fn advance_tiles(
        &self,
        mut tasks: Vec<TileTask>,
        kept: Option<(Scratch, Vec<StoredTile>)>,
        round: Round<'_>,
        requests: &mut EditRequests,
        progress: &Progress,
    ) -> Result<Workspace<'a>, OffsetError> {
        let (scratch, mut tiles) = match (kept, self.budget.remote) {
            (Some(kept), _) => kept,
            (None, Some(remote)) => (remote.parts(), vec![]),
            (None, None) => (Scratch::new(self.budget.storage)?, vec![]),
        };
        if let Some(remote) = self.budget.remote {
            let done = remote.advance(tasks, round.latest, round.levels, progress)?;
            for (tile, of_tile) in done {
                requests.extend(of_tile);
                tiles.push(tile);
            }
        } else {
            while let Some(task) = tasks.pop() {
                let key = task.key();
                match self.advance_tile(task, &scratch, round, progress)? {
                    TileOutcome::Done(tile, of_tile) => {
                        requests.extend(of_tile);
                        tiles.push(*tile);
                    }
                    TileOutcome::TooLarge => tasks.extend(children(key).map(TileTask::Grow)),
                }
            }
        }
        tiles.sort_unstable_by_key(|tile| tile.key.at.morton());
        Ok(Workspace::Tiled(scratch, tiles))
    }

    /// Advances a tile by a round.
    pub fn advance_tile(
        &self,
        task: TileTask,
        scratch: &Scratch,
        round: Round<'_>,
        progress: &Progress,
    ) -> Result<TileOutcome, OffsetError> {
        progress.check()?;
        let mut requests = EditRequests::default();
        let (grown, places) = match task {
            TileTask::Grow(key) => {
                let grown = self.grown(key, self.max_nodes(key), round, &mut requests, progress);
                (grown, None)
            }
            TileTask::Repair(tile) => {
                let places = [tile.tree, tile.patch];
                let max_nodes = self.max_nodes(tile.key);
                // a tile that grows a little is kept whole
                let max_nodes = max_nodes.saturating_add(max_nodes / 4);
                let grown = Box::new(tile.get(self.setting, max_nodes, scratch)?);
                let grown = self.repaired(grown, round, &mut requests, progress);
                (grown.map(|grown| *grown), Some(places))
            }
        };
        match grown {
            Ok(grown) => {
                let tile = StoredTile::put(grown, scratch, places)?;
                Ok(TileOutcome::Done(Box::new(tile), requests))
            }
            Err(Halt::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(Halt::TooLarge) => Ok(TileOutcome::TooLarge),
        }
    }

    /// Grows, extracts and inspects a tile.
    fn grown(
        &self,
        key: CellKey,
        max_nodes: usize,
        round: Round<'_>,
        requests: &mut EditRequests,
        progress: &Progress,
    ) -> Result<GrownTile<'a>, Halt> {
        let refinement = Refinement::grow(self.setting, key, round.edits, max_nodes, progress)?;
        let mut grown = GrownTile {
            key,
            refinement,
            places: CrossingCache::default(),
            defects: Defects::default(),
            patch: Patch::default(),
        };
        self.extract_and_inspect(
            &mut grown,
            Selection::Tile(key),
            round.levels,
            requests,
            progress,
        )?;
        Ok(grown)
    }

    /// Applies the latest edits to a tile, and extracts and inspects the surface around them.
    fn repaired(
        &self,
        mut grown: Box<GrownTile<'a>>,
        round: Round<'_>,
        requests: &mut EditRequests,
        progress: &Progress,
    ) -> Result<Box<GrownTile<'a>>, Halt> {
        let key = grown.key;
        let mut changed = grown
            .refinement
            .apply_edits(key, round.edits, round.latest, progress)?;
        changed.append(&mut grown.defects.leaves);
        let selection = Selection::around(key, changed, &grown.refinement, progress)?;
        self.extract_and_inspect(&mut grown, selection, round.levels, requests, progress)?;
        Ok(grown)
    }

    /// Extracts and inspects a selection.
    fn extract_and_inspect(
        &self,
        grown: &mut GrownTile<'a>,
        mut selection: Selection,
        levels: u8,
        requests: &mut EditRequests,
        progress: &Progress,
    ) -> Result<(), Halt> {
        let refinement = &grown.refinement;
        let extracted = extract(refinement, &mut selection, &mut grown.places, progress)?;
        let mut patch = extracted.patch(refinement, &selection, progress)?;
        (grown.defects, patch.proofs) = self.inspector().inspect(
            &grown.patch,
            refinement,
            (&extracted, &selection),
            levels,
            requests,
            progress,
        )?;
        drop(extracted);
        match &selection {
            Selection::Tile(_) => grown.patch = patch,
            Selection::Changes(near) => {
                let tree = &refinement.tree;
                let is_gone = |&leaf: &NodeId| !tree.is_leaf(leaf) || near.is_affected(leaf);
                let is_gone = |leaves: &[NodeId; 4]| leaves.iter().any(is_gone);
                grown.patch.replace(is_gone, patch, progress)?;
            }
        }
        Ok(())
    }

    /// Bound on the nodes of a tile; unbounded if the tile is hardly larger than its reach.
    fn max_nodes(&self, tile: CellKey) -> usize {
        // the chords of a facet of this size leave a sphere by the tolerance
        let cell = (8.0 * self.setting.field.radius() * self.setting.tolerance).sqrt();
        let may_be_cut = self.setting.frame.side_at(tile.level) >= MIN_CELLS * cell;
        if may_be_cut {
            self.budget.nodes
        } else {
            usize::MAX
        }
    }

    /// Grows a tile whatever its size: one that was lost.
    pub fn regrown(
        &self,
        tile: CellKey,
        scratch: &Scratch,
        round: Round<'_>,
        progress: &Progress,
    ) -> Result<TileOutcome, OffsetError> {
        let mut requests = EditRequests::default();
        match self.grown(tile, usize::MAX, round, &mut requests, progress) {
            Ok(grown) => {
                let tile = StoredTile::put(grown, scratch, None)?;
                Ok(TileOutcome::Done(Box::new(tile), requests))
            }
            Err(Halt::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(Halt::TooLarge) => unreachable!("any number of nodes is allowed"),
        }
    }

    /// Returns the surface in blocks, a single one if it fits in memory, and the workspace without trees that can be grown
    /// again.
    fn finished(
        &self,
        workspace: Workspace<'a>,
        progress: &Progress,
    ) -> Result<(Workspace<'a>, (Store, Vec<Block>)), OffsetError> {
        match workspace {
            Workspace::Empty => unreachable!("there was a round"),
            Workspace::Whole(whole) => {
                let (key, defects, patch) = whole.without_tree();
                let patch = patch.finished();
                let made = if patch.triangles.len() > self.budget.triangles {
                    let store = Store::Storage(Scratch::new(self.budget.storage)?);
                    let blocks = put_blocks(key, &patch, &defects.starts, &store, progress)?;
                    (store, blocks)
                } else {
                    let mut block = put_block(key, patch, &Store::Memory)?;
                    block.is_proved = defects.starts.is_empty();
                    (Store::Memory, vec![block])
                };
                Ok((Workspace::Empty, made))
            }
            Workspace::Tiled(scratch, tiles) => {
                let (store, blocks) = if let Some(remote) = self.budget.remote {
                    let blocks = remote.divide(&tiles, progress)?;
                    (Store::Storage(remote.parts()), blocks)
                } else {
                    let store = Store::Storage(Scratch::new(self.budget.storage)?);
                    let divide = |tile| divide_tile(tile, &scratch, &store, progress);
                    let blocks = tiles.iter().map(divide).collect::<Result<_, _>>()?;
                    (store, blocks)
                };
                let blocks = blocks.into_iter().flatten().collect();
                Ok((Workspace::Tiled(scratch, tiles), (store, blocks)))
            }
        }
    }
}

/// Divides a tile into blocks, which go to a store.
pub(crate) fn divide_tile(
    tile: &StoredTile,
    scratch: &Scratch,
    store: &Store,
    progress: &Progress,
) -> Result<Vec<Block>, OffsetError> {
    progress.check()?;
    let patch = scratch.patch(tile.patch)?.finished();
    put_blocks(tile.key, &patch, &tile.defects.starts, store, progress)
}

/// Returns the eight children of a tile.
pub(crate) fn children(tile: CellKey) -> impl Iterator<Item = CellKey> {
    (0..8).map(move |octant| tile.child(octant))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::{Enclosed, Field, Grid, Solid};
    use crate::finish::{Ample, measure};
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
    fn repaired(mesh: &TriMesh, side: Side, budget: Budget<'_>) -> Repaired {
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
        let repair = Repair {
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
        repair.run(&Progress::none()).unwrap()
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
            remote: None,
        }
    }

    #[test]
    fn the_surface_is_the_same_bit_by_bit_however_space_is_cut() {
        let cut_in_tiles = limited(12_000, usize::MAX);
        let cut_in_chunks = [limited(5000, 3000), limited(usize::MAX, 3000)];
        let cut_more = [limited(2000, usize::MAX), limited(4000, usize::MAX)];
        let (knife, comb) = (wedge(0.35, 1.0, 1.0), comb(2, 0.3, 0.3, 0.8));
        for (mesh, side, budgets) in [
            (soup(1), Side::Both, &[cut_in_tiles][..]),
            (soup(2), Side::Outer, &cut_in_chunks[..]),
            // cells with triangles in them, beside others that have none
            (turned(&knife.mesh), Side::Inner, &cut_more[..]),
            (turned(&comb.mesh), Side::Inner, &cut_more[1..]),
        ] {
            let whole = repaired(&mesh, side, limited(usize::MAX, usize::MAX));

            assert!(whole.is_proved && whole.tiles == 1);
            assert!(whole.rounds > 1, "{} rounds", whole.rounds);
            let counts = |m: &Repaired| (m.cells, m.deepest_level, m.rounds, m.split);
            let counted = counts(&whole);
            let whole = whole.surface.into_mesh(&Progress::none()).unwrap();
            assert!(!whole.triangles().is_empty());
            for budget in budgets.iter().copied() {
                let is_grown_whole = budget.nodes == usize::MAX;
                let cut = repaired(&mesh, side, budget);
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
        let repaired = repaired(&mesh, Side::Both, limited(usize::MAX, usize::MAX));
        let bvh = Bvh::new(&mesh);
        let field = Field::new(&bvh, Solid::No, 0.05, &Progress::none()).unwrap();
        let chunk = repaired.surface.chunk(0, &Progress::none()).unwrap();
        let facets = chunk.mesh.triangles().len();
        let known = chunk.ample.iter().filter(|&&is| is).count();
        assert!(known > facets / 2, "{known} of {facets}");
        let limits = [0.046, 0.054];
        let distance = 0.05 - 0.65 * 0.004;
        let measured = |facets: &[bool]| {
            let ample = Ample { distance, facets };
            let found = measure(&field, &chunk.mesh, limits, ample, &Progress::none()).unwrap();
            assert_eq!(found.unproved, 0);
            [found.least, found.most, found.max_found]
        };
        let [least, most, max_found] = measured(&chunk.ample);
        let [plain_least, plain_most, plain_most_found] = measured(&[]);
        assert!((least - plain_least).abs() <= 1e-3 * 0.004);
        assert_eq!([most, max_found], [plain_most, plain_most_found]);
    }
}
