//! Documents: an input that is never changed, and a list of edits.

use ravec_jobs::{Recipe, Step};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Number of an edit, unique in its document.
pub type EditId = u64;

/// Operations that look at their input and change nothing.
const ANALYSES: [&str; 2] = ["track", "plate"];

/// Fields of operations for files that are written beside the result.
const SIDE_OUTPUTS: [&str; 7] = [
    "svg",
    "show_grid",
    "deep_zoom",
    "seen",
    "certainty",
    "exports",
    "show",
];

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
    /// Further sizes that a retargeting at the end of the list is exported in, each in a file of its own.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub more_sizes: Vec<String>,
    /// False for an edit that is passed over.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub enabled: bool,
}

fn yes() -> bool {
    true
}

/// Sets a field of an object, or a field of a field; null removes it, and what is empty then.
fn set(object: &mut Value, name: &str, value: Value) {
    let Value::Object(fields) = object else {
        return;
    };
    match name.split_once('.') {
        Some((group, rest)) => {
            let inner = fields
                .entry(group)
                .or_insert_with(|| Value::Object(Map::new()));
            set(inner, rest, value);
            if inner.as_object().is_some_and(Map::is_empty) {
                fields.remove(group);
            }
        }
        None if value.is_null() => {
            fields.remove(name);
        }
        None => {
            fields.insert(name.to_owned(), value);
        }
    }
}

impl Edit {
    /// A parameter by its name in JSON, such as `size`, or `encoding.codec` for a field of another one; null if it has its default.
    pub fn param(&self, name: &str) -> &Value {
        let mut value = self.fields.get("params");
        for part in name.split('.') {
            value = value.and_then(|value| value.get(part));
        }
        value.unwrap_or(&Value::Null)
    }

    /// The same edit with another value of a parameter; null gives it its default.
    #[must_use]
    pub fn with_param(&self, name: &str, value: Value) -> Self {
        let mut edit = self.clone();
        let params = edit
            .fields
            .entry("params")
            .or_insert_with(|| Value::Object(Map::new()));
        set(params, name, value);
        edit
    }

    /// The same edit without the files that it writes beside its result: these belong to exports.
    pub(crate) fn without_side_outputs(&self) -> Self {
        let mut edit = self.clone();
        for name in SIDE_OUTPUTS {
            edit.fields.remove(name);
        }
        // a frame has none
        edit.with_param("encoding", Value::Null)
    }

    /// True for a conversion of a clip: a range of its frames, in another size or rate.
    pub fn is_conversion(&self) -> bool {
        self.operation == "video convert"
    }

    /// True for a conversion that leaves the pixels of frames as they are.
    pub fn keeps_pixels(&self) -> bool {
        self.is_conversion() && self.param("size").is_null()
    }

    /// True for an operation that looks at its input and changes nothing, such as `track`: its output is a file of its own, or an
    /// intermediate result for other edits. A `matte` with such an output is one; without, the clip becomes the foreground.
    pub fn is_analysis(&self) -> bool {
        ANALYSES.contains(&self.operation.as_str())
            || (self.operation == "matte" && self.output().is_some())
    }

    /// The output of an analysis, by which other edits name it.
    pub fn output(&self) -> Option<&str> {
        self.fields.get("output").and_then(Value::as_str)
    }

    /// The map of planes that a plate writes beside its picture, by which other edits name it.
    pub fn regions_output(&self) -> Option<&str> {
        let regions = self.fields.get("regions").and_then(Value::as_str);
        regions.filter(|_| self.operation == "plate")
    }

    /// True for a field that names what the edit writes.
    pub(crate) fn is_output(&self, field: &str) -> bool {
        field == "output" || (field == "regions" && self.operation == "plate")
    }

    /// A field of the operation that is text, such as a path.
    pub fn text_field(&self, name: &str) -> &str {
        let text = self.fields.get(name).and_then(Value::as_str);
        text.unwrap_or_default()
    }

    /// The same edit with another text in a field; without the field for an empty text.
    #[must_use]
    pub fn with_text_field(&self, name: &str, text: &str) -> Self {
        let mut edit = self.clone();
        if text.is_empty() {
            edit.fields.remove(name);
        } else {
            edit.fields.insert(name.to_owned(), text.into());
        }
        edit
    }

    /// The operation that writes the further sizes, with the size in the name of each file; `None` if there are none.
    fn more_sizes_step(&self, input: &Path, output: &Path) -> Result<Option<Step>, String> {
        if self.more_sizes.is_empty() {
            return Ok(None);
        }
        let stem = output.file_stem().unwrap_or_default().to_string_lossy();
        let extension = output.extension().unwrap_or_default().to_string_lossy();
        let named = output.with_file_name(format!("{stem}-{{size}}.{extension}"));
        let edit = self.with_param("sizes", self.more_sizes.clone().into());
        edit.step(input, &named).map(Some)
    }

