//! `studio`: starts the program with the window.

use crate::exit::{self, Failure};
use std::ffi::OsString;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Name of the program.
const PROGRAM: &str = "ravec-studio";

/// Starts the studio with these files and waits for its end.
pub fn start(files: &[PathBuf]) -> Result<(), Failure> {
    start_program(&program(), files)
}

/// The program beside this one, or else the one on the path.
fn program() -> OsString {
    let name = format!("{PROGRAM}{}", std::env::consts::EXE_SUFFIX);
    let own = std::env::current_exe().unwrap_or_default();
    let beside = own.with_file_name(&name);
    if beside.is_file() {
        beside.into_os_string()
    } else {
        name.into()
    }
}

fn start_program(program: &OsString, files: &[PathBuf]) -> Result<(), Failure> {
    let failed = |text: String| Failure::new(exit::FAILED, text);
    match Command::new(program).args(files).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(failed(format!("the studio ended with {status}"))),
        Err(error) if error.kind() == ErrorKind::NotFound => Err(failed(format!(
            "{PROGRAM} is not installed: run `cargo install --path crates/{PROGRAM}` in the sources of Ravec"
        ))),
        Err(error) => {
            let name = Path::new(program).display();
            Err(failed(format!("{name} cannot be started: {error}")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_studio_is_a_sentence_that_says_how_to_install_it() {
        let failure = start_program(&"no-such-program-of-ravec".into(), &[]).unwrap_err();
        assert!(format!("{failure:?}").contains("cargo install"));
    }
}
