//! Settings of operations for panels, made from the parameter structs.
//!
//! The flags of an operation on the command line have a name, a help text with the range in words, and a default; its fields in JSON
//! have the types. Both come from the one struct of the operation, and so does its panel.

use clap::{Arg, ArgAction, Command};
use ravec_jobs::Step;
use serde_json::{Value, json};
use std::any::TypeId;

/// The kind of control of a setting.
#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// On or off.
    Switch,
    /// One of some words.
    Choice(Vec<ChoiceValue>),
    /// A number, in a range if the help states one.
    Number {
        /// Least and largest value.
        range: Option<[f64; 2]>,
        /// True for whole numbers.
        whole: bool,
    },
    /// Words or numbers in the notation of the command line.
    Text,
    /// Several of these, separated by spaces.
    List,
}

/// A word that can be chosen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChoiceValue {
    /// The word.
    pub name: String,
    /// Its help text.
    pub help: String,
}

/// A setting of an operation.
#[derive(Debug, Clone, PartialEq)]
pub struct Setting {
    /// Name of the parameter in JSON.
    pub name: String,
    /// Label: the name in words.
    pub label: String,
    /// First paragraph of its documentation.
    pub help: String,
    /// The control.
    pub kind: Kind,
    /// Default, in the notation of the command line; empty if there is none.
    pub default: String,
}

/// An operation with its settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Form {
    /// Purpose of the operation, in one sentence.
    pub about: String,
    /// Its parameters, in the order of the command line.
    pub settings: Vec<Setting>,
}

/// Parameters that belong to the command line, or that the tools set.
const NOT_SETTINGS: [&str; 3] = ["resume", "pixel_centers", "input_rate"];

/// Parameters that have fields of their own, which are flags of the command line like others.
const GROUPS: [&str; 4] = [ENCODING, "output", "shot", "matte"];

/// The group of the encoding of clips.
const ENCODING: &str = "encoding";

/// Parameters that only clips have, beside their encoding.
const OF_CLIPS: [&str; 2] = ["look_ahead", "still_camera"];

/// Name of a parameter of an operation in an edit: with that of its group if it has one, as in `encoding.codec`. `None` for a flag
/// that is no parameter, such as a file.
fn name_in_edit(operation: &str, name: &str) -> Option<String> {
    let is_known = |params: Value| {
        let step = json!({"operation": operation, "params": params});
        // whatever else is wrong with it, such as files that are missing
        let wrong = serde_json::from_value::<Step>(step).err();
        wrong.is_none_or(|error| !error.to_string().contains("unknown field"))
    };
    if GROUPS.contains(&name) {
        return None;
    }
    if is_known(json!({name: null})) {
        return Some(name.to_owned());
    }
    let mut groups = GROUPS.iter();
    let group = groups.find(|group| is_known(json!({**group: {name: null}})))?;
    Some(format!("{group}.{name}"))
}

/// The form of an operation; `None` if there is no operation of that name.
pub fn form(operation: &str) -> Option<Form> {
    let all = Step::augment(Command::new("ravec"), Command::new);
    let mut command = &all;
    for word in operation.split(' ') {
        command = command.find_subcommand(word)?;
    }
    let about = command
        .get_about()
        .map(ToString::to_string)
        .unwrap_or_default();
    let settings = command.get_arguments();
    let settings = settings.filter_map(|arg| setting(operation, arg)).collect();
    Some(Form { about, settings })
}

fn setting(operation: &str, arg: &Arg) -> Option<Setting> {
    let name = arg.get_id().as_str();
    if NOT_SETTINGS.contains(&name) || arg.is_hide_set() {
        return None;
    }
    let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
    let defaults: Vec<_> = arg
        .get_default_values()
        .iter()
        .map(|value| value.to_string_lossy())
        .collect();
    let default = defaults.join(" ");
    Some(Setting {
        name: name_in_edit(operation, name)?,
        label: label_of(name),
        kind: kind(arg, &help, &default),
        help,
        default,
    })
}

impl Setting {
    /// True for a setting of clips alone.
    pub fn is_of_clips(&self) -> bool {
        self.name.split('.').next() == Some(ENCODING) || OF_CLIPS.contains(&self.name.as_str())
    }
}

/// `object_scale` as `Object scale`.
fn label_of(name: &str) -> String {
    let words = name.replace('_', " ");
    let mut letters = words.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}

fn kind(arg: &Arg, help: &str, default: &str) -> Kind {
    match arg.get_action() {
        ArgAction::SetTrue | ArgAction::SetFalse => return Kind::Switch,
        ArgAction::Append => return Kind::List,
        _ => {}
    }
    let choices: Vec<ChoiceValue> = (arg.get_possible_values().into_iter())
        .map(|value| ChoiceValue {
            name: value.get_name().to_owned(),
            help: value
                .get_help()
                .map(ToString::to_string)
                .unwrap_or_default(),
        })
        .collect();
    if !choices.is_empty() {
        return Kind::Choice(choices);
    }
    let range = range_in(help);
    if default.parse::<f64>().is_ok() || (default.is_empty() && range.is_some()) {
        if is_integer(arg) {
            return Kind::Number { range, whole: true };
        }
        let ends_whole = range.is_none_or(|range| range.iter().all(|end| end.fract() == 0.0));
        let whole = if default.is_empty() {
            ends_whole
        } else {
            !default.contains('.') && ends_whole && is_count(help)
        };
        return Kind::Number { range, whole };
    }
    Kind::Text
}

