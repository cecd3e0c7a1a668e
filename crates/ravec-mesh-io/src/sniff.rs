//! Detection of the format of a file from its first bytes.
//!
//! Magic numbers decide where there are some. Text is OFF or OBJ by its first line that is not a comment. Binary STL has
//! no mark at all (not even the absence of `solid` at its start): it is what is not text and has the right size, or whose
//! first triangles consist of numbers of ordinary magnitude.

use crate::MeshFormat;
use crate::number::{integer, words};
use crate::off::Header;
use crate::stl::are_facets;

/// Bytes that are examined: 80 triangles of a binary STL file, and what programs write in front of their text.
pub(super) const HEAD: usize = 1 << 12;

/// Bytes that are examined as long as there are nothing but comments and blank lines.
pub(super) const MAX_COMMENT: usize = 1 << 16;

/// Within these bytes a text file has no control characters, and a binary STL has some.
const TEXT: usize = 1024;

pub(super) fn sniff(head: &[u8]) -> Option<MeshFormat> {
    if head.starts_with(b"PK\x03\x04") {
        return Some(MeshFormat::ThreeMf);
    }
    if head.starts_with(b"glTF") {
        return Some(MeshFormat::Glb);
    }
    if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") {
        let ascii = b"format ascii";
        let is_ascii = head.windows(ascii.len()).any(|window| window == ascii);
        return Some(if is_ascii {
            MeshFormat::PlyAscii
        } else {
            MeshFormat::PlyBinary
        });
    }
    if is_text(head) {
        sniff_text(head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head))
    } else {
        looks_like_stl(head).then_some(MeshFormat::StlBinary)
    }
}

/// The statements that an OBJ file may begin with.
const OBJ: [&[u8]; 21] = [
    b"v",
    b"vt",
    b"vn",
    b"vp",
    b"f",
    b"fo",
    b"l",
    b"p",
    b"o",
    b"g",
    b"s",
    b"mg",
    b"mtllib",
    b"usemtl",
    b"usemap",
    b"maplib",
    b"shadow_obj",
    b"trace_obj",
    b"lod",
    b"cstype",
    b"deg",
];

fn is_text(head: &[u8]) -> bool {
    let head = &head[..head.len().min(TEXT)];
    !head
        .iter()
        .any(|&byte| byte < b' ' && !byte.is_ascii_whitespace() && byte != 0x0b)
}

/// True for text that has nothing but comments and blank lines, and perhaps the beginning of another line behind them.
pub(super) fn is_undecided(head: &[u8]) -> bool {
    // longer than the words and counts that decide
    const LINE: usize = 64;
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    let is_comment = |line: &[u8]| {
        let line = line.trim_ascii_start();
        line.is_empty() || line.starts_with(b"#")
    };
    let end = head.iter().rposition(|&byte| ends_line(byte));
    let (whole, last) = head.split_at(end.map_or(0, |end| end + 1));
    let may_go_on = is_comment(last) || last.trim_ascii_start().len() <= LINE;
    is_text(head) && may_go_on && whole.split(|&byte| ends_line(byte)).all(is_comment)
}

