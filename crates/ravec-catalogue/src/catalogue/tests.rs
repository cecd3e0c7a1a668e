#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

use super::*;
use std::path::Path;

/// An entry with all that an entry may have.
fn photo(path: &str) -> Entry {
    let size = ravec_raster::Size::new(36, 27).unwrap();
    Entry {
        id: 0,
        path: path.into(),
        width: 4000,
        height: 3000,
        orientation: 6,
        taken: Some("2016-05-04 03:02:01".into()),
        unreadable: None,
        flaw: None,
        dropped: None,
        bytes: 1234,
        modified: -5,
        hash: vec![7; 32],
        thumbnail: Some(Image::from_fn(size, |col, row| {
            Srgb([col as u8, row as u8, 9])
        })),
    }
}

/// A catalogue with three photos.
fn three(folder: &Path) -> PathBuf {
    let path = folder.join("photos.ravec");
    let mut catalogue = Catalogue::open_or_make(&path, &Progress::none()).unwrap();
    let changes = ["/a.jpg", "/b.jpg", "/c.jpg"].map(|path| Change::Put(Box::new(photo(path))));
    catalogue.change(&changes).unwrap();
    path
}

/// The database without the settings that keep its content from doing anything.
fn tamper(path: &Path, sql: &str) {
    let connection = Connection::open(path).unwrap();
    connection.execute_batch(sql).unwrap();
}

fn read_all(path: &Path) -> Result<usize, CatalogueError> {
    let catalogue = Catalogue::open_to_read(path, &Progress::none())?;
    catalogue.entries(true)?;
    let loaded = catalogue.usable(&MemoryBudget::unlimited())?;
    catalogue.knows(Path::new("/no/such/file"))?;
    Ok(loaded.entries.len())
}

#[test]
fn other_files_and_newer_catalogues_are_refused_and_stay_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let (path, progress) = (folder.path().join("photos.ravec"), Progress::none());
    for open in [Catalogue::open, Catalogue::open_to_read] {
        let error = open(&path, &progress).unwrap_err();
        assert!(matches!(error, CatalogueError::NoCatalogue { .. }));
    }
    assert!(!path.exists());
    drop(Catalogue::open_or_make(&path, &progress).unwrap());
    let catalogue = Catalogue::open(&path, &progress).unwrap();
    assert!(catalogue.entries(true).unwrap().is_empty());
    drop(catalogue);
    tamper(&path, "PRAGMA user_version = 7");
    let error = Catalogue::open_or_make(&path, &progress).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("has format 7 of a newer version"), "{text}");

    let database = folder.path().join("other.db");
    tamper(&database, "CREATE TABLE a (b);");
    let text = folder.path().join("text");
    ravec_files::write_atomically(&text, |writer| {
        std::io::Write::write_all(writer, &[b'a'; 4000])
    })
    .unwrap();
    for other in [&database, &text, &folder.path().to_path_buf()] {
        for open in [
            Catalogue::open,
            Catalogue::open_to_read,
            Catalogue::open_or_make,
        ] {
            let error = open(other, &progress).unwrap_err();
            assert!(
                matches!(error, CatalogueError::NotACatalogue { .. }),
                "{error}"
            );
        }
    }
    assert_eq!(std::fs::read(&text).unwrap(), [b'a'; 4000]);
    let error = Catalogue::open_or_make(&folder.path().join("no/a"), &progress).unwrap_err();
    assert!(matches!(error, CatalogueError::Change { .. }), "{error}");
}

