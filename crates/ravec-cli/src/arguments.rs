//! The command line: one definition for the parser, the help, the completions and the manual.
//!
//! The flags of an operation come from its struct in `ravec-jobs`; here are the commands around them.

use crate::help;
use clap::error::ErrorKind;
use clap::{ArgMatches, Args, CommandFactory as _, FromArgMatches, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;
use ravec::memory::MemoryBudget;
use ravec::progress::Progress;
use ravec_demo::Demo;
use ravec_jobs::recipe::Run;
use ravec_jobs::{AnyOperation, Context, Device, Limits, Recipe, Step};
use std::ffi::OsString;
use std::path::PathBuf;

/// Raster and vector views of images that work together.
#[derive(Debug, Parser)]
#[command(
    name = "ravec",
    version,
    after_help = help::PROGRAM,
    arg_required_else_help = true,
    propagate_version = true
)]
pub struct Arguments {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
    /// Options common to all commands.
    #[command(flatten)]
    pub global: Global,
}

/// The commands.
#[derive(Debug)]
pub enum Command {
    /// An operation that can be a step of a recipe.
    Step(Step),
    /// Another command.
    Other(Other),
}

/// The commands that are no steps of recipes.
#[derive(Debug, Subcommand)]
pub enum Other {
    Run(Run),
    Demo(Demo),
    /// Open the studio, in which pictures are worked on by hand
    #[command(after_help = help::STUDIO)]
    Studio {
        /// Pictures or projects to open
        files: Vec<PathBuf>,
    },
    /// Print a completion script for a shell
    #[command(after_help = help::COMPLETIONS)]
    Completions {
        /// The shell
        shell: Shell,
    },
    /// Print the manual page, or write the pages of all commands into a folder
    #[command(after_help = help::MAN)]
    Man {
        /// Output folder; created if it is missing
        #[arg(short, long, value_name = "DIR")]
        out: Option<PathBuf>,
    },
}

impl Command {
    /// The operation; `None` for the commands about the program itself.
    pub fn operation(&self) -> Option<&dyn AnyOperation> {
        match self {
            Self::Step(step) => Some(step.operation()),
            Self::Other(Other::Run(run)) => Some(run),
            Self::Other(Other::Demo(demo)) => Some(demo),
            Self::Other(Other::Studio { .. } | Other::Completions { .. } | Other::Man { .. }) => {
                None
            }
        }
    }

    /// The recipe that repeats the command; `None` for commands that are no steps.
    pub fn recipe(&self) -> Option<Recipe> {
        match self {
            Self::Step(step) => Some(Recipe::new(vec![step.clone()])),
            Self::Other(_) => None,
        }
    }
}

impl FromArgMatches for Command {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        match Step::from_matches(matches)? {
            Some(step) => Ok(Self::Step(step)),
            None => Other::from_arg_matches(matches).map(Self::Other),
        }
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Subcommand for Command {
    fn augment_subcommands(command: clap::Command) -> clap::Command {
        Other::augment_subcommands(Step::augment(command, group)).subcommand_required(true)
    }

    fn augment_subcommands_for_update(command: clap::Command) -> clap::Command {
        Self::augment_subcommands(command)
    }

    fn has_subcommand(name: &str) -> bool {
        let mut groups = Step::NAMES.iter().map(|name| name.split(' ').next());
        groups.any(|first| first == Some(name)) || Other::has_subcommand(name)
    }
}

/// The command of a group of operations.
fn group(name: &'static str) -> clap::Command {
    let (about, after_help) = match name {
        "mesh" => (
            "Describe, check, convert, compare, render and simplify triangle meshes",
            help::MESH,
        ),
        "video" => (
            "Describe and convert clips, and write their frames as pictures",
            help::VIDEO,
        ),
        "library" => ("Manage a catalogue of photos for mosaics", help::LIBRARY),
        _ => ("", ""),
    };
    clap::Command::new(name)
        .about(about)
        .after_help(after_help)
        .arg_required_else_help(true)
        .subcommand_required(true)
}

/// The definition of the command line. Each help page ends with the exit codes.
pub fn command() -> clap::Command {
    with_exit_codes(Arguments::command())
}

fn with_exit_codes(command: clap::Command) -> clap::Command {
    let examples = command.get_after_help().map(ToString::to_string);
    let text = [examples.as_deref(), Some(help::EXIT_CODES)];
    let text: Vec<_> = text.into_iter().flatten().collect();
    command
        .after_help(text.join("\n\n"))
        .mut_subcommands(with_exit_codes)
}

/// Reads the command line.
///
/// # Errors
/// A text for the user: help that was asked for, or the mistake.
pub fn parse(arguments: impl IntoIterator<Item = OsString>) -> Result<Arguments, clap::Error> {
    let mut command = command();
    let matches = command.try_get_matches_from_mut(arguments)?;
    let parsed =
        Arguments::from_arg_matches(&matches).map_err(|error| error.format(&mut command))?;
    if parsed.global.recipe.is_some() && parsed.command.recipe().is_none() {
        let text = "--recipe is for operations; this command is none that a recipe can have";
        return Err(command.error(ErrorKind::ArgumentConflict, text));
    }
    Ok(parsed)
}

/// A form of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ReportFormat {
    /// As JSON
    Json,
}

