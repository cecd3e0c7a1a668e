//! Memory and time of the program on pictures of extreme shape, against the square picture of as many pixels.
//!
//! The pictures have one bit a pixel, so that their files are small. A run that takes several times what the square picture
//! takes, beyond what is of a fixed size, is a fault: work that grows with the square of a side, or a row of windows for each
//! pixel of a column.

#![expect(
    clippy::disallowed_methods,
    reason = "the files of a measurement are thrown away"
)]

use anyhow::{Context as _, bail};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The operations. `QUAD` is the outline of the picture.
const OPERATIONS: [&str; 14] = [
    "compare in.png in.png",
    "match in.png in.png -o h.txt",
    "planes in.png -o out.png",
    "rectify in.png --quad QUAD -o out.png",
    "retarget in.png --size 50% -o out.png",
    "twocolor in.png -o out.png",
    "twocolor in.png --adaptive -o out.png",
    "brush in.png --everywhere --mode abstract -o out.png",
    "brush in.png --everywhere --mode smooth -o out.png",
    "brush in.png --everywhere --mode clean -o out.png",
    "brush in.png --everywhere --mode clean --noise-sigma 9 -o out.png",
    "brush in.png --everywhere --mode antialias -o out.png",
    "brush in.png --everywhere --mode stamp -o out.png",
    "complete in.png --mask hole.png -o out.png",
];

/// A shape may take this many times the memory of the square picture,
const MAX_MEMORY_RATIO: f64 = 2.0;
/// this many times its time, because windows and blocks reach over the border of a thin picture,
const MAX_TIME_RATIO: f64 = 8.0;
/// and so much more in any case: for threads, code, and what is of a fixed size.
const SLACK_MIB: f64 = 64.0;
const SLACK: Duration = Duration::from_secs(1);

/// Seconds after which a run is ended.
const HANG: Duration = Duration::from_mins(10);

/// What a run took.
struct Taken {
    peak_mib: f64,
    time: Duration,
    /// Its last words, if it refused.
    refusal: Option<String>,
}

/// Runs each operation on each shape and prints a table.
///
/// # Errors
/// If an operation takes more than the square picture allows, or does not end.
pub fn shapes(pixels: usize, only: &[String], program: Option<PathBuf>) -> anyhow::Result<()> {
    if cfg!(not(target_os = "linux")) {
        bail!("the peak of a process is read from /proc, which only Linux has");
    }
    let program = match program {
        Some(program) => program
            .canonicalize()
            .with_context(|| program.display().to_string())?,
        None => built()?,
    };
    let side = pixels.isqrt().max(1);
    let shapes = [
        (side, side),
        (pixels, 1),
        (1, pixels),
        (pixels / 2, 2),
        (2, pixels / 2),
        (pixels / 16, 16),
        (16, pixels / 16),
    ];
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/shapes");
    let folders = shapes.map(|(width, height)| root.join(format!("{width}x{height}")));
    for (folder, &(width, height)) in folders.iter().zip(&shapes) {
        std::fs::create_dir_all(folder)?;
        write_picture(folder, width.max(1), height.max(1))?;
    }
    let mut faults = String::new();
    for operation in OPERATIONS {
        if !only.is_empty() && !only.iter().any(|text| operation.contains(text.as_str())) {
            continue;
        }
        println!("{operation}");
        let mut square: Option<Taken> = None;
        for (folder, &(width, height)) in folders.iter().zip(&shapes) {
            let outline = format!("0,0,{width},0,{width},{height},0,{height}");
            let arguments = operation.replace("QUAD", &outline);
            let taken = run(&program, folder, &arguments)?;
            let Taken {
                peak_mib,
                time,
                refusal,
            } = &taken;
            let said = refusal.as_deref().unwrap_or_default();
            println!(
                "  {width} x {height}: {peak_mib:.0} MiB, {:.2} s {said}",
                time.as_secs_f64()
            );
            if let Some(square) = &square
                && (*peak_mib > MAX_MEMORY_RATIO * square.peak_mib + SLACK_MIB
                    || *time > square.time.mul_f64(MAX_TIME_RATIO) + SLACK)
            {
                writeln!(faults, "{operation}: {width} x {height}")?;
            }
            // a refusal of the square picture bounds nothing
            if square.is_none() {
                square = Some(taken).filter(|taken| taken.refusal.is_none());
            }
        }
    }
    std::fs::remove_dir_all(&root)?;
    if !faults.is_empty() {
        bail!("out of proportion to the square picture:\n{faults}");
    }
    Ok(())
}

