//! The coordinator: plans pieces and merges answers.

use super::piece::{INPUT, edits_name, surface_name};
use super::{Answer, Input, Piece, Work};
use crate::offset::offset_with;
use crate::params::{OffsetError, OffsetParams};
use crate::prove::EditRequests;
use crate::remote::{ChunkTask, Remote, SimplifiedChunk, TileOutcome, TileTask};
use crate::repair::children;
use crate::report::{ChunkFacts, StoredOffset};
use crate::store::{
    Block, ChunkedSurface, NewStorage, PART, Scratch, StoredTile, damaged, failed, part_name,
};
use crate::surface::Edits;
use ravec_mesh::TriMesh;
use ravec_pieces::{Cluster, Executor, PartStore};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;
use std::io::{self, ErrorKind};
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Restorations of one part before the store counts as unreliable.
const MAX_RESTORED: u32 = 8;

/// Computes the surface as [`offset_stored`](crate::offset_stored) does, with the steps in pieces that an executor runs by
/// [`OffsetWorker`](crate::OffsetWorker) on the parts in a store, which must be empty. The caller removes the parts.
///
/// [`OffsetParams::memory_bytes`] is the limit of each worker, and determines the pieces: without one, all of space is one
/// piece. Sheets to thicken are computed in this process.
///
/// # Errors
/// As [`offset_stored`](crate::offset_stored); [`OffsetError::Piece`] if a piece fails, with its reason.
pub fn offset_in_pieces(
    mesh: &TriMesh,
    params: &OffsetParams,
    storage: NewStorage<'_>,
    cluster: &Arc<Cluster>,
    progress: &Progress,
) -> Result<StoredOffset, OffsetError> {
    offset_with(mesh, params, storage, Some(cluster), progress)
}

/// State of the work.
#[derive(Default)]
struct State {
    /// Number of pieces so far.
    pieces: u64,
    /// Number of rounds with edits so far.
    rounds: u32,
    /// Number of published surfaces.
    surfaces: u64,
    /// The piece that wrote each part, and how often.
    made_by: FxHashMap<u64, (Piece, u32)>,
    /// Recomputed tiles by the number of their lost part.
    replaced: FxHashMap<u64, Box<StoredTile>>,
}

/// Coordinates the steps of one offset.
pub(crate) struct Coordinator {
    shared: Arc<Shared>,
}

/// State shared by the coordinator and the surfaces that it reads.
struct Shared {
    cluster: Arc<Cluster>,
    state: Mutex<State>,
    progress: Progress,
}

/// The parts for the coordinator, with lost ones recomputed.
struct RestoringStore(Arc<Shared>);

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> Result<(), OffsetError> {
        self.cluster.store().write(name, bytes).map_err(failed)
    }
}

impl Coordinator {
    /// Publishes the input.
    pub fn start(
        cluster: &Arc<Cluster>,
        mesh: &TriMesh,
        params: &OffsetParams,
        progress: &Progress,
    ) -> Result<Self, OffsetError> {
        let shared = Shared {
            cluster: Arc::clone(cluster),
            state: Mutex::default(),
            progress: progress.clone(),
        };
        shared.write(INPUT, &Input::encoded(mesh, params)?)?;
        Ok(Self {
            shared: Arc::new(shared),
        })
    }

    /// Runs pieces, and those that follow from their answers; returns all answers in the order of the pieces.
    fn run(
        &self,
        phase: &'static str,
        works: Vec<Work>,
        follow: impl Fn(&Work, &Answer) -> Vec<Work>,
        progress: &Progress,
    ) -> Result<Vec<(Work, Answer)>, OffsetError> {
        let mut state = self.shared.state();
        let mut executor = self.shared.cluster.executor();
        let executor = &mut **executor;
        let mut batch = Batch::default();
        for work in works {
            batch.submit(work, &mut state, executor)?;
        }
        let (mut shown, mut total) = (
            progress.phase(phase, batch.pending() as u64),
            batch.pending(),
        );
        let mut done = 0;
        while batch.pending() > 0 {
            let (number, answer) = executor.next(progress).map_err(piece_failed)?;
            let answer: Answer = ravec_pieces::from_bytes(&answer).map_err(failed)?;
            let added = batch.answered(number, answer, &follow, &mut state, executor)?;
            done += 1;
            if added > 0 {
                total += added;
                shown = progress.phase(phase, total as u64);
                shown.advance(done);
            } else {
                shown.advance(1);
            }
        }
        Ok(batch.into_answers())
    }

