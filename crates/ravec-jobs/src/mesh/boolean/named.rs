//! Mesh files with names by which expressions speak of them.

use crate::error::JobError;
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::fmt;
use std::path::PathBuf;

/// A mesh file and its name in the expression, as in `drill=parts/drill.ply`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "String", into = "String")]
pub struct NamedFile {
    /// Letters, digits and underscores; without one the file is called by a letter.
    pub name: Option<String>,
    /// The file of the mesh; `-` is standard input.
    pub path: PathBuf,
}

impl From<OsString> for NamedFile {
    /// The text before the first `=` is the name if it can be one; else all of it is the path, as in `./a=b.stl`.
    fn from(text: OsString) -> Self {
        let parts = text.to_str().and_then(|text| text.split_once('='));
        match parts {
            Some((name, path)) if is_name(name) => Self {
                name: Some(name.to_owned()),
                path: path.into(),
            },
            _ => Self {
                name: None,
                path: text.into(),
            },
        }
    }
}

impl NamedFile {
    /// The parser of the command line. Paths need not be Unicode.
    #[cfg(feature = "cli")]
    pub(super) fn parser() -> impl clap::builder::TypedValueParser<Value = Self> {
        use clap::builder::{OsStringValueParser, TypedValueParser as _};
        OsStringValueParser::new().map(Self::from)
    }
}

impl From<String> for NamedFile {
    fn from(text: String) -> Self {
        OsString::from(text).into()
    }
}

impl fmt::Display for NamedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let path = self.path.display();
        match &self.name {
            Some(name) => write!(f, "{name}={path}"),
            // not to be taken for one with a name
            None if Self::from(self.path.clone().into_os_string()) != *self => {
                write!(f, "./{path}")
            }
            None => write!(f, "{path}"),
        }
    }
}

impl From<NamedFile> for String {
    fn from(file: NamedFile) -> Self {
        file.to_string()
    }
}

/// True for the name of a mesh.
pub(super) fn is_name(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || c == '_')
}

/// The names of files in expressions: those without one take the letters a, b, c, … z, aa, ab, … in turn, without those that are given.
///
/// # Errors
/// [`JobError::NameTwice`].
pub fn names(files: &[NamedFile]) -> Result<Vec<String>, JobError> {
    let mut given: Vec<&str> = Vec::new();
    for name in files.iter().filter_map(|file| file.name.as_deref()) {
        if given.contains(&name) {
            return Err(JobError::NameTwice {
                name: name.to_owned(),
            });
        }
        given.push(name);
    }
    let mut free = (0..)
        .map(letters)
        .filter(|name| !given.contains(&name.as_str()));
    let names = files.iter().map(|file| match &file.name {
        Some(name) => name.clone(),
        None => free.next().unwrap_or_default(),
    });
    Ok(names.collect())
}

/// a, b, … z, aa, ab, …
fn letters(mut index: u32) -> String {
    let mut reversed = Vec::new();
    loop {
        reversed.push(char::from(b'a' + (index % 26) as u8));
        if index < 26 {
            return reversed.into_iter().rev().collect();
        }
        index = index / 26 - 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> NamedFile {
        NamedFile::from(OsString::from(text))
    }

    #[test]
    fn a_name_stands_before_the_first_equals_sign() {
        for (text, name, path) in [
            ("a=part.stl", Some("a"), "part.stl"),
            ("größe_2=x=y.ply", Some("größe_2"), "x=y.ply"),
            ("part.stl", None, "part.stl"),
            ("./a=b.stl", None, "./a=b.stl"),
            ("=b.stl", None, "=b.stl"),
            ("-", None, "-"),
            ("a=-", Some("a"), "-"),
        ] {
            let read = file(text);
            assert_eq!(
                (read.name.as_deref(), read.path),
                (name, path.into()),
                "{text}"
            );
        }
    }

    #[test]
    fn files_without_a_name_take_the_letters_that_are_free() {
        let files = ["x.stl", "b=y.stl", "z.stl", "a_=w.stl"].map(file);
        assert_eq!(names(&files).unwrap(), ["a", "b", "c", "a_"]);
        let many: Vec<_> = (0..30).map(|_| file("x")).collect();
        assert_eq!(
            names(&many).unwrap()[24..30],
            ["y", "z", "aa", "ab", "ac", "ad"]
        );
        assert_eq!(letters(701), "zz");
        assert_eq!(letters(702), "aaa");
        let error = names(&["a=x", "a=y"].map(file)).unwrap_err();
        assert_eq!(error.kind(), crate::ErrorKind::Request);
        assert!(
            error.to_string().contains("two meshes are named a"),
            "{error}"
        );
    }
}
