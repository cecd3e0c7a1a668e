//! `--device`.

use crate::program::{code, done, photos, ravec, report, stderr};

#[test]
fn the_cpu_is_taken_unless_hardware_is_there_and_unknown_adapters_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    done(
        folder.path(),
        "-q twocolor photo.jpg -o cpu.png --device cpu",
    );
    done(
        folder.path(),
        "-q twocolor photo.jpg -o auto.png --device auto",
    );
    let output = ravec(
        folder.path(),
        &[
            "twocolor",
            "photo.jpg",
            "-o",
            "none.png",
            "--device",
            "no-such-adapter",
        ],
    );
    assert_eq!(code(&output), 2);
    let text = stderr(&output);
    assert!(
        text.contains("no-such-adapter") && text.contains("cpu"),
        "{text}"
    );
    assert!(!folder.path().join("none.png").exists());
}

/// Needs a build with the feature `gpu` and the software driver for Vulkan; without them the program says why not.
#[test]
fn a_software_driver_gives_the_blocks_of_the_cpu() {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    let arguments = "twocolor photo.jpg -o gpu.png --whole-pixels --device llvmpipe";
    let output = ravec(folder.path(), &arguments.split(' ').collect::<Vec<_>>());
    if code(&output) == 2 {
        eprintln!("SKIPPED: {}", stderr(&output));
        return;
    }
    let on_gpu = report(folder.path(), arguments);
    let on_cpu = report(
        folder.path(),
        "twocolor photo.jpg -o cpu.png --whole-pixels",
    );
    for figure in ["blocks", "flat_blocks", "values"] {
        assert_eq!(
            on_gpu["figures"][figure], on_cpu["figures"][figure],
            "{figure}"
        );
    }
    let psnr = |report: &serde_json::Value| report["figures"]["psnr_db"].as_f64().unwrap();
    assert!((psnr(&on_gpu) - psnr(&on_cpu)).abs() < 1e-3);
    assert_eq!(on_gpu["warnings"].as_array().map(Vec::len), Some(0));

    let report = report(
        folder.path(),
        "brush photo.jpg -o s.png --mode smooth --everywhere --window 5 --device llvmpipe",
    );
    assert_eq!(report["warnings"].as_array().map(Vec::len), Some(0));
    done(
        folder.path(),
        "-q brush photo.jpg -o c.png --mode smooth --everywhere --window 5",
    );
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(
        read("s.png") == read("c.png"),
        "smoothing gives the same file"
    );
}
