//! `run`: recipes, which are lists of operations.
//!
//! Words: a *step* is an operation with its files and parameters; an *intermediate result* is an output of a step with a name
//! such as `@wide` in place of a path, which later steps read from memory.

use crate::context::{Context, is_intermediate};
use crate::error::{JobError, plain};
use crate::files;
use crate::identity::FileIdentity;
use crate::operation::{AnyOperation, Operation};
use crate::report::Report;
use crate::step::Step;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// The version of the format that is written and read.
const VERSION: u32 = 1;

/// Maximum size of a recipe in bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Maximum number of steps.
const MAX_STEPS: usize = 10_000;

/// A list of operations to run in order.
///
/// In JSON: `{"version": 1, "steps": [{"operation": "retarget", "input": "photo.jpg", …}, …]}`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The version of the format, 1.
    pub version: u32,
    /// Folder that relative paths start from (default: the working folder).
    #[serde(default, skip_serializing_if = "PathBase::is_default")]
    pub relative_to: PathBase,
    /// Data of the program that edits the recipe; not used when it is run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub editor: Option<Value>,
    /// The operations.
    pub steps: Vec<Step>,
}

/// Folder that the relative paths of a recipe start from.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PathBase {
    /// The folder in which the program runs.
    #[default]
    WorkingFolder,
    /// The folder of the recipe.
    Recipe,
}

impl PathBase {
    #[expect(
        clippy::trivially_copy_pass_by_ref,
        reason = "the signature that serde asks for"
    )]
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl Recipe {
    /// A recipe of these steps.
    pub fn new(steps: Vec<Step>) -> Self {
        Self {
            version: VERSION,
            relative_to: PathBase::default(),
            editor: None,
            steps,
        }
    }

    /// Reads a recipe from JSON.
    ///
    /// # Errors
    /// One sentence that names the step and the field.
    pub fn from_json(text: &str) -> Result<Self, String> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Raw {
            version: u32,
            #[serde(default)]
            relative_to: PathBase,
            #[serde(default)]
            editor: Option<Value>,
            steps: Vec<Value>,
        }
        let raw: Raw = serde_json::from_str(text).map_err(|error| error.to_string())?;
        if raw.version != VERSION {
            return Err(format!(
                "its version is {}, and only version {VERSION} is known",
                raw.version
            ));
        }
        if raw.steps.len() > MAX_STEPS {
            return Err(format!(
                "it has {} steps, which is more than {MAX_STEPS}",
                raw.steps.len()
            ));
        }
        let step = |(index, value)| {
            serde_json::from_value(value).map_err(|error| format!("step {}: {error}", index + 1))
        };
        let steps = raw.steps.into_iter().enumerate().map(step);
        Ok(Self {
            relative_to: raw.relative_to,
            editor: raw.editor,
            ..Self::new(steps.collect::<Result<_, String>>()?)
        })
    }

    /// The same recipe with relative paths that start from `folder`, if they do not start from the working folder.
    ///
    /// # Errors
    /// A path that is not Unicode, which JSON cannot hold.
    fn resolved(mut self, folder: &Path) -> Result<Self, serde_json::Error> {
        if self.relative_to == PathBase::Recipe {
            for step in &mut self.steps {
                *step = step.rebased(folder)?;
            }
        }
        Ok(self)
    }

    /// The recipe as indented JSON with a final line break.
    ///
    /// # Errors
    /// A path that is not Unicode, which JSON cannot hold.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        Ok(format!("{}\n", serde_json::to_string_pretty(self)?))
    }

    /// Refuses files that get in each other's way: an output that replaces an input of the recipe or the output of another
    /// step, and an intermediate result that no earlier step writes and that is not there already.
    fn check(&self, recipe: &Path, context: &Context) -> Result<(), JobError> {
        let mut written = HashSet::new();
        let mut intermediates = context.names();
        // files that exist before the recipe runs
        let mut read: HashSet<_> = FileIdentity::of(recipe).into_iter().collect();
        for step in &self.steps {
            let operation = step.operation();
            for path in operation.inputs() {
                if is_intermediate(path) {
                    if !intermediates.contains(path) {
                        return Err(JobError::NoIntermediate {
                            path: path.to_path_buf(),
                            expected: "an output of an earlier step",
                        });
                    }
                } else if !written.contains(path) {
                    read.extend(FileIdentity::of(path));
                }
            }
            for path in operation.outputs() {
                let owned = || path.to_path_buf();
                if is_intermediate(path) {
                    intermediates.insert(owned());
                } else if !files::is_stream(path) {
                    let twice = !written.insert(owned());
                    if twice {
                        return Err(JobError::OutputTwice { path: owned() });
                    }
                }
            }
        }
        for path in &written {
            if FileIdentity::of(path).is_some_and(|file| read.contains(&file)) {
                return Err(JobError::OverwritesInput { path: path.clone() });
            }
        }
        Ok(())
    }

    /// Runs the steps in order, as if they stood in the recipe `file`, which need not exist. Intermediate results of `context` may be
    /// inputs, and those of the steps are left there.
    ///
    /// # Errors
    /// Those of [`Run::run`], but for reading the file.
    pub fn run(&self, file: &Path, context: &Context) -> Result<Report, JobError> {
        let mut report = Report::new(Run::NAME, &Params::default());
        report.recipe = serde_json::to_value(self).ok();
        let unreadable = |error: serde_json::Error| JobError::Recipe {
            path: file.to_path_buf(),
            reason: error.to_string(),
        };
        let recipe = self.clone().resolved(parent(file)).map_err(unreadable)?;
        recipe.run_steps(file, context, &mut report)?;
        Ok(report)
    }

    /// Checks and runs the steps, whose paths are resolved.
    fn run_steps(
        &self,
        file: &Path,
        context: &Context,
        report: &mut Report,
    ) -> Result<(), JobError> {
        self.check(file, context)?;
        for (index, step) in self.steps.iter().enumerate() {
            context.progress.check()?;
            let operation = step.operation();
            tracing::info!("step {}: {}", index + 1, operation.name());
            let done = run_step(operation, context).map_err(|cause| cause.in_step(index + 1))?;
            report.absorb(done, |path| is_intermediate(Path::new(path)));
            if report.passed == Some(false) {
                report.record_dropped(format!(
                    "the recipe ended after step {} ({}): its verdict is no",
                    index + 1,
                    operation.name()
                ));
                break;
            }
        }
        Ok(())
    }

    /// Each step with its inputs and outputs, and what becomes of files that exist.
    fn plan(&self) -> Value {
        let described = |step: &Step| {
            let operation = step.operation();
            let outputs = operation.outputs();
            let files = outputs.into_iter().map(|path| described(path, false));
            let folders = operation.folders();
            let folders = folders.into_iter().map(|path| described(path, true));
            let inputs = operation.inputs();
            let inputs: Vec<_> = inputs.iter().map(|path| path.to_string_lossy()).collect();
            json!({
                "operation": operation.name(),
                "inputs": inputs,
                "outputs": files.chain(folders).collect::<Vec<_>>(),
            })
        };
        self.steps.iter().map(described).collect()
    }
}

