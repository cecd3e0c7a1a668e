//! Reads every picture of a folder: of `RAVEC_PHOTOS`, and says so if there is none.

use ravec_media::{Limits, read};
use std::path::Path;

fn read_all(folder: &Path, count: &mut usize) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let extension = path.extension().and_then(|extension| extension.to_str());
        if path.is_dir() {
            read_all(&path, count);
        } else if matches!(
            extension,
            Some("png" | "jpg" | "jpeg" | "webp" | "tif" | "exr" | "hdr" | "bmp")
        ) {
            let picture = read(&path, &Limits::default()).unwrap();
            for warning in &picture.warnings {
                println!("{}: {warning}", path.display());
            }
            *count += 1;
        }
    }
}

#[test]
fn every_picture_of_a_folder_can_be_read() {
    let Some(folder) = std::env::var_os("RAVEC_PHOTOS") else {
        eprintln!("skipped: RAVEC_PHOTOS names no folder of pictures");
        return;
    };
    let mut count = 0;
    read_all(Path::new(&folder), &mut count);
    println!("{count} pictures");
    assert!(count > 0);
}