    fn run_all(
        &self,
        phase: &'static str,
        works: impl Iterator<Item = Work>,
        progress: &Progress,
    ) -> Result<Vec<Answer>, OffsetError> {
        let done = self.run(phase, works.collect(), |_, _| vec![], progress)?;
        Ok(done.into_iter().map(|(_, answer)| answer).collect())
    }

    /// Writes a surface for the workers; returns its number.
    fn published(&self, surface: &ChunkedSurface) -> Result<u64, OffsetError> {
        if let Some(&number) = surface.published.get() {
            return Ok(number);
        }
        let number = {
            let mut state = self.shared.state();
            state.surfaces += 1;
            state.surfaces
        };
        let bytes = surface.to_bytes()?;
        let name = surface_name(number);
        self.shared.write(&name, &bytes)?;
        Ok(*surface.published.get_or_init(|| number))
    }
}

impl RestoringStore {
    /// Returns whether a part is a tile, whose bytes may differ when it is recomputed.
    fn is_tile(&self, name: &str) -> bool {
        let part = name
            .strip_prefix(PART)
            .and_then(|number| number.parse::<u64>().ok());
        let state = self.0.state();
        let piece = part.and_then(|part| state.made_by.get(&part));
        piece.is_some_and(|(piece, _)| matches!(piece.work, Work::Tile { .. }))
    }

    /// Recomputes a lost part.
    fn restore(&self, part: u64) -> Result<(), OffsetError> {
        let Self(shared) = self;
        let mut state = shared.state();
        if shared.cluster.store().read_all(&part_name(part)).is_ok() {
            // another thread restored it
            return Ok(());
        }
        let mut executor = shared.cluster.executor();
        let mut batch = Batch::default();
        batch.recompute(part, &mut state, &mut **executor)?;
        while batch.pending() > 0 {
            let (number, answer) = executor.next(&shared.progress).map_err(piece_failed)?;
            let answer: Answer = ravec_pieces::from_bytes(&answer).map_err(failed)?;
            batch.answered(number, answer, &|_, _| vec![], &mut state, &mut **executor)?;
        }
        Ok(())
    }
}

impl PartStore for RestoringStore {
    fn write(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        self.0.cluster.store().write(name, bytes)
    }

    fn read(&self, name: &str, range: Range<u64>) -> io::Result<Vec<u8>> {
        let found = self.0.cluster.store().read(name, range.clone());
        let is_lost = |error: &io::Error| {
            matches!(error.kind(), ErrorKind::NotFound | ErrorKind::UnexpectedEof)
        };
        match found {
            Err(error) if is_lost(&error) && !self.is_tile(name) => {
                let part = name
                    .strip_prefix(PART)
                    .and_then(|number| number.parse().ok());
                let part = part.ok_or(error)?;
                self.restore(part).map_err(io::Error::other)?;
                self.0.cluster.store().read(name, range)
            }
            found => found,
        }
    }

    fn read_all(&self, name: &str) -> io::Result<Vec<u8>> {
        self.0.cluster.store().read_all(name)
    }

    fn remove(&self, name: &str) -> io::Result<()> {
        self.0.cluster.store().remove(name)
    }
}

/// The pieces of one step.
#[derive(Default)]
struct Batch {
    /// Pending pieces by number.
    pending: FxHashMap<u64, Piece>,
    /// Pieces that wait for a part, with the number of the piece that recomputes it.
    waiting: Vec<(u64, Piece)>,
    /// Lost parts by the number of the piece that recomputes them.
    restoring: FxHashMap<u64, u64>,
    /// Position of each piece in the answers, by number.
    order: FxHashMap<u64, usize>,
    answers: Vec<Option<(Work, Answer)>>,
}

impl Batch {
    /// Returns the number of pending pieces.
    fn pending(&self) -> usize {
        self.pending.len()
    }

    fn into_answers(self) -> Vec<(Work, Answer)> {
        self.answers.into_iter().flatten().collect()
    }

    fn submit(
        &mut self,
        work: Work,
        state: &mut State,
        executor: &mut dyn Executor,
    ) -> Result<(), OffsetError> {
        state.pieces += 1;
        let part = state.pieces;
        self.order.insert(part, self.answers.len());
        self.answers.push(None);
        self.send(Piece { part, work }, state, executor)
    }

