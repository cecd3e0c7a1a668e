//! Whatever the bytes: a mesh or an error, within the limits.

use glam::DVec2;
use proptest::prelude::*;
use ravec_memory::MemoryBudget;
use ravec_mesh::TriMesh;
use ravec_mesh_io::{
    Attributes, MeshFile, MeshFormat, MeshLimits, ReadMeshError, ReadOptions, ReadWarning,
    WriteOptions, read_mesh, write_mesh_with,
};
use ravec_progress::Progress;

const ALL: [MeshFormat; 9] = [
    MeshFormat::StlBinary,
    MeshFormat::StlAscii,
    MeshFormat::PlyBinary,
    MeshFormat::PlyAscii,
    MeshFormat::Obj,
    MeshFormat::Off,
    MeshFormat::ThreeMf,
    MeshFormat::Glb,
    MeshFormat::Gltf,
];

fn small() -> MeshLimits {
    MeshLimits {
        memory: MemoryBudget::new(1_000_000),
        max_triangles: 64,
        max_vertices: 64,
    }
}

fn read(file: &[u8], limits: &MeshLimits) -> Result<MeshFile, ReadMeshError> {
    let options = ReadOptions {
        limits: limits.clone(),
        size: Some(file.len() as u64),
        colors: true,
        texture: true,
        ..ReadOptions::default()
    };
    read_mesh(file, &options, &Progress::none())
}

/// An octahedron: 6 vertices, 8 triangles.
fn octahedron() -> TriMesh {
    let places = [1.0, -1.0].map(|s| [[s, 0.0, 0.0], [0.0, s, 0.25], [0.0, 0.0, 1.5 * s]]);
    let positions = places.as_flattened().iter().map(|&at| at.into()).collect();
    let triangles = (0..8_u32).map(|signs| {
        let corner = |axis: u32| axis + 3 * (signs >> axis & 1);
        let [x, y, z] = [0, 1, 2].map(corner);
        if signs.count_ones() % 2 == 0 {
            [x, y, z]
        } else {
            [y, x, z]
        }
    });
    TriMesh::new(positions, triangles.collect()).unwrap()
}

fn written(format: MeshFormat) -> Vec<u8> {
    let mut file = Vec::new();
    let progress = Progress::none();
    let attributes = Attributes {
        colors: &[[1, 20, 200, 255]; 6],
        texture: &[[DVec2::X; 3]; 8],
        objects: &[],
    };
    write_mesh_with(
        &octahedron(),
        attributes,
        format,
        &WriteOptions::default(),
        &mut file,
        &progress,
    )
    .unwrap();
    file
}

/// Panics if a mesh is larger than it may be, or an error says nothing.
fn judge(outcome: Result<MeshFile, ReadMeshError>, limits: &MeshLimits) {
    match outcome {
        Ok(file) => {
            assert!(file.mesh.positions().len() as u64 <= limits.max_vertices);
            assert!(file.mesh.triangles().len() as u64 <= limits.max_triangles);
            // attributes are there for all or for none
            let (colors, texture) = (file.colors.len(), file.texture.len());
            assert!(colors == 0 || colors == file.mesh.positions().len());
            assert!(texture == 0 || texture == file.mesh.triangles().len());
        }
        Err(error) => assert!(error.to_string().len() > 5),
    }
}

#[test]
fn a_file_cut_anywhere_is_an_error_or_a_mesh() {
    for format in ALL {
        let file = written(format);
        for length in 0..file.len() {
            let outcome = read(&file[..length], &small());
            // Of text the last number may be cut, of OBJ whole lines.
            let text = matches!(
                format,
                MeshFormat::StlAscii
                    | MeshFormat::PlyAscii
                    | MeshFormat::Obj
                    | MeshFormat::Off
                    | MeshFormat::Gltf
            );
            // And `p` alone is a statement of OBJ.
            let is_mesh = outcome.as_ref().is_ok_and(|file| file.format == format);
            // Of binary STL whole triangles may be missing, which is remarked.
            let whole = format == MeshFormat::StlBinary && length > 84 && (length - 84) % 50 == 0;
            let counted = |warning: &ReadWarning| matches!(warning, ReadWarning::OtherCount { .. });
            let is_remarked = whole
                && outcome
                    .as_ref()
                    .is_ok_and(|file| file.warnings.iter().any(counted));
            assert!(
                text || is_remarked || !is_mesh,
                "{format} of {length} bytes is a mesh"
            );
            judge(outcome, &small());
        }
        assert_eq!(read(&file, &small()).unwrap().mesh.triangles().len(), 8);
    }
}