#[test]
fn what_was_put_is_read_back_by_a_connection_that_cannot_write() {
    let folder = tempfile::tempdir().unwrap();
    let path = three(folder.path());
    let mut catalogue = Catalogue::open_to_read(&path, &Progress::none()).unwrap();
    let memory = MemoryBudget::unlimited();
    let loaded = catalogue.usable(&memory).unwrap();
    let paths = ["/a.jpg", "/b.jpg", "/c.jpg"];
    for ((number, path), entry) in (1..).zip(paths).zip(&loaded.entries) {
        let expected = Entry {
            id: number,
            ..photo(path)
        };
        assert_eq!(*entry, expected);
    }
    assert!(memory.used() >= 3 * 36 * 27 * 3, "{}", memory.used());
    let small = MemoryBudget::new(4000);
    let error = catalogue.usable(&small).unwrap_err();
    assert!(matches!(error, CatalogueError::Memory { .. }), "{error}");

    let error = catalogue.change(&[Change::Put(Box::new(photo("/d.jpg")))]);
    let text = error.unwrap_err().to_string();
    assert!(text.ends_with("it is write-protected"), "{text}");
    assert_eq!(read_all(&path).unwrap(), 3);
    let files: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(files.len(), 1, "a catalogue at rest is one file");
}

#[test]
fn rows_that_nobody_wrote_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for wrong in [
        "path = '/a' || char(0) || 'b'",
        "path = CAST(x'2fff' AS TEXT)",
        "path = 'relative.jpg'",
        "path = ''",
        "path = x'2f61'",
        "path = '/' || hex(zeroblob(40000))",
        "path = '/' || hex(zeroblob(1000000))",
        "hash = x'07'",
        "hash = 'text'",
        "bytes = -1",
        "bytes = 'many'",
        "modified = 1.5",
        "width = -1",
        "width = 0",
        "height = 4294967296",
        "height = 9223372036854775807",
        "orientation = 9",
        "orientation = -1",
        "taken = x'00'",
        "unreadable = CAST(x'ff' AS TEXT)",
        "flaw = hex(zeroblob(1000000))",
        "thumbnail_width = 0",
        "thumbnail_width = -36",
        "thumbnail_width = 35",
        "thumbnail_width = 9223372036854775807",
        "thumbnail = x''",
        "thumbnail = x'0102'",
        "thumbnail = 'text'",
        "thumbnail_width = 1, thumbnail = zeroblob(111)",
        "thumbnail_width = 37, thumbnail = zeroblob(111)",
        "thumbnail_width = 1000, thumbnail = zeroblob(3000000)",
    ] {
        let path = three(folder.path());
        tamper(&path, &format!("UPDATE photo SET {wrong} WHERE id = 2"));
        let error = read_all(&path).expect_err(wrong);
        assert!(
            matches!(error, CatalogueError::Damaged { .. }),
            "{wrong}: {error}"
        );
        std::fs::remove_file(path).unwrap();
    }
}

#[test]
fn other_tables_views_and_triggers_are_refused_and_not_run() {
    let folder = tempfile::tempdir().unwrap();
    for wrong in [
        "CREATE TABLE other (a)",
        "CREATE TRIGGER t AFTER INSERT ON photo BEGIN DELETE FROM photo; END",
        "CREATE VIEW v AS SELECT load_extension('x')",
        "DROP INDEX photo_by_hash",
        "ALTER TABLE photo RENAME TO old; CREATE VIEW photo AS SELECT * FROM old",
        "ALTER TABLE photo ADD COLUMN more TEXT",
        "ALTER TABLE photo ADD COLUMN more AS (zeroblob(1000000000))",
    ] {
        let path = three(folder.path());
        tamper(&path, wrong);
        for open in [
            Catalogue::open,
            Catalogue::open_to_read,
            Catalogue::open_or_make,
        ] {
            let error = open(&path, &Progress::none()).expect_err(wrong);
            assert!(
                matches!(error, CatalogueError::Damaged { .. }),
                "{wrong}: {error}"
            );
        }
        std::fs::remove_file(path).unwrap();
    }
}