    /// Sends a piece, with recomputed tiles in place of lost ones.
    fn send(
        &mut self,
        mut piece: Piece,
        state: &mut State,
        executor: &mut dyn Executor,
    ) -> Result<(), OffsetError> {
        if let Some(tile) = piece.work.tile_mut() {
            while let Some(again) = state.replaced.get(&tile.tree.part) {
                tile.clone_from(again);
            }
        }
        let bytes = ravec_pieces::to_bytes(&piece).map_err(failed)?;
        executor.submit(piece.part, bytes).map_err(piece_failed)?;
        self.pending.insert(piece.part, piece);
        Ok(())
    }

    /// Takes an answer; returns the number of pieces that it adds.
    fn answered(
        &mut self,
        number: u64,
        answer: Answer,
        follow: &impl Fn(&Work, &Answer) -> Vec<Work>,
        state: &mut State,
        executor: &mut dyn Executor,
    ) -> Result<usize, OffsetError> {
        // a piece that ran twice is answered twice
        let Some(piece) = self.pending.remove(&number) else {
            return Ok(0);
        };
        if let Answer::Missing(part) = answer {
            self.restore(part, piece, state, executor)?;
            return Ok(1);
        }
        let mut added = 0;
        if let Some(lost) = self.restoring.remove(&number) {
            if let Answer::Tile(TileOutcome::Done(tile, _)) = answer {
                state.replaced.insert(lost, tile);
            }
            let waiting = std::mem::take(&mut self.waiting);
            for (on, waiting) in waiting {
                if on == number {
                    self.send(waiting, state, executor)?;
                    added += 1;
                } else {
                    self.waiting.push((on, waiting));
                }
            }
        } else {
            let following = follow(&piece.work, &answer);
            added += following.len();
            for work in following {
                self.submit(work, state, executor)?;
            }
            let at = *self.order.get(&number).ok_or_else(damaged)?;
            self.answers[at] = Some((piece.work.clone(), answer));
        }
        let times = state.made_by.get(&number).map_or(0, |(_, times)| *times);
        state.made_by.insert(number, (piece, times));
        Ok(added)
    }

    /// Recomputes a lost part for a piece that needs it.
    fn restore(
        &mut self,
        lost: u64,
        needed_by: Piece,
        state: &mut State,
        executor: &mut dyn Executor,
    ) -> Result<(), OffsetError> {
        if let Some((&on, _)) = self.restoring.iter().find(|&(_, &part)| part == lost) {
            self.waiting.push((on, needed_by));
            return Ok(());
        }
        let on = self.recompute(lost, state, executor)?;
        self.waiting.push((on, needed_by));
        Ok(())
    }

    /// Sends the piece that recomputes a lost part; returns its number.
    fn recompute(
        &mut self,
        lost: u64,
        state: &mut State,
        executor: &mut dyn Executor,
    ) -> Result<u64, OffsetError> {
        let missing = OffsetError::MissingPart { part: lost };
        let (piece, times) = state.made_by.get_mut(&lost).ok_or(missing.clone())?;
        *times += 1;
        if *times > MAX_RESTORED {
            return Err(missing);
        }
        let mut piece = piece.clone();
        if let Work::Tile { task, fits, .. } = &mut piece.work {
            // the tile that it was repaired from is gone: grown with all edits so far, it is the same
            *task = TileTask::Grow(task.key());
            *fits = true;
            state.pieces += 1;
            piece.part = state.pieces;
        }
        let on = piece.part;
        self.restoring.insert(on, lost);
        self.send(piece, state, executor)?;
        Ok(on)
    }
}

impl Remote for Coordinator {
    fn parts(&self) -> Scratch {
        Scratch::of_parts(Arc::new(RestoringStore(Arc::clone(&self.shared))), u64::MAX)
    }

