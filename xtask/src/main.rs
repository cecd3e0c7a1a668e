//! Project chores, run as `cargo xtask <chore>`.
//!
//! | chore | what it does |
//! | --- | --- |
//! | `arrows` | checks who depends on whom, and what sources may not mention |
//! | `check` | everything that must hold before a change is taken: format, lints, tests, docs, arrows |

mod arrows;
mod check;
mod sources;

use anyhow::{Context as _, bail};
use cargo_metadata::{Metadata, MetadataCommand};
use clap::{Parser, Subcommand};

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
    /// Check format, lints, tests, docs and arrows
    Check {
        /// Leave the tests out, because they ran already
        #[arg(long)]
        skip_tests: bool,
    },
}

fn main() -> anyhow::Result<()> {
    match Arguments::parse().chore {
        Chore::Arrows => check_arrows(),
        Chore::Check { skip_tests } => check::check(skip_tests),
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
