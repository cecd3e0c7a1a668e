//! Folders, their contents, the program and the dice.

use rusqlite::{Connection, OpenFlags};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// Names and contents of all files below a folder, or one entry with an empty name for a file; nothing if it is not there.
pub type Content = BTreeMap<String, Vec<u8>>;

/// Content of a path.
pub fn content(path: &Path) -> Content {
    let mut found = Content::new();
    gather(path, "", &mut found);
    found
}

fn gather(path: &Path, name: &str, found: &mut Content) {
    if let Ok(bytes) = fs::read(path) {
        found.insert(name.to_owned(), bytes);
    }
    for entry in fs::read_dir(path).into_iter().flatten() {
        let entry = entry.unwrap();
        let inner = format!("{name}/{}", entry.file_name().to_string_lossy());
        gather(&entry.path(), &inner, found);
    }
}

/// The names in a folder, sorted.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.is_empty())
}

/// Kills of each operation.
pub fn rounds() -> u32 {
    variable("RAVEC_CRASH_ROUNDS").map_or(3, |text| text.parse().expect("a number of rounds"))
}

/// The program that is killed.
pub fn program() -> PathBuf {
    variable("RAVEC_CRASH_PROGRAM")
        .map_or_else(|| env!("CARGO_BIN_EXE_ravec").into(), PathBuf::from)
}

/// The program with its arguments, not yet started.
pub fn command(folder: &Path, arguments: &[String]) -> Command {
    wrapped(program().into_os_string(), folder, arguments)
}

/// Another program that starts the program.
pub fn wrapped(first: OsString, folder: &Path, arguments: &[String]) -> Command {
    let mut command = Command::new(first);
    command
        .args(arguments)
        .current_dir(folder)
        .env_remove("RAVEC_LOG")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    command
}

pub fn start(folder: &Path, arguments: &[String]) -> Child {
    command(folder, arguments).spawn().unwrap()
}

pub fn run(folder: &Path, arguments: &[String]) -> Output {
    start(folder, arguments).wait_with_output().unwrap()
}

/// Runs the program, which must succeed.
#[track_caller]
pub fn succeed(folder: &Path, arguments: &[String]) {
    let output = run(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
}

/// Asserts that a run failed with a sentence, and not by a signal.
#[track_caller]
pub fn assert_failed(output: &Output, of: &[String]) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code().is_some_and(|code| code != 0),
        "{of:?}: {}: {said}",
        output.status
    );
    assert!(said.starts_with("ravec: error: "), "{of:?}: {said}");
}

/// The words of a command line.
pub fn words(line: &str) -> Vec<String> {
    line.split_whitespace().map(str::to_owned).collect()
}

/// Random numbers (xorshift) from the seed and what they are for.
pub struct Dice(u64);

impl Dice {
    pub fn new(of: &str) -> Self {
        let seed: u64 =
            variable("RAVEC_CRASH_SEED").map_or(1, |text| text.parse().expect("a seed"));
        let mixed = of.bytes().fold(seed, |mixed, byte| {
            (mixed ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        Self(mixed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    /// A number from 0 to 1.
    pub fn share(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// The paths in a catalogue, which must be sound. A copy is looked at, so that the program finds the catalogue as it was left.
#[track_caller]
pub fn catalogued(catalogue: &Path) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    let copy = folder.path().join("copy.ravec");
    for suffix in ["", "-journal", "-wal"] {
        let named = |path: &Path| {
            let mut name = path.as_os_str().to_owned();
            name.push(suffix);
            PathBuf::from(name)
        };
        if named(catalogue).exists() {
            fs::copy(named(catalogue), named(&copy)).unwrap();
        }
    }
    if !copy.exists() {
        return Vec::new();
    }
    let connection = Connection::open_with_flags(&copy, OpenFlags::SQLITE_OPEN_READ_WRITE).unwrap();
    let verdict: String = connection
        .query_row("PRAGMA integrity_check", [], |row| row.get(0))
        .unwrap();
    assert_eq!(verdict, "ok", "{}", catalogue.display());
    // a file that was made and not yet filled has no table
    let tables: i64 = connection
        .query_row("SELECT count(*) FROM sqlite_master", [], |row| row.get(0))
        .unwrap();
    if tables == 0 {
        return Vec::new();
    }
    let mut statement = connection
        .prepare("SELECT path FROM photo ORDER BY path")
        .unwrap();
    let paths = statement.query_map([], |row| row.get(0)).unwrap();
    paths.collect::<Result<_, _>>().unwrap()
}

/// A picture of 24 bits a pixel.
pub fn bmp(width: usize, height: usize, pixel_at: impl Fn(usize, usize) -> [u8; 3]) -> Vec<u8> {
    let row_bytes = (3 * width).next_multiple_of(4);
    let mut file = b"BM".to_vec();
    for number in [54 + row_bytes * height, 0, 54, 40, width, height] {
        file.extend((number as u32).to_le_bytes());
    }
    file.extend([1, 0, 24, 0]);
    file.extend([0; 24]);
    for row in 0..height {
        for col in 0..width {
            file.extend(pixel_at(col, row));
        }
        file.resize(file.len() + row_bytes - 3 * width, 0);
    }
    file
}

/// A photo like no other.
pub fn photo(number: usize, width: usize, height: usize) -> Vec<u8> {
    bmp(width, height, |col, row| {
        [
            (number * 37 + col * 5) as u8,
            (number * 11 + row * 7) as u8,
            (number / 7 + col * row) as u8,
        ]
    })
}

/// A sphere with bumps as a binary STL file, of `2 * (rings - 1) * around` triangles.
pub fn bumpy_sphere(around: usize, rings: usize) -> Vec<u8> {
    use std::f64::consts::PI;
    let at = |i: usize, j: usize| {
        let (a, b) = (
            2.0 * PI * (i % around) as f64 / around as f64,
            PI * j as f64 / rings as f64,
        );
        let r = 1.0 + 0.1 * (5.0 * a).sin() * (7.0 * b).sin() * b.sin();
        // both poles are single points
        let s = if j == 0 || j == rings { 0.0 } else { b.sin() };
        [r * s * a.cos(), r * s * a.sin(), r * b.cos()].map(|v| v as f32)
    };
    let mut triangles = Vec::new();
    for (i, j) in (0..around).flat_map(|i| (0..rings).map(move |j| (i, j))) {
        let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
        if j + 1 < rings {
            triangles.push([a, b, c]);
        }
        if j > 0 {
            triangles.push([a, c, d]);
        }
    }
    let mut file = vec![b' '; 80];
    file.extend((triangles.len() as u32).to_le_bytes());
    for triangle in triangles {
        file.extend([0; 12]);
        file.extend(triangle.as_flattened().iter().flat_map(|v| v.to_le_bytes()));
        file.extend([0; 2]);
    }
    file
}
