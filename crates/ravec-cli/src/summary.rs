//! Reports for the user: lines on standard output, or JSON in a file.

use crate::exit::{self, Failure};
use crate::flags::Flags;
use ravec_jobs::recipe::Run;
use ravec_jobs::{FileReport, Finding, Operation as _, Place, Report, escape_controls, write_text};
use serde_json::Value;
use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;

/// The report for a reader: verdict, files, figures, findings, time.
pub fn summary(report: &Report) -> String {
    let mut text = String::new();
    if let Some(verdict) = report.verdict.line(report.passed) {
        put(&mut text, format_args!("{verdict}"));
    }
    for file in &report.inputs {
        line(&mut text, "read", file);
    }
    for file in &report.outputs {
        line(&mut text, "wrote", file);
    }
    if report.operation == Run::NAME
        && let Some(steps) = report.result.as_ref().and_then(Value::as_array)
    {
        for step in steps {
            plan(&mut text, step);
        }
    }
    let width = report.figures.keys().map(|name| name.len()).max();
    for (name, figure) in &report.figures {
        let width = width.unwrap_or(0);
        put(
            &mut text,
            format_args!("{name:width$}  {}", number(*figure)),
        );
    }
    for finding in &report.findings {
        list(&mut text, finding);
    }
    if let Some(seed) = report.seed {
        put(&mut text, format_args!("seed {seed}"));
    }
    let times: Vec<_> = report
        .timings
        .iter()
        .map(|timing| format!("{} {:.3} s", timing.phase, timing.duration_secs))
        .collect();
    if !times.is_empty() {
        put(&mut text, format_args!("{}", times.join(", ")));
    }
    text
}

/// A step of a recipe that was not run: what it would read and write.
fn plan(text: &mut String, step: &Value) {
    let word = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let list = |name: &str| step[name].as_array().cloned().unwrap_or_default();
    put(text, format_args!("{}", word(&step["operation"])));
    for path in list("inputs") {
        put(text, format_args!("  reads   {}", word(&path)));
    }
    for output in list("outputs") {
        let (path, state) = (word(&output["path"]), word(&output["state"]));
        put(text, format_args!("  writes  {path} ({state})"));
    }
}

fn line(text: &mut String, verb: &str, file: &FileReport) {
    let size = match (file.width, file.height) {
        (Some(width), Some(height)) => format!(", {width} x {height}"),
        _ => String::new(),
    };
    let pixels = file
        .pixels
        .map_or(String::new(), |kind| format!(", {kind}"));
    let counts = match (file.triangles, file.vertices) {
        (Some(triangles), Some(vertices)) => {
            format!(", {triangles} triangles, {vertices} vertices")
        }
        _ => String::new(),
    };
    let unit = file.unit.map_or(String::new(), |unit| format!(", {unit}"));
    put(
        text,
        format_args!(
            "{verb} {} ({}{size}{pixels}{counts}{unit})",
            file.path, file.format
        ),
    );
}

/// Findings and their places.
fn list(text: &mut String, finding: &Finding) {
    put(text, format_args!("{}: {}", finding.what, finding.count));
    for place in &finding.places {
        put(text, format_args!("  {}", described(place)));
    }
    let more = finding.count - (finding.places.len() as u64).min(finding.count);
    // of some no place is known
    if more > 0 && !finding.places.is_empty() {
        put(text, format_args!("  and {more} more"));
    }
}

fn described(place: &Place) -> String {
    let named = |one: &str, several: &str, indices: &[u32]| {
        let list: Vec<_> = indices.iter().map(u32::to_string).collect();
        let what = if list.len() == 1 { one } else { several };
        (!list.is_empty()).then(|| format!("{what} {}", list.join(" and ")))
    };
    let [x, y, z] = place.at.map(number);
    let parts = [
        named("vertex", "vertices", &place.vertices),
        named("triangle", "triangles", &place.triangles),
        Some(format!("at ({x}, {y}, {z})")),
        place.note.as_ref().map(|note| format!("- {note}")),
    ];
    let parts: Vec<_> = parts.into_iter().flatten().collect();
    parts.join(" ")
}

