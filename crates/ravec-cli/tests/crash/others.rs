//! Several processes at one catalogue, and at one target.

use crate::operations::{Operation, PHOTOS};
use crate::world::{Dice, catalogued, rounds, start, succeed, words};
use std::fs;
use std::time::{Duration, Instant};

/// Folders that photos are added from at once.
const ADDERS: usize = 3;

#[test]
fn several_processes_share_a_catalogue_while_one_is_killed() {
    let operation = Operation::add();
    let folder = operation.folder.path();
    // a part of the photos for each process
    for adder in 0..ADDERS {
        fs::create_dir(folder.join(format!("in/photos/{adder}"))).unwrap();
    }
    for number in 0..PHOTOS {
        let name = format!("{number:03}.bmp");
        let part = format!("in/photos/{}/{name}", number % ADDERS);
        fs::rename(folder.join("in/photos").join(&name), folder.join(part)).unwrap();
    }
    let inputs = operation.inputs();
    let line = |adder: usize| {
        words(&format!(
            "library add in/photos/{adder} --catalogue out/photos.ravec"
        ))
    };
    let began = Instant::now();
    succeed(folder, &line(0));
    let duration = began.elapsed();
    let mut dice = Dice::new("several processes");
    for round in 0..rounds() {
        operation.remove_output();
        // two that live, one that is killed, and one that reads
        succeed(
            folder,
            &words("library add in/photos/0/000.bmp --catalogue out/photos.ravec"),
        );
        let mut doomed = start(folder, &line(0));
        let living: Vec<_> = (1..ADDERS)
            .map(|adder| start(folder, &line(adder)))
            .collect();
        let reader = start(folder, &words("library stats --catalogue out/photos.ravec"));
        std::thread::sleep(
            Duration::min(duration, Duration::from_secs(5)).mul_f64(1.5 * dice.share()),
        );
        doomed.kill().unwrap();
        doomed.wait().unwrap();
        for child in living.into_iter().chain([reader]) {
            let output = child.wait_with_output().unwrap();
            assert!(
                output.status.success(),
                "round {round}: {}",
                String::from_utf8_lossy(&output.stderr)
            );
        }
        let photos = catalogued(&operation.output());
        for adder in 1..ADDERS {
            let part = format!("/in/photos/{adder}/");
            let found = photos.iter().filter(|path| path.contains(&part)).count();
            assert_eq!(
                found,
                PHOTOS / ADDERS,
                "round {round}: photos of process {adder}"
            );
        }
        succeed(folder, operation.line(0));
        operation.assert_done(0);
        assert!(
            operation.inputs() == inputs,
            "round {round}: an input changed"
        );
    }
}

#[test]
fn writers_of_one_target_do_not_disturb_one_another() {
    for operation in [Operation::mosaic(), Operation::convert()] {
        let folder = operation.folder.path();
        for round in 0..rounds() {
            let which = (round % 2) as usize;
            let writers: Vec<_> = (0..3)
                .map(|_| start(folder, operation.line(which)))
                .collect();
            for writer in writers {
                let output = writer.wait_with_output().unwrap();
                let said = String::from_utf8_lossy(&output.stderr);
                assert!(
                    output.status.success(),
                    "{}, round {round}: {said}",
                    operation.name
                );
            }
            operation.assert_done(which);
        }
    }
}
