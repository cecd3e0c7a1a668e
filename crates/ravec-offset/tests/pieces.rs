//! Offsets whose steps others run: the same surfaces and reports, whatever the order, and whatever is lost on the way.

mod support;

use ravec_mesh::TriMesh;
use ravec_offset::{
    OffsetError, OffsetParams, OffsetWorker, Side, Storage, StoredOffset, offset_in_pieces,
    offset_stored,
};
use ravec_pieces::{Crew, FolderStore, PartStore, Team};
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

/// What happens to the pieces.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Luck {
    /// They run in order.
    Good,
    /// They run in any order, some of them twice, by workers that have just started.
    Mixed,
    /// Parts are lost, too.
    Bad,
}

/// A crew in this process.
struct Bench {
    store: Arc<dyn PartStore>,
    worker: Option<OffsetWorker>,
    pieces: VecDeque<(u64, Vec<u8>)>,
    luck: Luck,
    ran: Arc<AtomicU64>,
    lost: Arc<AtomicU64>,
}

impl Bench {
    fn new(folder: &Path, luck: Luck) -> Self {
        Self {
            store: Arc::new(FolderStore::new(folder)),
            worker: None,
            pieces: VecDeque::new(),
            luck,
            ran: Arc::default(),
            lost: Arc::default(),
        }
    }
}

impl Crew for Bench {
    fn submit(&mut self, number: u64, piece: Vec<u8>) -> io::Result<()> {
        if self.luck != Luck::Good {
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
        if self.luck != Luck::Good && ran.is_multiple_of(5) {
            self.worker = None;
        }
        if self.luck == Luck::Bad && ran.is_multiple_of(4) {
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
fn in_pieces(mesh: &TriMesh, asked: &OffsetParams, luck: Luck) -> (StoredOffset, [u64; 2]) {
    let folder = tempfile::tempdir().unwrap();
    let bench = Bench::new(folder.path(), luck);
    let counts = [&bench.ran, &bench.lost].map(Arc::clone);
    let team = Arc::new(Team::new(Arc::clone(&bench.store), Box::new(bench)));
    let none = Progress::none();
    let made = offset_in_pieces(mesh, asked, &storage, &team, &none).unwrap();
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
        ("comb", &comb, params(Side::Both, 0.05, 0.001, true)),
        ("comb", &comb, params(Side::Both, 0.05, 0.001, false)),
    ] {
        let asked = limited(&asked);
        let none = Progress::none();
        let alone = offset_stored(mesh, &asked, &storage, &none).unwrap();
        let expected = alone.surface.into_mesh(&none).unwrap();
        assert!(alone.report.tiles > 1, "{name}: {}", alone.report.tiles);
        for luck in [Luck::Good, Luck::Mixed, Luck::Bad] {
            let (made, [ran, lost]) = in_pieces(mesh, &asked, luck);
            assert_eq!(made.report, alone.report, "{name}, {luck:?}");
            let mesh = made.surface.into_mesh(&none).unwrap();
            assert!(mesh == expected, "{name}, {luck:?}");
            assert!(ran > 20);
            assert_eq!(lost > 0, luck == Luck::Bad, "{name}");
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
        let (made, _) = in_pieces(&mesh, &asked, Luck::Good);
        assert_eq!(made.report, alone.report);
        let [made, alone] = [made, alone].map(|offset| offset.surface.into_mesh(&none).unwrap());
        assert!(made == alone);
    }
}

#[test]
fn a_failed_piece_and_a_cancellation_end_the_work() {
    struct Broken(Option<io::ErrorKind>);
    impl Crew for Broken {
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
    let run = |crew: Broken| {
        let team = Arc::new(Team::new(Arc::clone(&store), Box::new(crew)));
        offset_in_pieces(&mesh, &asked, &storage, &team, &Progress::none()).unwrap_err()
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
    let bench = Bench::new(folder.path(), Luck::Good);
    let team = Arc::new(Team::new(Arc::clone(&store), Box::new(bench)));
    offset_in_pieces(&mesh, &asked, &storage, &team, &none).unwrap();
    let worker = OffsetWorker::open(store, &none).unwrap();
    for piece in [&[][..], &[9; 3], &[255; 40]] {
        assert!(worker.run(piece, &none).is_err());
    }
}
