//! Sentences and kinds of errors.

use super::*;
use ravec::memory::OverBudget;
use std::io;

fn unreadable(cause: DecodeError) -> JobError {
    let path = PathBuf::from("a.png");
    JobError::from(ReadError { path, cause })
}

fn unwritable(path: &str, cause: EncodeError) -> JobError {
    let path = PathBuf::from(path);
    JobError::from(WriteError { path, cause })
}

fn unread_mesh(path: &str, cause: ReadMeshError) -> JobError {
    let path = PathBuf::from(path);
    JobError::from(ReadMeshFileError { path, cause })
}

fn unwritten_mesh(path: &str, cause: WriteMeshError) -> JobError {
    let path = PathBuf::from(path);
    JobError::from(WriteMeshFileError { path, cause })
}

fn each_has_its_kind_and_sentence<const N: usize>(cases: [(JobError, ErrorKind, &str); N]) {
    for (error, kind, sentence) in cases {
        assert_eq!(error.to_string(), sentence);
        assert_eq!(error.kind(), kind, "{sentence}");
    }
}

#[test]
fn requests_that_make_no_sense_are_explained() {
    each_has_its_kind_and_sentence([
        (
            JobError::Parameter {
                field: "width",
                value: "0".to_owned(),
                range: "1 to 65535",
            },
            ErrorKind::Request,
            "`width` is 0, but must be 1 to 65535",
        ),
        (
            JobError::OverwritesInput {
                path: "a.png".into(),
            },
            ErrorKind::Request,
            "cannot write a.png: it is an input, which stays as it is; choose another name",
        ),
        (
            JobError::OutputTwice { path: "-".into() },
            ErrorKind::Request,
            "standard output cannot take two outputs: give each its own file",
        ),
        (
            JobError::InputTwice,
            ErrorKind::Request,
            "standard input can be read only once: give a file for the other input",
        ),
    ]);
}

#[test]
fn pictures_that_cannot_be_used_are_named() {
    let size = |width| Size::new(width, 1).unwrap();
    let no_file = io::Error::from_raw_os_error(2);
    each_has_its_kind_and_sentence([
        (
            unreadable(DecodeError::Empty),
            ErrorKind::Input,
            "cannot read a.png: the file is empty",
        ),
        (
            unreadable(no_file.into()),
            ErrorKind::Input,
            "cannot read a.png: No such file or directory",
        ),
        (
            JobError::SizesDiffer {
                a: "a".into(),
                a_size: size(1),
                b: "-".into(),
                b_size: size(2),
            },
            ErrorKind::Input,
            "a has 1 x 1 pixels and standard input has 2 x 1: give two pictures of the same size",
        ),
        (
            unwritable("a.png", io::Error::other("disk full").into()),
            ErrorKind::Output,
            "cannot write a.png: disk full",
        ),
        (
            unwritable("a.jpg", EncodeError::Quality { quality: 0 }),
            ErrorKind::Request,
            "cannot write a.jpg: JPEG quality is 1 to 100, not 0",
        ),
        (
            unwritable("-", io::Error::other("no reader").into()),
            ErrorKind::Output,
            "cannot write standard output: no reader",
        ),
    ]);
}

#[test]
fn meshes_that_cannot_be_used_are_named() {
    each_has_its_kind_and_sentence([
        (
            unread_mesh("a.stl", ReadMeshError::Empty),
            ErrorKind::Input,
            "cannot read a.stl: the file is empty",
        ),
        (
            unread_mesh("a.stl", io::Error::from_raw_os_error(2).into()),
            ErrorKind::Input,
            "cannot read a.stl: No such file or directory",
        ),
        (
            JobError::NoTriangles { path: "-".into() },
            ErrorKind::Input,
            "cannot use standard input: the mesh has no triangles",
        ),
        (
            unwritten_mesh("-", io::Error::other("disk full").into()),
            ErrorKind::Output,
            "cannot write standard output: disk full",
        ),
        (
            JobError::UnknownMeshFormat {
                path: "a.png".into(),
            },
            ErrorKind::Request,
            "cannot write a.png: its extension does not name a mesh format; known are .stl, .ply, .obj, .off, .3mf, \
             .glb, .gltf",
        ),
        (
            unread_mesh(
                "a",
                ReadMeshError::OverBudget(OverBudget {
                    needed: 9,
                    used: 2,
                    limit: 5,
                }),
            ),
            ErrorKind::Input,
            "cannot read a: reading the file takes 11 bytes of memory or more, and the limit is 5 for all files together \
             (raise `max_bytes`)",
        ),
    ]);
}

#[test]
fn inputs_without_a_result_are_named() {
    each_has_its_kind_and_sentence([
        (
            JobError::NoMatch {
                first: "a".into(),
                second: "b".into(),
                cause: MatchError::TooFewMatches { matches: 2 },
            },
            ErrorKind::Failure,
            "cannot match a with b: only 2 features of the photos match, too few to trust",
        ),
        (
            JobError::from_offset(Path::new("a"), OffsetError::NoTriangles),
            ErrorKind::Input,
            "cannot use a: the mesh has no triangles",
        ),
        (
            JobError::from_offset(Path::new("a"), OffsetError::Distance { got: -1.0 }),
            ErrorKind::Request,
            "cannot offset a: the distance is -1, but must be a number above 0",
        ),
        (
            JobError::from_offset(Path::new("a"), OffsetError::NotClosed { boundary_edges: 4 }),
            ErrorKind::Input,
            "cannot offset a: the mesh is not closed (4 boundary edges), so it has no inside: choose side both or \
             outer, or close it first",
        ),
        (
            JobError::from_offset(Path::new("a"), OffsetError::Empty { distance: 9.0 }),
            ErrorKind::Failure,
            "cannot offset a: no point of that side is 9 away from the mesh: choose a smaller distance",
        ),
    ]);
}

#[test]
fn a_cancellation_is_one_wherever_it_comes_from() {
    each_has_its_kind_and_sentence([
        (
            JobError::from_offset(Path::new("a"), OffsetError::Cancelled(Cancelled)),
            ErrorKind::Cancelled,
            "interrupted; nothing half-written is left",
        ),
        (
            unread_mesh("a", ReadMeshError::Cancelled),
            ErrorKind::Cancelled,
            "interrupted; nothing half-written is left",
        ),
        (
            Cancelled.into(),
            ErrorKind::Cancelled,
            "interrupted; nothing half-written is left",
        ),
    ]);
}
