//! Combines meshes: `cargo run --release -p ravec-jobs --example combine -- 'a - b' part.stl drill.stl out.stl`

use ravec::boolean::{BooleanParams, Expr, boolean};
use ravec::mesh::TriMesh;
use ravec::mesh_io::{MeshFormat, ReadOptions, WriteOptions, read_mesh, write_mesh};
use ravec::progress::Progress;
use ravec_files::write_atomically;
use std::error::Error;
use std::fs::File;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [expression, inputs @ .., output] = &arguments[..] else {
        return Err("usage: combine EXPRESSION MESH... OUTPUT.stl".into());
    };
    let progress = Progress::none();
    // names stand for the meshes in the order in which they appear first
    let (expression, names) = Expr::parse(expression)?;
    if names.len() != inputs.len() {
        return Err(format!("{} names, but {} meshes", names.len(), inputs.len()).into());
    }
    let read = |path: &String| -> Result<TriMesh, Box<dyn Error>> {
        Ok(read_mesh(File::open(path)?, &ReadOptions::default(), &progress)?.mesh)
    };
    let meshes: Vec<TriMesh> = inputs.iter().map(read).collect::<Result<_, _>>()?;
    let result = boolean(&meshes, &expression, &BooleanParams::default(), &progress)?;
    write_atomically(Path::new(output), |file| {
        let options = WriteOptions::default();
        write_mesh(
            &result.mesh,
            MeshFormat::StlBinary,
            &options,
            file,
            &progress,
        )
    })?;
    println!(
        "volume {}, solid: {}",
        result.report.volume, result.report.solid
    );
    Ok(())
}