    fn advance(
        &self,
        tasks: Vec<TileTask>,
        latest: &Edits,
        levels: u8,
        progress: &Progress,
    ) -> Result<Vec<(StoredTile, EditRequests)>, OffsetError> {
        let rounds = {
            let mut state = self.shared.state();
            if !latest.is_empty() {
                state.rounds += 1;
                let bytes = ravec_pieces::to_bytes(latest).map_err(failed)?;
                let name = edits_name(state.rounds);
                self.shared.write(&name, &bytes)?;
            }
            state.rounds
        };
        let work = |task| Work::Tile {
            task,
            rounds,
            levels,
            fits: false,
        };
        let follow = |before: &Work, answer: &Answer| match (before, answer) {
            (Work::Tile { task, .. }, Answer::Tile(TileOutcome::TooLarge)) => children(task.key())
                .map(|key| work(TileTask::Grow(key)))
                .collect(),
            _ => vec![],
        };
        let works = tasks.into_iter().map(work).collect();
        let mut done = vec![];
        let mut replaced = vec![];
        for (work, answer) in self.run("tiles", works, follow, progress)? {
            if let Work::Tile {
                task: TileTask::Repair(tile),
                ..
            } = work
            {
                replaced.push(tile.tree.part);
            }
            match answer {
                Answer::Tile(TileOutcome::Done(tile, requests)) => done.push((*tile, requests)),
                Answer::Tile(TileOutcome::TooLarge) => {}
                _ => return Err(damaged()),
            }
        }
        let mut state = self.shared.state();
        for part in replaced {
            state.made_by.remove(&part);
            let store = self.shared.cluster.store();
            store.remove(&part_name(part)).map_err(failed)?;
        }
        Ok(done)
    }

    fn divide(
        &self,
        tiles: &[StoredTile],
        progress: &Progress,
    ) -> Result<Vec<Vec<Block>>, OffsetError> {
        let works = tiles
            .iter()
            .map(|tile| Work::Divide(Box::new(tile.clone())));
        let answers = self.run_all("blocks", works, progress)?.into_iter();
        let blocks = answers.map(|answer| match answer {
            Answer::Blocks(blocks) => Ok(blocks),
            _ => Err(damaged()),
        });
        blocks.collect()
    }

    fn defects(
        &self,
        surface: &ChunkedSurface,
        progress: &Progress,
    ) -> Result<Vec<Vec<[u32; 2]>>, OffsetError> {
        let number = self.published(surface)?;
        let works = (0..surface.count()).map(|chunk| Work::Defects {
            surface: number,
            chunk,
        });
        let answers = self.run_all("search", works, progress)?.into_iter();
        let defects = answers.map(|answer| match answer {
            Answer::Defects(defects) => Ok(defects),
            _ => Err(damaged()),
        });
        defects.collect()
    }

    fn simplify(
        &self,
        surface: &ChunkedSurface,
        tasks: Vec<ChunkTask>,
        progress: &Progress,
    ) -> Result<Vec<SimplifiedChunk>, OffsetError> {
        let number = self.published(surface)?;
        let works = tasks.into_iter().map(|task| Work::Simplify {
            surface: number,
            task,
        });
        let answers = self.run_all("simplify", works, progress)?.into_iter();
        let chunks = answers.map(|answer| match answer {
            Answer::Simplified(chunk) => Ok(*chunk),
            _ => Err(damaged()),
        });
        chunks.collect()
    }

    fn pairs(
        &self,
        surface: &ChunkedSurface,
        progress: &Progress,
    ) -> Result<Vec<Vec<[[u32; 2]; 2]>>, OffsetError> {
        let number = self.published(surface)?;
        let works = (0..surface.count()).map(|chunk| Work::Pairs {
            surface: number,
            chunk,
        });
        let answers = self.run_all("search", works, progress)?.into_iter();
        let pairs = answers.map(|answer| match answer {
            Answer::Pairs(pairs) => Ok(pairs),
            _ => Err(damaged()),
        });
        pairs.collect()
    }

    fn facts(
        &self,
        surface: &ChunkedSurface,
        ample_distance: f64,
        progress: &Progress,
    ) -> Result<Vec<ChunkFacts>, OffsetError> {
        let number = self.published(surface)?;
        let works = (0..surface.count()).map(|chunk| Work::Facts {
            surface: number,
            chunk,
            ample_distance,
        });
        let answers = self.run_all("measure", works, progress)?.into_iter();
        let facts = answers.map(|answer| match answer {
            Answer::Facts(facts) => Ok(facts),
            _ => Err(damaged()),
        });
        facts.collect()
    }
}

/// Error for a piece that failed.
#[expect(
    clippy::needless_pass_by_value,
    reason = "taken as it comes from a result"
)]
fn piece_failed(error: io::Error) -> OffsetError {
    if error.kind() == ErrorKind::Interrupted {
        return Cancelled.into();
    }
    OffsetError::Piece {
        cause: error.to_string(),
    }
}
