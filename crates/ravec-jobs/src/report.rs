//! The report of a run, as data.

use crate::error::JobError;
use crate::identity::FileIdentity;
use crate::operation::Operation;
use crate::step::tagged;
use crate::text::escape_json;
use crate::verdict::Verdict;
use serde::Serialize;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

/// The report of a run, with all that is needed to repeat and to judge it. `--json` writes it, and the program prints a summary
/// of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The operation, as it is called on the command line.
    pub operation: &'static str,
    /// The version of Ravec.
    pub version: &'static str,
    /// The files that were read, in the order of reading.
    pub inputs: Vec<FileReport>,
    /// The files that were written, in the order of writing.
    pub outputs: Vec<FileReport>,
    /// The parameters, defaults included.
    pub parameters: serde_json::Value,
    /// The seed of everything random in the run, if anything was.
    pub seed: Option<u64>,
    /// Durations of the phases, in order. They differ from run to run; all other fields do not.
    pub timings: Vec<Timing>,
    /// Measured figures by name, with the unit at its end (`psnr_db`). An infinite figure is `null` in JSON.
    pub figures: BTreeMap<&'static str, f64>,
    /// The report of the library in full, with the names of its own struct; `figures` has its numbers under the names of the
    /// operation. The operation documents the struct.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub details: Option<serde_json::Value>,
    /// Findings with their places; empty if the operation searches for nothing.
    pub findings: Vec<Finding>,
    /// True if what was promised is what was written, of an operation that promises or judges: a solid, a proved distance, a
    /// distance that is small enough.
    pub passed: Option<bool>,
    /// Facts about the file that was written, and what was changed, dropped and assumed on the way.
    pub verdict: Verdict,
    /// The result of an operation that computes data, such as corners or homographies. The operation documents its fields.
    pub result: Option<serde_json::Value>,
    /// Warnings about a run that succeeded.
    pub warnings: Vec<String>,
    /// The recipe that repeats the run with [`Run`](crate::recipe::Run); `None` if a path is not Unicode.
    pub recipe: Option<serde_json::Value>,
    /// The reports of the steps of a recipe.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<Report>,
    /// Files that no output of this run may replace.
    #[serde(skip)]
    protected: Vec<FileIdentity>,
}

/// A file that was read or written.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct FileReport {
    /// The path as it was given; `-` is standard input or output.
    pub path: String,
    /// The format, as in `PNG`.
    pub format: String,
    /// Columns, if it is a picture.
    pub width: Option<usize>,
    /// Rows, if it is a picture.
    pub height: Option<usize>,
    /// Sample kind and alpha of a picture, as in `8 bit with alpha`.
    pub pixels: Option<&'static str>,
    /// Vertices, if it is a mesh.
    pub vertices: Option<u64>,
    /// Frames, if it is a clip and they are known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<u64>,
    /// Triangles, if it is a mesh.
    pub triangles: Option<u64>,
    /// The unit of a mesh's coordinates, if the file says it.
    pub unit: Option<&'static str>,
}

/// Something that was looked for and found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Name in the plural, as in `boundary edges`.
    pub what: &'static str,
    /// Number of occurrences.
    pub count: u64,
    /// True if it keeps the operation from passing.
    pub defect: bool,
    /// The first places, as many as were asked for.
    pub places: Vec<Place>,
}

/// A place on a mesh. Vertices and triangles are counted from 0, in the order of the file.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Place {
    /// The vertices that it is about.
    pub vertices: Vec<u32>,
    /// The triangles that it is about.
    pub triangles: Vec<u32>,
    /// The position, in units of the file.
    pub at: [f64; 3],
    /// Further details, in a few words.
    pub note: Option<String>,
}

/// The duration of a phase.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Timing {
    /// Name of the phase, one or two words.
    pub phase: &'static str,
    /// Wall-clock time.
    pub duration_secs: f64,
}

impl Report {
    /// The report of a run that has done nothing yet.
    ///
    /// # Panics
    /// If the parameters cannot be JSON, which is a bug of their type: a map with keys that are not strings.
    pub fn new(operation: &'static str, parameters: &impl Serialize) -> Self {
        Self {
            operation,
            version: env!("CARGO_PKG_VERSION"),
            inputs: Vec::new(),
            outputs: Vec::new(),
            parameters: serde_json::to_value(parameters)
                .expect("parameter structs have named fields of plain values"),
            seed: None,
            timings: Vec::new(),
            figures: BTreeMap::new(),
            details: None,
            findings: Vec::new(),
            passed: None,
            verdict: Verdict::default(),
            result: None,
            warnings: Vec::new(),
            recipe: None,
            steps: Vec::new(),
            protected: Vec::new(),
        }
    }

    /// The report of a run of `operation` that has done nothing yet.
    pub fn of<O: Operation>(operation: &O, parameters: &impl Serialize) -> Self {
        let step = tagged(operation).ok();
        Self {
            recipe: step.map(|step| json!({ "version": 1, "steps": [step] })),
            ..Self::new(O::NAME, parameters)
        }
    }

    /// Adds the report of a step: its files, except those that `is_intermediate`, its time, verdict and warnings.
    pub(crate) fn absorb(&mut self, step: Self, is_intermediate: impl Fn(&str) -> bool) {
        let files = |files: &[FileReport]| -> Vec<FileReport> {
            let files = files.iter().filter(|file| !is_intermediate(&file.path));
            files.cloned().collect()
        };
        self.inputs.extend(files(&step.inputs));
        self.outputs.extend(files(&step.outputs));
        self.timings.push(Timing {
            phase: step.operation,
            duration_secs: step.timings.iter().map(|timing| timing.duration_secs).sum(),
        });
        let passed = [self.passed, step.passed].into_iter().flatten();
        self.passed = passed.reduce(|all, passed| all && passed);
        self.warnings.extend(step.warnings.iter().cloned());
        self.verdict.absorb(step.verdict.clone());
        self.steps.push(step);
    }