/// Lines end in line feeds, in carriage returns, or in both: then there is an empty one between.
fn ends_line(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

fn sniff_text(head: &[u8]) -> Option<MeshFormat> {
    if let Some(inside) = head.trim_ascii_start().strip_prefix(b"{") {
        // names or the end follow, which distinguishes JSON from other text with braces
        let inside = inside.trim_ascii_start();
        let is_json = inside.is_empty() || inside.starts_with(b"\"") || inside.starts_with(b"}");
        return is_json.then_some(MeshFormat::Gltf);
    }
    for line in head.split(|&byte| ends_line(byte)) {
        let line = line.split(|&byte| byte == b'#').next().unwrap_or(line);
        let mut words = words(line);
        let Some(first) = words.next() else {
            continue;
        };
        if first.eq_ignore_ascii_case(b"solid") {
            return Some(MeshFormat::StlAscii);
        }
        if Header::parse(first).is_some() {
            return Some(MeshFormat::Off);
        }
        if OBJ.contains(&first) {
            return Some(MeshFormat::Obj);
        }
        // The word OFF is optional.
        let counts = || std::iter::once(first).chain(words.clone());
        let are_counts = counts().all(|word| integer(word).is_some_and(|count| count >= 0));
        return (are_counts && counts().count() == 3).then_some(MeshFormat::Off);
    }
    // Nothing but comments and blank lines: as an OBJ file it has no vertices.
    head.trim_ascii_start()
        .starts_with(b"#")
        .then_some(MeshFormat::Obj)
}

fn looks_like_stl(head: &[u8]) -> bool {
    const MOST: usize = 20;
    let facets = head.get(84..).unwrap_or_default();
    let numbers = facets.chunks_exact(50).take(MOST).flat_map(|facet| {
        let numbers = facet[..48].as_chunks::<4>().0;
        numbers.iter().map(|&bytes| f32::from_le_bytes(bytes).abs())
    });
    let (mut ordinary, mut count) = (0, 0);
    for number in numbers {
        ordinary += u32::from(number == 0.0 || (1e-12..1e12).contains(&number));
        count += 1;
    }
    // An empty file has nothing behind its count, as zeros without end have; a count that was never filled in has triangles.
    let claims_some = head.get(80..84).is_some_and(|claim| claim != [0; 4]);
    // Of random bits three numbers in ten are in this range.
    is_size_of_stl(head, head.len() as u64)
        || claims_some && count > 0 && ordinary * 10 >= count * 6
        || are_facets(facets)
}

/// Returns `true` if a binary STL file that begins with `head` has `size` bytes.
pub(super) fn is_size_of_stl(head: &[u8], size: u64) -> bool {
    let count = head
        .get(80..84)
        .map(|count| [count[0], count[1], count[2], count[3]]);
    count.is_some_and(|count| size == 84 + 50 * u64::from(u32::from_le_bytes(count)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_formats_are_known_by_their_first_words() {
        for (text, format) in [
            ("solid name\nfacet normal 0 0 1\n", MeshFormat::StlAscii),
            ("\n  SOLID\n", MeshFormat::StlAscii),
            ("ply\nformat ascii 1.0\n", MeshFormat::PlyAscii),
            (
                "ply\r\nformat binary_big_endian 1.0\r\n",
                MeshFormat::PlyBinary,
            ),
            ("\u{feff}# comment\n\nv 1 2 3\n", MeshFormat::Obj),
            ("mtllib a.mtl\r\n", MeshFormat::Obj),
            ("# a\r\rv 1 2 3\r", MeshFormat::Obj),
            ("# a\rOFF\r8 6 12\r", MeshFormat::Off),
            ("\rsolid a\rfacet", MeshFormat::StlAscii),
            ("# only a comment", MeshFormat::Obj),
            ("OFF\n8 6 12\n", MeshFormat::Off),
            ("# c\nSTCOFF\n", MeshFormat::Off),
            ("OFF490 518 0\n", MeshFormat::Off),
            ("8 6 12\n0 0 0\n", MeshFormat::Off),
            (" {\"asset\":{}}", MeshFormat::Gltf),
        ] {
            assert_eq!(sniff(text.as_bytes()), Some(format), "{text}");
        }
        for text in [
            "",
            "\n",
            "<svg/>",
            "solidus 3",
            "8 6\n",
            "-1 2 3\n",
            "hello world",
            "{{{{",
            "{ a }",
        ] {
            assert_eq!(sniff(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn a_binary_stl_is_known_even_if_it_begins_with_solid() {
        let mut file = vec![b' '; 80];
        file[..5].copy_from_slice(b"solid");
        file.extend(1_u32.to_le_bytes());
        for number in [
            0.0_f32,
            0.0,
            1.0,
            0.0,
            0.0,
            0.0,
            1.5,
            0.0,
            0.0,
            f32::NAN,
            2.5,
            0.0,
        ] {
            file.extend(number.to_le_bytes());
        }
        file.extend([0, 0]);
        assert_eq!(sniff(&file), Some(MeshFormat::StlBinary));
        assert_eq!(sniff(&file[..100]), None);
    }

    #[test]
    fn other_binary_files_are_no_mesh() {
        let mut state = 1_u32;
        let mut random: Vec<u8> = std::iter::repeat_with(|| {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            (state >> 24) as u8
        })
        .take(5000)
        .collect();
        random[..8].copy_from_slice(b"\x89PNG\r\n\x1a\n");
        assert_eq!(sniff(&random), None);
        assert_eq!(sniff(&[0xff; 300]), None);
        assert_eq!(sniff(&[0; 4096]), None);
        assert_eq!(sniff(&[0; 84]), Some(MeshFormat::StlBinary));
    }

    #[test]
    fn text_is_undecided_as_long_as_it_may_be_a_comment() {
        for open in [
            "",
            "\n \n",
            "# a\n# b",
            "  # a",
            "\u{feff}#",
            "# a\nmtll",
            "8 6 1",
        ] {
            assert!(is_undecided(open.as_bytes()), "{open}");
        }
        let long = format!("# a\n{{{}", "x".repeat(70));
        for decided in [
            "v\n",
            "# a\nv 0 0 0\n",
            "# a\rv 0 0 0\r",
            long.as_str(),
            "# a\n\0",
        ] {
            assert!(!is_undecided(decided.as_bytes()), "{decided}");
        }
    }
}
