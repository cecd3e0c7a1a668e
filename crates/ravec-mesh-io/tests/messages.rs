//! Quotes of a file in messages are short and harmless, and a stream that is not a mesh is given up at once.

use std::io::{self, Cursor, Read, Write as _};

use ravec_mesh_io::{MeshFormat, ReadMeshError, ReadOptions, read_mesh};
use ravec_progress::Progress;

/// Sets the title of a terminal, in two spellings, and turns the direction of text.
const EVIL: &str = "\u{1b}]0;x\u{7}\u{9b}31m\u{202e}";

fn error_of(file: &[u8]) -> ReadMeshError {
    let outcome = read_mesh(file, &ReadOptions::default(), &Progress::none());
    match outcome {
        Ok(file) => panic!("a mesh: {file:?}"),
        Err(error) => error,
    }
}

fn packed(name: &str, text: &str) -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    archive.start_file(name, options).unwrap();
    archive.write_all(text.as_bytes()).unwrap();
    archive.finish().unwrap().into_inner()
}

/// A word with control characters that is too long to be quoted.
fn long_word() -> String {
    format!("{EVIL}{}", "w".repeat(5000))
}

/// Blanks in front of which a file is examined more closely.
const BLANKS: usize = 2000;

/// Checks that each file is refused in a short sentence, with its word in it and without its control characters.
fn check_quotes<const N: usize>(files: [(&str, Vec<u8>); N]) {
    for (what, file) in files {
        let error = error_of(&file);
        let text = error.to_string();
        let harmless = |c: char| !c.is_control() && c != '\u{202e}';
        assert!(text.chars().all(harmless), "{what}: {text:?}");
        assert!(text.chars().count() < 350, "{what}: {text}");
        let quotes = text.contains("\\u{1b}]0;x\\u{7}");
        assert!(quotes || what == "3MF: an element", "{what}: {text}");
    }
}

#[test]
fn words_of_an_stl_file_are_escaped_and_cut() {
    let long = long_word();
    let blank = " ".repeat(BLANKS);
    check_quotes([
        (
            "STL: a word",
            format!("solid a\n{blank}{long}").into_bytes(),
        ),
        (
            "STL: a number",
            format!("solid a\n{blank}outer loop vertex {long}").into_bytes(),
        ),
        (
            "STL: a word after outer",
            format!("solid a\n{blank}outer {long}").into_bytes(),
        ),
    ]);
}

#[test]
fn words_of_a_ply_file_are_escaped_and_cut() {
    let long = long_word();
    let ply = "ply\nformat ascii 1.0\n";
    let vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    check_quotes([
        (
            "PLY: a word of the header",
            format!("{ply}{long}\n").into_bytes(),
        ),
        (
            "PLY: a format",
            format!("ply\nformat {long}\n").into_bytes(),
        ),
        (
            "PLY: a count",
            format!("{ply}element vertex {long}\n").into_bytes(),
        ),
        (
            "PLY: a type",
            format!("{ply}{vertex}property {long} a\n").into_bytes(),
        ),
        (
            "PLY: a name",
            format!("{ply}element {long} 3\nproperty int a\nend_header\n").into_bytes(),
        ),
        (
            "PLY: a number",
            format!("{ply}{vertex}end_header\n{long} 1 2\n").into_bytes(),
        ),
    ]);
}

#[test]
fn words_of_obj_and_off_files_are_escaped_and_cut() {
    let long = long_word();
    let blank = " ".repeat(BLANKS);
    check_quotes([
        (
            "OBJ: a word",
            format!("v 0 0 0\n{blank}\u{e9}{long}\n").into_bytes(),
        ),
        (
            "OBJ: a corner",
            format!("v 0 0 0\n{blank}\nf {long}\n").into_bytes(),
        ),
        (
            "OBJ: a vertex",
            format!("v 0 0 0\n{blank}\nv {long}\n").into_bytes(),
        ),
        (
            "OFF: a count",
            format!("OFF\n{blank}\n{long}\n").into_bytes(),
        ),
        (
            "OFF: a vertex",
            format!("OFF\n1 0 0\n{blank}\n{long}\n").into_bytes(),
        ),
        (
            "OFF: a number of corners",
            format!("OFF\n1 1 0\n0 0 0\n{blank}\n{long}\n").into_bytes(),
        ),
    ]);
}

