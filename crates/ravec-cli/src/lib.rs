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
mod help;
mod interrupt;
mod log;
mod progress_bar;
mod summary;

use arguments::{Arguments, Command, Global, LibraryCommand, MeshCommand, ReportFormat};
use clap::{CommandFactory as _, Parser as _};
use exit::Failure;
use ravec::progress::Progress;
use ravec_jobs::{
    JobError, Report, Source, brush, catalogue, check_files, check_folder, compare, complete,
    escape_except, match_photos, mesh, mosaic, plane, retarget, scenes, twocolor,
};
use std::ffi::OsString;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

/// The definition of the command line, from which the help, the completions and the manual are made.
pub fn command() -> clap::Command {
    Arguments::command()
}

/// Runs the program with its arguments, the first of which is its name.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    let arguments = match Arguments::try_parse_from(arguments) {
        Ok(arguments) => arguments,
        Err(answer) => return usage(&answer),
    };
    match exit::catch_bugs(|| execute(arguments)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

/// Help and version go to standard output; what is wrong with the flags is an error like any other.
fn usage(answer: &clap::Error) -> ExitCode {
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
        return ExitCode::from(exit::USAGE);
    }
    match summary::print(&text(std::io::stdout().is_terminal())) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

fn execute(
    Arguments {
        command,
        mut global,
    }: Arguments,
) -> Result<(), Failure> {
    listen(&global);
    if let Command::Boolean {
        report: Some(ReportFormat::Json),
        ..
    } = command
    {
        global.json = Some("-".into());
    }
    // the operations look at their own files; only here is the report known, too
    let outputs: Vec<_> = command
        .outputs()
        .into_iter()
        .chain(global.json.as_deref())
        .collect();
    let side_files = command.catalogue().map(journals).unwrap_or_default();
    let side_files = side_files.iter().map(PathBuf::as_path);
    let inputs: Vec<_> = command.inputs().into_iter().chain(side_files).collect();
    check_files(&inputs, &outputs)?;
    let limits = global.limits();
    let memory = limits.memory.clone();
    let source = |path| Source {
        path,
        limits: limits.clone(),
    };
    match command {
        Command::Compare { a, b, params } => job(&global, |progress| {
            compare::run(&source(a), &source(b), &params, progress)
        }),
        Command::Match {
            first,
            second,
            output,
            params,
        } => job(&global, |progress| {
            match_photos::run(&source(first), &source(second), &output, &params, progress)
        }),
        Command::Rectify {
            input,
            output,
            params,
        } => job(&global, |progress| {
            plane::rectify::run(&source(input), &output, &params, progress)
        }),
        Command::Snap {
            input,
            output,
            params,
        } => answer(&global, |progress| {
            plane::snap::run(&source(input), output.as_deref(), &params, progress)
        }),
        Command::Planes {
            input,
            output,
            params,
        } => answer(&global, |progress| {
            plane::planes::run(&source(input), output.as_deref(), &params, progress)
        }),
        Command::Complete {
            input,
            mask,
            features,
            sources,
            replay,
            steps,
            output,
            params,
        } => job(&global, |progress| {
            let files = complete::Files {
                mask: mask.map(source),
                features: features.map(source),
                photos: sources.into_iter().map(source).collect(),
                replay,
                steps,
            };
            complete::run(&source(input), &files, &output, &params, progress)
        }),
        Command::Retarget {
            input,
            output,
            protect,
            give_way,
            show_grid,
            params,
        } => {
            let extras = retarget::Extras {
                protect: protect.map(source),
                give_way: give_way.map(source),
                show_grid,
            };
            job(&global, |progress| {
                retarget::run(&source(input), &output, &extras, &params, progress)
            })
        }
        Command::Twocolor {
            input,
            output,
            svg,
            params,
        } => {
            let targets = twocolor::Targets {
                picture: output,
                svg,
            };
            job(&global, |progress| {
                twocolor::run(&source(input), &targets, &params, progress)
            })
        }
        Command::Brush {
            input,
            output,
            everywhere: _,
            stroke,
            mask,
            params,
        } => {
            let targets = brush::Targets {
                picture: output,
                mask,
                strokes: stroke,
            };
            job(&global, |progress| {
                brush::run(&source(input), &targets, &params, progress)
            })
        }
        Command::Mesh { command, limits } => {
            let limits = limits.limits(memory);
            job(&global, |progress| on_mesh(command, &limits, progress))
        }
        Command::Offset {
            input,
            output,
            params,
            limits,
        } => {
            let limits = limits.limits(memory);
            let input = mesh::MeshSource {
                path: input,
                limits,
            };
            job(&global, |progress| {
                mesh::offset::run(&input, &output, &params, progress)
            })
        }
        Command::Boolean {
            expression,
            files,
            output,
            origins,
            picture,
            report: _,
            params,
            limits,
        } => {
            let limits = limits.limits(memory);
            let targets = mesh::boolean::Targets {
                mesh: output,
                origins,
                picture,
            };
            job(&global, |progress| {
                mesh::boolean::run(&expression, &files, &limits, &targets, &params, progress)
            })
        }
        Command::Library { command } => on_library(command, &global),
        Command::Mosaic {
            input,
            catalogue,
            output,
            deep_zoom,
            params,
        } => {
            let outputs = mosaic::Outputs {
                picture: output.as_deref(),
                deep_zoom: deep_zoom.as_deref(),
            };
            job(&global, |progress| {
                let report = global.json.as_deref();
                mosaic::run(
                    &source(input),
                    &catalogue,
                    &outputs,
                    report,
                    &params,
                    progress,
                )
            })
        }
        Command::Demo { image, out, params } => {
            let photo = image.map(source);
            job(&global, |progress| {
                ravec_demo::run(photo.as_ref(), &out, &params, progress)
            })
        }
        Command::Scenes { out, params } => {
            job(&global, |progress| scenes::run(&out, &params, progress))
        }
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut command_for_pages(), "ravec", &mut script);
            summary::print(&String::from_utf8_lossy(&script))
        }
        Command::Man { out } => manual(out.as_deref()),
    }
}

