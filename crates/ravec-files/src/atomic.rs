//! Files that appear whole or not at all.

use crate::temporary::{TemporaryFile, folder_of, remove_stale};
use std::fs::{File, Permissions};
use std::io::{self, BufWriter, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

/// Writer for the content of a file that is being made.
pub type AtomicWriter<'a> = BufWriter<&'a File>;

/// Writes a file so that others see either its old content or the whole new one.
///
/// `write` fills a temporary file in the target's folder, which then takes the target's place. If `write` fails, or the
/// process is asked to stop inside it and it returns an error, the target is as it was and no temporary file is left.
/// Symbolic links are written through; a replaced file hands on its permissions; a new one gets those of any new file.
/// Targets that are not plain files (a pipe, `/dev/null`) get the finished content at the end.
///
/// The content reaches the disk before the name does: after a loss of power the target is old or new, never half there, as
/// far as the disk keeps what it confirmed.
///
/// Does not guarantee: that hard links and owner of a replaced file survive.
///
/// # Errors
/// Any error that `write` returns, or an error of the file system, such as a missing folder or a write-protected
/// target.
pub fn write_atomically<T, E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut AtomicWriter<'_>) -> Result<T, E>,
) -> Result<T, E> {
    let file = AtomicFile::create(path)?;
    let value = fill(file.file(), write)?;
    file.persist()?;
    Ok(value)
}

/// A file that is being made over a longer time: [`write_atomically`] for content that comes piece by piece.
///
/// It takes the place of its target by [`persist`](Self::persist), with the same guarantees. Dropped before, it leaves nothing.
pub struct AtomicFile {
    content: Content,
}

enum Content {
    /// To be renamed.
    File {
        temporary: TemporaryFile,
        path: PathBuf,
        permissions: Option<Permissions>,
    },
    /// To be copied into a pipe or a device.
    Stream { file: File, path: PathBuf },
}

impl AtomicFile {
    /// An empty file that is to replace `path`.
    ///
    /// # Errors
    /// Those of [`write_atomically`] before its content is written.
    pub fn create(path: &Path) -> io::Result<Self> {
        let content = match Target::of(path)? {
            Target::Stream(path) => Content::Stream {
                file: tempfile::tempfile()?,
                path,
            },
            Target::File { path, permissions } => Content::File {
                temporary: TemporaryFile::beside(&path)?,
                path,
                permissions,
            },
        };
        Ok(Self { content })
    }

    /// The file to write into.
    pub fn file(&self) -> &File {
        match &self.content {
            Content::File { temporary, .. } => temporary.as_file(),
            Content::Stream { file, .. } => file,
        }
    }

    /// Puts the content in place.
    ///
    /// # Errors
    /// An error of the file system; the target is as it was then, unless it is a pipe or a device.
    pub fn persist(self) -> io::Result<()> {
        match self.content {
            Content::Stream { mut file, path } => {
                file.seek(SeekFrom::Start(0))?;
                io::copy(&mut file, &mut File::options().write(true).open(path)?)?;
                Ok(())
            }
            Content::File {
                temporary,
                path,
                permissions,
            } => {
                if let Some(permissions) = permissions {
                    temporary.as_file().set_permissions(permissions)?;
                }
                temporary.persist(&path)
            }
        }
    }
}

/// Refuses a target that [`write_atomically`] could not even begin to write, so that long work for it need not be done.
///
/// Makes a temporary file in the target's folder and removes it, with those that killed processes left there for the same
/// target. Does not guarantee: that writing will succeed later.
///
/// # Errors
/// As [`write_atomically`] would have.
pub fn check_writable(path: &Path) -> io::Result<()> {
    match Target::of(path)? {
        Target::File { path, .. } => {
            remove_stale(&path);
            TemporaryFile::beside(&path).map(drop)
        }
        // opening a pipe would wait for its reader
        Target::Stream(_) => Ok(()),
    }
}

/// A file without a name, for what does not fit in memory: in the folder of what will be written `beside` it, if that is a plain
/// file, or else where the system keeps temporary files. It is gone when it is closed, or the program ends.
///
/// # Errors
/// The error of the file system, with the folder.
pub fn scratch_file(beside: Option<&Path>) -> io::Result<File> {
    let folder = match beside.map(Target::of).transpose()? {
        Some(Target::File { path, .. }) => folder_of(&path).to_owned(),
        Some(Target::Stream(_)) | None => std::env::temp_dir(),
    };
    let named = |error: io::Error| {
        let sentence = format!("a temporary file in {}: {error}", folder.display());
        io::Error::new(error.kind(), sentence)
    };
    tempfile::tempfile_in(&folder).map_err(named)
}

/// Final destination of the content.
enum Target {
    /// A plain file, old or to be made.
    File {
        path: PathBuf,
        /// Those of the old file.
        permissions: Option<Permissions>,
    },
    /// Something else that takes bytes.
    Stream(PathBuf),
}

