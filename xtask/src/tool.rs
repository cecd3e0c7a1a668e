//! Programs of others that a check runs if they are installed.

use std::process::{Command, Stdio};

/// A program that `cargo install` installs.
pub struct Tool {
    /// The name of the program.
    pub program: &'static str,
    /// The package that it is in.
    pub package: &'static str,
}

impl Tool {
    /// Returns `true` if the program is installed. If it is not, prints that `check` is skipped, and the command that installs
    /// the program.
    pub fn is_installed(&self, check: &str) -> bool {
        if self.succeeds(&["--version"]) {
            return true;
        }
        let Self { program, package } = self;
        println!("{check}: SKIPPED: {program} is not installed (cargo install --locked {package})");
        false
    }

    /// Returns `true` if the program succeeds with these arguments. Its output is not shown.
    pub fn succeeds(&self, arguments: &[&str]) -> bool {
        let output = self.command().args(arguments).output();
        output.is_ok_and(|output| output.status.success())
    }

    /// Returns `true` if the program succeeds with these arguments. Its output is shown if it does not.
    pub fn passes(&self, arguments: &[&str]) -> anyhow::Result<bool> {
        let output = self.command().args(arguments).output()?;
        if !output.status.success() {
            eprint!("{}", String::from_utf8_lossy(&output.stdout));
            eprint!("{}", String::from_utf8_lossy(&output.stderr));
        }
        Ok(output.status.success())
    }

    fn command(&self) -> Command {
        let mut command = Command::new(self.program);
        command
            .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
            .stdin(Stdio::null());
        command
    }
}
