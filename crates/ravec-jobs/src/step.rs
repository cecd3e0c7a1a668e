//! The list of all operations, and one value for any of them.

use crate::context::is_intermediate;
use crate::files::is_stream;
use crate::operation::{AnyOperation, Operation};
use crate::{
    brush, catalogue, compare, complete, match_photos, matte, mesh, mosaic, plane, plate, retarget,
    scenes, stabilize, track, twocolor, video,
};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Lists the operations: one variant each.
macro_rules! operations {
    ($($variant:ident($operation:ty),)*) => {
        /// Any operation, as a step of a recipe.
        ///
        /// In JSON it is an object with the fields of the operation and its name, as in
        /// `{"operation": "compare", "a": "a.png", "b": "b.png", "params": {}}`.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Step {
            $(
                #[doc = concat!("See [`", stringify!($operation), "`].")]
                $variant(Box<$operation>),
            )*
        }

        impl Step {
            /// The names of all operations.
            pub const NAMES: &[&str] = &[$(<$operation as Operation>::NAME,)*];

            /// The operation, whichever it is.
            pub fn operation(&self) -> &dyn AnyOperation {
                match self {
                    $(Self::$variant(operation) => &**operation,)*
                }
            }

            /// The fields of an operation as JSON, with its name as a field `operation`.
            fn tagged(&self) -> Result<Value, serde_json::Error> {
                match self {
                    $(Self::$variant(operation) => tagged(&**operation),)*
                }
            }

            /// Reads the fields of the operation of this name.
            fn from_fields(name: &str, fields: Value) -> Result<Self, serde_json::Error> {
                match name {
                    $(<$operation as Operation>::NAME => {
                        Ok(Self::$variant(serde_json::from_value(fields)?))
                    })*
                    unknown => Err(serde_json::Error::custom(format_args!(
                        "there is no operation {unknown:?}; known are {}",
                        Self::NAMES.join(", ")
                    ))),
                }
            }
        }

        #[cfg(feature = "cli")]
        impl Step {
            /// Adds a subcommand for each operation. Those of a group, such as `mesh info`, are added to the command that
            /// `group` gives for its name.
            pub fn augment(
                mut command: clap::Command,
                group: impl Fn(&'static str) -> clap::Command,
            ) -> clap::Command {
                use clap::Args as _;
                $(command = add(command, <$operation as Operation>::NAME, <$operation>::augment_args, &group);)*
                command
            }

            /// The operation that was given on the command line; `None` if it is none of these.
            ///
            /// # Errors
            /// A flag that is missing.
            pub fn from_matches(matches: &clap::ArgMatches) -> Result<Option<Self>, clap::Error> {
                use clap::FromArgMatches as _;
                let Some((first, matches)) = matches.subcommand() else {
                    return Ok(None);
                };
                let (name, matches) = match matches.subcommand() {
                    Some((second, matches)) => (format!("{first} {second}"), matches),
                    None => (first.to_owned(), matches),
                };
                $(
                    if name == <$operation as Operation>::NAME {
                        let operation = <$operation>::from_arg_matches(matches)?;
                        return Ok(Some(Self::$variant(Box::new(operation))));
                    }
                )*
                Ok(None)
            }
        }

        $(
            impl From<$operation> for Step {
                fn from(operation: $operation) -> Self {
                    Self::$variant(Box::new(operation))
                }
            }
        )*
    };
}