#[test]
fn each_limit_is_kept_in_each_format_and_named() {
    let generous = MeshLimits::default();
    for format in ALL {
        let file = written(format);
        for (what, fits, breaks) in [
            (
                "triangles",
                MeshLimits {
                    max_triangles: 8,
                    ..generous.clone()
                },
                MeshLimits {
                    max_triangles: 7,
                    ..generous.clone()
                },
            ),
            (
                "vertices",
                MeshLimits {
                    max_vertices: 6,
                    ..generous.clone()
                },
                MeshLimits {
                    max_vertices: 5,
                    ..generous.clone()
                },
            ),
        ] {
            assert!(read(&file, &fits).is_ok(), "{format} {what}");
            match read(&file, &breaks) {
                Err(error @ ReadMeshError::TooMany { what: named, .. }) => {
                    assert_eq!(named, what, "{format}");
                    assert!(
                        error.to_string().contains(&format!("`max_{what}`")),
                        "{error}"
                    );
                }
                other => panic!("{format} {what}: {other:?}"),
            }
        }
        let tiny = MeshLimits {
            memory: MemoryBudget::new(1000),
            ..generous.clone()
        };
        match read(&file, &tiny) {
            Err(error @ ReadMeshError::OverBudget(_)) => {
                let text = error.to_string();
                assert!(
                    text.contains("`max_bytes`") && text.contains("1000"),
                    "{text}"
                );
            }
            other => panic!("{format}: {other:?}"),
        }
        assert_eq!(tiny.memory.used(), 0, "{format}");
    }
}

#[test]
fn what_is_read_keeps_its_memory_reserved_as_long_as_it_lives() {
    for format in ALL {
        let (file, limits) = (written(format), MeshLimits::default());
        let first = read(&file, &limits).unwrap();
        let (used, peak) = (limits.memory.used(), limits.memory.peak());
        assert!(used >= 6 * 24 + 8 * 12, "{format}: {used}");
        let second = read(&file, &limits).unwrap();
        assert_eq!(limits.memory.used(), 2 * used, "{format}");
        assert_eq!(first, second, "the reservation is no part of the value");
        let clone = first.clone();
        drop((first, second));
        assert_eq!(limits.memory.used(), used, "{format}");
        drop(clone);
        assert_eq!(limits.memory.used(), 0, "{format}");
        // a file that has no room beside another one
        let shared = MeshLimits {
            memory: MemoryBudget::new(peak + used / 2),
            ..limits.clone()
        };
        let _first = read(&file, &shared).unwrap();
        let outcome = read(&file, &shared);
        assert!(
            matches!(outcome, Err(ReadMeshError::OverBudget(_))),
            "{format}"
        );
    }
}

#[test]
fn an_archive_that_unpacks_to_more_than_allowed_is_refused() {
    use std::io::Write as _;

    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    archive.start_file("3D/3dmodel.model", options).unwrap();
    archive.write_all(b"<model>").unwrap();
    archive.write_all(&vec![b' '; 10_000_000]).unwrap();
    archive.write_all(b"</model>").unwrap();
    let file = archive.finish().unwrap().into_inner();
    assert!(file.len() < 50_000);
    let limits = MeshLimits {
        memory: MemoryBudget::new(9_000_000),
        ..MeshLimits::default()
    };
    assert!(matches!(
        read(&file, &limits),
        Err(ReadMeshError::OverBudget(_))
    ));
    assert!(read(&file, &MeshLimits::default()).is_ok());
}

