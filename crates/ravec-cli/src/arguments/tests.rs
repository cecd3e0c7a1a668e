//! The definition, the files and the defaults of all commands.

use super::*;
use std::path::Path;

fn parsed(line: &str) -> Arguments {
    parse(line.split(' ').map(OsString::from)).unwrap_or_else(|error| panic!("{line}: {error}"))
}

/// A line for each operation, with its inputs and outputs.
const LINES: &[(&str, &str, &str)] = &[
    ("ravec compare a b", "a b", ""),
    ("ravec match a b -o c", "a b", "c"),
    ("ravec rectify a -o b --quad 0,0,9,0,9,9,0,9", "a", "b"),
    ("ravec snap a -o b --quad 0,0,9,0,9,9,0,9", "a", "b"),
    ("ravec planes a -o b", "a", "b"),
    (
        "ravec track a --quad 0,0,9,0,9,9,0,9 -o b.json --export c.nk --show d --mask e --exclude f --strokes g --photo h",
        "a e f g h",
        "b.json c.nk d",
    ),
    (
        "ravec track a --track b --export after-effects=c --correct 3:0,0,9,0,9,9,0,9",
        "a b",
        "c",
    ),
    ("ravec stabilize a -o b --track c", "a c", "b"),
    (
        "ravec plate a -o b --track c --exclude d --strokes e --seen f --certainty g",
        "a c d e",
        "b f g",
    ),
    (
        "ravec matte a -o b --plate c --trimap f --track d --strokes e",
        "a c f d e",
        "b",
    ),
    ("ravec complete a --mask b -o c", "a b", "c"),
    (
        "ravec retarget a -o b -s 50% --protect c --give-way d --show-grid e",
        "a c d",
        "b e",
    ),
    (
        "ravec complete a --mask b -o c --source d --source e --features f --replay g --steps h",
        "a b f d e g",
        "c h",
    ),
    ("ravec twocolor a -o b --svg c", "a", "b c"),
    ("ravec brush a -o b --stroke c --mask d", "a c", "b d"),
    ("ravec brush a -o b --everywhere", "a", "b"),
    ("ravec mesh info a", "a", ""),
    ("ravec mesh check a", "a", ""),
    ("ravec mesh convert a -o b", "a", "b"),
    ("ravec mesh compare a b", "a b", ""),
    ("ravec mesh render a -o b --compare c", "a c", "b"),
    ("ravec mesh simplify a -o b --error 1", "a", "b"),
    ("ravec offset a -o b --distance 1", "a", "b"),
    (
        "ravec boolean x|b x=a b -o c --origins d --picture e",
        "a b",
        "c d e",
    ),
    ("ravec compare a b --plot c", "a b", "c"),
    ("ravec video info a", "a", ""),
    ("ravec video convert a b --size 50%", "a", "b"),
    ("ravec video frames a -o b --at 3", "a", "b"),
    (
        "ravec video remove a -o b --plate c --matte d --track e",
        "a e c d",
        "b",
    ),
    (
        "ravec video replace a -o b --plate c --matte d --image e --track f",
        "a f c d e",
        "b",
    ),
    (
        "ravec video enhance a -o b --photo c --plate d --matte e --track f",
        "a f c d e",
        "b",
    ),
    (
        "ravec video overlay a -o b --image c --track d --matte e",
        "a d e c",
        "b",
    ),
    (
        "ravec video paste a -o b --into c --plate d --matte e --track f --into-track g --into-matte h",
        "a f g h d e c",
        "b",
    ),
    ("ravec mosaic a --catalogue b -o c", "a b", "c"),
    ("ravec library add a b --catalogue c", "c a b", ""),
    ("ravec library remove a --catalogue b", "b", ""),
    ("ravec library list --catalogue a", "a", ""),
    ("ravec library clean --catalogue a", "a", ""),
    ("ravec library stats --catalogue a", "a", ""),
    ("ravec scenes -o a", "", ""),
    ("ravec demo --image a", "a", ""),
    ("ravec run a --dry-run", "a", ""),
];

