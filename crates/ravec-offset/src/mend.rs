//! The surface, mended until it is proved and does not meet itself.
//!
//! All tiles are grown and cut into triangles; cells of triangles that are not proved, or meet others, are split; tiles that
//! depend on these cells are done again. Every round sees the orders of the rounds before and no others, so that what comes
//! out does not depend on the tiles. Where memory is limited a tile that would take too much is cut into eight, and only one
//! tile is in memory at a time, beside the surface itself; otherwise all of space is one tile, which stays.

use crate::extract::{CrossingPlaces, extract};
use crate::grid::doubled;
use crate::judge::{AmpleFacets, Judge, Proved, meeting_pairs, separate};
use crate::outermost::reachable;
use crate::refine::{Halt, Refinement, Setting};
use crate::scope::Scope;
use crate::tile::{Assembled, Orders, Patch, Reach, assemble};
use glam::DVec3;
use ravec_octree::{CellKey, NodeId};
use ravec_progress::{Cancelled, Progress};

/// Rounds of mending after which what is left is reported.
const MOST_ROUNDS: u32 = 100;

/// As [`MOST_ROUNDS`] where the surface is made of the triangles themselves: what 40 rounds do not mend, 100 do not.
const MOST_ROUNDS_OF_SURFACE: u32 = 40;

/// Rounds after which cells are split by one more level at once.
const HASTE: u32 = 8;

/// A surface of more triangles than this, made of the input's triangles themselves, is given up if a round makes it larger
/// by this factor: that far from being mended, it would take minutes and end as crowded. Those that could be mended grew
/// by a third in a round at most.
const LARGE: usize = 500_000;
const MOST_GROWTH: f64 = 1.6;

/// Tiles of fewer cells along a side are not cut any more: they are hardly larger than what they depend on.
const LEAST_CELLS: f64 = 16.0;

/// What to mend, and how far.
pub(crate) struct Mending<'a> {
    pub setting: Setting<'a>,
    /// The least and the largest distance that a point of the surface may have.
    pub limits: [f64; 2],
    /// Whether to drop what cannot be reached from far away.
    pub outer_only: bool,
    /// How many nodes the tree of a tile may have.
    pub most_nodes: usize,
}

/// The surface, and what it took.
pub(crate) struct Mended {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Facets that are proved to leave ample room below them.
    pub ample: AmpleFacets,
    /// Whether all is proved, and triangles meet nowhere.
    pub is_proved: bool,
    /// Whether mending was given up: each round made the surface much larger, and there is none.
    pub is_given_up: bool,
    /// Leaves of the tree.
    pub cells: u64,
    pub deepest_level: u8,
    pub tiles: u64,
    pub rounds: u32,
    /// Leaves that were split, and corners that were filled, to mend the surface.
    pub split: u64,
    pub filled: u64,
}

/// A part of space.
struct Tile<'a> {
    key: CellKey,
    /// What it depends on; nothing before it was done.
    reach: Option<Reach>,
    refinement: Option<Refinement<'a>>,
    places: CrossingPlaces,
    /// Facets that were proved, by a hash of their corners.
    proved: Proved,
    /// Leaves of triangles that are not proved, or meet others.
    bad: Vec<NodeId>,
    patch: Patch,
    /// Whether nothing is wrong with the patch.
    is_proved: bool,
    leaves: u64,
    deepest_level: u8,
}

impl Tile<'_> {
    fn new(key: CellKey) -> Self {
        Self {
            key,
            reach: None,
            refinement: None,
            places: CrossingPlaces::default(),
            proved: Proved::default(),
            bad: vec![],
            patch: Patch::default(),
            is_proved: false,
            leaves: 0,
            deepest_level: 0,
        }
    }

    /// Gives back the memory of all that can be found again.
    fn forget(&mut self) {
        self.refinement = None;
        self.places = CrossingPlaces::default();
        self.proved = Proved::default();
        self.bad = vec![];
        self.patch.leaves = vec![];
    }
}

