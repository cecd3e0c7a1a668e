//! The list of all operations, and one value for any of them.

use crate::context::is_intermediate;
use crate::files::is_stream;
use crate::operation::{AnyOperation, Operation};
use crate::{
    brush, catalogue, compare, complete, match_photos, mesh, mosaic, plane, retarget, scenes,
    stabilize, track, twocolor, video,
};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value};
use std::path::Path;

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
}

impl Step {
    /// The same step, of which the relative paths of files start from `folder`.
    ///
    /// # Errors
    /// A path that is not Unicode, which JSON cannot hold.
    pub(crate) fn rebased(&self, folder: &Path) -> Result<Self, serde_json::Error> {
        let operation = self.operation();
        let paths: Vec<&Path> = (operation.inputs().into_iter())
            .chain(operation.outputs())
            .chain(operation.folders())
            .collect();
        let mut fields = self.tagged()?;
        // files are fields of the operation itself, not of its parameters
        let all = fields.as_object_mut().into_iter().flatten();
        for (_, field) in all.filter(|(name, _)| *name != "params" && *name != "operation") {
            rebase(field, &paths, folder);
        }
        serde_json::from_value(fields)
    }
}

/// Lets strings that are one of the `paths` start from `folder`.
fn rebase(field: &mut Value, paths: &[&Path], folder: &Path) {
    match field {
        Value::String(text) => {
            let path = Path::new(text.as_str());
            let is_file = !is_intermediate(path) && !is_stream(path);
            if is_file && path.is_relative() && paths.contains(&path) {
                *text = folder.join(path).to_string_lossy().into_owned();
            }
        }
        Value::Array(values) => {
            for value in values {
                rebase(value, paths, folder);
            }
        }
        Value::Object(fields) => {
            for (_, value) in fields {
                rebase(value, paths, folder);
            }
        }
        _ => {}
    }
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
