//! End of the program: exit codes and the sentence of an error.

use crate::flags::Flags;
use crate::interrupt;
use ravec_jobs::{ErrorKind, JobError, escape_except};
use std::backtrace::Backtrace;
use std::io::Write as _;
use std::panic::{self, AssertUnwindSafe};
use std::sync::{Arc, Mutex, PoisonError};

/// All went well.
pub const DONE: u8 = 0;
/// The operation failed for another reason than its files, or its verdict is no.
pub const FAILED: u8 = 1;
/// The command line was wrong: an unknown flag, a value out of range.
pub const USAGE: u8 = 2;
/// An input could not be read, or is invalid.
pub const INPUT: u8 = 3;
/// An output could not be written.
pub const OUTPUT: u8 = 4;
/// An output was written, but the verdict on it is no.
pub const NOT_AS_PROMISED: u8 = 5;
/// Ctrl-C, or a request to end.
pub const INTERRUPTED: u8 = 130;

/// Writes to standard error. Whether anybody listens there is not the program's business.
pub fn print(text: &str) {
    drop(std::io::stderr().lock().write_all(text.as_bytes()));
}

/// Writes one line to standard error: an `error` or a `warning`. Names and texts from files in it are made safe to show.
pub fn say(kind: &str, sentence: &str) {
    print(&format!(
        "ravec: {kind}: {}\n",
        escape_except(sentence, &[])
    ));
}

/// An error and the code to end with.
#[derive(Debug)]
pub struct Failure {
    /// The exit code.
    pub code: u8,
    /// What, where, and what to do. Empty if it was reported before.
    pub sentence: String,
    /// Lines below the sentence, such as an expression with a mark below its mistake.
    pub lines: String,
}

impl Failure {
    /// A failure with its sentence.
    pub fn new(code: u8, sentence: impl std::fmt::Display) -> Self {
        Self {
            code,
            sentence: sentence.to_string(),
            lines: String::new(),
        }
    }

    /// Reports the failure to the user and gives the exit code.
    pub fn report(&self) -> u8 {
        let reported = self.code == INTERRUPTED && !interrupt::report_once();
        if !self.sentence.is_empty() && !reported {
            say("error", &self.sentence);
            print(&escape_except(&self.lines, &['\n']));
        }
        self.code
    }
}

/// The exit code for an error of this kind.
pub fn code(kind: ErrorKind) -> u8 {
    match kind {
        ErrorKind::Failure => FAILED,
        ErrorKind::Request => USAGE,
        ErrorKind::Input => INPUT,
        ErrorKind::Output => OUTPUT,
        ErrorKind::Cancelled => INTERRUPTED,
    }
}

impl Failure {
    /// The failure for an error of an operation with these flags.
    pub fn of(error: &JobError, flags: &Flags) -> Self {
        let mut failure = Self::new(code(error.kind()), flags.name_in(&error.to_string()));
        if let JobError::Expression { .. } = error
            && let Some((sentence, lines)) = failure.sentence.split_once('\n')
        {
            failure.lines = format!("{lines}\n");
            failure.sentence = sentence.to_owned();
        }
        failure
    }
}

/// Runs `work` and turns a panic in it, which is a bug, into a failure like any other.
///
/// A panic is not printed where it happens, because decoders may panic on hostile files and be caught further down, where
/// that is an ordinary refusal. It is shown by `-vv`, with a backtrace if the variable `RUST_BACKTRACE` asks for one.
///
/// # Errors
/// That of `work`, or the panic with the code for failures.
pub fn catch_bugs<T>(work: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure> {
    let last = Arc::new(Mutex::new(String::new()));
    let seen = Arc::clone(&last);
    panic::set_hook(Box::new(move |panic| {
        tracing::debug!("{panic}\n{}", Backtrace::capture());
        *seen.lock().unwrap_or_else(PoisonError::into_inner) = panic.to_string();
    }));
    // whatever the work left half-done is not looked at again
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    drop(panic::take_hook());
    result.unwrap_or_else(|_| {
        let panic = last.lock().unwrap_or_else(PoisonError::into_inner);
        let panic = panic.replace('\n', " ");
        Err(Failure::new(
            FAILED,
            format_args!(
                "this is a bug in ravec, please report it with the command that you gave: {panic}"
            ),
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bug_becomes_one_sentence_with_its_place() {
        let failure = catch_bugs::<()>(|| panic!("the sky\nfell")).unwrap_err();
        assert_eq!(failure.code, FAILED);
        assert!(failure.sentence.contains("exit.rs"), "{}", failure.sentence);
        assert!(
            failure.sentence.ends_with("the sky fell"),
            "{}",
            failure.sentence
        );
        assert_eq!(failure.sentence.lines().count(), 1);
    }
}