    /// The operation with these files. An analysis keeps its own output.
    ///
    /// # Errors
    /// One sentence about a field.
    pub fn step(&self, input: &Path, output: &Path) -> Result<Step, String> {
        let fields = self.whole(input, output)?;
        serde_json::from_value(Value::Object(fields)).map_err(|error| error.to_string())
    }

    /// The fields of the operation with these files, and its name.
    fn whole(&self, input: &Path, output: &Path) -> Result<Map<String, Value>, String> {
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
        Ok(fields)
    }

    /// The same edit with other paths of its own files, such as masks and the meshes of a Boolean operation. An edit that makes no
    /// sense stays as it is.
    #[must_use]
    pub fn with_paths(&self, change: &dyn Fn(&Path) -> PathBuf) -> Self {
        let mut edit = self.clone();
        let Ok(mut whole) = self.whole(&result_name(0), &result_name(1)) else {
            return edit;
        };
        if Step::map_paths(&mut whole, change).is_err() {
            return edit;
        }
        for (name, field) in &mut edit.fields {
            let Some(changed) = whole.remove(name) else {
                continue;
            };
            *field = match changed {
                // without the input
                Value::Array(files) if self.operation == "boolean" && name == "files" => {
                    files.into_iter().skip(1).collect()
                }
                changed => changed,
            };
        }
        edit
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

/// True for the name of an intermediate result.
pub(crate) fn is_result_name(path: &Path) -> bool {
    path.to_string_lossy().starts_with('@')
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
            more_sizes: Vec::new(),
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

    /// The edits that change what one of them is given.
    pub fn links_before(&self, id: EditId) -> impl Iterator<Item = &Arc<Edit>> {
        let before = self.edits.iter().take_while(move |edit| edit.id != id);
        before.filter(|edit| edit.enabled && !edit.is_analysis())
    }

    /// The edits that are not passed over.
    pub fn enabled(&self) -> impl Iterator<Item = &Arc<Edit>> {
        self.edits.iter().filter(|edit| edit.enabled)
    }

    /// The last analysis of an operation that is not passed over, before the edit with this number or, without one, at the end.
    pub fn last_analysis(&self, operation: &str, before: Option<EditId>) -> Option<&Arc<Edit>> {
        let edits = self.edits.iter();
        let edits = edits.take_while(|edit| Some(edit.id) != before);
        let found = edits.filter(|edit| edit.enabled && edit.is_analysis());
        found.filter(|edit| edit.operation == operation).last()
    }

    /// A name for an intermediate result that no edit has, such as `@plate` or `@plate-2`.
    pub fn free_name(&self, stem: &str, extension: &str) -> String {
        let taken = |name: &String| {
            let is_its = |edit: &Arc<Edit>| {
                [edit.output(), edit.regions_output()].contains(&Some(name.as_str()))
            };
            self.edits.iter().any(is_its)
        };
        let numbered = (2..).map(|number| format!("@{stem}-{number}{extension}"));
        let mut names = std::iter::once(format!("@{stem}{extension}")).chain(numbered);
        // there are more names than edits
        names.find(|name| !taken(name)).unwrap_or_default()
    }

    /// True if all that is written are files of edits which look at the source, such as tracks.
    pub fn has_analyses_only(&self) -> bool {
        self.enabled().next().is_some() && self.links().next().is_none()
    }

    /// True if an analysis writes a file.
    pub fn writes_files(&self) -> bool {
        let mut outputs = self.enabled().filter_map(|edit| edit.output());
        outputs.any(|output| !is_result_name(Path::new(output)))
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
            let wrong = |reason| EditError {
                edit: edit.id,
                operation: edit.operation.clone(),
                reason,
            };
            steps.push(edit.step(&input, &target).map_err(wrong)?);
            if target == output {
                steps.extend(edit.more_sizes_step(&input, output).map_err(wrong)?);
            }
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
    fn further_sizes_are_written_by_the_last_edit_only() {
        let mut document = document();
        let more = |edit: &Arc<Edit>| Edit {
            more_sizes: vec!["100x100".to_owned(), "90x160".to_owned()],
            ..Edit::clone(edit)
        };
        document.replace(more(&document.edits[1]));
        let recipe = document.recipe(Path::new("out.png")).unwrap();
        assert_eq!(recipe.steps.len(), 3);
        let last = recipe.steps[2].operation();
        assert_eq!(last.inputs(), [Path::new("@1")]);
        assert_eq!(last.outputs(), [Path::new("out-{size}.png")]);
        document.push("twocolor", fields(json!({})));
        let recipe = document.recipe(Path::new("out.png")).unwrap();
        assert_eq!(recipe.steps.len(), 3);
        assert_eq!(recipe.steps[2].operation().name(), "twocolor");
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
        let inner = edit.with_param("encoding.codec", "h264".into());
        assert_eq!(inner.param("encoding.codec"), "h264");
        assert_eq!(inner.param("encoding"), &json!({"codec": "h264"}));
        assert_eq!(inner.with_param("encoding.codec", Value::Null), edit);
    }
}