operations! {
    Compare(compare::Compare),
    Match(match_photos::Match),
    Rectify(plane::rectify::Rectify),
    Snap(plane::snap::Snap),
    Planes(plane::planes::Planes),
    Track(track::Track),
    Stabilize(stabilize::Stabilize),
    Plate(plate::Plate),
    Matte(matte::Matte),
    Complete(complete::Complete),
    Retarget(retarget::Retarget),
    TwoColor(twocolor::TwoColor),
    Brush(brush::Brush),
    MeshInfo(mesh::info::Info),
    MeshCheck(mesh::check::Check),
    MeshConvert(mesh::convert::Convert),
    MeshCompare(mesh::compare::Compare),
    MeshRender(mesh::render::Render),
    MeshSimplify(mesh::simplify::Simplify),
    Offset(mesh::offset::Offset),
    Boolean(mesh::boolean::Boolean),
    LibraryAdd(catalogue::Add),
    LibraryRemove(catalogue::Remove),
    LibraryList(catalogue::List),
    LibraryClean(catalogue::Clean),
    LibraryStats(catalogue::Stats),
    Mosaic(mosaic::Mosaic),
    Scenes(scenes::Scenes),
    VideoInfo(video::info::Info),
    VideoConvert(video::convert::Convert),
    VideoFrames(video::frames::Frames),
    VideoRemove(video::edit::remove::Remove),
    VideoReplace(video::edit::replace::Replace),
    VideoEnhance(video::edit::enhance::Enhance),
    VideoPaste(video::edit::paste::Paste),
    VideoOverlay(video::edit::overlay::Overlay),
}

/// Fields that are no files, whatever they say.
const NOT_FILES: [&str; 3] = ["operation", "params", "expression"];

impl Step {
    /// The same step, of which the relative paths of files start from `folder`.
    ///
    /// # Errors
    /// A path that is not Unicode, which JSON cannot hold.
    pub(crate) fn rebased(&self, folder: &Path) -> Result<Self, serde_json::Error> {
        let mut fields = Map::deserialize(self.tagged()?).map_err(serde_json::Error::custom)?;
        Self::map_paths(&mut fields, &|path| folder.join(path))?;
        serde_json::from_value(Value::Object(fields))
    }

    /// Replaces the path of each file and folder in the fields of a step as JSON, with its `operation`; standard input and output
    /// and intermediate results such as `@wide` stay. Parameters stay, and may be wrong where an operation needs none.
    ///
    /// ```
    /// use serde_json::json;
    ///
    /// let mut step = json!({
    ///     "operation": "boolean", "expression": "a - drill", "files": ["a=@0", "drill=drill.ply"], "output": "out.ply",
    /// });
    /// ravec_jobs::Step::map_paths(step.as_object_mut().unwrap(), &|path| std::path::Path::new("parts").join(path))?;
    /// assert_eq!(step["files"], json!(["a=@0", "drill=parts/drill.ply"]));
    /// # Ok::<(), serde_json::Error>(())
    /// ```
    ///
    /// # Errors
    /// Fields that are no operation; a path that is not Unicode, which JSON cannot hold. The fields are partly changed then.
    pub fn map_paths(
        fields: &mut Map<String, Value>,
        change: &dyn Fn(&Path) -> PathBuf,
    ) -> Result<(), serde_json::Error> {
        let step = serde_json::from_value(Value::Object(fields.clone())).or_else(|_| {
            // without parameters that make no sense
            let mut plain = fields.clone();
            plain.remove("params");
            serde_json::from_value::<Self>(Value::Object(plain))
        })?;
        let operation = step.operation();
        let paths: Vec<&Path> = (operation.inputs().into_iter())
            .chain(operation.outputs())
            .chain(operation.folders())
            .filter(|path| !is_intermediate(path) && !is_stream(path))
            .collect();
        // files are fields of the operation itself, not of its parameters
        for (name, field) in fields {
            if !NOT_FILES.contains(&name.as_str()) {
                map_strings(field, &paths, change)?;
            }
        }
        Ok(())
    }
}

/// Replaces strings that are one of the `paths`, or end in one after a word and an equals sign.
fn map_strings(
    field: &mut Value,
    paths: &[&Path],
    change: &dyn Fn(&Path) -> PathBuf,
) -> Result<(), serde_json::Error> {
    match field {
        Value::String(text) => {
            let is_file = |text: &str| paths.contains(&Path::new(text));
            let (word, path) = match text.split_once('=') {
                Some((word, path)) if !is_file(text) && is_file(path) => (Some(word), path),
                _ if is_file(text) => (None, text.as_str()),
                _ => return Ok(()),
            };
            let changed = change(Path::new(path));
            let changed = changed.to_str().ok_or_else(|| {
                serde_json::Error::custom(format_args!("{} is not Unicode", changed.display()))
            })?;
            *text = match word {
                Some(word) => format!("{word}={changed}"),
                None => changed.to_owned(),
            };
        }
        Value::Array(values) => {
            for value in values {
                map_strings(value, paths, change)?;
            }
        }
        Value::Object(fields) => {
            for (_, value) in fields {
                map_strings(value, paths, change)?;
            }
        }
        _ => {}
    }
    Ok(())
}