#[test]
fn words_of_3mf_and_gltf_files_are_escaped_and_cut() {
    let long = long_word();
    let model = |text: &str| packed("3D/3dmodel.model", text);
    let object = "<object id=\"1\"><mesh></mesh></object>";
    check_quotes([
        (
            "3MF: a unit",
            model(&format!("<model unit=\"{long}\"></model>")),
        ),
        ("3MF: an element", model(&format!("<model></{long}>"))),
        (
            "3MF: a part",
            model(&format!(
                "<model><resources>{object}</resources><build><item objectid=\"1\" path=\"{long}\"/></build></model>"
            )),
        ),
        (
            "glTF: an address",
            format!(
                "{{\"buffers\":[{{\"byteLength\":1,\"uri\":{}}}]}}",
                serde_json::to_string(&long).unwrap()
            )
            .into_bytes(),
        ),
        (
            "glTF: an extension",
            format!(
                "{{\"extensionsRequired\":[{}]}}",
                serde_json::to_string(&long).unwrap()
            )
            .into_bytes(),
        ),
        (
            "glTF: a string for a number",
            format!("{{\"scene\":{}}}", serde_json::to_string(&long).unwrap()).into_bytes(),
        ),
    ]);
}

/// Repeats its bytes without end, some at a time, and counts them.
struct Endless<'a> {
    bytes: &'a [u8],
    given: u64,
}

impl Read for Endless<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = buffer.len().min(1000);
        for (i, byte) in buffer[..count].iter_mut().enumerate() {
            *byte = self.bytes[(self.given as usize + i) % self.bytes.len()];
        }
        self.given += count as u64;
        Ok(count)
    }
}

#[test]
fn a_stream_that_is_no_mesh_is_given_up_after_some_kilobytes() {
    for (bytes, most) in [
        (&b"\0"[..], 6_000),
        (b"\xff", 6_000),
        (b"y\n", 6_000),
        (b"a", 6_000),
        (b"{", 6_000),
        (b"{} ", 20_000),
        (b"<html>\n", 6_000),
        (b"\n", 70_000),
        (b" ", 70_000),
        (b"# nothing\n", 70_000),
    ] {
        let mut stream = Endless { bytes, given: 0 };
        let outcome = read_mesh(&mut stream, &ReadOptions::default(), &Progress::none());
        assert!(
            matches!(
                outcome,
                Err(ReadMeshError::UnknownFormat | ReadMeshError::Syntax { .. })
            ),
            "{bytes:?}: {outcome:?}"
        );
        assert!(stream.given <= most, "{bytes:?}: {}", stream.given);
    }
    // the header of a PLY file has an end
    let mut stream = (&b"ply\n"[..]).chain(Endless {
        bytes: b"comment\n",
        given: 0,
    });
    let outcome = read_mesh(&mut stream, &ReadOptions::default(), &Progress::none());
    assert!(matches!(outcome, Err(ReadMeshError::Syntax { .. })));
}

#[test]
fn a_line_that_begins_at_the_end_of_what_is_looked_at_first_is_read_whole() {
    for line in [
        "mtllib a.mtl\nv 0 0 0\n",
        "1 0 0\n0 0 0\n",
        "{\"nodes\":[]}",
    ] {
        for length in 4070..4100 {
            let comment = format!("#{}\n", " ".repeat(length));
            let comment = if line.starts_with('{') {
                " ".repeat(length)
            } else {
                comment
            };
            let file = comment + line;
            let outcome = read_mesh(file.as_bytes(), &ReadOptions::default(), &Progress::none());
            assert!(outcome.is_ok(), "{length} {line}: {outcome:?}");
        }
    }
}

#[test]
fn comments_in_front_of_a_text_file_may_be_long() {
    for (length, is_read) in [(3000, true), (60_000, true), (70_000, false)] {
        let file = format!("{}OFF\n1 0 0\n0 0 0\n", "# comment\n".repeat(length / 10));
        match read_mesh(file.as_bytes(), &ReadOptions::default(), &Progress::none()) {
            Ok(file) => assert!(is_read && file.format == MeshFormat::Off, "{length}"),
            Err(error) => assert!(!is_read, "{length}: {error}"),
        }
    }
}
