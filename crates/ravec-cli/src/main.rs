//! The program `ravec`.

use std::process::ExitCode;

fn main() -> ExitCode {
    ravec_cli::run(std::env::args_os())
}