impl<'a> Mending<'a> {
    pub fn run(&self, progress: &Progress) -> Result<Mended, Cancelled> {
        let mut tiles = vec![Tile::new(CellKey::ROOT)];
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
            let mut next = self.round(&mut tiles, &orders, &latest, levels, progress)?;
            let extracted = tiles.iter().map(|tile| tile.patch.triangles.len()).sum();
            let before = std::mem::replace(&mut size, extracted);
            let grows = before > 0 && extracted as f64 > MOST_GROWTH * before as f64;
            if self.setting.field.level == 0.0 && extracted > LARGE && grows {
                return Ok(Mended {
                    positions: vec![],
                    triangles: vec![],
                    ample: AmpleFacets::default(),
                    is_proved: false,
                    is_given_up: true,
                    cells: 0,
                    deepest_level: 0,
                    tiles: tiles.len() as u64,
                    rounds,
                    split: orders.split.len() as u64,
                    filled: orders.filled.len() as u64,
                });
            }
            if next.is_empty() || rounds == most_rounds {
                let whole = self.assemble(&tiles, progress)?;
                let mut is_proved = tiles.iter().all(|tile| tile.is_proved);
                let proved = tiles.iter().map(|tile| &tile.proved);
                let ample = self.judge().ample_facets(proved);
                if is_proved {
                    // trees grow again in the rare case that they are needed
                    tiles.iter_mut().for_each(Tile::forget);
                    // only crowded cells let triangles meet, and these were searched: this is to be sure
                    let pairs = meeting_pairs(&whole.positions, &whole.triangles, progress)?;
                    let mut bad: Vec<u32> = pairs.into_iter().flatten().collect();
                    if self.setting.grid.is_coarse() {
                        let doubled = doubled(&whole.positions);
                        let is_doubled = |t: &[u32; 3]| t.iter().any(|v| doubled.contains(v));
                        let at = (0u32..).zip(&whole.triangles);
                        bad.extend(at.filter(|(_, t)| is_doubled(t)).map(|(t, _)| t));
                    }
                    is_proved = bad.is_empty();
                    next = self.separation(&whole, &bad, &tiles, &orders, levels, progress)?;
                }
                if next.is_empty() || rounds == most_rounds {
                    return Ok(Mended {
                        positions: whole.positions,
                        triangles: whole.triangles,
                        ample,
                        is_proved,
                        is_given_up: false,
                        cells: tiles.iter().map(|tile| tile.leaves).sum(),
                        deepest_level: tiles.iter().map(|t| t.deepest_level).max().unwrap_or(0),
                        tiles: tiles.len() as u64,
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

    /// Does all tiles that the latest orders concern; returns what is to be done next.
    fn round(
        &self,
        tiles: &mut Vec<Tile<'a>>,
        orders: &Orders,
        latest: &Orders,
        levels: u8,
        progress: &Progress,
    ) -> Result<Orders, Cancelled> {
        let mut next = Orders::default();
        let mut at = 0;
        while at < tiles.len() {
            let tile = &mut tiles[at];
            let is_concerned = tile.reach.is_none_or(|reach| latest.concern(&reach));
            if is_concerned {
                match self.tend(tile, [orders, latest], levels, &mut next, progress) {
                    Ok(()) => {}
                    Err(Halt::Cancelled(cancelled)) => return Err(cancelled),
                    Err(Halt::TooLarge) => {
                        let key = tile.key;
                        let children = (0..8).map(|octant| Tile::new(key.child(octant)));
                        tiles.splice(at..=at, children);
                        continue;
                    }
                }
            }
            at += 1;
        }
        Ok(next)
    }

    /// Grows a tile, or mends it, cuts it into triangles and judges these.
    fn tend(
        &self,
        tile: &mut Tile<'a>,
        [orders, latest]: [&Orders; 2],
        levels: u8,
        next: &mut Orders,
        progress: &Progress,
    ) -> Result<(), Halt> {
        let (refinement, mut scope) = if let Some(mut refinement) = tile.refinement.take() {
            let first_new = refinement.tree.len() as NodeId;
            refinement.mend(latest, progress)?;
            let filled = latest.filled.iter();
            let changed = (first_new..refinement.tree.len() as NodeId)
                .chain(filled.flat_map(|&corner| refinement.leaves_at(corner)))
                .chain(std::mem::take(&mut tile.bad));
            let scope = Scope::around(changed, &refinement, progress)?;
            (refinement, scope)
        } else {
            tile.patch = Patch::default();
            let refinement = self.grow(tile.key, orders, progress)?;
            (refinement, Scope::Tile(tile.key))
        };
        let extracted = extract(&refinement, &mut scope, &mut tile.places, progress)?;
        let patch = extracted.patch(&refinement, &scope, progress)?;
        tile.patch = match &scope {
            Scope::Tile(_) => patch,
            Scope::Changes(near) => {
                let tree = &refinement.tree;
                let is_gone = |&leaf: &NodeId| !tree.is_leaf(leaf) || near.is_affected(leaf);
                let is_gone = |leaves: &[NodeId; 4]| leaves.iter().any(is_gone);
                tile.patch.replaced(is_gone, &patch, progress)?
            }
        };
        tile.bad = self.judge().judge(
            &mut tile.proved,
            &refinement,
            (&extracted, &scope),
            levels,
            next,
            progress,
        )?;
        tile.is_proved = tile.bad.is_empty();
        let leaves = || {
            let all = refinement.tree.leaves();
            all.map(|leaf| refinement.tree.key(leaf))
                .filter(|key| tile.key.owns(key.at))
        };
        tile.leaves = leaves().count() as u64;
        tile.deepest_level = leaves().map(|key| key.level).max().unwrap_or(0);
        tile.reach = Some(refinement.reach());
        // the only tile may stay: it was within what is allowed
        if tile.key == CellKey::ROOT {
            tile.refinement = Some(refinement);
        } else {
            tile.forget();
        }
        Ok(())
    }

    fn grow(
        &self,
        tile: CellKey,
        orders: &Orders,
        progress: &Progress,
    ) -> Result<Refinement<'a>, Halt> {
        // the chords of a facet of this size leave a sphere by the tolerance
        let cell = (8.0 * self.setting.field.radius() * self.setting.tolerance).sqrt();
        let may_be_cut = self.setting.frame.side_at(tile.level) >= LEAST_CELLS * cell;
        let most_nodes = if may_be_cut {
            self.most_nodes
        } else {
            usize::MAX
        };
        Refinement::grow(self.setting, tile, orders, most_nodes, progress)
    }

    fn assemble(&self, tiles: &[Tile<'_>], progress: &Progress) -> Result<Assembled, Cancelled> {
        let whole = assemble(tiles.iter().map(|tile| &tile.patch), progress)?;
        if !self.outer_only {
            return Ok(whole);
        }
        let seen = reachable(&whole.positions, &whole.triangles, progress)?;
        if seen.iter().all(|&seen| seen) {
            return Ok(whole);
        }
        whole.retain(|t| seen[t], progress)
    }

    /// Orders what separates triangles from others that they meet.
    fn separation(
        &self,
        whole: &Assembled,
        triangles: &[u32],
        tiles: &[Tile<'a>],
        orders: &Orders,
        levels: u8,
        progress: &Progress,
    ) -> Result<Orders, Cancelled> {
        let mut next = Orders::default();
        let mut origins: Vec<[u32; 2]> = triangles
            .iter()
            .map(|&t| whole.origin[t as usize])
            .collect();
        origins.sort_unstable();
        for of_tile in origins.chunk_by(|a, b| a[0] == b[0]) {
            let tile = &tiles[of_tile[0][0] as usize];
            let grown;
            let refinement = match &tile.refinement {
                Some(refinement) => refinement,
                None => match self.grow(tile.key, orders, progress) {
                    Ok(refinement) => {
                        grown = refinement;
                        &grown
                    }
                    Err(Halt::Cancelled(cancelled)) => return Err(cancelled),
                    Err(Halt::TooLarge) => unreachable!("it was grown before"),
                },
            };
            for &[_, t] in of_tile {
                let edge = tile.patch.edges[tile.patch.edge_of[t as usize] as usize];
                separate(
                    refinement,
                    &refinement.leaves_around(edge),
                    levels,
                    &mut next,
                );
            }
        }
        Ok(next)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::enclosed::Enclosed;
    use crate::field::{Field, Solid};
    use crate::grid::Grid;
    use crate::measure::measure;
    use crate::params::Coordinates;
    use ravec_mesh::{Bvh, TriMesh};
    use ravec_octree::Frame;

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

    fn mended(mesh: &TriMesh, outer_only: bool, most_nodes: usize) -> Mended {
        let bvh = Bvh::new(mesh);
        let (distance, tolerance) = (0.05, 0.004);
        let bounds = mesh.bounds().grown(distance + 4.0 * tolerance);
        let mut frame = Frame {
            origin: bounds.min,
            side: 1.01 * bounds.size().max_element(),
        };
        let field = Field::new(&bvh, Solid::No, distance, &Progress::none()).unwrap();
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
            most_nodes,
        };
        mending.run(&Progress::none()).unwrap()
    }

    #[test]
    fn the_surface_is_the_same_bit_by_bit_however_space_is_cut() {
        for (seed, outer_only, most_nodes) in [(1, false, 12_000), (2, true, 5000)] {
            let mesh = soup(seed);
            let whole = mended(&mesh, outer_only, usize::MAX);

            // the whole was mended where it changed, tiles are grown anew in each round
            assert!(whole.is_proved && whole.tiles == 1 && !whole.triangles.is_empty());
            // the whole was mended where it changed, tiles are grown anew in each round
            assert!(whole.rounds > 1, "{} rounds", whole.rounds);
            let cut = mended(&mesh, outer_only, most_nodes);
            assert!(cut.tiles >= 8, "{} tiles", cut.tiles);
            assert_eq!(cut.positions, whole.positions);
            assert_eq!(cut.triangles, whole.triangles);
            let counts = |m: &Mended| (m.cells, m.deepest_level, m.rounds, m.split);
            assert_eq!(counts(&cut), counts(&whole));
        }
    }

    #[test]
    fn facets_that_are_known_to_have_ample_room_are_measured_as_others() {
        let mesh = soup(3);
        let mended = mended(&mesh, false, usize::MAX);
        let bvh = Bvh::new(&mesh);
        let field = Field::new(&bvh, Solid::No, 0.05, &Progress::none()).unwrap();
        let surface = TriMesh::new(mended.positions, mended.triangles).unwrap();
        let facets = surface.triangles().len();
        let known = (0..facets as u32)
            .filter(|&t| mended.ample.contains(surface.corners(t)))
            .count();
        assert!(known > facets / 2, "{known} of {facets}");
        let limits = [0.046, 0.054];
        let measured = |ample: &AmpleFacets| {
            let found = measure(&field, &surface, limits, ample, &Progress::none()).unwrap();
            assert_eq!(found.unproved, 0);
            [found.least, found.most, found.most_found]
        };
        let [least, most, most_found] = measured(&mended.ample);
        let [plain_least, plain_most, plain_most_found] = measured(&AmpleFacets::default());
        assert!((least - plain_least).abs() <= 1e-3 * 0.004);
        assert_eq!([most, most_found], [plain_most, plain_most_found]);
    }
}