impl Target {
    fn of(path: &Path) -> io::Result<Self> {
        let path = follow_links(path)?;
        match std::fs::metadata(&path) {
            Ok(old) if old.is_dir() => Err(io::ErrorKind::IsADirectory.into()),
            Ok(old) if !old.is_file() => Ok(Self::Stream(path)),
            Ok(old) if old.permissions().readonly() => Err(io::ErrorKind::PermissionDenied.into()),
            Ok(old) => Ok(Self::File {
                path,
                permissions: Some(old.permissions()),
            }),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Self::File {
                path,
                permissions: None,
            }),
            Err(error) => Err(error),
        }
    }
}

fn fill<T, E: From<io::Error>>(
    file: &File,
    write: impl FnOnce(&mut AtomicWriter<'_>) -> Result<T, E>,
) -> Result<T, E> {
    let mut writer = BufWriter::with_capacity(1 << 16, file);
    let value = write(&mut writer)?;
    writer.flush()?;
    Ok(value)
}

/// The path behind any symbolic links, which need not exist: where [`write_atomically`] writes.
///
/// # Errors
/// If a link cannot be read, or links lead in a circle.
pub fn follow_links(path: &Path) -> io::Result<PathBuf> {
    // as many links as Linux follows
    const MAX_LINKS: usize = 40;
    let mut path = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match std::fs::symlink_metadata(&path) {
            Ok(metadata) if metadata.is_symlink() => {
                let link = std::fs::read_link(&path)?;
                path = folder_of(&path).join(link);
            }
            _ => return Ok(path),
        }
    }
    Err(io::Error::other("too many levels of symbolic links"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn put(path: &Path, text: &str) -> io::Result<()> {
        write_atomically(path, |writer| writer.write_all(text.as_bytes()))
    }

    #[test]
    fn a_file_appears_and_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        put(&path, "one").unwrap();
        put(&path, "two").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "two");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_file_that_is_made_piece_by_piece_appears_at_the_end_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let file = AtomicFile::create(&path).unwrap();
        file.file().write_all(b"one").unwrap();
        assert!(!path.exists());
        file.file().write_all(b"two").unwrap();
        file.persist().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "onetwo");
        let file = AtomicFile::create(&path).unwrap();
        file.file().write_all(b"half").unwrap();
        drop(file);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "onetwo");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_scratch_file_has_no_name_and_needs_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let mut file = scratch_file(Some(&path)).unwrap();
        file.write_all(b"something").unwrap();
        assert_eq!(names(folder.path()), [""; 0]);
        scratch_file(None).unwrap();
        let error = scratch_file(Some(&path.join("b.txt"))).unwrap_err();
        assert!(error.to_string().contains("a.txt"), "{error}");
    }

    #[test]
    fn a_failing_writer_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        put(&path, "old").unwrap();
        let result: io::Result<()> = write_atomically(&path, |writer| {
            writer.write_all(&vec![0; 100_000])?;
            Err(io::Error::other("stopped"))
        });
        assert_eq!(result.unwrap_err().to_string(), "stopped");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn a_panicking_writer_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let result = std::panic::catch_unwind(|| {
            write_atomically(&path, |_| -> io::Result<()> { panic!("on purpose") })
        });
        assert!(result.is_err());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn a_missing_folder_and_a_folder_as_target_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("no/a.txt");
        let missing = put(&path, "x").unwrap_err();
        assert_eq!(missing.kind(), io::ErrorKind::NotFound);
        assert_eq!(missing.to_string(), "its folder does not exist");
        assert_eq!(
            check_writable(&path).unwrap_err().to_string(),
            missing.to_string()
        );
        let error = put(folder.path(), "x").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::IsADirectory);
        assert!(check_writable(folder.path()).is_err());
    }

    #[test]
    fn looking_whether_a_file_can_be_written_leaves_everything_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        check_writable(&path).unwrap();
        assert!(names(folder.path()).is_empty());
        put(&path, "old").unwrap();
        check_writable(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(names(folder.path()), ["a.txt"]);
        assert!(check_writable(&path.join("b.txt")).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn links_are_written_through_and_permissions_are_handed_on() {
        use std::os::unix::fs::{PermissionsExt as _, symlink};
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let (real, link) = (folder.path().join("real"), folder.path().join("link"));

        symlink("real", &link).unwrap();
        put(&link, "through a dangling link").unwrap();
        let plain = folder.path().join("plain");
        File::options()
            .write(true)
            .create_new(true)
            .open(&plain)
            .unwrap();
        assert_eq!(mode(&real), mode(&plain), "a new file has the usual mode");

        std::fs::set_permissions(&real, std::fs::Permissions::from_mode(0o640)).unwrap();
        put(&link, "again").unwrap();
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(std::fs::read_to_string(&real).unwrap(), "again");
        assert_eq!(mode(&real), 0o640);

        std::fs::set_permissions(&real, std::fs::Permissions::from_mode(0o440)).unwrap();
        let error = put(&real, "protected").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::PermissionDenied);

        symlink("b", folder.path().join("a")).unwrap();
        symlink("a", folder.path().join("b")).unwrap();
        assert!(put(&folder.path().join("a"), "x").is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_device_gets_the_content_and_stays_a_device() {
        put(Path::new("/dev/null"), "x").unwrap();
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
    }
}