#[test]
fn the_definition_is_consistent() {
    command().debug_assert();
}

#[test]
fn the_files_of_an_operation_are_known_before_it_runs() {
    let text = |paths: Vec<&Path>| {
        let names: Vec<_> = paths.iter().map(|path| path.to_str().unwrap()).collect();
        names.join(" ")
    };
    for (line, inputs, outputs) in LINES {
        let command = parsed(line).command;
        let operation = command.operation().unwrap();
        assert_eq!(text(operation.inputs()), *inputs, "{line}");
        assert_eq!(text(operation.outputs()), *outputs, "{line}");
    }
    for name in Step::NAMES {
        let known = |line: &&(&str, &str, &str)| line.0.starts_with(&format!("ravec {name} "));
        assert!(LINES.iter().any(|line| known(&line)), "no line for {name}");
    }
}

#[test]
fn a_recipe_repeats_the_command() {
    for (line, ..) in LINES {
        let command = parsed(line).command;
        let Some(recipe) = command.recipe() else {
            continue;
        };
        let text = recipe.to_json().unwrap();
        assert_eq!(Recipe::from_json(&text).as_ref(), Ok(&recipe), "{text}");
    }
}

/// Parameters that a command line leaves out and those that JSON leaves out are the same.
#[test]
fn flags_left_out_give_the_default_parameters() {
    for (line, ..) in LINES {
        let Command::Step(step) = parsed(line).command else {
            continue;
        };
        let mut fields = serde_json::to_value(&step).unwrap();
        let given: &[&str] = match step {
            Step::Retarget(_) => &["sizes"],
            Step::Rectify(_) | Step::Snap(_) => &["quad"],
            Step::Track(_) => &["quads", "corrections"],
            Step::MeshSimplify(_) => &["error"],
            Step::Offset(_) => &["distance"],
            Step::VideoConvert(_) => &["size"],
            Step::VideoFrames(_) => &["at"],
            _ => &[],
        };
        let params = fields["params"].as_object_mut().unwrap();
        params.retain(|name, _| given.contains(&name.as_str()));
        let sparse: Step = serde_json::from_value(fields).unwrap();
        assert_eq!(sparse, step, "{line}");
    }
    let global = parsed("ravec compare a b").global;
    let context = global.context(Device::default(), &Progress::none());
    let default = Context::default();
    assert_eq!(context.limits, default.limits);
    assert_eq!(context.mesh_limits(), default.mesh_limits());
    assert!(context.side_outputs.is_empty());
}

#[test]
fn the_former_flag_for_a_report_is_an_alias() {
    let global = parsed("ravec boolean union a -o b --report json").global;
    assert_eq!(global.report_file(), Some("-".into()));
}

#[test]
fn only_steps_have_recipes() {
    let line = "ravec demo --recipe a.json";
    let error = parse(line.split(' ').map(OsString::from)).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::ArgumentConflict);
}

#[test]
fn each_help_page_ends_with_the_exit_codes() {
    fn walk(command: &clap::Command) {
        let end = command.get_after_help().unwrap().to_string();
        assert!(end.ends_with(help::EXIT_CODES), "{}", command.get_name());
        assert!(end.starts_with("Examples:"), "{}", command.get_name());
        assert!(command.get_about().is_some() || command.get_name() == "help");
        command.get_subcommands().for_each(walk);
    }
    walk(&command());
}

#[test]
fn counts_take_a_power_of_a_thousand() {
    assert_eq!(count("12"), Ok(12));
    assert_eq!(count("5k"), Ok(5_000));
    assert_eq!(count("2M"), Ok(2_000_000));
    assert_eq!(count("3G"), Ok(3_000_000_000));
    for wrong in ["", "0", "k", "-1", "1.5M", "99999999999999999G", "1é"] {
        assert!(count(wrong).is_err(), "{wrong}");
    }
}