/// The fields of an operation as JSON, with its name.
pub(crate) fn tagged<O: Operation>(operation: &O) -> Result<Value, serde_json::Error> {
    #[derive(Serialize)]
    struct Tagged<'a, O> {
        operation: &'static str,
        #[serde(flatten)]
        fields: &'a O,
    }
    serde_json::to_value(Tagged {
        operation: O::NAME,
        fields: operation,
    })
}

/// Adds the subcommand of an operation to `command` or to one of its groups.
#[cfg(feature = "cli")]
fn add(
    command: clap::Command,
    name: &'static str,
    augment: fn(clap::Command) -> clap::Command,
    group: &dyn Fn(&'static str) -> clap::Command,
) -> clap::Command {
    let Some((first, second)) = name.split_once(' ') else {
        return command.subcommand(augment(clap::Command::new(name)));
    };
    let command = match command.find_subcommand(first) {
        Some(_) => command,
        None => command.subcommand(group(first)),
    };
    command.mut_subcommand(first, |group| {
        group.subcommand(augment(clap::Command::new(second)))
    })
}

impl Serialize for Step {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let value = self.tagged().map_err(serde::ser::Error::custom)?;
        value.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Step {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut fields = Map::deserialize(deserializer)?;
        let name = match fields.remove("operation") {
            Some(Value::String(name)) => name,
            Some(_) => return Err(D::Error::custom("`operation` must be a name")),
            None => return Err(D::Error::missing_field("operation")),
        };
        Self::from_fields(&name, Value::Object(fields)).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn moved(step: Value) -> Value {
        let Value::Object(mut fields) = step else {
            panic!("no object")
        };
        Step::map_paths(&mut fields, &|path| Path::new("/there").join(path)).unwrap();
        Value::Object(fields)
    }

    #[test]
    fn paths_of_all_notations_are_replaced_and_nothing_else() {
        let track = json!({
            "operation": "track", "input": "@0", "output": "csv=corners.txt", "exports": ["pin.nk", "json=a=b.txt"],
            "show": "/elsewhere/show.mp4", "track": "t.json", "params": {"frames": 7, "correct": ["pin.nk"]},
        });
        let expected = json!({
            "operation": "track", "input": "@0", "output": "csv=/there/corners.txt",
            "exports": ["/there/pin.nk", "json=/there/a=b.txt"],
            "show": "/elsewhere/show.mp4", "track": "/there/t.json", "params": {"frames": 7, "correct": ["pin.nk"]},
        });
        assert_eq!(moved(track), expected);
        let boolean = json!({
            "operation": "boolean", "expression": "a", "files": ["a=@1", "a", "x=y.ply", "./p=q.ply", "-"],
            "output": "o.ply", "origins": "o.csv",
        });
        let expected = json!({
            "operation": "boolean", "expression": "a",
            "files": ["a=@1", "/there/a", "x=/there/y.ply", "/there/./p=q.ply", "-"],
            "output": "/there/o.ply", "origins": "/there/o.csv",
        });
        assert_eq!(moved(boolean), expected);
        let mosaic = json!({
            "operation": "mosaic", "input": "a.png", "catalogue": "photos.db", "output": "@1", "deep_zoom": "zoom",
        });
        let expected = json!({
            "operation": "mosaic", "input": "/there/a.png", "catalogue": "/there/photos.db", "output": "@1",
            "deep_zoom": "/there/zoom",
        });
        assert_eq!(moved(mosaic), expected);
    }

    #[test]
    fn fields_that_are_no_operation_are_an_error() {
        let mut fields = Map::new();
        fields.insert("operation".to_owned(), "no such".into());
        assert!(Step::map_paths(&mut fields, &Path::to_path_buf).is_err());
    }
}
