//! Dependencies: licenses, sources, repeated versions and known advisories, by `cargo-deny` and `deny.toml`.
//!
//! Advisories need the database of `RustSec`, which is fetched from the network; without it they are left out, with a line
//! that says so.

use anyhow::bail;
use std::process::{Command, Stdio};

/// Checks what can be checked here, and says what cannot.
pub fn deny() -> anyhow::Result<()> {
    if !is_installed() {
        println!("deny: SKIPPED: cargo-deny is not installed (cargo install --locked cargo-deny)");
        return Ok(());
    }
    if !run(&["check", "licenses", "bans", "sources"])? {
        bail!("a dependency is not as deny.toml asks");
    }
    if !fetched() {
        println!("deny: SKIPPED: the database of advisories cannot be fetched");
        return Ok(());
    }
    if !run(&["check", "advisories"])? {
        bail!("a dependency has a known fault or is not maintained");
    }
    Ok(())
}

fn cargo_deny() -> Command {
    let mut command = Command::new("cargo-deny");
    command
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .stdin(Stdio::null());
    command
}

fn is_installed() -> bool {
    let version = cargo_deny().arg("--version").output();
    version.is_ok_and(|output| output.status.success())
}

/// Whether the database of advisories is there, fetched just now.
fn fetched() -> bool {
    let output = cargo_deny().args(["fetch", "db"]).output();
    output.is_ok_and(|output| output.status.success())
}

/// Whether a check passes. Its findings are shown if it does not.
fn run(arguments: &[&str]) -> anyhow::Result<bool> {
    let output = cargo_deny().args(arguments).output()?;
    if !output.status.success() {
        eprint!("{}", String::from_utf8_lossy(&output.stderr));
    }
    Ok(output.status.success())
}
