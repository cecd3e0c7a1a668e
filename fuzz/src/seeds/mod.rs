//! Makes the seeds: small files of every kind that the readers know, in `fuzz/corpus/TARGET/seed-NAME`.
//!
//! Each must be read by its target, which the replay checks. The fuzzer makes them if the variable `RAVEC_FUZZ_SEEDS` names
//! the folder `fuzz/corpus`; files that begin with `seed-` are replaced, all others stay.

mod clips;
mod meshes;
mod pictures;
mod raw;
mod texts;

use std::fs;
use std::path::Path;

/// The target, the name and the content of a seed.
type Seed = (&'static str, String, Vec<u8>);

/// Writes all seeds below a folder.
pub fn write(folder: &Path) -> std::io::Result<()> {
    let mut seeds: Vec<Seed> = pictures::seeds();
    seeds.extend(raw::seeds());
    seeds.extend(meshes::seeds());
    seeds.extend(texts::seeds());
    seeds.extend(clips::seeds());
    let mut bytes = 0;
    for (target, name, content) in &seeds {
        let folder = folder.join(target);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join(format!("seed-{name}")), content)?;
        bytes += content.len();
    }
    println!("{} seeds, {bytes} bytes", seeds.len());
    Ok(())
}
