//! Every input of the fuzzers' corpus, and every find, through the bodies of the fuzz targets: read or refused within the
//! limits, without a panic that nobody contains.
//!
//! The bodies and their promises are in `fuzz/targets`. Memory is counted for the whole process, so this is a single test.

#[path = "../../../fuzz/targets/mod.rs"]
mod targets;

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use targets::{BROKEN, Outcome, TARGETS, run};

#[global_allocator]
static ALLOCATOR: targets::memory::Counting = targets::memory::Counting;

/// What the fuzzer calls a hang.
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

/// What is wrong with a run of an input, if anything.
fn fault(target: &targets::Target, path: &Path) -> Option<String> {
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