/// True if the parameter itself is an integer.
fn is_integer(arg: &Arg) -> bool {
    let of = arg.get_value_parser().type_id();
    of == TypeId::of::<usize>()
        || of == TypeId::of::<u64>()
        || of == TypeId::of::<u32>()
        || of == TypeId::of::<u8>()
        || of == TypeId::of::<i32>()
}

/// True if a help text is about things that are counted.
fn is_count(help: &str) -> bool {
    let first = help.split_whitespace().next().unwrap_or_default();
    [
        "Number",
        "Columns",
        "Rows",
        "Cells",
        "Steps",
        "Repetitions",
        "Quality",
        "Seed",
        "Side",
    ]
    .contains(&first)
}

/// The first range in a text such as "2 to 400".
fn range_in(help: &str) -> Option<[f64; 2]> {
    let clean = |word: &str| {
        let word = word.trim_matches(|c: char| !c.is_ascii_digit() && c != '-' && c != '.');
        word.trim_end_matches('.').parse::<f64>().ok()
    };
    let words: Vec<&str> = help.split_whitespace().collect();
    words.windows(3).find_map(|window| {
        let [low, to, high] = window else { return None };
        if *to != "to" {
            return None;
        }
        let (low, high) = (clean(low)?, clean(high)?);
        (low < high).then_some([low, high])
    })
}

/// A value in the notation of the command line as JSON for a setting.
pub fn to_json(kind: &Kind, text: &str) -> Value {
    match kind {
        Kind::Switch => (text == "true").into(),
        Kind::Number { whole, .. } => match text.parse::<f64>() {
            Ok(number) if *whole => (number.round() as i64).into(),
            Ok(number) => number.into(),
            Err(_) => text.into(),
        },
        Kind::List => text.split_whitespace().map(Value::from).collect(),
        // many texts are numbers or words to their parsers
        Kind::Text if text.is_empty() => Value::Null,
        Kind::Choice(_) | Kind::Text => text.into(),
    }
}

/// A value as the command line writes it.
pub fn to_text(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        Value::Array(values) => values.iter().map(to_text).collect::<Vec<_>>().join(" "),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_from_help_texts() {
        assert_eq!(
            range_in("Weight of straight lines, 0 to 10"),
            Some([0.0, 10.0])
        );
        assert_eq!(
            range_in("The scale, 0.25 to 4, as far as"),
            Some([0.25, 4.0])
        );
        assert_eq!(
            range_in("Cells along the longer side, 2 to 400."),
            Some([2.0, 400.0])
        );
        assert_eq!(range_in("from here to there"), None);
    }

    #[test]
    fn retargeting_has_its_parameters() {
        let form = form("retarget").unwrap();
        assert!(form.about.contains("aspect ratio"), "{}", form.about);
        let find = |name: &str| {
            form.settings
                .iter()
                .find(|setting| setting.name == name)
                .unwrap()
        };
        assert_eq!(
            find("saliency").kind,
            Kind::Number {
                range: Some([0.0, 1.0]),
                whole: false
            }
        );
        assert_eq!(find("adaptive").kind, Kind::Switch);
        assert_eq!(find("sizes").kind, Kind::List);
        assert!(matches!(&find("borders").kind, Kind::Choice(values) if values.len() > 1));
        assert!(!find("lines").help.is_empty() && !find("lines").default.is_empty());
        assert!(form.settings.iter().all(|setting| setting.name != "input"));
    }

    #[test]
    fn parameters_that_are_integers_take_whole_numbers() {
        let form = form("mosaic").unwrap();
        for (name, range) in [("rounds", Some([0.0, 100.0])), ("degree", None)] {
            let mut settings = form.settings.iter();
            let setting = settings.find(|setting| setting.name == name).unwrap();
            assert_eq!(setting.kind, Kind::Number { range, whole: true }, "{name}");
        }
    }

    #[test]
    fn every_operation_has_a_form() {
        for name in Step::NAMES {
            assert!(form(name).is_some(), "{name}");
        }
        assert!(form("no such operation").is_none());
    }

    #[test]
    fn values_come_back_as_they_were() {
        let number = Kind::Number {
            range: None,
            whole: false,
        };
        for (kind, text) in [
            (&number, "0.25"),
            (&Kind::List, "50% 75%x100%"),
            (&Kind::Text, "auto"),
        ] {
            assert_eq!(to_text(&to_json(kind, text)), text);
        }
    }
}