/// Flags that every operation takes.
#[derive(Debug, Args)]
#[command(next_help_heading = "Global options")]
pub struct Global {
    /// Log to standard error; twice: in detail
    #[arg(short, long, global = true, action = clap::ArgAction::Count, conflicts_with = "quiet")]
    pub verbose: u8,
    /// Print errors only
    #[arg(short, long, global = true)]
    pub quiet: bool,
    /// Write a report of the run as JSON; `-` writes it to standard output
    #[arg(long, global = true, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Number of threads, 1 to 1024 [default: all cores]. The result does not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Device for two-color pixels and warps: `cpu`, `gpu` for a hardware adapter, `auto` for one if there is one, or part of the
    /// name of an adapter. Other operations run on the CPU
    #[arg(long, global = true, value_name = "DEVICE", default_value = "cpu")]
    pub device: String,
    /// Maximum number of pixels of a picture, read or written; `k`, `M` and `G` multiply by powers of 1000
    #[arg(long, global = true, value_name = "COUNT", value_parser = count,
        default_value_t = Limits::default().max_pixels)]
    pub max_pixels: u64,
    /// Memory budget in bytes for all inputs together, while they are read and as long as they are needed; `k`, `M` and
    /// `G` multiply by powers of 1000 [default: half of the memory of the machine]
    #[arg(long, global = true, value_name = "COUNT", value_parser = count)]
    pub max_bytes: Option<u64>,
    /// Maximum number of triangles of an input mesh; `k`, `M` and `G` multiply by powers of 1000
    #[arg(long, global = true, value_name = "COUNT", value_parser = count,
        default_value_t = Context::default().max_triangles)]
    pub max_triangles: u64,
    /// Maximum number of vertices of an input mesh; `k`, `M` and `G` multiply by powers of 1000
    #[arg(long, global = true, value_name = "COUNT", value_parser = count,
        default_value_t = Context::default().max_vertices)]
    pub max_vertices: u64,
    /// Maximum number of frames of an input clip; `k`, `M` and `G` multiply by powers of 1000
    #[arg(long, global = true, value_name = "COUNT", value_parser = count,
        default_value_t = Context::default().max_frames)]
    pub max_frames: u64,
    /// Write the operation as a recipe for `ravec run`; `-` writes it to standard output
    #[arg(long, global = true, value_name = "FILE")]
    pub recipe: Option<PathBuf>,
    /// The former name of `--json -`.
    #[arg(
        long,
        global = true,
        hide = true,
        value_enum,
        value_name = "FORMAT",
        conflicts_with = "json"
    )]
    report: Option<ReportFormat>,
}

impl Global {
    /// The file of the report; `-` is standard output.
    pub fn report_file(&self) -> Option<PathBuf> {
        let former = self.report.map(|ReportFormat::Json| PathBuf::from("-"));
        self.json.clone().or(former)
    }

    /// The files that are written after the operation: the report and the recipe.
    pub fn side_outputs(&self) -> Vec<PathBuf> {
        self.report_file()
            .into_iter()
            .chain(self.recipe.clone())
            .collect()
    }

    /// The surroundings of a run, with a new memory budget.
    pub fn context(&self, device: Device, progress: &Progress) -> Context {
        let memory = self
            .max_bytes
            .map_or_else(MemoryBudget::default, MemoryBudget::new);
        let mut context = Context::new(progress);
        context.limits = Limits {
            max_pixels: self.max_pixels,
            memory,
        };
        context.max_triangles = self.max_triangles;
        context.max_vertices = self.max_vertices;
        context.max_frames = self.max_frames;
        context.side_outputs = self.side_outputs();
        context.device = device;
        context
    }
}

/// A positive whole number with an optional `k`, `M` or `G`.
fn count(text: &str) -> Result<u64, String> {
    let (digits, factor) = match text.char_indices().last() {
        Some((at, 'k' | 'K')) => (&text[..at], 1_000),
        Some((at, 'm' | 'M')) => (&text[..at], 1_000_000),
        Some((at, 'g' | 'G')) => (&text[..at], 1_000_000_000),
        _ => (text, 1),
    };
    digits
        .parse::<u64>()
        .ok()
        .and_then(|number| number.checked_mul(factor))
        .filter(|&number| number > 0)
        .ok_or_else(|| "a positive whole number is needed, as in 500000000 or 500M".to_owned())
}

#[cfg(test)]
mod tests;