    /// Takes over the warnings and the sentences of the verdict of a part of this run, each once.
    pub(crate) fn adopt_remarks(&mut self, part: &Self) {
        let lists = [
            (&mut self.warnings, &part.warnings),
            (&mut self.verdict.changed, &part.verdict.changed),
            (&mut self.verdict.dropped, &part.verdict.dropped),
            (&mut self.verdict.assumed, &part.verdict.assumed),
        ];
        for (own, others) in lists {
            for sentence in others {
                if !own.contains(sentence) {
                    own.push(sentence.clone());
                }
            }
        }
    }

    /// Protects a file that was read from every output of this run.
    pub(crate) fn protect(&mut self, path: &Path) {
        self.protected.extend(FileIdentity::of(path));
    }

    /// Refuses an output that would replace a file which this run has read or written, whatever link or spelling leads to
    /// it.
    ///
    /// # Errors
    /// [`JobError::OverwritesInput`], [`JobError::OutputTwice`].
    pub fn check_output(&self, path: &Path) -> Result<(), JobError> {
        let Some(output) = FileIdentity::of(path) else {
            return Ok(());
        };
        let path = path.to_path_buf();
        if self.protected.contains(&output) {
            return Err(JobError::OverwritesInput { path });
        }
        let written = |file: &FileReport| FileIdentity::of(Path::new(&file.path));
        if self
            .outputs
            .iter()
            .any(|file| written(file).as_ref() == Some(&output))
        {
            return Err(JobError::OutputTwice { path });
        }
        Ok(())
    }

    /// Records the time since `start` as that of a phase.
    pub(crate) fn add_time(&mut self, phase: &'static str, start: Instant) {
        self.timings.push(Timing {
            phase,
            duration_secs: start.elapsed().as_secs_f64(),
        });
    }

    /// Runs `work` and records its duration. A phase that is timed again adds up.
    pub fn time<T>(&mut self, phase: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        let duration_secs = start.elapsed().as_secs_f64();
        tracing::debug!(phase, duration_secs, "phase done");
        match self.timings.iter_mut().find(|timing| timing.phase == phase) {
            Some(timing) => timing.duration_secs += duration_secs,
            None => self.timings.push(Timing {
                phase,
                duration_secs,
            }),
        }
        result
    }

    /// Embeds the report of a library.
    ///
    /// # Panics
    /// If it cannot be JSON, which is a bug of its type: a map with keys that are not strings.
    pub(crate) fn embed(&mut self, details: &impl Serialize) {
        let details = serde_json::to_value(details);
        self.details = Some(details.expect("reports have named fields of plain values"));
    }

    /// Records something that the user should know.
    pub fn warn(&mut self, warning: impl Into<String>) {
        let warning = warning.into();
        tracing::warn!("{warning}");
        self.warnings.push(warning);
    }

    /// Records a change of the data that was not asked for, as a warning, too.
    pub fn record_changed(&mut self, sentence: impl Into<String>) {
        let sentence = sentence.into();
        self.verdict.changed.push(sentence.clone());
        self.warn(sentence);
    }

    /// Records content of the inputs that the output lacks, as a warning, too.
    pub fn record_dropped(&mut self, sentence: impl Into<String>) {
        let sentence = sentence.into();
        self.verdict.dropped.push(sentence.clone());
        self.warn(sentence);
    }

    /// Records an assumption about an input, as a warning, too.
    pub fn record_assumed(&mut self, sentence: impl Into<String>) {
        let sentence = sentence.into();
        self.verdict.assumed.push(sentence.clone());
        self.warn(sentence);
    }

    /// The report as indented JSON with a final line break. Control characters of names and texts are escaped, so that the
    /// file can be shown on a terminal.
    ///
    /// # Panics
    /// Never: all keys are strings, and infinite figures become `null`.
    pub fn to_json(&self) -> String {
        let mut text =
            serde_json::to_string_pretty(self).expect("a report has string keys and plain values");
        text.push('\n');
        escape_json(&text).into_owned()
    }

    /// The result as indented JSON with a final line break, escaped like [`to_json`](Self::to_json).
    pub fn result_json(&self) -> Option<String> {
        let result = self.result.as_ref()?;
        Some(escape_json(&format!("{result:#}\n")).into_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_infinite_figure_is_null_in_json() {
        let mut report = Report::new("compare", &());
        report.figures.insert("psnr_db", f64::INFINITY);
        report.figures.insert("ssim", 1.0);
        let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
        assert_eq!(json["figures"]["psnr_db"], serde_json::Value::Null);
        assert_eq!(json["figures"]["ssim"], 1.0);
        assert_eq!(json["operation"], "compare");
    }

    #[test]
    fn the_durations_of_a_phase_add_up() {
        let mut report = Report::new("compare", &());
        assert_eq!(report.time("read", || 3), 3);
        report.time("compare", || ());
        report.time("read", || ());
        let phases: Vec<_> = report.timings.iter().map(|timing| timing.phase).collect();
        assert_eq!(phases, ["read", "compare"]);
        assert!(
            report
                .timings
                .iter()
                .all(|timing| timing.duration_secs >= 0.0)
        );
    }
}
