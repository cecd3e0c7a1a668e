//! Documents: an input that is never changed, and a list of edits.

use ravec_jobs::{Recipe, Step};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Number of an edit, unique in its document.
pub type EditId = u64;

/// Operations that look at their input and change nothing.
const ANALYSES: [&str; 1] = ["track"];

/// Fields of operations that are files to read, beside the input.
const FILE_FIELDS: [&str; 1] = ["catalogue"];

/// Fields of operations that are written besides the output.
const SIDE_OUTPUTS: [&str; 1] = ["deep_zoom"];

/// Name of the input in the expression of a Boolean operation.
pub const INPUT_NAME: &str = "a";

/// An operation without its files: these follow from its place in the list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edit {
    /// Number in the document.
    pub id: EditId,
    /// Name of the operation, as on the command line.
    pub operation: String,
    /// Fields of the operation but `input` and `output`, as in a recipe.
    pub fields: Map<String, Value>,
    /// False for an edit that is passed over.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub enabled: bool,
}

fn yes() -> bool {
    true
}

impl Edit {
    /// A parameter by its name in JSON; null if it has its default.
    pub fn param(&self, name: &str) -> &Value {
        let params = self.fields.get("params");
        params
            .and_then(|params| params.get(name))
            .unwrap_or(&Value::Null)
    }

    /// The same edit with another value of a parameter; null gives it its default.
    #[must_use]
    pub fn with_param(&self, name: &str, value: Value) -> Self {
        let mut edit = self.clone();
        let params = edit
            .fields
            .entry("params")
            .or_insert_with(|| Value::Object(Map::new()));
        if let Value::Object(params) = params {
            if value.is_null() {
                params.remove(name);
            } else {
                params.insert(name.to_owned(), value);
            }
        }
        edit
    }

    /// True for an operation that looks at its input and changes nothing, such as `track`: its output is a file of its own.
    pub fn is_analysis(&self) -> bool {
        ANALYSES.contains(&self.operation.as_str())
    }

    /// The files beside the input that the result depends on.
    pub(crate) fn read_files(&self) -> impl Iterator<Item = PathBuf> {
        let files = FILE_FIELDS.iter().filter_map(|name| self.fields.get(*name));
        files.filter_map(Value::as_str).map(PathBuf::from)
    }

    /// The same edit without what it writes besides its output: while it is edited, nothing is written.
    pub(crate) fn without_side_outputs(&self) -> Self {
        let mut edit = self.clone();
        for name in SIDE_OUTPUTS {
            edit.fields.remove(name);
        }
        edit
    }

    /// The operation with these files. An analysis keeps its own output.
    ///
    /// # Errors
    /// One sentence about a field.
    pub fn step(&self, input: &Path, output: &Path) -> Result<Step, String> {
        let mut fields = self.fields.clone();
        let text = |path: &Path| {
            let text = path.to_str();
            text.map(Value::from)
                .ok_or_else(|| format!("{} is not Unicode", path.display()))
        };
        if self.operation == "boolean" {
            // the input is the first of several
            let more = fields.remove("files").unwrap_or(Value::Null);
            let input = format!("{INPUT_NAME}={}", text(input)?.as_str().unwrap_or_default());
            let mut files = vec![Value::from(input)];
            files.extend(more.as_array().into_iter().flatten().cloned());
            fields.insert("files".to_owned(), files.into());
        } else {
            fields.insert("input".to_owned(), text(input)?);
        }
        if !self.is_analysis() {
            fields.insert("output".to_owned(), text(output)?);
        }
        fields.insert("operation".to_owned(), self.operation.clone().into());
        serde_json::from_value(Value::Object(fields)).map_err(|error| error.to_string())
    }
}

/// An input and its edits. A clone is cheap: edits are shared.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    /// The file that is edited. It is read, never written.
    pub source: PathBuf,
    /// The edits in their order.
    pub edits: Vec<Arc<Edit>>,
    next_id: EditId,
}

/// An edit that makes no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{operation}: {reason}")]
pub struct EditError {
    /// Number of the edit.
    pub edit: EditId,
    /// Name of its operation.
    pub operation: String,
    /// One sentence.
    pub reason: String,
}

/// Name of the intermediate result behind `count` edits.
pub(crate) fn result_name(count: usize) -> PathBuf {
    PathBuf::from(format!("@{count}"))
}

impl Document {
    /// A document without edits.
    pub fn new(source: impl Into<PathBuf>) -> Self {
        Self {
            source: source.into(),
            edits: Vec::new(),
            next_id: 1,
        }
    }

    /// A document of these edits, which get new numbers where two have the same.
    pub fn from_edits(source: impl Into<PathBuf>, edits: Vec<Edit>) -> Self {
        let mut document = Self::new(source);
        for edit in edits {
            let id = document.next_id.max(edit.id);
            document.edits.push(Arc::new(Edit { id, ..edit }));
            document.next_id = id + 1;
        }
        document
    }

