//! The name of standard streams.

use std::path::Path;

/// True if `path` is `-`, which stands for standard input where it is read and for standard output where it is written.
pub fn is_stream(path: &Path) -> bool {
    path.as_os_str() == "-"
}
