//! Offsets whose steps run in pieces: the same surfaces and reports in any order of the pieces, and with lost parts.

mod support;

use ravec_mesh::TriMesh;
use ravec_offset::{
    OffsetError, OffsetParams, OffsetWorker, Side, Storage, StoredOffset, offset_in_pieces,
    offset_stored,
};
use ravec_pieces::{Cluster, Executor, FolderStore, PartStore};
use ravec_progress::Progress;
use ravec_scenes::solids::{comb, torus};
use std::collections::VecDeque;
use std::io::{self, Cursor, Error};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use support::verdict::params;

/// Memory limit under which surfaces of these small meshes have some thousand triangles at once.
const LITTLE: u64 = 66 << 20;

#[expect(clippy::unnecessary_wraps, reason = "others may fail")]
fn storage() -> io::Result<Box<dyn Storage>> {
    Ok(Box::new(Cursor::new(Vec::new())))
}

/// Faults of the executor.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Faults {
    /// Pieces run in order.
    None,
    /// Pieces run in another order, some of them twice, by workers that have just started.
    Reordered,
    /// Parts are lost as well.
    LostParts,
}

/// An executor in this process.
struct LocalExecutor {
    store: Arc<dyn PartStore>,
    worker: Option<OffsetWorker>,
    pieces: VecDeque<(u64, Vec<u8>)>,
    faults: Faults,
    ran: Arc<AtomicU64>,
    lost: Arc<AtomicU64>,
}

impl LocalExecutor {
    fn new(folder: &Path, faults: Faults) -> Self {
        Self {
            store: Arc::new(FolderStore::new(folder)),
            worker: None,
            pieces: VecDeque::new(),
            faults,
            ran: Arc::default(),
            lost: Arc::default(),
        }
    }
}

impl Executor for LocalExecutor {
    fn submit(&mut self, number: u64, piece: Vec<u8>) -> io::Result<()> {
        if self.faults != Faults::None {
            if number.is_multiple_of(3) {
                self.pieces.push_front((number, piece.clone()));
            }
            if number.is_multiple_of(2) {
                self.pieces.push_front((number, piece));
                return Ok(());
            }
        }
        self.pieces.push_back((number, piece));
        Ok(())
    }

    fn next(&mut self, progress: &Progress) -> io::Result<(u64, Vec<u8>)> {
        let (number, piece) = self.pieces.pop_front().expect("a piece is out");
        let ran = 1 + self.ran.fetch_add(1, Ordering::Relaxed);
        if self.faults != Faults::None && ran.is_multiple_of(5) {
            self.worker = None;
        }
        if self.faults == Faults::LostParts && ran.is_multiple_of(4) {
            let part = format!("part-{}", number.saturating_sub(1 + ran / 4 % 7));
            let was_there = self.store.read_all(&part).is_ok();
            self.lost.fetch_add(u64::from(was_there), Ordering::Relaxed);
            self.store.remove(&part)?;
        }
        let store = Arc::clone(&self.store);
        let worker = match self.worker.take() {
            Some(worker) => worker,
            None => OffsetWorker::open(store, progress).map_err(Error::other)?,
        };
        let answer = worker.run(&piece, progress).map_err(Error::other)?;
        self.worker = Some(worker);
        Ok((number, answer))
    }
}

fn limited(asked: &OffsetParams) -> OffsetParams {
    OffsetParams {
        memory_bytes: Some(LITTLE),
        ..asked.clone()
    }
}

/// Returns the offset, the number of pieces that ran, and that of parts that were lost.
fn in_pieces(mesh: &TriMesh, asked: &OffsetParams, faults: Faults) -> (StoredOffset, [u64; 2]) {
    let folder = tempfile::tempdir().unwrap();
    let executor = LocalExecutor::new(folder.path(), faults);
    let counts = [&executor.ran, &executor.lost].map(Arc::clone);
    let cluster = Arc::new(Cluster::new(
        Arc::clone(&executor.store),
        Box::new(executor),
    ));
    let none = Progress::none();
    let made = offset_in_pieces(mesh, asked, &storage, &cluster, &none).unwrap();
    let StoredOffset { surface, report } = made;
    // the surface may lie in parts
    let surface = surface.into_mesh(&none).unwrap().into();
    let counts = counts.map(|count| count.load(Ordering::Relaxed));
    (StoredOffset { surface, report }, counts)
}

