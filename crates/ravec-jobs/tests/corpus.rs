//! Every input of the fuzzers' corpus, and every find, through the bodies of the fuzz targets: read or refused within the
//! limits, without a panic that nobody contains.
//!
//! The bodies and their promises are in `fuzz/targets`. Memory is counted for the whole process, so this is a single test.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

#[path = "../../../fuzz/targets/mod.rs"]
mod targets;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use targets::{Outcome, TARGETS, Target, run};

#[global_allocator]
static ALLOCATOR: targets::memory::Counting = targets::memory::Counting;

/// Duration that the fuzzer calls a hang.
const LONGEST: Duration = Duration::from_secs(10);

/// All files of a target in the corpus or among the finds, by their names.
fn inputs(kind: &str, target: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../fuzz")
        .join(kind);
    let Ok(entries) = fs::read_dir(folder.join(target)) else {
        return Vec::new();
    };
    let mut inputs: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    inputs.sort();
    inputs
}

/// Description of the fault of a run, if there is one.
fn fault(target: &Target, path: &Path) -> Option<String> {
    let input = fs::read(path).unwrap();
    let name = path.file_name().unwrap().to_string_lossy();
    let start = Instant::now();
    let result = run(target, &input);
    let took = start.elapsed();
    match result {
        Err(broken) => Some(broken),
        Ok(_) if took > LONGEST => Some(format!("took {took:?}")),
        Ok(Outcome::Refused) if name.starts_with("seed-") => {
            Some("a seed is refused, so it shows nothing of its kind".to_owned())
        }
        Ok(_) => None,
    }
}

/// A target with the least budget that any has.
const fn broken(name: &'static str, body: fn(&[u8]) -> Outcome) -> Target {
    Target {
        name,
        body,
        max_held: 1 << 20,
    }
}

/// Targets that break each promise on purpose, by which the judge is judged.
const BROKEN: &[Target] = &[
    broken("panics", |_| panic!("ours")),
    broken("catches its own panic", |_| {
        let _ = std::panic::catch_unwind(|| panic!("ours, caught"));
        Outcome::Read
    }),
    broken("panics in the standard library", |input| {
        let _ = std::panic::catch_unwind(|| Vec::<u64>::with_capacity(usize::MAX - input.len()));
        Outcome::Read
    }),
    broken("holds too much", |input| {
        let held = vec![1_u8; (1 << 20) + input.len()];
        Outcome::of::<_, String>(&Ok(std::hint::black_box(held)))
    }),
];

#[test]
fn every_input_is_read_or_refused_within_the_limits() {
    let mut faults = Vec::new();
    for target in BROKEN {
        if run(target, b"a").is_ok() {
            faults.push(format!(
                "the judge does not see a target that {}",
                target.name
            ));
        }
    }
    let mut count = 0;
    for target in TARGETS {
        let corpus = inputs("corpus", target.name);
        if corpus.is_empty() {
            faults.push(format!("{} has no input", target.name));
        }
        for path in corpus.iter().chain(&inputs("finds", target.name)) {
            count += 1;
            let name = path.file_name().unwrap().to_string_lossy();
            faults.extend(
                fault(target, path).map(|fault| format!("{}/{name}: {fault}", target.name)),
            );
        }
    }
    // the hook of the targets keeps messages to itself
    drop(std::panic::take_hook());
    assert!(
        faults.is_empty(),
        "of {count} inputs:\n{}",
        faults.join("\n")
    );
}
