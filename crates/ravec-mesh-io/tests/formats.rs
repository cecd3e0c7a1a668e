//! Round trips: written meshes are read back, in every format.

use proptest::prelude::*;
use ravec_mesh::{TriMesh, weld};
use ravec_mesh_io::{
    LengthUnit, MeshFile, MeshFormat, Precision, ReadMeshError, ReadOptions, ReadWarning,
    WriteMeshError, WriteOptions, read_mesh, write_mesh,
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

/// The formats that keep 64-bit floats.
const EXACT: [MeshFormat; 6] = [
    MeshFormat::StlAscii,
    MeshFormat::PlyBinary,
    MeshFormat::PlyAscii,
    MeshFormat::Obj,
    MeshFormat::Off,
    MeshFormat::ThreeMf,
];

fn read(file: &[u8]) -> Result<MeshFile, ReadMeshError> {
    read_mesh(file, &ReadOptions::default(), &Progress::none())
}

fn written(mesh: &TriMesh, format: MeshFormat, options: WriteOptions) -> Vec<u8> {
    let mut file = Vec::new();
    write_mesh(mesh, format, &options, &mut file, &Progress::none()).unwrap();
    file
}

fn mesh(positions: &[[f64; 3]], triangles: &[[u32; 3]]) -> TriMesh {
    let positions = positions.iter().map(|&at| at.into()).collect();
    TriMesh::new(positions, triangles.to_vec()).unwrap()
}

/// The places of all corners, −0 taken for 0.
fn corners(mesh: &TriMesh) -> Vec<[[f64; 3]; 3]> {
    let triangles = 0..mesh.triangles().len() as u32;
    let corners = triangles.map(|triangle| mesh.corners(triangle));
    corners
        .map(|corners| corners.map(|at| at.to_array().map(|x| x + 0.0)))
        .collect()
}

fn meshes(coordinate: impl Strategy<Value = f64>) -> impl Strategy<Value = TriMesh> {
    let positions = prop::collection::vec(prop::array::uniform3(coordinate), 1..40);
    let triangles = prop::collection::vec(any::<[u32; 3]>(), 1..60);
    (positions, triangles).prop_map(|(positions, triangles)| {
        let count = positions.len() as u32;
        let triangles: Vec<_> = triangles.iter().map(|t| t.map(|v| v % count)).collect();
        mesh(&positions, &triangles)
    })
}

fn any_f32() -> impl Strategy<Value = f64> {
    use prop::num::f32::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    (NORMAL | SUBNORMAL | ZERO | POSITIVE | NEGATIVE).prop_map(f64::from)
}

fn any_f64() -> impl Strategy<Value = f64> {
    use prop::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
    NORMAL | SUBNORMAL | ZERO | POSITIVE | NEGATIVE
}

proptest! {
    #[test]
    fn doubles_come_back_bit_for_bit(mesh in meshes(any_f64())) {
        for format in EXACT {
            let file = read(&written(&mesh, format, WriteOptions::default())).unwrap();
            prop_assert_eq!(file.format, format);
            prop_assert_eq!(corners(&file.mesh), corners(&mesh), "{}", format);
            if format != MeshFormat::StlAscii {
                prop_assert_eq!(&file.mesh, &mesh, "{}", format);
            }
            prop_assert_eq!(file.warnings, vec![], "{}", format);
        }
    }

    #[test]
    fn single_floats_come_back_from_every_format(mesh in meshes(any_f32())) {
        for format in ALL {
            let file = read(&written(&mesh, format, WriteOptions::default())).unwrap();
            prop_assert_eq!(file.format, format);
            prop_assert_eq!(corners(&file.mesh), corners(&mesh), "{}", format);
            prop_assert_eq!(file.warnings, vec![], "{}", format);
            if matches!(format, MeshFormat::StlBinary | MeshFormat::StlAscii) {
                let again = weld(&file.mesh, 0.0);
                prop_assert_eq!(again.merged, 0);
            } else {
                prop_assert_eq!(&file.mesh, &mesh, "{}", format);
            }
        }
    }

    #[test]
    fn rounding_on_request_rounds_to_single_floats(
        mesh in meshes(-1e30_f64..1e30),
        format in prop::sample::select(EXACT.to_vec()),
    ) {
        let options = WriteOptions { precision: Precision::Single, ..WriteOptions::default() };
        let file = read(&written(&mesh, format, options)).unwrap();
        for (got, given) in corners(&file.mesh).iter().zip(corners(&mesh)) {
            let singles = |corners: &[[f64; 3]; 3]| corners.map(|at| at.map(|x| x as f32));
            prop_assert_eq!(singles(got), singles(&given));
        }
    }

    #[test]
    fn white_space_comments_and_line_ends_do_not_matter_in_text(
        mesh in meshes(any_f64()),
        format in prop::sample::select(vec![MeshFormat::PlyAscii, MeshFormat::Obj, MeshFormat::Off]),
        dirt in prop::collection::vec(0_usize..6, 1..20),
    ) {
        let text = String::from_utf8(written(&mesh, format, WriteOptions::default())).unwrap();
        let mut dirty = String::new();
        let mut dirt = dirt.into_iter().cycle();
        let mut is_header = format == MeshFormat::PlyAscii;
        for line in text.lines() {
            is_header &= line != "end_header";
            // The header of PLY has comments of its own, its data have none.
            let comment = match format {
                _ if is_header => "\ncomment v 1 2 3",
                MeshFormat::PlyAscii => "",
                _ => "\n# v 1 2 3\n\n",
            };
            let (indent, gap, end) = match dirt.next().unwrap() {
                0 => ("", " ", ""),
                1 => ("", "\t ", "\r"),
                2 => ("", " ", " \t"),
                3 => ("", "  ", comment),
                4 if !is_header => (" ", " ", "\n\n"),
                _ => ("", " ", "  \r"),
            };
            dirty += indent;
            dirty += &line.replace(' ', gap);
            if dirty != "ply" {
                dirty += end;
            }
            dirty += "\n";
        }
        let file = read(dirty.trim_ascii_end().as_bytes()).unwrap();
        prop_assert_eq!(file.format, format);
        prop_assert_eq!(file.mesh, mesh);
    }

    #[test]
    fn ascii_stl_does_not_care_for_white_space_and_case(mesh in meshes(any_f32()), upper: bool) {
        let text = String::from_utf8(written(&mesh, MeshFormat::StlAscii, WriteOptions::default())).unwrap();
        let text = text.trim_end().replace("\n endloop", "\tendloop").replace('\n', "\r\n \n");
        let text = if upper { text.to_ascii_uppercase() } else { text };
        let file = read(text.as_bytes()).unwrap();
        prop_assert_eq!(corners(&file.mesh), corners(&mesh));
        prop_assert_eq!(file.warnings, vec![]);
    }
}

#[test]
fn equal_places_of_an_stl_file_are_one_vertex() {
    // A tetrahedron, with a zero of either sign.
    let places = [
        [0.0, -0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    let tetrahedron = mesh(&places, &[[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]);
    for format in [MeshFormat::StlBinary, MeshFormat::StlAscii] {
        let mut file = written(&tetrahedron, format, WriteOptions::default());
        if format == MeshFormat::StlAscii {
            let text = String::from_utf8(file).unwrap();
            file = text.replacen("vertex 0.0", "vertex -0", 1).into_bytes();
        }
        let found = read(&file).unwrap();
        assert_eq!(found.mesh.positions().len(), 4, "{format}");
        assert_eq!(corners(&found.mesh), corners(&tetrahedron), "{format}");
    }
}

#[test]
fn vertices_are_welded_on_request_in_any_format() {
    let places = [
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0; 3],
        [1e-3, 0.0, 0.0],
    ];
    let cracked = mesh(&places, &[[0, 1, 2], [3, 2, 1], [4, 1, 2]]);
    for (tolerance, vertices, merged) in [(None, 5, 0), (Some(0.0), 4, 1), (Some(0.01), 3, 2)] {
        let file = written(&cracked, MeshFormat::Obj, WriteOptions::default());
        let options = ReadOptions {
            weld_tolerance: tolerance,
            ..ReadOptions::default()
        };
        let found = read_mesh(&file[..], &options, &Progress::none()).unwrap();
        assert_eq!(found.mesh.positions().len(), vertices);
        let warnings: &[ReadWarning] = &[ReadWarning::Welded {
            vertices: merged,
            collapsed: 0,
        }];
        assert_eq!(found.warnings, warnings[usize::from(merged == 0)..]);
    }
}

#[test]
fn meshes_without_triangles_are_written_and_read() {
    for mesh in [mesh(&[], &[]), mesh(&[[1.0, 2.0, 3.0]], &[])] {
        for format in ALL {
            let file = read(&written(&mesh, format, WriteOptions::default())).unwrap();
            assert_eq!(file.format, format);
            assert!(file.mesh.triangles().is_empty());
            assert_eq!(file.warnings, [ReadWarning::NoTriangles], "{format}");
        }
    }
}

#[test]
fn the_unit_goes_into_3mf_and_scales_gltf() {
    let triangle = mesh(
        &[[0.0; 3], [1000.0, 0.0, 0.0], [0.0, 25.4, 0.0]],
        &[[0, 1, 2]],
    );
    for unit in LengthUnit::ALL {
        let options = WriteOptions {
            unit: Some(unit),
            ..WriteOptions::default()
        };
        let file = read(&written(&triangle, MeshFormat::ThreeMf, options)).unwrap();
        assert_eq!((file.unit, &file.mesh), (Some(unit), &triangle));
        for format in [MeshFormat::Glb, MeshFormat::Gltf] {
            let file = read(&written(&triangle, format, options)).unwrap();
            assert_eq!(file.unit, Some(LengthUnit::Meter));
            let x = file.mesh.positions()[1].x;
            assert!(
                (x - 1000.0 * unit.in_meters()).abs() < 1e-9 * x,
                "{unit}: {x}"
            );
        }
    }
    let default = read(&written(
        &triangle,
        MeshFormat::ThreeMf,
        WriteOptions::default(),
    ));
    assert_eq!(default.unwrap().unit, Some(LengthUnit::Millimeter));
    let ply = read(&written(
        &triangle,
        MeshFormat::PlyBinary,
        WriteOptions::default(),
    ));
    assert_eq!(ply.unwrap().unit, None);
}

#[test]
fn ply_holds_doubles_only_where_singles_would_lose_something() {
    let short = mesh(&[[0.5, 1.0, 2.0]; 3], &[[0, 1, 2]]);
    let long = mesh(&[[0.1, 1.0, 2.0]; 3], &[[0, 1, 2]]);
    let header = |mesh, options| {
        let file = written(mesh, MeshFormat::PlyBinary, options);
        String::from_utf8_lossy(&file[..100]).into_owned()
    };
    let exact = WriteOptions::default();
    let single = WriteOptions {
        precision: Precision::Single,
        ..exact
    };
    assert!(header(&short, exact).contains("property float x"));
    assert!(header(&long, exact).contains("property double x"));
    assert!(header(&long, single).contains("property float x"));
}

#[test]
fn file_names_choose_the_format_and_formats_name_files() {
    for format in ALL {
        let chosen = MeshFormat::from_extension(format.extension()).unwrap();
        assert_eq!(chosen.extension(), format.extension());
        assert!(!format.to_string().is_empty());
    }
    assert_eq!(
        MeshFormat::from_extension(".3MF"),
        Some(MeshFormat::ThreeMf)
    );
    assert_eq!(MeshFormat::from_extension(""), None);
}

#[test]
fn coordinates_beyond_single_floats_are_refused_where_the_format_has_no_others() {
    let far = mesh(&[[0.0; 3], [1.0; 3], [0.0, -1e39, 0.0]], &[[0, 1, 2]]);
    let single = WriteOptions {
        precision: Precision::Single,
        ..WriteOptions::default()
    };
    for format in ALL {
        for options in [WriteOptions::default(), single] {
            let outcome = write_mesh(&far, format, &options, Vec::new(), &Progress::none());
            if EXACT.contains(&format) && options.precision == Precision::Exact {
                assert!(outcome.is_ok(), "{format}");
            } else {
                let refused = matches!(
                    outcome,
                    Err(WriteMeshError::BeyondF32 {
                        vertex: 2,
                        value: -1e39,
                        ..
                    })
                );
                assert!(refused, "{format}");
            }
        }
    }
}

/// Takes some bytes and then fails.
struct Full(usize);

impl std::io::Write for Full {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.0 < bytes.len() {
            return Err(std::io::ErrorKind::StorageFull.into());
        }
        self.0 -= bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_disk_is_an_error_of_writing() {
    let triangle = mesh(&[[0.0; 3], [1.0; 3], [0.0, 1.0, 0.0]], &[[0, 1, 2]]);
    for format in ALL {
        let size = written(&triangle, format, WriteOptions::default()).len();
        for room in 0..size {
            let options = WriteOptions::default();
            let outcome = write_mesh(&triangle, format, &options, Full(room), &Progress::none());
            assert!(
                matches!(outcome, Err(WriteMeshError::Io(_))),
                "{format} {room}"
            );
        }
    }
}

#[test]
fn a_cancelled_reader_or_writer_stops() {
    let triangle = mesh(&[[0.0; 3], [1.0; 3], [0.0, 1.0, 0.0]], &[[0, 1, 2]]);
    let progress = Progress::none();
    progress.cancel();
    for format in ALL {
        let options = WriteOptions::default();
        let outcome = write_mesh(&triangle, format, &options, Vec::new(), &progress);
        assert!(
            matches!(outcome, Err(WriteMeshError::Cancelled)),
            "{format}"
        );
        let file = written(&triangle, format, options);
        let outcome = read_mesh(&file[..], &ReadOptions::default(), &progress);
        assert!(matches!(outcome, Err(ReadMeshError::Cancelled)), "{format}");
    }
}

#[test]
fn progress_ends_at_the_whole() {
    use std::sync::{Arc, Mutex};

    let triangle = mesh(
        &[[0.0; 3], [1.0; 3], [0.0, 1.0, 0.0]],
        &vec![[0, 1, 2]; 20_000],
    );
    for format in ALL {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let sink = Arc::clone(&seen);
        let progress = Progress::new(move |update| sink.lock().unwrap().push(update));
        let mut file = Vec::new();
        write_mesh(
            &triangle,
            format,
            &WriteOptions::default(),
            &mut file,
            &progress,
        )
        .unwrap();
        let whole = |phase| {
            let last = seen
                .lock()
                .unwrap()
                .iter()
                .rfind(|update| update.phase == phase)
                .copied();
            last.map(|update| update.fraction())
        };
        // STL has no rows for vertices.
        let least = if format.extension() == "stl" {
            0.99
        } else {
            1.0
        };
        assert!(whole("write") >= Some(least), "{format}");
        let options = ReadOptions {
            size: Some(file.len() as u64),
            ..ReadOptions::default()
        };
        read_mesh(&file[..], &options, &progress).unwrap();
        assert_eq!(whole("read"), Some(1.0), "{format}");
    }
}