    /// Appends an edit; its number.
    pub fn push(&mut self, operation: &str, fields: Map<String, Value>) -> EditId {
        let id = self.next_id;
        self.next_id += 1;
        self.edits.push(Arc::new(Edit {
            id,
            operation: operation.to_owned(),
            fields,
            enabled: true,
        }));
        id
    }

    /// The edit with a number.
    pub fn edit(&self, id: EditId) -> Option<&Arc<Edit>> {
        self.edits.iter().find(|edit| edit.id == id)
    }

    /// Replaces the edit that has the same number; does nothing if there is none.
    pub fn replace(&mut self, edit: Edit) {
        if let Some(place) = self.edits.iter_mut().find(|other| other.id == edit.id) {
            *place = Arc::new(edit);
        }
    }

    /// Removes an edit.
    pub fn remove(&mut self, id: EditId) {
        self.edits.retain(|edit| edit.id != id);
    }

    /// Moves an edit by some places, as far as the list goes.
    pub fn shift(&mut self, id: EditId, places: isize) {
        if let Some(from) = self.edits.iter().position(|edit| edit.id == id) {
            let last = self.edits.len() - 1;
            let to = from.saturating_add_signed(places).min(last);
            let edit = self.edits.remove(from);
            self.edits.insert(to, edit);
        }
    }

    /// The edits that change what is passed on.
    pub fn links(&self) -> impl Iterator<Item = &Arc<Edit>> {
        self.enabled().filter(|edit| !edit.is_analysis())
    }

    /// The edits that are not passed over.
    pub fn enabled(&self) -> impl Iterator<Item = &Arc<Edit>> {
        self.edits.iter().filter(|edit| edit.enabled)
    }

    /// The recipe that makes `output` of the source.
    ///
    /// # Errors
    /// [`EditError`] for the first edit that makes no sense; without an edit there is nothing to run.
    pub fn recipe(&self, output: &Path) -> Result<Recipe, EditError> {
        let links = self.links().count();
        let mut steps = Vec::new();
        let mut done = 0;
        for edit in self.enabled() {
            let input = match done {
                0 => self.source.clone(),
                done if done == links => output.to_path_buf(),
                done => result_name(done),
            };
            if !edit.is_analysis() {
                done += 1;
            }
            let target = match done {
                done if done == links => output.to_path_buf(),
                done => result_name(done),
            };
            steps.push(edit.step(&input, &target).map_err(|reason| EditError {
                edit: edit.id,
                operation: edit.operation.clone(),
                reason,
            })?);
        }
        Ok(Recipe::new(steps))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn fields(params: Value) -> Map<String, Value> {
        let mut fields = Map::new();
        fields.insert("params".to_owned(), params);
        fields
    }

    fn document() -> Document {
        let mut document = Document::new("photo.png");
        document.push("twocolor", fields(json!({})));
        document.push("retarget", fields(json!({"sizes": ["50%x100%"]})));
        document
    }

    #[test]
    fn edits_become_the_steps_of_a_recipe() {
        let recipe = document().recipe(Path::new("out.png")).unwrap();
        let paths: Vec<_> = (recipe.steps.iter())
            .map(|step| {
                let operation = step.operation();
                (
                    operation.inputs()[0].to_path_buf(),
                    operation.outputs()[0].to_path_buf(),
                )
            })
            .collect();
        let expected = [("photo.png", "@1"), ("@1", "out.png")];
        assert_eq!(
            paths,
            expected.map(|(a, b)| (PathBuf::from(a), PathBuf::from(b)))
        );
    }

    #[test]
    fn an_edit_that_is_switched_off_is_passed_over() {
        let mut document = document();
        let first = Edit {
            enabled: false,
            ..Edit::clone(&document.edits[0])
        };
        document.replace(first);
        let recipe = document.recipe(Path::new("out.png")).unwrap();
        assert_eq!(recipe.steps.len(), 1);
        assert_eq!(
            recipe.steps[0].operation().inputs(),
            [Path::new("photo.png")]
        );
    }

    #[test]
    fn edits_move_and_keep_their_numbers() {
        let mut document = document();
        let (first, second) = (document.edits[0].id, document.edits[1].id);
        document.shift(second, -5);
        let order: Vec<EditId> = document.edits.iter().map(|edit| edit.id).collect();
        assert_eq!(order, [second, first]);
        document.remove(second);
        let third = document.push("twocolor", Map::new());
        assert!(third > second);
    }

    #[test]
    fn a_wrong_parameter_names_the_edit() {
        let mut document = document();
        let wrong = document.edits[1].with_param("saliency", "much".into());
        document.replace(wrong);
        let error = document.recipe(Path::new("out.png")).unwrap_err();
        assert_eq!(error.edit, document.edits[1].id);
        assert!(error.to_string().starts_with("retarget: "), "{error}");
    }

    #[test]
    fn a_parameter_that_is_null_has_its_default() {
        let edit = Edit::clone(&document().edits[1]);
        let changed = edit.with_param("saliency", 0.25.into());
        assert_eq!(changed.param("saliency"), 0.25);
        assert_eq!(changed.with_param("saliency", Value::Null), edit);
    }
}
