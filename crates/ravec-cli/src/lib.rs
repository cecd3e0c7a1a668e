//! The command line program `ravec`: a thin layer over the operations of `ravec-jobs`.
//!
//! This crate parses flags, shows progress, catches Ctrl-C, prints the report and chooses the exit code. It holds no
//! algorithm.
//!
//! # Exit codes
//!
//! | code | meaning |
//! | --- | --- |
//! | 0 | done |
//! | 1 | the operation failed, or its verdict is no: a mesh has defects, a distance is too large |
//! | 2 | the command line is wrong |
//! | 3 | an input cannot be read, is no valid picture or mesh, or exceeds a limit |
//! | 4 | an output cannot be written |
//! | 5 | an output was written, but is not what was promised: an offset is not proved or not solid, a combined mesh not solid |
//! | 130 | interrupted by Ctrl-C; nothing half-written is left |
//!
//! # Streams
//!
//! Standard output carries what was asked for: a picture or mesh if the output is `-`, the report with `--json -`, else a summary.
//! Standard error carries errors (one sentence, `ravec: error: ...`), warnings, the progress bar if it is a terminal, and
//! what `-v` says.

mod arguments;
mod exit;
mod flags;
mod help;
mod interrupt;
mod log;
mod progress_bar;
mod studio;
mod summary;

use arguments::{Arguments, Command, Global, Other};
use exit::Failure;
use flags::Flags;
use ravec::progress::Progress;
use ravec_jobs::{
    AnyOperation, Device, JobError, Recipe, Report, check_files, check_folder, escape_except,
    write_text,
};
use std::ffi::OsString;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use tracing_subscriber::EnvFilter;

pub use arguments::command;

/// Runs the program with its arguments, the first of which is its name, and gives its exit code.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments = match arguments::parse(arguments) {
        Ok(arguments) => arguments,
        Err(answer) => return usage(&answer),
    };
    match exit::catch_bugs(|| execute(arguments)) {
        Ok(()) => exit::DONE,
        Err(failure) => failure.report(),
    }
}

/// Returns the recipe that repeats a command, without running it, as JSON.
///
/// # Errors
/// The exit code, if the arguments ask for help or are wrong, which is then printed, or if no recipe can have the command.
pub fn recipe_of(arguments: impl IntoIterator<Item = OsString>) -> Result<String, u8> {
    let arguments = arguments::parse(arguments).map_err(|answer| usage(&answer))?;
    let recipe = arguments.command.recipe();
    let text = recipe.and_then(|recipe| recipe.to_json().ok());
    text.ok_or_else(|| {
        exit::print("ravec: error: this command is none that a recipe can have\n");
        exit::USAGE
    })
}

/// Help and version go to standard output; what is wrong with the flags is an error like any other.
fn usage(answer: &clap::Error) -> u8 {
    let text = answer.render();
    // an argument that is quoted may have an escape sequence of its own; then nothing is colored
    let plain = text.to_string();
    let safe = escape_except(&plain, &['\n']);
    let text = |terminal: bool| {
        if terminal && safe == plain {
            text.ansi().to_string()
        } else {
            safe.to_string()
        }
    };
    if answer.use_stderr() {
        exit::print(&format!("ravec: {}", text(std::io::stderr().is_terminal())));
        return exit::USAGE;
    }
    match summary::print(&text(std::io::stdout().is_terminal())) {
        Ok(()) => exit::DONE,
        Err(failure) => failure.report(),
    }
}

fn execute(Arguments { command, global }: Arguments) -> Result<(), Failure> {
    listen(&global);
    if let Some(operation) = command.operation() {
        return run_operation(operation, command.recipe(), &global);
    }
    match command {
        Command::Other(Other::Completions { shell }) => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut command_for_pages(), "ravec", &mut script);
            summary::print(&String::from_utf8_lossy(&script))
        }
        Command::Other(Other::Man { out }) => manual(out.as_deref()),
        Command::Other(Other::Studio { files }) => studio::start(&files),
        Command::Other(Other::Run(_) | Other::Demo(_)) | Command::Step(_) => Ok(()),
    }
}

/// Checks the files of an operation, runs it, and shows and writes its report.
fn run_operation(
    operation: &dyn AnyOperation,
    recipe: Option<Recipe>,
    global: &Global,
) -> Result<(), Failure> {
    let flags = Flags::of(operation.name());
    let failed = |error: JobError| Failure::of(&error, &flags);
    // operations check their own files; only here are the report and the recipe known as well
    let side_files = operation.side_files();
    let side_files = side_files.iter().map(PathBuf::as_path);
    let inputs: Vec<_> = operation.inputs().into_iter().chain(side_files).collect();
    let side_outputs = global.side_outputs();
    let mut outputs = operation.outputs();
    outputs.extend(side_outputs.iter().map(PathBuf::as_path));
    check_files(&inputs, &outputs).map_err(failed)?;
    let device = Device::open(&global.device).map_err(failed)?;
    if let Some(adapter) = device.adapter() {
        tracing::info!(adapter, "device");
    }
    let report = perform(global, &flags, |progress| {
        operation.run(&global.context(device, progress))
    })?;
    if let (Some(path), Some(recipe)) = (&global.recipe, recipe) {
        let text = recipe.to_json().map_err(|error| {
            let text = format!("cannot write the recipe {}: {error}", path.display());
            Failure::new(exit::OUTPUT, text)
        })?;
        report.check_output(path).map_err(failed)?;
        write_text(path, &text).map_err(failed)?;
    }
    show(operation, global, &flags, &report)
}

