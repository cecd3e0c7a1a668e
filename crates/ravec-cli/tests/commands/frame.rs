//! Features that all operations share: flags, streams, exit codes, interruption.

use crate::program::{assert_refused, code, files, folder, ravec, stderr, stdout};
use std::path::Path;
use std::process::{Command, Stdio};

#[test]
fn without_arguments_it_shows_the_help() {
    let output = ravec(Path::new("."), &[]);
    assert_eq!(code(&output), 2);
    assert!(
        stderr(&output).contains("Usage: ravec"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn the_help_lists_operations_and_exit_codes() {
    for arguments in [
        &["--help"][..],
        &["help", "compare"],
        &["compare", "--help"],
    ] {
        let output = ravec(Path::new("."), arguments);
        assert_eq!(code(&output), 0);
        let text = stdout(&output);
        assert!(
            text.contains("Exit codes:") && text.contains("130  interrupted"),
            "{text}"
        );
        assert!(text.contains("compare"), "{text}");
    }
    let output = ravec(Path::new("."), &["--version"]);
    assert_eq!(
        stdout(&output),
        format!("ravec {}\n", env!("CARGO_PKG_VERSION"))
    );
}

#[test]
fn wrong_flags_are_usage_errors() {
    for arguments in [
        &["compare", "a.bmp"][..],
        &["compare", "a.bmp", "b.bmp", "--bogus"],
        &["compare", "a.bmp", "b.bmp", "--threads", "0"],
        &["compare", "a.bmp", "b.bmp", "--max-pixels", "many"],
        &["compare", "a.bmp", "b.bmp", "-q", "-v"],
        &["nonsense"],
    ] {
        let output = ravec(Path::new("."), arguments);
        assert_eq!(code(&output), 2, "{arguments:?}");
        assert!(
            stderr(&output).starts_with("ravec: error: "),
            "{arguments:?}"
        );
        assert_eq!(stdout(&output), "");
    }
}

#[test]
fn completions_and_manual_come_from_the_same_definition() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let output = ravec(folder.path(), &["completions", shell]);
        assert_eq!(code(&output), 0);
        assert!(stdout(&output).contains("compare"), "{shell}");
    }
    let page = ravec(folder.path(), &["man"]);
    assert!(stdout(&page).contains(".TH ravec"), "{}", stdout(&page));
    let output = ravec(folder.path(), &["man", "--out", "pages"]);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    let compare = std::fs::read_to_string(folder.path().join("pages/ravec-compare.1")).unwrap();
    assert!(compare.contains("Exit codes"));
}

/// A reader that stops early is no error worth a word.
#[cfg(unix)]
#[test]
fn a_closed_pipe_is_quiet() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(["completions", "bash"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((code(&output), stderr(&output)), (0, String::new()));
}

/// The first Ctrl-C waits for the work to stop, which here it cannot, as it waits for its input; the second does not wait.
/// Can only fail by a wrong code or by hanging.
#[cfg(unix)]
#[test]
fn ctrl_c_twice_ends_the_program_at_once() {
    use std::io::{BufRead as _, BufReader};
    let folder = folder();
    let mut child = Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(["-v", "compare", "-", "a.bmp"])
        .current_dir(folder.path())
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let said = BufReader::new(child.stderr.take().unwrap());
    let reading = said
        .lines()
        .find(|line| line.as_ref().unwrap().contains("reading"));
    assert!(reading.is_some(), "the program is at work");
    let status = loop {
        let pid = child.id().to_string();
        Command::new("kill").args(["-INT", &pid]).status().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(20));
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
    };
    assert_eq!(status.code(), Some(130));
}

#[test]
fn quiet_says_nothing_and_verbose_speaks_on_standard_error() {
    let folder = folder();
    let output = ravec(folder.path(), &["-q", "compare", "a.bmp", "b.bmp"]);
    assert_eq!(
        (stdout(&output), stderr(&output)),
        (String::new(), String::new())
    );
    let output = ravec(folder.path(), &["compare", "a.bmp", "b.bmp", "-vv"]);
    assert!(stderr(&output).contains("a.bmp"), "{}", stderr(&output));
    assert!(stdout(&output).contains("psnr_db"));
}

#[test]
fn an_output_that_cannot_be_written_leaves_nothing() {
    let folder = folder();
    let before = files(folder.path());
    let output = ravec(
        folder.path(),
        &["-q", "compare", "a.bmp", "b.bmp", "--json", "no/r.json"],
    );
    assert_refused(&output, 4, &["no/r.json"]);
    let output = ravec(
        folder.path(),
        &[
            "scenes", "--out", "a.bmp", "--width", "64", "--height", "48",
        ],
    );
    assert_refused(&output, 4, &["a.bmp"]);
    assert_eq!(files(folder.path()), before);
}