/// The files that a database keeps beside itself while it is changed, or after it was killed.
fn journals(database: &Path) -> Vec<PathBuf> {
    let beside = |ending: &str| {
        let mut name = database.as_os_str().to_owned();
        name.push(ending);
        name.into()
    };
    ["-journal", "-wal", "-shm"].map(beside).to_vec()
}

/// Runs an operation on a catalogue of photos.
fn on_library(command: LibraryCommand, global: &Global) -> Result<(), Failure> {
    let limits = global.limits();
    let report = global.json.as_deref();
    match command {
        LibraryCommand::Add {
            paths,
            catalogue,
            params,
        } => job(global, |progress| {
            catalogue::add(
                &paths,
                &catalogue.catalogue,
                report,
                &limits,
                &params,
                progress,
            )
        }),
        LibraryCommand::Remove {
            paths,
            catalogue,
            params,
        } => job(global, |progress| {
            catalogue::remove(&paths, &catalogue.catalogue, report, &params, progress)
        }),
        LibraryCommand::List { catalogue, params } => answer(global, |progress| {
            catalogue::list(&catalogue.catalogue, report, &params, progress)
        }),
        LibraryCommand::Clean { catalogue, params } => answer(global, |progress| {
            catalogue::clean(&catalogue.catalogue, report, &params, progress)
        }),
        LibraryCommand::Stats { catalogue, params } => job(global, |progress| {
            catalogue::stats(&catalogue.catalogue, report, &params, progress)
        }),
    }
}

/// Runs an operation on meshes.
fn on_mesh(
    command: MeshCommand,
    limits: &mesh::MeshLimits,
    progress: &Progress,
) -> Result<Report, JobError> {
    let source = |path| mesh::MeshSource {
        path,
        limits: limits.clone(),
    };
    match command {
        MeshCommand::Info { input, params } => mesh::info::run(&source(input), &params, progress),
        MeshCommand::Check { input, params } => mesh::check::run(&source(input), &params, progress),
        MeshCommand::Convert {
            input,
            output,
            params,
        } => mesh::convert::run(&source(input), &output, &params, progress),
        MeshCommand::Compare { a, b, params } => {
            mesh::compare::run(&source(a), &source(b), &params, progress)
        }
        MeshCommand::Render {
            input,
            output,
            compare,
            params,
        } => {
            let other = compare.map(source);
            let input = source(input);
            mesh::render::run(&input, other.as_ref(), &output, &params, progress)
        }
        MeshCommand::Simplify {
            input,
            output,
            params,
        } => mesh::simplify::run(&source(input), &output, &params, progress),
    }
}

/// Runs an operation and shows its report.
fn job(
    global: &Global,
    operation: impl FnOnce(&Progress) -> Result<Report, JobError> + Send,
) -> Result<(), Failure> {
    let report = perform(global, operation)?;
    show(global, &report, |report| summarize(global, report))
}

fn summarize(global: &Global, report: &Report) -> Result<(), Failure> {
    if global.quiet {
        return Ok(());
    }
    summary::print(&summary::summary(report))
}

/// Runs an operation whose result is no file, and prints the result, unless it is in a file of JSON or standard output has
/// something else to carry.
fn answer(
    global: &Global,
    operation: impl FnOnce(&Progress) -> Result<Report, JobError> + Send,
) -> Result<(), Failure> {
    let report = perform(global, operation)?;
    show(global, &report, |report| {
        if report.outputs.iter().any(|file| file.format == "JSON") {
            return summarize(global, report);
        }
        let result = report.result_json();
        result.map_or(Ok(()), |result| summary::print(&result))
    })
}

/// Runs an operation with progress, cancellation and the chosen threads.
fn perform(
    global: &Global,
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
    Ok(result?)
}

/// Shows warnings, lets `tell` print unless standard output is taken, writes the report and gives the verdict.
fn show(
    global: &Global,
    report: &Report,
    tell: impl FnOnce(&Report) -> Result<(), Failure>,
) -> Result<(), Failure> {
    if !global.quiet && global.verbose == 0 {
        for warning in &report.warnings {
            exit::say("warning", warning);
        }
    }
    let to_stdout = |path: &Path| path.as_os_str() == "-";
    let taken = global.json.as_deref().is_some_and(to_stdout)
        || report.outputs.iter().any(|file| file.path == "-");
    if !taken {
        tell(report)?;
    }
    if let Some(path) = &global.json {
        summary::write_json(report, path)?;
    }
    if report.passed == Some(false) {
        // what was found is in the summary and in the report
        let code = if report.outputs.is_empty() {
            exit::FAILED
        } else {
            exit::NOT_AS_PROMISED
        };
        return Err(Failure::new(code, ""));
    }
    Ok(())
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
    check_folder(folder)?;
    std::fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(command_for_pages(), folder))
        .map_err(|error| {
            Failure::new(
                exit::OUTPUT,
                format_args!("cannot write the manual into {}: {error}", folder.display()),
            )
        })
}
