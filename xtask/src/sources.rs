//! Names that sources may not mention.
//!
//! An arrow keeps crates apart, but the standard library is everywhere: that the crates below `media` never touch a
//! file, a socket or another process is read from their sources. Tests and comments are left out.
//!
//! Does not guarantee: a path hidden behind a macro or a renamed import passes. The check is against accidents.

use anyhow::Context as _;
use std::path::{Path, PathBuf};

/// The crates whose readers and writers take `impl Read` and `impl Write`.
const WITHOUT_FILES: &[&str] = &[
    "ravec",
    "ravec-mesh",
    "ravec-mesh-render",
    "ravec-mosaic",
    "ravec-progress",
    "ravec-raster",
    "ravec-scenes",
    "ravec-twocolor",
];

/// Names that reach out of the program. Each begins at the start of a word.
const REFUSED: &[&str] = &[
    "std::fs",
    "fs::",
    "File::",
    "OpenOptions",
    "std::net",
    "std::process",
    "Command::new",
];

/// Each line that the rules refuse, as a sentence.
pub fn refused(root: &Path) -> anyhow::Result<Vec<String>> {
    let mut refused = Vec::new();
    for name in WITHOUT_FILES {
        for path in rust_files(&root.join("crates").join(name).join("src"))? {
            let source = std::fs::read_to_string(&path)
                .with_context(|| format!("reading {}", path.display()))?;
            for (line, word) in mentions(&source) {
                refused.push(format!(
                    "{}:{line}: `{word}` in a crate that touches no files: take `impl Read` or `impl Write`",
                    path.strip_prefix(root).unwrap_or(&path).display()
                ));
            }
        }
    }
    Ok(refused)
}

/// All `.rs` files below `folder`, sorted.
fn rust_files(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let entries =
        std::fs::read_dir(folder).with_context(|| format!("listing {}", folder.display()))?;
    for entry in entries {
        let path = entry?.path();
        if path.is_dir() {
            files.extend(rust_files(&path)?);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// The refused words with their line numbers, up to the tests, which are last in each file of ours.
fn mentions(source: &str) -> Vec<(usize, &'static str)> {
    let mut found = Vec::new();
    for (index, line) in source.lines().enumerate() {
        if line.trim() == "#[cfg(test)]" {
            break;
        }
        let code = line.split("//").next().unwrap_or_default();
        for word in REFUSED {
            let starts_a_word = |at: usize| {
                !code[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == ':')
            };
            if code.match_indices(word).any(|(at, _)| starts_a_word(at)) {
                found.push((index + 1, *word));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_in_code_is_found_with_its_line() {
        let source = "use std::io::Read;\nlet file = std::fs::File::open(path)?;\n";
        assert_eq!(mentions(source), [(2, "std::fs")]);
        assert_eq!(mentions("let text = fs::read(path);"), [(1, "fs::")]);
        assert_eq!(mentions("    File::create(path)"), [(1, "File::")]);
    }

    #[test]
    fn comments_tests_and_longer_words_are_left_alone() {
        assert_eq!(mentions("//! never uses std::fs\n/// nor fs::read\n"), []);
        assert_eq!(mentions("#[cfg(test)]\nmod tests { use std::fs; }"), []);
        assert_eq!(mentions("MyFile::open(); offs::value()"), []);
    }
}