#[test]
fn broken_pages_give_an_error_whichever_byte_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = three(folder.path());
    let whole = std::fs::read(&path).unwrap();
    let other = folder.path().join("broken.ravec");
    for at in (0..whole.len()).step_by(211) {
        for value in [0x00, 0x80, 0xff] {
            let mut broken = whole.clone();
            broken[at] = value;
            broken[(at * 7 + 13) % whole.len()] ^= value;
            std::fs::write(&other, &broken).unwrap();
            // must not panic; many bytes do not matter
            let _ = read_all(&other);
            if let Ok(mut catalogue) = Catalogue::open(&other, &Progress::none()) {
                let _ = catalogue.change(&[Change::Put(Box::new(photo("/d.jpg")))]);
            }
        }
    }
    for length in (0..whole.len()).step_by(1000) {
        std::fs::write(&other, &whole[..length]).unwrap();
        match read_all(&other) {
            // pages of an index that is not used
            Ok(photos) => assert_eq!(photos, 3),
            Err(CatalogueError::Damaged { .. } | CatalogueError::NotACatalogue { .. }) => {}
            Err(error) => panic!("{length}: {error}"),
        }
    }
}

#[test]
fn rows_that_share_their_pages_do_not_take_more_memory_than_the_file() {
    let account = |rows: u64, bytes: u64| {
        let file = tempfile::NamedTempFile::new().unwrap();
        file.as_file().set_len(10_000).unwrap();
        let memory = MemoryBudget::unlimited();
        let mut account = Account::new(file.path(), &memory);
        (0..rows).try_for_each(|_| account.enter(bytes, false))
    };
    assert!(account(10, 1000).is_ok());
    assert!(matches!(account(11, 1000), Err(Trouble::Damaged(_))));
    let most = MAX_PHOTOS as u64;
    assert!(account(most, 0).is_ok());
    assert!(matches!(account(most + 1, 0), Err(Trouble::Damaged(_))));
}

#[test]
fn a_change_that_a_killed_process_left_half_done_is_taken_back_by_a_reader() {
    let folder = tempfile::tempdir().unwrap();
    let path = three(folder.path());
    let torn = folder.path().join("torn.ravec");
    let connection = Connection::open(&path).unwrap();
    // pages go to the file before the change is complete
    connection
        .execute_batch("PRAGMA cache_size = 1; PRAGMA cache_spill = 1; BEGIN;")
        .unwrap();
    for number in 0..200 {
        let mut entry = photo("/new.jpg");
        entry.path = format!("/new-{number}.jpg").into();
        Change::Put(Box::new(entry)).make(&connection).unwrap();
    }
    std::fs::copy(&path, &torn).unwrap();
    let journal = folder.path().join("photos.ravec-journal");
    std::fs::copy(&journal, folder.path().join("torn.ravec-journal")).unwrap();
    drop(connection);
    assert_ne!(
        std::fs::metadata(&torn).unwrap().len(),
        std::fs::metadata(&path).unwrap().len(),
        "the file has pages of the change"
    );
    assert_eq!(read_all(&torn).unwrap(), 3);
    assert!(!folder.path().join("torn.ravec-journal").exists());
}

#[test]
fn whoever_waits_for_another_process_can_be_cancelled() {
    let folder = tempfile::tempdir().unwrap();
    let path = three(folder.path());
    let other = Connection::open(&path).unwrap();
    other.execute_batch("BEGIN EXCLUSIVE").unwrap();
    for open in [
        Catalogue::open,
        Catalogue::open_to_read,
        Catalogue::open_or_make,
    ] {
        let error = open(&path, &Progress::cancelled_at(3)).unwrap_err();
        assert!(matches!(error, CatalogueError::Cancelled(_)), "{error}");
    }
    other.execute_batch("ROLLBACK").unwrap();
    assert_eq!(read_all(&path).unwrap(), 3);
}

