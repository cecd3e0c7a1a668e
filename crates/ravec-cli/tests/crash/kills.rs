//! Killed at random moments.

use crate::operations::Operation;
use crate::world::{Dice, content, rounds, start, succeed, words};
use std::time::{Duration, Instant};

/// Kills an operation again and again, and looks at what is left and at the next run.
fn kill(operation: &Operation) {
    let folder = operation.folder.path();
    let mut dice = Dice::new(operation.name);
    let inputs = operation.inputs();
    let began = Instant::now();
    succeed(folder, operation.line(0));
    let duration = began.elapsed();
    operation.assert_done(0);
    let mut killed = 0;
    for round in 0..rounds() {
        let which = (round % 2) as usize;
        // from nothing in every third round, and always for a catalogue, which would have all photos otherwise
        if round % 3 == 0 || operation.is_catalogue() {
            operation.remove_output();
        }
        let before = content(&operation.output());
        let moment = duration.mul_f64(1.1 * dice.share());
        let mut child = start(folder, operation.line(which));
        std::thread::sleep(moment);
        child.kill().unwrap();
        killed += u32::from(!child.wait().unwrap().success());
        let state = format!("{}, round {round}, killed after {moment:?}", operation.name);
        println!("{state}");
        assert!(operation.inputs() == inputs, "{state}: an input changed");
        operation.assert_whole(&before, which);
        if operation.is_catalogue() && operation.output().exists() {
            looks_sound(operation);
        }
        succeed(folder, operation.line(which));
        operation.assert_done(which);
        assert!(
            operation.inputs() == inputs,
            "{state}: an input changed in the next run"
        );
    }
    println!(
        "{}: {killed} of {} kills came before the end",
        operation.name,
        rounds()
    );
}

/// The program opens a catalogue that a killed run left, unless that run had not begun to make one of it.
fn looks_sound(operation: &Operation) {
    if crate::world::catalogued(&operation.output()).is_empty() {
        return;
    }
    succeed(
        operation.folder.path(),
        &words("library stats --catalogue out/photos.ravec"),
    );
}

#[test]
fn adding_photos_survives_kills() {
    kill(&Operation::add());
}

#[test]
fn a_mosaic_survives_kills() {
    kill(&Operation::mosaic());
}

#[test]
fn a_page_that_zooms_survives_kills() {
    kill(&Operation::deep_zoom());
}

#[test]
fn an_offset_in_little_memory_survives_kills() {
    kill(&Operation::offset());
}

#[test]
fn a_conversion_survives_kills() {
    kill(&Operation::convert());
}

#[test]
fn a_clip_survives_kills() {
    kill(&Operation::clip());
}

#[test]
fn a_clip_that_is_resumed_after_kills_has_the_bytes_of_one_without() {
    let operation = Operation::clip();
    let folder = operation.folder.path();
    let mut dice = Dice::new("resume");
    let began = Instant::now();
    succeed(folder, operation.line(0));
    let duration = began.elapsed();
    let resume: Vec<String> = [operation.line(0), &words("--resume")].concat();
    for _ in 0..rounds() {
        operation.remove_output();
        // two kills, each at any moment, then to the end
        for _ in 0..2 {
            let mut child = start(folder, &resume);
            std::thread::sleep(duration.mul_f64(1.1 * dice.share()));
            child.kill().unwrap();
            child.wait().unwrap();
        }
        succeed(folder, &resume);
        operation.assert_done(0);
    }
}

#[test]
fn names_of_killed_runs_with_any_process_id_block_nothing() {
    let operations = [Operation::deep_zoom(), Operation::convert()];
    for operation in &operations {
        // in a container process ids begin at 1 again and again
        for id in (1..64).chain(std::process::id()..std::process::id() + 500) {
            for name in ["zoom", "mesh.3mf"] {
                for kind in ["part", "old"] {
                    let path = operation.out().join(format!(".{name}.{id}.{kind}"));
                    std::fs::create_dir(&path).unwrap();
                    std::fs::write(path.join("a"), "a").unwrap();
                }
            }
        }
        succeed(operation.folder.path(), operation.line(0));
    }
}

/// A test of the tests: a moment is within the time that an operation takes.
#[test]
fn moments_are_drawn_from_all_of_the_time() {
    let mut dice = Dice::new("moments");
    let shares: Vec<f64> = (0..1000).map(|_| dice.share()).collect();
    assert!(shares.iter().all(|share| (0.0..1.0).contains(share)));
    assert!(shares.iter().any(|&share| share < 0.05) && shares.iter().any(|&share| share > 0.95));
    assert!(Duration::from_secs(1).mul_f64(shares[0]) < Duration::from_secs(1));
}
