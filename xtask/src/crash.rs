//! Crash tests: the tests `crash` of `ravec-cli` with more rounds, and with another program on request.

use anyhow::{Context as _, bail};
use std::path::Path;
use std::process::Command;

/// Runs the tests one after the other, so that a killed run has the machine for itself.
pub fn crash(rounds: u32, seed: u64, program: Option<&Path>) -> anyhow::Result<()> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command
        .args(["test", "--package", "ravec-cli", "--test", "crash"])
        .args(["--", "--nocapture", "--test-threads", "1"])
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .env("RAVEC_CRASH_ROUNDS", rounds.to_string())
        .env("RAVEC_CRASH_SEED", seed.to_string());
    if let Some(program) = program {
        // the tests run in another folder
        let program = program
            .canonicalize()
            .with_context(|| program.display().to_string())?;
        command.env("RAVEC_CRASH_PROGRAM", program);
    }
    if !command.status()?.success() {
        bail!("a crash test failed");
    }
    Ok(())
}
