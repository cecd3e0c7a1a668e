//! Fuzzing: builds the fuzzer in its own workspace and runs it for each target.
//!
//! libFuzzer works with stable Rust if the compiler is set to count covered edges, for which it needs no nightly flag; a
//! C++ compiler must be there to build it. `fuzz/corpus/TARGET` has the inputs that are kept in the repository,
//! `fuzz/work/TARGET` what libFuzzer finds worth keeping on this machine, and `fuzz/finds/TARGET` inputs that break a
//! promise. A find is fixed, then moved into the corpus as `find-…`; the test `corpus` of `ravec-jobs` replays both.

use anyhow::{Context as _, bail};
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Time limit of an input, in seconds.
const TIMEOUT_SECS: u64 = 10;

/// The memory of the process, in MiB: the limits of a run (below 64 MiB), the corpus and what is counted for each edge.
const RSS_LIMIT_MIB: u64 = 2048;

/// The longest input, in bytes, unless a seed is longer.
const MAX_LEN: u64 = 8192;

/// After so many finds a target rests: most are the same fault.
const MAX_FINDS: usize = 8;

/// Counts covered edges, and what is compared with what.
const FLAGS: &str = "--cfg fuzzing -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=16";

/// Outcome of one target.
#[derive(Default)]
struct Tally {
    runs: u64,
    covered: u64,
    finds: Vec<String>,
}

/// Runs the targets in turn, each for an equal share of `minutes`; all of them if `targets` is empty.
pub fn fuzz(minutes: f64, targets: &[String]) -> anyhow::Result<()> {
    let root = root();
    let known = names(&root.join("fuzz/corpus"))?;
    if let Some(unknown) = targets.iter().find(|target| !known.contains(target)) {
        bail!(
            "there is no target {unknown}; known are {}",
            known.join(", ")
        );
    }
    let targets = if targets.is_empty() {
        &known[..]
    } else {
        targets
    };
    let program = build(&root)?;
    let share = Duration::try_from_secs_f64(60.0 * minutes / targets.len() as f64)
        .context("--minutes must be a positive number")?;
    let mut failed = false;
    for target in targets {
        let tally = run(&root, &program, target, share)?;
        println!(
            "fuzz: {target}: {} runs, {} edges, {} finds",
            tally.runs,
            tally.covered,
            tally.finds.len()
        );
        for find in &tally.finds {
            println!("fuzz: {target}: {find}");
            failed = true;
        }
    }
    if failed {
        bail!(
            "promises were broken; the inputs are in fuzz/finds, and `cargo xtask fuzz --replay` says how"
        );
    }
    Ok(())
}

/// Replays the corpus and all finds without libFuzzer.
pub fn replay() -> anyhow::Result<()> {
    let passed = Command::new(cargo())
        .args(["test", "--package", "ravec-jobs", "--test", "corpus"])
        .args(["--", "--nocapture"])
        .current_dir(root())
        .status()?
        .success();
    if !passed {
        bail!("an input breaks a promise");
    }
    Ok(())
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn cargo() -> OsString {
    std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())
}

/// The names of all folders in a folder, sorted.
fn names(folder: &Path) -> anyhow::Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            names.push(entry.file_name().to_string_lossy().into_owned());
        }
    }
    names.sort();
    Ok(names)
}

/// Builds the fuzzer with the versions that the product has, and returns the program.
fn build(root: &Path) -> anyhow::Result<PathBuf> {
    let compiler = std::env::var_os("CXX").unwrap_or_else(|| "c++".into());
    let found = Command::new(&compiler)
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    if !found.is_ok_and(|status| status.success()) {
        bail!("libFuzzer needs a C++ compiler (c++ or the variable CXX): install g++ or clang++");
    }
    let (ours, theirs) = (root.join("Cargo.lock"), root.join("fuzz/Cargo.lock"));
    let time = |path: &Path| {
        path.metadata()
            .and_then(|metadata| metadata.modified())
            .ok()
    };
    if time(&theirs) < time(&ours) {
        fs::copy(&ours, &theirs)?;
    }
    let host = host()?;
    // the target is named, so that build scripts and macros are not counted
    let built = Command::new(cargo())
        .args([
            "build",
            "--release",
            "--bin",
            "fuzz",
            "--target",
            &host,
            "--target-dir",
        ])
        .arg(root.join("target/fuzz"))
        .current_dir(root.join("fuzz"))
        .env("RUSTFLAGS", FLAGS)
        .status()?;
    if !built.success() {
        bail!("the fuzzer cannot be built");
    }
    Ok(root.join("target/fuzz").join(host).join("release/fuzz"))
}

/// The machine that is compiled for.
fn host() -> anyhow::Result<String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(rustc).arg("-vV").output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let host = text.lines().find_map(|line| line.strip_prefix("host: "));
    host.map(str::to_owned)
        .context("rustc does not name its host")
}

