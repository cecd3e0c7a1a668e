//! The worker: runs pieces.

use super::piece::{INPUT, edits_name, surface_name};
use super::{Answer, Input, Piece, Work};
use crate::domain::{Enclosed, Field};
use crate::finish::{Finish, Simplifier, is_rough};
use crate::params::OffsetError;
use crate::remote::TileTask;
use crate::repair::{Repair, Round, divide_tile};
use crate::store::{ChunkedSurface, Scratch, Store, damaged, failed, in_memory};
use crate::surface::Edits;
use crate::task::Task;
use ravec_pieces::PartStore;
use ravec_progress::Progress;
use self_cell::self_cell;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// The input, and its search tree.
struct Prepared {
    input: Input,
    task: Task,
}

/// Data computed once from an input.
struct Ready<'a> {
    field: Field<'a>,
    enclosed: Enclosed,
    is_rough: OnceLock<bool>,
}

self_cell!(
    struct Session {
        owner: Prepared,
        #[not_covariant]
        dependent: Ready,
    }
);

/// The edits of some rounds.
#[derive(Default)]
struct KnownEdits {
    rounds: u32,
    all: Edits,
    latest: Edits,
}

/// Runs pieces of an offset that [`offset_in_pieces`](crate::offset_in_pieces) coordinates, usually in another process.
///
/// Keeps the mesh with its search tree from piece to piece, and at most one tile or chunk beside it, in
/// [`OffsetParams::memory_bytes`](crate::OffsetParams::memory_bytes) together.
pub struct OffsetWorker {
    parts: Arc<dyn PartStore>,
    session: Session,
    edits: Mutex<Arc<KnownEdits>>,
    surface: Mutex<Option<(u64, Arc<ChunkedSurface>)>>,
}

impl std::fmt::Debug for OffsetWorker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OffsetWorker").finish_non_exhaustive()
    }
}

impl OffsetWorker {
    /// Prepares the work whose parts are in a store.
    ///
    /// # Errors
    /// [`OffsetError::Storage`] if there is no such work or the store fails; [`OffsetError::Cancelled`].
    pub fn open(parts: Arc<dyn PartStore>, progress: &Progress) -> Result<Self, OffsetError> {
        let input = Input::decoded(&parts.read_all(INPUT).map_err(failed)?)?;
        let task = Task::checked(&input.mesh, &input.params, false, progress)?;
        let session = Session::try_new(Prepared { input, task }, |prepared| {
            let Prepared { input, task } = prepared;
            let field = task.field(progress)?;
            let finish = task.finish(&input.mesh, &input.params, &field, &in_memory)?;
            let nodes = finish.budget.nodes;
            let enclosed = task.enclosed(&field, input.params.side, nodes, progress)?;
            Ok::<_, OffsetError>(Ready {
                field,
                enclosed,
                is_rough: OnceLock::new(),
            })
        })?;
        Ok(Self {
            parts,
            session,
            edits: Mutex::default(),
            surface: Mutex::default(),
        })
    }

    /// Runs a piece; returns the answer for the coordinator.
    ///
    /// # Errors
    /// [`OffsetError::Storage`] if the store fails, or the bytes are no piece; [`OffsetError::Cancelled`].
    pub fn run(&self, piece: &[u8], progress: &Progress) -> Result<Vec<u8>, OffsetError> {
        let Piece { part, work } = ravec_pieces::from_bytes(piece).map_err(failed)?;
        let own = Scratch::of_parts(Arc::clone(&self.parts), part);
        let answer = (self.session).with_dependent(|prepared, ready| {
            let Prepared { input, task } = prepared;
            let finish = task.finish(&input.mesh, &input.params, &ready.field, &in_memory)?;
            let repair = task.repair(&input.params, &finish, &ready.enclosed);
            let job = Job {
                worker: self,
                input,
                ready,
                finish: &finish,
                repair: &repair,
                progress,
            };
            job.run(work, own)
        });
        let answer = match answer {
            Err(OffsetError::MissingPart { part }) => Answer::Missing(part),
            other => other?,
        };
        ravec_pieces::to_bytes(&answer).map_err(failed)
    }