fn put(text: &mut String, line: std::fmt::Arguments<'_>) {
    // a line has names from outside, which must not break it nor reach the terminal as they are
    let line = line.to_string();
    writeln!(text, "{}", escape_controls(&line)).expect("a string takes every write");
}

/// Four significant digits at least, and whole numbers as such.
fn number(figure: f64) -> String {
    if figure.is_infinite() {
        "infinite".to_owned()
    } else if figure == figure.trunc() && figure.abs() < 1e15 {
        format!("{figure}")
    } else if figure.abs() >= 10.0 {
        format!("{figure:.2}")
    } else if figure.abs() < 1e-4 {
        format!("{figure:.3e}")
    } else if figure.abs() < 0.1 {
        // as many zeros behind the point as there are, and four digits
        let zeros = (-figure.abs().log10()).floor() as usize;
        format!("{figure:.*}", zeros + 4)
    } else {
        format!("{figure:.4}")
    }
}

/// Writes the report as JSON to a file, or to standard output if the path is `-`.
///
/// # Errors
/// With the code for outputs, if it cannot be written.
pub fn write_json(report: &Report, path: &Path, flags: &Flags) -> Result<(), Failure> {
    if path.as_os_str() == "-" {
        return print(&report.to_json());
    }
    report
        .check_output(path)
        .and_then(|()| write_text(path, &report.to_json()))
        .map_err(|error| Failure::of(&error, flags))
}

/// Prints to standard output. A reader that has gone away (`ravec ... | head`) ends the program without a word.
///
/// # Errors
/// With the code for outputs, if it cannot be written.
pub fn print(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Ok(()) => Ok(()),
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        Err(error) => Err(Failure::new(
            exit::OUTPUT,
            format_args!("cannot write to standard output: {error}"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_names_files_figures_seed_and_time() {
        let mut report = Report::new("compare", &());
        report.inputs.push(FileReport {
            path: "a.png".to_owned(),
            format: "png".to_owned(),
            width: Some(4),
            height: Some(3),
            pixels: Some("8 bit"),
            ..FileReport::default()
        });
        report.figures.insert("psnr_db", f64::INFINITY);
        report.figures.insert("ssim", 0.98765);
        report.seed = Some(7);
        report.time("read", || ());
        let text = summary(&report);
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(
            lines[..4],
            [
                "read a.png (png, 4 x 3, 8 bit)",
                "psnr_db  infinite",
                "ssim     0.9877",
                "seed 7"
            ]
        );
        assert!(lines[4].starts_with("read 0.0"), "{}", lines[4]);
    }

    #[test]
    fn findings_say_how_often_where_and_how() {
        let mut report = Report::new("mesh check", &());
        report.findings = vec![
            Finding {
                what: "self-intersections",
                count: 3,
                defect: true,
                places: vec![Place {
                    triangles: vec![4, 9],
                    at: [0.5, 12.0, -1.0],
                    note: Some("crossing".to_owned()),
                    ..Place::default()
                }],
            },
            Finding {
                what: "unused vertices",
                count: 1,
                defect: false,
                places: vec![Place {
                    vertices: vec![7],
                    ..Place::default()
                }],
            },
        ];
        report.passed = Some(false);
        let text = summary(&report);
        assert_eq!(
            text.lines().collect::<Vec<_>>(),
            [
                "not passed",
                "self-intersections: 3",
                "  triangles 4 and 9 at (0.5000, 12, -1) - crossing",
                "  and 2 more",
                "unused vertices: 1",
                "  vertex 7 at (0, 0, 0)",
            ]
        );
    }

    #[test]
    fn numbers_are_short_and_whole_ones_stay_whole() {
        for (figure, text) in [
            (31.4159, "31.42"),
            (0.5, "0.5000"),
            (12.0, "12"),
            (-0.25, "-0.2500"),
            (0.0123456, "0.01235"),
            (-0.00123456, "-0.001235"),
            (1.23456e-7, "1.235e-7"),
            (0.0, "0"),
        ] {
            assert_eq!(number(figure), text);
        }
    }
}