/// Runs one target for a time, again and again after finds.
fn run(root: &Path, program: &Path, target: &str, share: Duration) -> anyhow::Result<Tally> {
    let folder = |kind: &str| root.join("fuzz").join(kind).join(target);
    let (corpus, work, finds) = (folder("corpus"), folder("work"), folder("finds"));
    fs::create_dir_all(&work)?;
    fs::create_dir_all(&finds)?;
    // temporary files of targets stay in memory where that is possible
    let memory = Path::new("/dev/shm");
    let base = if memory.is_dir() {
        memory.to_path_buf()
    } else {
        std::env::temp_dir()
    };
    let scratch = base.join(format!("ravec-fuzz-{}-{target}", std::process::id()));
    fs::create_dir_all(&scratch)?;
    let longest = longest(&corpus)?;
    let start = Instant::now();
    let mut tally = Tally::default();
    while tally.finds.len() < MAX_FINDS {
        let left = share.saturating_sub(start.elapsed()).as_secs();
        if left == 0 {
            break;
        }
        let mut command = Command::new(program);
        command
            .arg(&work)
            .arg(&corpus)
            .arg(format!("-max_total_time={left}"))
            .arg(format!("-timeout={TIMEOUT_SECS}"))
            .arg(format!("-rss_limit_mb={RSS_LIMIT_MIB}"))
            .arg(format!("-max_len={}", MAX_LEN.max(longest)))
            .arg(format!("-artifact_prefix={}/", finds.display()))
            .args(["-print_final_stats=1", "-detect_leaks=0", "-reload=0"])
            .env("RAVEC_FUZZ_TARGET", target)
            .env("RAYON_NUM_THREADS", "1")
            .env("TMPDIR", &scratch)
            .stdin(Stdio::null());
        let words = root
            .join("fuzz/dictionaries")
            .join(format!("{target}.dict"));
        if words.is_file() {
            command.arg(format!("-dict={}", words.display()));
        }
        let output = command
            .output()
            .with_context(|| program.display().to_string())?;
        let log = String::from_utf8_lossy(&output.stderr);
        keep_log(&work.with_extension("log"), &log)?;
        tally.runs += number_after(&log, "stat::number_of_executed_units:").unwrap_or_default();
        tally.covered = number_after(&log, " cov: ").unwrap_or(tally.covered);
        let contained: BTreeSet<&str> = log
            .lines()
            .filter(|line| line.starts_with("CONTAINED"))
            .collect();
        for line in contained {
            println!("fuzz: {line}");
        }
        if !output.status.success() {
            tally.finds.push(described(&log));
        }
    }
    fs::remove_dir_all(&scratch)?;
    // a folder without finds says nothing
    let _ = fs::remove_dir(&finds);
    Ok(tally)
}

/// Writes what the fuzzer said where a person can read it.
#[expect(
    clippy::disallowed_methods,
    reason = "a log for a person, which may be half there"
)]
fn keep_log(path: &Path, log: &str) -> anyhow::Result<()> {
    Ok(fs::write(path, log)?)
}

/// Bytes of the longest file in a folder.
fn longest(folder: &Path) -> anyhow::Result<u64> {
    let mut longest = 0;
    for entry in fs::read_dir(folder)? {
        longest = longest.max(entry?.metadata()?.len());
    }
    Ok(longest)
}

/// The last number behind a text.
fn number_after(log: &str, text: &str) -> Option<u64> {
    let (_, rest) = log.rsplit_once(text)?;
    rest.split_whitespace().next()?.parse().ok()
}

/// The promise that was broken and the file that shows it.
fn described(log: &str) -> String {
    let line = |start: &str| log.lines().find(|line| line.contains(start));
    let promise = line("BROKEN")
        .or_else(|| line("ERROR: libFuzzer:"))
        .unwrap_or("it ended without a word");
    let file = line("Test unit written to").unwrap_or_default();
    format!("{promise} {file}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_and_finds_are_taken_from_the_log() {
        let log = "#12\tNEW    cov: 40 ft: 9\nBROKEN png: a panic\nartifact_prefix='f/'; Test unit written to f/crash-1\n\
            #99\tpulse  cov: 57 ft: 9\nstat::number_of_executed_units: 123\n";
        assert_eq!(
            number_after(log, "stat::number_of_executed_units:"),
            Some(123)
        );
        assert_eq!(number_after(log, " cov: "), Some(57));
        assert_eq!(number_after(log, "none"), None);
        let find = described(log);
        assert!(
            find.contains("a panic") && find.contains("f/crash-1"),
            "{find}"
        );
    }

    #[test]
    fn every_dictionary_is_that_of_a_target() {
        let root = root();
        let targets = names(&root.join("fuzz/corpus")).unwrap();
        for entry in fs::read_dir(root.join("fuzz/dictionaries")).unwrap() {
            let path = entry.unwrap().path();
            let target = path.file_stem().unwrap().to_string_lossy().into_owned();
            assert!(targets.contains(&target), "{target}");
        }
    }
}
