//! Time in proportion to the file, for files that were made to take more.

mod bombs;

use std::fmt::Write as _;
use std::time::{Duration, Instant};

use ravec_mesh_io::{ReadOptions, read_mesh};
use ravec_progress::Progress;

fn time(file: &[u8]) -> Duration {
    let runs = (0..3).map(|_| {
        let start = Instant::now();
        drop(read_mesh(file, &ReadOptions::default(), &Progress::none()));
        start.elapsed()
    });
    runs.min().unwrap()
}

/// Sixteen times the file takes sixteen times the time, and not the square of that.
#[track_caller]
fn assert_linear(make: impl Fn(usize) -> Vec<u8>, size: usize) {
    let (small, large) = (time(&make(size)), time(&make(16 * size)));
    // half way between, as factors, and something for what is not proportional
    let bound = 64 * small + Duration::from_millis(30);
    assert!(large < bound, "{small:?} became {large:?}");
}

#[test]
fn parts_of_an_archive_are_found_without_going_through_all_of_them() {
    assert_linear(bombs::many_parts, 1500);
}

#[test]
fn components_that_bring_nothing_are_not_walked_again_with_each_use() {
    assert_linear(
        |count| {
            let empty = "<component objectid=\"2\"/>".repeat(count);
            let items = "<item objectid=\"3\"/>".repeat(count);
            let both = format!("<component objectid=\"1\"/>{empty}");
            let objects = format!(
                "<object id=\"2\"/><object id=\"3\"><components>{both}</components></object>"
            );
            bombs::built(&objects, &items)
        },
        1000,
    );
}

#[test]
fn primitives_that_bring_nothing_are_not_walked_again_with_each_node() {
    assert_linear(
        |count| {
            let one = "{\"attributes\":{\"POSITION\":0}}";
            let empty = ",{\"attributes\":{\"POSITION\":0},\"indices\":1}";
            let view = "\"bufferView\":0,\"componentType\":";
            let text = bombs::CORNERS.replace(
                "\"type\":\"VEC3\"}]",
                &format!("\"type\":\"VEC3\"}},{{{view}5125,\"count\":0,\"type\":\"SCALAR\"}}]"),
            );
            let meshes = format!("[{{\"primitives\":[{one}{}]}}]", empty.repeat(count));
            let nodes = bombs::list("{\"mesh\":0}", count);
            bombs::json(&format!("{text},\"meshes\":{meshes},\"nodes\":{nodes}"))
        },
        1000,
    );
}

#[test]
fn places_that_were_chosen_to_collide_take_no_longer_than_others() {
    const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
    let stir = |hash: u64, word: u64| (hash.rotate_left(23) ^ word).wrapping_mul(SPREAD);
    let chosen = |x: f64, y: f64| {
        let before = stir(stir(0, x.to_bits()), y.to_bits()).rotate_left(23);
        f64::from_bits(before ^ 0x4d)
    };
    let file = |z: &dyn Fn(f64, f64) -> f64| {
        let mut text = "solid\n".to_owned();
        let mut count = 0;
        for i in 1.. {
            let (x, y) = (f64::from(i), 0.5);
            let z = z(x, y);
            if z.is_finite() {
                count += 1;
                writeln!(
                    text,
                    "outer loop vertex {x} {y} {z:e} vertex 0 0 0 vertex 1 0 0 endloop"
                )
                .unwrap();
            }
            if count == 100_000 {
                return text.into_bytes();
            }
        }
        unreachable!("numbers do not end")
    };
    let (chosen, other) = (file(&chosen), file(&|x, y| (x * y).sin() * 1e-300));
    // the other way around it would be minutes
    assert!(time(&chosen) < 10 * time(&other) + Duration::from_millis(100));
}