/// The program with release settings.
fn built() -> anyhow::Result<PathBuf> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let status = Command::new(cargo)
        .args(["build", "--release", "--package", "ravec-cli"])
        .current_dir(&root)
        .status()?;
    if !status.success() {
        bail!("the program cannot be built");
    }
    Ok(root.join("target/release/ravec").canonicalize()?)
}

/// Writes the picture and a mask of its middle.
fn write_picture(folder: &Path, width: usize, height: usize) -> anyhow::Result<()> {
    let row_bytes = width.div_ceil(8);
    let noise = |at: usize| ((at as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as u8;
    let picture: Vec<u8> = (0..row_bytes * height).map(noise).collect();
    std::fs::write(folder.join("in.png"), png(width, height, &picture))?;
    let bytes = picture.len();
    let middle = |at: usize| 255 * u8::from(at.abs_diff(bytes / 2) < (bytes / 1000).max(1));
    let mask: Vec<u8> = (0..bytes).map(middle).collect();
    Ok(std::fs::write(
        folder.join("hole.png"),
        png(width, height, &mask),
    )?)
}

/// A gray PNG of one bit a pixel, not compressed.
fn png(width: usize, height: usize, rows: &[u8]) -> Vec<u8> {
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |name: &[u8; 4], data: &[u8]| {
        file.extend((data.len() as u32).to_be_bytes());
        let content = [&name[..], data].concat();
        file.extend(&content);
        file.extend(crc(&content).to_be_bytes());
    };
    let mut header = Vec::new();
    header.extend((width as u32).to_be_bytes());
    header.extend((height as u32).to_be_bytes());
    header.extend([1, 0, 0, 0, 0]);
    chunk(b"IHDR", &header);
    let mut filtered = Vec::with_capacity(rows.len() + height);
    for row in rows.chunks(width.div_ceil(8)) {
        filtered.push(0);
        filtered.extend(row);
    }
    let mut data = vec![0x78, 0x01];
    let blocks = filtered.chunks(65_535);
    let last = blocks.len() - 1;
    for (number, block) in blocks.enumerate() {
        let length = block.len() as u16;
        data.push(u8::from(number == last));
        data.extend(length.to_le_bytes());
        data.extend((!length).to_le_bytes());
        data.extend(block);
    }
    data.extend(adler(&filtered).to_be_bytes());
    chunk(b"IDAT", &data);
    chunk(b"IEND", &[]);
    file
}

fn crc(data: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in data {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
        }
    }
    !crc
}

fn adler(data: &[u8]) -> u32 {
    let (a, b) = data.iter().fold((1u32, 0u32), |(a, b), byte| {
        let a = (a + u32::from(*byte)) % 65_521;
        (a, (b + a) % 65_521)
    });
    b << 16 | a
}

/// Runs the program in the folder, and asks for its peak until it ends.
fn run(program: &Path, folder: &Path, arguments: &str) -> anyhow::Result<Taken> {
    let said = folder.join("said.txt");
    let start = Instant::now();
    let mut child = Command::new(program)
        .args(["-q", "--max-pixels", "4000000000", "--max-bytes", "64G"])
        .args(arguments.split(' '))
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(std::fs::File::create(&said)?)
        .spawn()?;
    let status = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak_kib = 0;
    let ended = loop {
        if let Ok(text) = std::fs::read_to_string(&status) {
            let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
            let found = line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok());
            peak_kib = peak_kib.max(found.unwrap_or(0u64));
        }
        if let Some(ended) = child.try_wait()? {
            break ended;
        }
        if start.elapsed() > HANG {
            child.kill()?;
            child.wait()?;
            bail!("{arguments}: does not end within {HANG:?}");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let words = std::fs::read_to_string(said)?;
    let refusal = words
        .lines()
        .find(|line| line.starts_with("ravec: error: "));
    if ended.code().is_none_or(|code| code > 4) {
        bail!("{arguments}: {ended}: {words}");
    }
    Ok(Taken {
        peak_mib: peak_kib as f64 / 1024.0,
        time: start.elapsed(),
        refusal: refusal.map(str::to_owned),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_a_png_are_those_of_the_standards() {
        assert_eq!(crc(b"IEND"), 0xae42_6082);
        assert_eq!(adler(b"Wikipedia"), 0x11e6_0398);
    }
}