#[test]
fn objects_that_use_one_another_over_and_over_are_refused_before_they_are_built() {
    use std::fmt::Write as _;
    use std::io::Write as _;

    // 2 to the power of 50 triangles; or none, as often.
    for triangle in ["<triangle v1=\"0\" v2=\"0\" v3=\"0\"/>", ""] {
        let mut model = format!(
            "<model><resources><object id=\"0\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/></vertices>\
             <triangles>{triangle}</triangles></mesh></object>"
        );
        for id in 1..=50 {
            let twice = format!("<component objectid=\"{}\"/>", id - 1).repeat(2);
            write!(
                model,
                "<object id=\"{id}\"><components>{twice}</components></object>"
            )
            .unwrap();
        }
        model += "</resources><build><item objectid=\"50\"/></build></model>";
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        archive
            .start_file("3D/3dmodel.model", zip::write::SimpleFileOptions::default())
            .unwrap();
        archive.write_all(model.as_bytes()).unwrap();
        let outcome = read(
            &archive.finish().unwrap().into_inner(),
            &MeshLimits::default(),
        );
        if triangle.is_empty() {
            assert!(outcome.unwrap().mesh.triangles().is_empty());
        } else {
            assert!(matches!(
                outcome,
                Err(ReadMeshError::TooMany {
                    what: "triangles",
                    ..
                })
            ));
        }
    }
}

#[test]
fn counts_that_a_header_claims_take_no_memory() {
    let ply = |encoding| {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex 199999999\nproperty double x\nproperty double y\n\
             property double z\nelement face 199999999\nproperty list uint int vertex_indices\nend_header\n0 0 0\n"
        )
    };
    let mut stl = vec![0; 84 + 70];
    stl[80..84].copy_from_slice(&199_999_999_u32.to_le_bytes());
    for file in [
        ply("ascii").into_bytes(),
        ply("binary_little_endian").into_bytes(),
        b"OFF\n199999999 199999999 0\n0 0 0\n".to_vec(),
        b"OFF\n1 1 0\n0 0 0\n199999999 0 0\n".to_vec(),
        stl,
    ] {
        // Allocating what is claimed would take some 7 GB and longer than the test may.
        let outcome = read(&file, &MeshLimits::default());
        let is_cut = matches!(
            outcome,
            Err(ReadMeshError::Truncated { .. } | ReadMeshError::Syntax { .. })
        );
        assert!(is_cut, "{outcome:?}");
    }
    for (header, what) in [
        ("OFF\n200000001 0 0\n", "vertices"),
        ("OFF\n0 200000001 0\n", "triangles"),
        ("OFF\n0 999999999999999999 0\n", "triangles"),
        ("OFF\n0 1 0\n999999999999999999 0\n", "triangles"),
    ] {
        match read(header.as_bytes(), &MeshLimits::default()) {
            Err(ReadMeshError::TooMany { what: named, .. }) => assert_eq!(named, what),
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn what_is_no_mesh_is_said_to_be_none() {
    assert!(matches!(read(b"", &small()), Err(ReadMeshError::Empty)));
    for file in [
        &b"hello"[..],
        b"\x89PNG\r\n\x1a\n",
        b"<html></html>",
        &[0xff; 500],
        b"\n\n",
    ] {
        assert!(matches!(
            read(file, &small()),
            Err(ReadMeshError::UnknownFormat)
        ));
    }
}

/// Fails after some bytes.
struct Broken<'a>(&'a [u8]);

impl std::io::Read for Broken<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        match std::io::Read::read(&mut self.0, buffer) {
            Ok(0) => Err(std::io::ErrorKind::ConnectionReset.into()),
            other => other,
        }
    }
}

#[test]
fn an_error_of_the_reader_is_passed_on() {
    for format in ALL {
        let file = written(format);
        for length in [0, 20, file.len() / 2] {
            let options = ReadOptions::default();
            let outcome = read_mesh(Broken(&file[..length]), &options, &Progress::none());
            assert!(
                matches!(outcome, Err(ReadMeshError::Io(_))),
                "{format} {length}: {outcome:?}"
            );
        }
    }
}