#[test]
fn the_surface_is_the_same_byte_by_byte_whoever_runs_the_pieces() {
    let ring = torus(1.0, 0.4, 24, 16).mesh;
    let comb = comb(2, 0.3, 0.3, 0.8).mesh;
    for (name, mesh, asked) in [
        ("ring", &ring, params(Side::Outer, 0.08, 0.0008, true)),
        ("comb", &comb, params(Side::Both, 0.05, 0.001, false)),
    ] {
        let asked = limited(&asked);
        let none = Progress::none();
        let alone = offset_stored(mesh, &asked, &storage, &none).unwrap();
        let expected = alone.surface.into_mesh(&none).unwrap();
        assert!(alone.report.tiles > 1, "{name}: {}", alone.report.tiles);
        for faults in [Faults::None, Faults::Reordered, Faults::LostParts] {
            let (made, [ran, lost]) = in_pieces(mesh, &asked, faults);
            assert_eq!(made.report, alone.report, "{name}, {faults:?}");
            let mesh = made.surface.into_mesh(&none).unwrap();
            assert!(mesh == expected, "{name}, {faults:?}");
            assert!(ran > 20);
            assert_eq!(lost > 0, faults == Faults::LostParts, "{name}");
        }
    }
}

#[test]
fn a_shell_and_a_surface_in_one_piece_are_made_as_well() {
    let mesh = torus(1.0, 0.4, 12, 8).mesh;
    for asked in [
        limited(&params(Side::Shell, 0.08, 0.0016, false)),
        params(Side::Outer, 0.08, 0.004, true),
    ] {
        let none = Progress::none();
        let alone = offset_stored(&mesh, &asked, &storage, &none).unwrap();
        let (made, _) = in_pieces(&mesh, &asked, Faults::None);
        assert_eq!(made.report, alone.report);
        let [made, alone] = [made, alone].map(|offset| offset.surface.into_mesh(&none).unwrap());
        assert!(made == alone);
    }
}

#[test]
fn a_failed_piece_and_a_cancellation_end_the_work() {
    struct Broken(Option<io::ErrorKind>);
    impl Executor for Broken {
        fn submit(&mut self, _: u64, _: Vec<u8>) -> io::Result<()> {
            Ok(())
        }
        fn next(&mut self, _: &Progress) -> io::Result<(u64, Vec<u8>)> {
            Err(match self.0 {
                Some(kind) => Error::new(kind, "stopped"),
                None => Error::other("the disk is full"),
            })
        }
    }
    let mesh = torus(1.0, 0.4, 12, 8).mesh;
    let asked = limited(&params(Side::Outer, 0.08, 0.0016, true));
    let folder = tempfile::tempdir().unwrap();
    let store: Arc<dyn PartStore> = Arc::new(FolderStore::new(folder.path()));
    let run = |executor: Broken| {
        let cluster = Arc::new(Cluster::new(Arc::clone(&store), Box::new(executor)));
        offset_in_pieces(&mesh, &asked, &storage, &cluster, &Progress::none()).unwrap_err()
    };
    let error = run(Broken(None));
    assert!(error.to_string().contains("the disk is full"), "{error}");
    let error = run(Broken(Some(io::ErrorKind::Interrupted)));
    assert!(matches!(error, OffsetError::Cancelled(_)));
}

#[test]
fn what_no_coordinator_wrote_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let store: Arc<dyn PartStore> = Arc::new(FolderStore::new(folder.path()));
    let none = Progress::none();
    assert!(OffsetWorker::open(Arc::clone(&store), &none).is_err());
    for bytes in [&[][..], &[1; 7], &[255; 64]] {
        store.write("input", bytes).unwrap();
        let error = OffsetWorker::open(Arc::clone(&store), &none).unwrap_err();
        assert!(matches!(error, OffsetError::Storage { .. }), "{error}");
    }
    let mesh = torus(1.0, 0.4, 12, 8).mesh;
    let asked = params(Side::Outer, 0.08, 0.004, true);
    let executor = LocalExecutor::new(folder.path(), Faults::None);
    let cluster = Arc::new(Cluster::new(Arc::clone(&store), Box::new(executor)));
    offset_in_pieces(&mesh, &asked, &storage, &cluster, &none).unwrap();
    let worker = OffsetWorker::open(store, &none).unwrap();
    for piece in [&[][..], &[9; 3], &[255; 40]] {
        assert!(worker.run(piece, &none).is_err());
    }
}