/// An output before it is written.
fn described(path: &Path, folder: bool) -> Value {
    let state = if is_intermediate(path) {
        "in memory"
    } else if files::is_stream(path) {
        "standard output"
    } else {
        match (folder, path.exists()) {
            (false, false) => "new file",
            (false, true) => "replaces a file",
            (true, false) => "new folder",
            (true, true) => "fills a folder",
        }
    };
    json!({ "path": path.to_string_lossy(), "state": state })
}

/// Run the operations of a recipe in order
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Run {
    /// Recipe as JSON, such as --recipe writes; `-` is standard input
    #[cfg_attr(feature = "cli", arg(value_name = "RECIPE"))]
    pub file: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

/// Parameters of [`Run`].
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Print the inputs and outputs of each step and the files that would be replaced; run nothing
    #[cfg_attr(feature = "cli", arg(long))]
    pub dry_run: bool,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec retarget photo.jpg -o narrow.png --size 75%x100% --recipe narrow.json
  ravec run narrow.json --dry-run
  ravec run narrow.json

A recipe is a list of operations, with the names of their flags and `_` in place of `-`; parameters that are left out \
have their defaults:
  {\"version\": 1, \"steps\": [
    {\"operation\": \"brush\", \"input\": \"noisy.jpg\", \"output\": \"@clean\", \"everywhere\": true,
     \"params\": {\"mode\": \"clean\"}},
    {\"operation\": \"retarget\", \"input\": \"@clean\", \"output\": \"wide.png\",
     \"params\": {\"sizes\": [\"150%x100%\"]}}]}
An output whose name begins with @ stays in memory, for later steps of the same run; its samples and coordinates are not rounded \
to those of a file. Other paths are relative to the working folder, or to that of the recipe with \"relative_to\": \"recipe\".

No step may replace a file that the recipe reads, and no two steps may write one file. The first step that fails, or whose \
verdict is no, ends the run with its exit code; files of earlier steps stay. The report lists the reports of the steps.";

impl Operation for Run {
    const NAME: &'static str = "run";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.file]
    }

    /// Those of its steps are checked when the recipe is read.
    fn outputs(&self) -> Vec<&Path> {
        Vec::new()
    }

    /// The result of a dry run lists the `operation`, `inputs` and `outputs` of each step; an output has a `path` and a
    /// `state`, such as `new file` or `replaces a file`. Otherwise [`Report::steps`] has the reports of the steps.
    ///
    /// # Errors
    /// [`JobError::Recipe`], [`JobError::OverwritesInput`], [`JobError::OutputTwice`], [`JobError::NoIntermediate`],
    /// [`JobError::Step`] with the error of a step.
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let unreadable = |reason: String| JobError::Recipe {
            path: self.file.clone(),
            reason,
        };
        let text =
            files::read_text(&self.file, MAX_BYTES).map_err(|error| unreadable(plain(&error)))?;
        let recipe = Recipe::from_json(&text).map_err(unreadable)?;
        let mut report = Report::of(self, &self.params);
        report.recipe = serde_json::to_value(&recipe).ok();
        let recipe = recipe
            .resolved(parent(&self.file))
            .map_err(|error| unreadable(error.to_string()))?;
        if self.params.dry_run {
            recipe.check(&self.file, context)?;
            report.result = Some(recipe.plan());
            return Ok(report);
        }
        recipe.run_steps(&self.file, &context.with_intermediates(), &mut report)?;
        Ok(report)
    }
}

/// The folder of a file.
fn parent(file: &Path) -> &Path {
    file.parent().unwrap_or(Path::new(""))
}

/// Checks the files of a step and runs it.
fn run_step(operation: &dyn AnyOperation, context: &Context) -> Result<Report, JobError> {
    let side_files = operation.side_files();
    let side_files = side_files.iter().map(PathBuf::as_path);
    let inputs: Vec<_> = operation.inputs().into_iter().chain(side_files).collect();
    let side_outputs = context.side_outputs.iter().map(PathBuf::as_path);
    let outputs = operation.outputs().into_iter().chain(side_outputs);
    let outputs: Vec<_> = outputs.collect();
    context.check_files(&inputs, &outputs)?;
    operation.run(context)
}
