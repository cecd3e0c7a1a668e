//! The fuzzer: runs the target that the variable `RAVEC_FUZZ_TARGET` names under libFuzzer.
//!
//! `cargo xtask fuzz` builds it with the flags that it needs and runs it for each target.

#![no_main]

#[path = "../targets/mod.rs"]
mod targets;

mod mutate;
mod seeds;

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use std::collections::HashSet;
use std::sync::{Mutex, OnceLock, PoisonError};
use targets::{TARGETS, Target};

#[global_allocator]
static ALLOCATOR: targets::memory::Counting = targets::memory::Counting;

fn target() -> &'static Target {
    static TARGET: OnceLock<&Target> = OnceLock::new();
    TARGET.get_or_init(|| {
        let name = std::env::var("RAVEC_FUZZ_TARGET").unwrap_or_default();
        TARGETS
            .iter()
            .find(|target| target.name == name)
            .unwrap_or_else(|| panic!("RAVEC_FUZZ_TARGET must name a target, not {name:?}"))
    })
}

/// Says once for each place in foreign code that a panic of it was contained.
fn report_contained() {
    static SEEN: OnceLock<Mutex<HashSet<String>>> = OnceLock::new();
    let Some(panic) = targets::take_foreign() else {
        return;
    };
    let place = panic.lines().next().unwrap_or_default().to_owned();
    let seen = SEEN.get_or_init(Mutex::default);
    if seen
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .insert(place)
    {
        eprintln!("CONTAINED {}: {panic}", target().name);
    }
}

fuzz_target!(
    init: {
        // after libFuzzer's hook, which ends the process at every panic
        if let Some(folder) = std::env::var_os("RAVEC_FUZZ_SEEDS") {
            seeds::write(folder.as_ref()).expect("the folder can be written to");
            std::process::exit(0);
        }
        targets::watch();
    },
    |input: &[u8]| {
        if let Err(broken) = targets::run(target(), input) {
            eprintln!("BROKEN {}: {broken}", target().name);
            std::process::abort();
        }
        report_contained();
    }
);

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    mutate::mutate(target().name, data, size, max_size, seed, fuzzer_mutate)
});
