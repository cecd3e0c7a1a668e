//! Runs the program and looks at how it ended.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

pub fn ravec(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(arguments)
        .current_dir(folder)
        .env_remove("RAVEC_LOG")
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

pub fn code(output: &Output) -> i32 {
    output.status.code().unwrap()
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Asserts an exit code and one sentence on standard error that names all the words; nothing on standard output.
#[track_caller]
pub fn assert_refused(output: &Output, expected: i32, words: &[&str]) {
    let text = stderr(output);
    assert_eq!(code(output), expected, "{text}");
    assert_eq!(stdout(output), "");
    assert!(text.starts_with("ravec: error: "), "{text}");
    assert_eq!(text.trim_end().lines().count(), 1, "{text}");
    for word in words {
        assert!(text.contains(word), "no `{word}` in: {text}");
    }
}

/// A folder with two pictures, `a.bmp` and `b.bmp`, that differ in one pixel.
pub fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let ramp = |col: usize, row: usize| [(7 * col) as u8, (9 * row) as u8, 100];
    std::fs::write(folder.path().join("a.bmp"), bmp(32, 24, ramp)).unwrap();
    let spot = |col, row| {
        if (col, row) == (5, 6) {
            [255; 3]
        } else {
            ramp(col, row)
        }
    };
    std::fs::write(folder.path().join("b.bmp"), bmp(32, 24, spot)).unwrap();
    folder
}

/// A bitmap file of 24 bits a pixel, blue first, from the bottom row.
pub fn bmp(width: usize, height: usize, pixel_at: impl Fn(usize, usize) -> [u8; 3]) -> Vec<u8> {
    let row_bytes = (3 * width).next_multiple_of(4);
    let mut file = b"BM".to_vec();
    let long = |file: &mut Vec<u8>, number: usize| file.extend((number as u32).to_le_bytes());
    long(&mut file, 54 + row_bytes * height);
    long(&mut file, 0);
    long(&mut file, 54);
    long(&mut file, 40);
    long(&mut file, width);
    long(&mut file, height);
    file.extend([1, 0, 24, 0]);
    for number in [0, row_bytes * height, 2835, 2835, 0, 0] {
        long(&mut file, number);
    }
    for row in (0..height).rev() {
        for col in 0..width {
            let [r, g, b] = pixel_at(col, row);
            file.extend([b, g, r]);
        }
        file.extend(vec![0; row_bytes - 3 * width]);
    }
    file
}

pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}
