//! Hollows a closed mesh: `cargo run --release -p ravec-jobs --example hollow -- part.stl hollow.stl 1.5`

use ravec::mesh_io::{MeshFormat, ReadOptions, WriteOptions, read_mesh, write_mesh};
use ravec::offset::{OffsetParams, Side, offset};
use ravec::progress::Progress;
use ravec_files::write_atomically;
use std::error::Error;
use std::fs::File;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, thickness] = &arguments[..] else {
        return Err("usage: hollow MESH OUTPUT.stl THICKNESS".into());
    };
    let progress = Progress::none();
    let part = read_mesh(File::open(input)?, &ReadOptions::default(), &progress)?.mesh;
    let distance: f64 = thickness.parse()?;
    let params = OffsetParams {
        distance,
        tolerance: 0.05 * distance,
        side: Side::Shell,
        ..OffsetParams::default()
    };
    let hollow = offset(&part, &params, &progress)?;
    write_atomically(Path::new(output), |file| {
        let options = WriteOptions::default();
        write_mesh(
            &hollow.mesh,
            MeshFormat::StlBinary,
            &options,
            file,
            &progress,
        )
    })?;
    println!(
        "{} triangles, proved: {}, solid: {}",
        hollow.mesh.triangles().len(),
        hollow.report.certified,
        hollow.report.solid
    );
    Ok(())
}
