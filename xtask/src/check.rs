//! The whole check: what must hold before a change is taken.
//!
//! All steps run even if one fails, so that one run shows everything. A step's output is shown only if it fails, except
//! that of the tests, whose counts are worth seeing.

use anyhow::bail;
use std::process::{Command, Stdio};
use std::time::Instant;

/// A command of the check.
struct Step {
    name: &'static str,
    arguments: &'static [&'static str],
    streams: bool,
}

const fn quiet(name: &'static str, arguments: &'static [&'static str]) -> Step {
    Step {
        name,
        arguments,
        streams: false,
    }
}

const FORMAT: Step = quiet("format", &["fmt", "--all", "--check"]);

/// The fuzzer has a workspace of its own. Its lints would build it; the bodies of its targets are linted with `ravec-jobs`.
const FUZZER_FORMAT: Step = quiet(
    "format of the fuzzer",
    &["fmt", "--manifest-path", "fuzz/Cargo.toml", "--check"],
);

const LINTS: Step = quiet(
    "lints",
    &[
        "clippy",
        "--workspace",
        "--all-targets",
        "--",
        "-D",
        "warnings",
    ],
);

/// In the workspace the command line turns the feature `cli` on for everybody, so its absence needs a look of its own.
const FEATURES: Step = quiet(
    "features: jobs without the command line",
    &[
        "clippy",
        "-p",
        "ravec-jobs",
        "--no-default-features",
        "--",
        "-D",
        "warnings",
    ],
);

/// Unit tests, integration tests and doc tests.
const TESTS: Step = Step {
    name: "tests",
    arguments: &["test", "--workspace"],
    streams: true,
};

const DOCS: Step = quiet("docs", &["doc", "--workspace", "--no-deps"]);

/// A check that runs in this program.
type Chore = fn() -> anyhow::Result<()>;

/// Runs every step and fails if one did.
pub fn check(skip_tests: bool) -> anyhow::Result<()> {
    let mut failed = Vec::new();
    let tests = (!skip_tests).then_some(TESTS);
    for step in [FORMAT, FUZZER_FORMAT, LINTS, FEATURES]
        .into_iter()
        .chain(tests)
        .chain([DOCS])
    {
        let start = Instant::now();
        let passed = run(&step)?;
        report(step.name, passed, start);
        if !passed {
            failed.push(step.name);
        }
    }
    let chores: [(&'static str, Chore); 3] = [
        ("arrows", crate::check_arrows),
        ("spelling", crate::spelling::spelling),
        ("dependencies", crate::deny::deny),
    ];
    for (name, chore) in chores {
        let start = Instant::now();
        let outcome = chore();
        report(name, outcome.is_ok(), start);
        if let Err(error) = outcome {
            eprintln!("{error:#}");
            failed.push(name);
        }
    }
    if failed.is_empty() {
        println!("check: all is well");
        Ok(())
    } else {
        bail!("failed: {}", failed.join(", "))
    }
}

fn report(name: &str, passed: bool, start: Instant) {
    let verdict = if passed { "ok" } else { "FAILED" };
    println!(
        "check: {name}: {verdict} ({:.1} s)",
        start.elapsed().as_secs_f64()
    );
}

/// True if the step's command succeeded.
fn run(step: &Step) -> anyhow::Result<bool> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command
        .args(step.arguments)
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
        .env("RUSTDOCFLAGS", "-D warnings")
        .stdin(Stdio::null());
    if step.streams {
        return Ok(command.status()?.success());
    }
    let output = command.output()?;
    if !output.status.success() {
        eprint!("{}", String::from_utf8_lossy(&output.stdout));
        eprint!("{}", String::from_utf8_lossy(&output.stderr));
    }
    Ok(output.status.success())
}