/// A change of a file: of a byte, or of a number in text, or a piece that is taken out or repeated.
#[derive(Debug, Clone)]
enum Change {
    Byte(prop::sample::Index, u8),
    Number(prop::sample::Index, &'static str),
    Remove(prop::sample::Index, usize),
    Repeat(prop::sample::Index, usize),
}

fn change() -> impl Strategy<Value = Change> {
    let numbers = [
        "-1",
        "0",
        "99",
        "4294967295",
        "4294967296",
        "18446744073709551615",
        "1e999",
        "nan",
        "",
    ];
    prop_oneof![
        (any::<prop::sample::Index>(), any::<u8>()).prop_map(|(at, byte)| Change::Byte(at, byte)),
        (
            any::<prop::sample::Index>(),
            prop::sample::select(numbers.to_vec())
        )
            .prop_map(|(at, number)| Change::Number(at, number)),
        (any::<prop::sample::Index>(), 1_usize..60)
            .prop_map(|(at, length)| Change::Remove(at, length)),
        (any::<prop::sample::Index>(), 1_usize..60)
            .prop_map(|(at, length)| Change::Repeat(at, length)),
    ]
}

fn apply(change: &Change, file: &mut Vec<u8>) {
    if file.is_empty() {
        return;
    }
    match *change {
        Change::Byte(at, byte) => {
            let at = at.index(file.len());
            file[at] = byte;
        }
        Change::Number(at, number) => {
            let from = at.index(file.len());
            let is_digit = |byte: &u8| byte.is_ascii_digit() || b".-".contains(byte);
            let Some(start) = file[from..].iter().position(is_digit) else {
                return;
            };
            let start = from + start;
            let length = file[start..]
                .iter()
                .take_while(|byte| is_digit(byte))
                .count();
            file.splice(start..start + length, number.bytes());
        }
        Change::Remove(at, length) => {
            let start = at.index(file.len());
            let end = file.len().min(start + length);
            file.drain(start..end);
        }
        Change::Repeat(at, length) => {
            let start = at.index(file.len());
            let end = file.len().min(start + length);
            let piece = file[start..end].to_vec();
            file.splice(end..end, piece);
        }
    }
}

/// A 3MF file whose model is changed, not the bytes of the archive.
fn repacked(file: &[u8], changes: &[Change]) -> Vec<u8> {
    use std::io::{Read as _, Write as _};

    let mut old = zip::ZipArchive::new(std::io::Cursor::new(file)).unwrap();
    let mut model = Vec::new();
    old.by_name("3D/3dmodel.model")
        .unwrap()
        .read_to_end(&mut model)
        .unwrap();
    for change in changes {
        apply(change, &mut model);
    }
    let mut new = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    new.start_file("3D/3dmodel.model", zip::write::SimpleFileOptions::default())
        .unwrap();
    new.write_all(&model).unwrap();
    new.finish().unwrap().into_inner()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn a_changed_file_is_an_error_or_a_mesh(
        format in prop::sample::select(ALL.to_vec()),
        changes in prop::collection::vec(change(), 1..6),
        inside: bool,
    ) {
        let mut file = written(format);
        if inside && format == MeshFormat::ThreeMf {
            file = repacked(&file, &changes);
        } else {
            for change in &changes {
                apply(change, &mut file);
            }
        }
        judge(read(&file, &small()), &small());
        let huge = MeshLimits { memory: MemoryBudget::new(3_000_000), ..MeshLimits::default() };
        judge(read(&file, &huge), &huge);
    }

    #[test]
    fn any_bytes_are_an_error_or_a_mesh(
        start in prop::sample::select(vec![
            &b""[..], b"ply\nformat ascii 1.0\n", b"ply\nformat binary_big_endian 1.0\nelement face 3\n", b"OFF\n", b"v 1 2 3\nf ",
            b"solid\nfacet ", b"PK\x03\x04", b"glTF\x02\0\0\0", b"{\"nodes\":[",
        ]),
        bytes in prop::collection::vec(any::<u8>(), 0..400),
        words in "([0-9a-z.#/\\- \n]{0,200})",
        text: bool,
    ) {
        let rest = if text { words.as_bytes() } else { &bytes };
        judge(read(&[start, rest].concat(), &small()), &small());
    }
}
