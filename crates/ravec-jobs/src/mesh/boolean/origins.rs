//! The origin of each triangle of a result, as a file.

use super::NamedFile;
use crate::context::Context;
use crate::error::JobError;
use crate::files::{is_stream, write_output_text};
use crate::report::Report;
use ravec::boolean::Origin;
use std::fmt::Write as _;
use std::path::Path;

/// Refuses a path that says neither JSON nor CSV.
pub(super) fn check(path: &Path) -> Result<(), JobError> {
    kind(path).map(|_| ())
}

#[derive(Clone, Copy)]
enum Kind {
    Json,
    Csv,
}

fn kind(path: &Path) -> Result<Kind, JobError> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    match extension.map(str::to_ascii_lowercase).as_deref() {
        Some("json") => Ok(Kind::Json),
        Some("csv") => Ok(Kind::Csv),
        _ if is_stream(path) => Ok(Kind::Csv),
        _ => Err(JobError::Parameter {
            field: "origins",
            value: path.display().to_string(),
            range: "a file that ends in .json or .csv",
        }),
    }
}

/// Writes a row for each triangle of the result, in its order.
pub(super) fn write(
    path: &Path,
    inputs: &[(&String, &NamedFile)],
    origins: &[Origin],
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    let (text, format) = match kind(path)? {
        Kind::Json => (json(inputs, origins), "JSON"),
        Kind::Csv => (csv(inputs, origins), "CSV"),
    };
    write_output_text(path, format, &text, report, context)
}

/// One object with the meshes and, for each triangle, `[mesh, triangle, reversed, whole]`.
fn json(inputs: &[(&String, &NamedFile)], origins: &[Origin]) -> String {
    let meshes: Vec<_> = inputs
        .iter()
        .map(|(name, file)| {
            serde_json::json!({"name": name, "path": file.path.display().to_string()})
        })
        .collect();
    let meshes = serde_json::Value::Array(meshes);
    let mut text = format!("{{\"meshes\": {meshes},\n\"triangles\": [");
    for (i, origin) in origins.iter().enumerate() {
        let separator = if i == 0 { "\n" } else { ",\n" };
        let Origin {
            mesh,
            triangle,
            reversed,
            whole,
        } = origin;
        let triangle = triangle.map_or("null".to_owned(), |triangle| triangle.to_string());
        write!(text, "{separator}[{mesh}, {triangle}, {reversed}, {whole}]")
            .expect("a string takes every write");
    }
    text.push_str("\n]}\n");
    text
}

fn csv(inputs: &[(&String, &NamedFile)], origins: &[Origin]) -> String {
    let mut text = "mesh,triangle,reversed,whole\n".to_owned();
    for origin in origins {
        let name = inputs[origin.mesh as usize].0;
        let triangle = origin.triangle.map_or(String::new(), |t| t.to_string());
        let [reversed, whole] = [origin.reversed, origin.whole].map(u8::from);
        writeln!(text, "{name},{triangle},{reversed},{whole}").expect("a string takes every write");
    }
    text
}