#[test]
fn a_number_that_another_photo_has_got_since_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = three(folder.path());
    let mut catalogue = Catalogue::open(&path, &Progress::none()).unwrap();
    let stale = |path: &str| (3, PathBuf::from(path));
    let (id, path) = stale("/before.jpg");
    let changes = [
        Change::Forget {
            id,
            path: path.clone(),
        },
        Change::Drop {
            id,
            path: path.clone(),
            reason: "tiny".into(),
        },
        Change::Move {
            id,
            from: path,
            to: "/elsewhere.jpg".into(),
            bytes: 1,
            modified: 1,
        },
    ];
    assert_eq!(catalogue.change(&changes).unwrap(), 0);
    let entries = catalogue.entries(false).unwrap();
    assert_eq!(entries[2].path, Path::new("/c.jpg"));
}

#[cfg(unix)]
#[test]
fn a_photo_is_known_by_every_link_and_spelling() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().canonicalize().unwrap();
    let path = root.join("photos.ravec");
    let mut catalogue = Catalogue::open_or_make(&path, &Progress::none()).unwrap();
    std::fs::create_dir_all(root.join("in/deep")).unwrap();
    for name in ["in/deep/a.jpg", "in/other.jpg"] {
        std::fs::write(root.join(name), name).unwrap();
    }
    let known = ["in/deep/a.jpg", "in/gone.jpg"];
    let changes = known.map(|name| {
        let path = root.join(name);
        Change::Put(Box::new(photo(path.to_str().unwrap())))
    });
    catalogue.change(&changes).unwrap();
    symlink("in/deep", root.join("folder")).unwrap();
    symlink("folder/a.jpg", root.join("link.jpg")).unwrap();
    symlink("in/gone.jpg", root.join("dangling.jpg")).unwrap();
    symlink("photos.ravec", root.join("link.ravec")).unwrap();
    std::fs::hard_link(root.join("in/deep/a.jpg"), root.join("hard.jpg")).unwrap();
    std::fs::hard_link(&path, root.join("hard.ravec")).unwrap();

    for (name, reason) in [
        ("in/deep/a.jpg", "it is a photo of the catalogue"),
        ("in/./deep/../deep/a.jpg", "it is a photo of the catalogue"),
        ("folder/a.jpg", "it is a photo of the catalogue"),
        ("link.jpg", "it is a photo of the catalogue"),
        ("hard.jpg", "it is a photo of the catalogue"),
        ("in/gone.jpg", "it is a photo of the catalogue"),
        ("dangling.jpg", "it is a photo of the catalogue"),
        ("photos.ravec", "it belongs to the catalogue"),
        ("in/../photos.ravec", "it belongs to the catalogue"),
        ("link.ravec", "it belongs to the catalogue"),
        ("hard.ravec", "it belongs to the catalogue"),
        ("photos.ravec-journal", "it belongs to the catalogue"),
        ("in/../photos.ravec-wal", "it belongs to the catalogue"),
        ("photos.ravec-shm", "it belongs to the catalogue"),
    ] {
        assert!(catalogue.knows(&root.join(name)).unwrap(), "{name}");
        match catalogue.check_output(&root.join(name)) {
            Err(CatalogueError::Protected { reason: said, .. }) => {
                assert_eq!(said, reason, "{name}");
            }
            other => panic!("{name}: {other:?}"),
        }
    }
    for name in [
        "in/other.jpg",
        "new.jpg",
        "in/new.jpg",
        "no/new.jpg",
        "a.jpg",
    ] {
        assert!(!catalogue.knows(&root.join(name)).unwrap(), "{name}");
        catalogue.check_output(&root.join(name)).unwrap();
    }
    // the catalogue by another of its names
    let linked = Catalogue::open_to_read(&root.join("link.ravec"), &Progress::none()).unwrap();
    assert!(linked.knows(&path).unwrap());
    assert!(linked.knows(&root.join("photos.ravec-journal")).unwrap());

    for name in ["", "in", "in/deep", "folder", "in/.."] {
        assert!(
            catalogue.check_output_folder(&root.join(name)).is_err(),
            "{name}"
        );
    }
    for name in ["new", "in/new", "new/deeper"] {
        catalogue.check_output_folder(&root.join(name)).unwrap();
    }
}
