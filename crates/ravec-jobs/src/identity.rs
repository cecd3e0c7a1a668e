//! Files told apart by what they are, not by how their paths are spelled.

use crate::files::is_stream;
use ravec_files::follow_links;
use std::path::{Path, PathBuf};

/// A plain file that is there, or a place where one can be made.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) enum FileIdentity {
    /// A file by its device and number, which all links to it share.
    #[cfg(unix)]
    Node {
        /// The device.
        device: u64,
        /// The number of the file on the device.
        inode: u64,
    },
    /// A place in the file system, without links.
    Place(PathBuf),
}

impl FileIdentity {
    /// None for standard streams, for pipes, devices and folders, and for what cannot be found.
    pub fn of(path: &Path) -> Option<Self> {
        if is_stream(path) {
            return None;
        }
        match path.metadata() {
            Ok(metadata) if metadata.is_file() => {
                #[cfg(unix)]
                {
                    use std::os::unix::fs::MetadataExt as _;
                    Some(Self::Node {
                        device: metadata.dev(),
                        inode: metadata.ino(),
                    })
                }
                #[cfg(not(unix))]
                path.canonicalize().ok().map(Self::Place)
            }
            Ok(_) => None,
            Err(_) => {
                let path = follow_links(path).ok()?;
                let folder = match path.parent()? {
                    folder if folder == Path::new("") => Path::new("."),
                    folder => folder,
                };
                let place = folder.canonicalize().ok()?.join(path.file_name()?);
                Some(Self::Place(place))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn put(path: &Path) {
        fs::File::options()
            .write(true)
            .create_new(true)
            .open(path)
            .unwrap();
    }

    #[test]
    fn spellings_of_a_place_are_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("sub")).unwrap();
        for name in ["new", "old"] {
            if name == "old" {
                put(&at(name));
            }
            let identity = FileIdentity::of(&at(name)).unwrap();
            let detour = at("sub").join("..").join(name);
            assert_eq!(FileIdentity::of(&detour), Some(identity.clone()), "{name}");
            assert_ne!(FileIdentity::of(&at("other")), Some(identity));
        }
        assert_eq!(FileIdentity::of(Path::new("-")), None);
        assert_eq!(FileIdentity::of(folder.path()), None);
        assert_eq!(FileIdentity::of(&at("no/file")), None);
    }

    #[cfg(unix)]
    #[test]
    fn links_of_all_kinds_are_the_file_that_they_lead_to() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        put(&at("file"));
        fs::hard_link(at("file"), at("hard")).unwrap();
        symlink("file", at("soft")).unwrap();
        symlink(folder.path(), at("folder")).unwrap();
        symlink("missing", at("dangling")).unwrap();
        let identity = FileIdentity::of(&at("file"));
        assert!(identity.is_some());
        for name in ["hard", "soft", "folder/file", "folder/folder/soft"] {
            assert_eq!(FileIdentity::of(&at(name)), identity, "{name}");
        }
        assert_eq!(
            FileIdentity::of(&at("dangling")),
            FileIdentity::of(&at("missing"))
        );
        assert_eq!(FileIdentity::of(Path::new("/dev/null")), None);
    }
}