    /// Returns the edits of some rounds.
    fn edits(&self, rounds: u32) -> Result<Arc<KnownEdits>, OffsetError> {
        let mut known = self.edits.lock().unwrap_or_else(PoisonError::into_inner);
        if known.rounds != rounds {
            let mut next = if known.rounds < rounds {
                KnownEdits {
                    rounds: known.rounds,
                    all: known.all.clone(),
                    latest: Edits::default(),
                }
            } else {
                KnownEdits::default()
            };
            while next.rounds < rounds {
                next.rounds += 1;
                let bytes = self.parts.read_all(&edits_name(next.rounds));
                let bytes = bytes.map_err(failed)?;
                next.latest = ravec_pieces::from_bytes(&bytes).map_err(failed)?;
                next.all.extend(&next.latest);
            }
            *known = Arc::new(next);
        }
        Ok(Arc::clone(&known))
    }

    /// Returns a published surface that has a chunk.
    fn surface(&self, number: u64, chunk: usize) -> Result<Arc<ChunkedSurface>, OffsetError> {
        let surface = self.known_surface(number)?;
        if chunk < surface.count() {
            Ok(surface)
        } else {
            Err(damaged())
        }
    }

    fn known_surface(&self, number: u64) -> Result<Arc<ChunkedSurface>, OffsetError> {
        let mut known = self.surface.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((of, surface)) = &*known
            && *of == number
        {
            return Ok(Arc::clone(surface));
        }
        let bytes = self.parts.read_all(&surface_name(number)).map_err(failed)?;
        let scratch = Scratch::of_parts(Arc::clone(&self.parts), u64::MAX);
        let surface = Arc::new(ChunkedSurface::from_bytes(&bytes, scratch)?);
        *known = Some((number, Arc::clone(&surface)));
        Ok(surface)
    }
}

/// A piece with all that it needs.
struct Job<'j, 'a> {
    worker: &'j OffsetWorker,
    input: &'a Input,
    ready: &'j Ready<'a>,
    finish: &'j Finish<'j>,
    repair: &'j Repair<'j>,
    progress: &'j Progress,
}

impl Job<'_, '_> {
    fn run(&self, work: Work, own: Scratch) -> Result<Answer, OffsetError> {
        let Self {
            worker, progress, ..
        } = *self;
        match work {
            Work::Tile {
                task,
                rounds,
                levels,
                fits,
            } => {
                let edits = worker.edits(rounds)?;
                let round = Round {
                    edits: &edits.all,
                    latest: &edits.latest,
                    levels,
                };
                let outcome = match task {
                    TileTask::Grow(key) if fits => {
                        self.repair.regrown(key, &own, round, progress)?
                    }
                    task => self.repair.advance_tile(task, &own, round, progress)?,
                };
                own.write()?;
                Ok(Answer::Tile(outcome))
            }
            Work::Divide(tile) => {
                let parts = Scratch::of_parts(Arc::clone(&worker.parts), u64::MAX);
                let store = Store::Storage(own);
                let blocks = divide_tile(&tile, &parts, &store, progress)?;
                store.write()?;
                Ok(Answer::Blocks(blocks))
            }
            Work::Defects { surface, chunk } => {
                let surface = worker.surface(surface, chunk)?;
                Ok(Answer::Defects(surface.defects_in(chunk, progress)?))
            }
            Work::Simplify { surface, task } => {
                let surface = worker.surface(surface, task.chunk)?;
                let store = Store::Storage(own);
                let Input { mesh, params } = self.input;
                let is_rough = *(self.ready.is_rough).get_or_init(|| is_rough(mesh, params));
                let simplifier = Simplifier::new(
                    &self.ready.field,
                    params,
                    self.finish.limits,
                    is_rough,
                    progress,
                );
                let done = simplifier.simplify_chunk(&surface, task, &store)?;
                store.write()?;
                Ok(Answer::Simplified(Box::new(done)))
            }
            Work::Pairs { surface, chunk } => {
                let surface = worker.surface(surface, chunk)?;
                Ok(Answer::Pairs(surface.pairs_in(chunk, progress)?))
            }
            Work::Facts {
                surface,
                chunk,
                ample_distance,
            } => {
                let surface = worker.surface(surface, chunk)?;
                let facts =
                    (self.finish).facts_of_chunk(&surface, chunk, ample_distance, progress)?;
                Ok(Answer::Facts(facts))
            }
        }
    }
}
