//! Project chores, run as `cargo xtask <chore>`.
//!
//! | chore | what it does |
//! | --- | --- |
//! | `arrows` | checks who depends on whom, and what sources may not mention |
//! | `check` | everything that must hold before a change is taken: format, lints, tests, docs, arrows, spelling, dependencies |
//! | `crash` | kills the program at random moments and checks the files it left |
//! | `deny` | checks licenses, sources and advisories of dependencies, where `cargo-deny` is installed |
//! | `fuzz` | runs the fuzz targets of all readers, or replays their inputs |
//! | `guide-pictures` | takes the pictures of the studio's guide from the running program |
//! | `shapes` | measures memory and time of the program on pictures of extreme shape |
//! | `spelling` | checks the spelling of code and documents, where `typos` is installed |
//! | `window` | drives the studio in a real window, where `Xvfb` and `xdotool` are installed |

mod arrows;
mod check;
mod crash;
mod deny;
mod fuzz;
mod shapes;
mod sources;
mod spelling;
mod studio;
mod tool;

use anyhow::{Context as _, bail};
use cargo_metadata::{Metadata, MetadataCommand};
use clap::{Parser, Subcommand};
use std::path::PathBuf;

#[derive(Parser)]
#[command(name = "cargo xtask", about = "Project chores of Ravec")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// Check the crates' arrows and what their sources may not mention
    Arrows,
    /// Check format, lints, tests, docs, arrows, spelling and dependencies
    Check {
        /// Leave the tests out, because they ran already
        #[arg(long)]
        skip_tests: bool,
    },
    /// Kill the program at random moments and check the files it left
    Crash {
        /// Kills of each operation
        #[arg(long, default_value_t = 50)]
        rounds: u32,
        /// Seed of the moments
        #[arg(long, default_value_t = 1)]
        seed: u64,
        /// The program [default: built for the tests]
        #[arg(long)]
        program: Option<PathBuf>,
    },
    /// Check licenses, sources and advisories of dependencies
    Deny,
    /// Run the fuzz targets of all readers
    Fuzz {
        /// Minutes for all targets together
        #[arg(long, default_value_t = 10.0)]
        minutes: f64,
        /// Only this target; can be given several times
        #[arg(long, value_name = "NAME")]
        target: Vec<String>,
        /// Replay the corpus and all finds, without libFuzzer
        #[arg(long, conflicts_with_all = ["minutes", "target"])]
        replay: bool,
    },
    /// Take the pictures of the studio's guide from the running program
    GuidePictures,
    /// Measure memory and time of the program on pictures of extreme shape, against the square one of as many pixels
    Shapes {
        /// Pixels of each picture
        #[arg(long, default_value_t = 20_000_000)]
        pixels: usize,
        /// Only operations whose command contains this text; can be given several times
        #[arg(long, value_name = "TEXT")]
        only: Vec<String>,
        /// The program [default: built with release settings]
        #[arg(long)]
        program: Option<PathBuf>,
    },
    /// Check the spelling of code and documents
    Spelling,
    /// Drive the studio in a real window
    Window,
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().chore {
        Chore::Arrows => check_arrows(),
        Chore::Check { skip_tests } => check::check(skip_tests),
        Chore::Crash {
            rounds,
            seed,
            program,
        } => crash::crash(rounds, seed, program.as_deref()),
        Chore::Deny => deny::deny(),
        Chore::Fuzz { replay: true, .. } => fuzz::replay(),
        Chore::Fuzz {
            minutes, target, ..
        } => fuzz::fuzz(minutes, &target),
        Chore::GuidePictures => studio::guide_pictures(),
        Chore::Shapes {
            pixels,
            only,
            program,
        } => shapes::shapes(pixels, &only, program),
        Chore::Spelling => spelling::spelling(),
        Chore::Window => studio::window(),
    }
}

/// Prints every arrow and every word that the rules refuse, and fails if there is one.
fn check_arrows() -> anyhow::Result<()> {
    let metadata = workspace()?;
    let mut refused = arrows::refused(&metadata);
    let root = metadata.workspace_root.as_std_path();
    refused.extend(sources::refused(root)?);
    let docs = std::fs::read_to_string(root.join("docs/architecture.md"))
        .context("reading docs/architecture.md")?;
    let table = arrows::markdown();
    if !docs.contains(&table) {
        refused.push(format!(
            "docs/architecture.md: the table of arrows must be\n\n{table}"
        ));
    }
    for line in &refused {
        eprintln!("{line}");
    }
    if refused.is_empty() {
        println!(
            "arrows: {} crates as in the table",
            metadata.workspace_members.len()
        );
        Ok(())
    } else {
        bail!(
            "{} refused; the rules are in docs/architecture.md",
            refused.len()
        )
    }
}

/// The packages of this workspace with the dependencies that they declare.
fn workspace() -> anyhow::Result<Metadata> {
    MetadataCommand::new()
        .manifest_path(concat!(env!("CARGO_MANIFEST_DIR"), "/../Cargo.toml"))
        .no_deps()
        .exec()
        .context("cargo metadata")
}