/// Runs an operation with progress, cancellation and the chosen threads.
fn perform(
    global: &Global,
    flags: &Flags,
    operation: impl FnOnce(&Progress) -> Result<Report, JobError> + Send,
) -> Result<Report, Failure> {
    let silent = global.quiet || global.verbose > 0 || !std::io::stderr().is_terminal();
    let (progress, bar) = if silent {
        (Progress::none(), None)
    } else {
        let (progress, bar) = progress_bar::drawn();
        (progress, Some(bar))
    };
    let failed = |error: anyhow::Error| Failure::new(exit::FAILED, format_args!("{error:#}"));
    interrupt::cancel_on_ctrl_c(&progress).map_err(failed)?;
    // none: rayon takes the number of cores
    let threads = global.threads.map_or(0, usize::from);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|error| {
            Failure::new(
                exit::FAILED,
                format_args!(
                    "cannot start {threads} threads: {error}; ask for fewer with --threads"
                ),
            )
        })?;
    let result = pool.install(|| operation(&progress));
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    result.map_err(|error| Failure::of(&error, flags))
}

/// Shows warnings, prints the summary or the result unless standard output is an output, writes the report and gives the verdict.
fn show(
    operation: &dyn AnyOperation,
    global: &Global,
    flags: &Flags,
    report: &Report,
) -> Result<(), Failure> {
    if !global.quiet && global.verbose == 0 {
        for warning in &report.warnings {
            exit::say("warning", &flags.name_in(warning));
        }
    }
    let report_file = global.report_file();
    let to_stdout = |path: &PathBuf| path.as_os_str() == "-";
    let taken = global.side_outputs().iter().any(to_stdout)
        || report.outputs.iter().any(|file| file.path == "-");
    if !taken {
        print_report(operation, global, report)?;
    }
    if let Some(path) = &report_file {
        summary::write_json(report, path, flags)?;
    }
    if report.passed == Some(false) {
        // findings are in the summary and in the report; of a recipe, the last step has the verdict
        let judged = report.steps.last().unwrap_or(report);
        let code = if judged.outputs.is_empty() {
            exit::FAILED
        } else {
            exit::NOT_AS_PROMISED
        };
        return Err(Failure::new(code, ""));
    }
    Ok(())
}

/// Prints the result of an operation whose result is data, unless it is in a file; else a summary, unless `--quiet`.
fn print_report(
    operation: &dyn AnyOperation,
    global: &Global,
    report: &Report,
) -> Result<(), Failure> {
    let in_file = report.outputs.iter().any(|file| file.format == "JSON");
    let result = report
        .result_json()
        .filter(|_| operation.prints_result() && !in_file);
    match result {
        Some(result) => summary::print(&result),
        None if global.quiet => Ok(()),
        None => summary::print(&summary::summary(report)),
    }
}

/// Lets `-v` (or the variable `RAVEC_LOG`, in the syntax of `tracing-subscriber`) decide what is said on standard error.
fn listen(global: &Global) {
    let level = match global.verbose {
        0 => "off",
        1 => "info",
        2 => "debug",
        _ => "trace",
    };
    let filter = EnvFilter::try_from_env("RAVEC_LOG").unwrap_or_else(|_| EnvFilter::new(level));
    let colored = std::io::stderr().is_terminal();
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(move || log::SafeStderr { colored })
        .with_ansi(colored)
        .with_target(false)
        .without_time();
    // Only a second subscriber in the same process can fail here, and then the first one stays.
    drop(subscriber.try_init());
}

/// The definition without the parts that only make sense on a terminal.
fn command_for_pages() -> clap::Command {
    command().term_width(100)
}

fn manual(out: Option<&Path>) -> Result<(), Failure> {
    let Some(folder) = out else {
        let mut page = Vec::new();
        clap_mangen::Man::new(command_for_pages())
            .render(&mut page)
            .expect("a vector takes every write");
        return summary::print(&String::from_utf8_lossy(&page));
    };
    check_folder(folder).map_err(|error| Failure::of(&error, &Flags::of("man")))?;
    std::fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(command_for_pages(), folder))
        .map_err(|error| {
            Failure::new(
                exit::OUTPUT,
                format_args!("cannot write the manual into {}: {error}", folder.display()),
            )
        })
}
