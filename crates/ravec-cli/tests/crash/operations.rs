//! The operations that are killed: their inputs, what they write, and what they write when nobody kills them.

use crate::world::{
    Content, bumpy_sphere, catalogued, content, names, photo, program, succeed, words,
};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Photos that are added.
pub const PHOTOS: usize = 600;

/// Photos that mosaics are made of.
const TILES: usize = 40;

/// An operation in a folder of its own: inputs in `in`, the output alone in `out`.
pub struct Operation {
    pub name: &'static str,
    pub folder: TempDir,
    /// The output below `out`.
    output: &'static str,
    /// Two command lines with different results, so that an old output is not a new one.
    lines: [Vec<String>; 2],
    /// Results of the two lines; none for a catalogue, which says by its rows how far it came.
    results: Option<[Content; 2]>,
}

impl Operation {
    fn new(
        name: &'static str,
        output: &'static str,
        prepare: impl FnOnce(&Path),
        lines: [&str; 2],
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for inner in ["in", "out"] {
            fs::create_dir(folder.path().join(inner)).unwrap();
        }
        prepare(folder.path());
        let mut operation = Self {
            name,
            folder,
            output,
            lines: lines.map(words),
            results: None,
        };
        if output != CATALOGUE {
            let results = [0, 1].map(|line| {
                operation.remove_output();
                succeed(operation.folder.path(), operation.line(line));
                content(&operation.output())
            });
            assert_ne!(
                results[0], results[1],
                "{name}: the lines must differ in what they give"
            );
            operation.remove_output();
            operation.results = Some(results);
        }
        operation
    }

    /// All operations, made anew.
    pub fn all() -> Vec<Self> {
        vec![
            Self::add(),
            Self::mosaic(),
            Self::deep_zoom(),
            Self::offset(),
            Self::convert(),
            Self::clip(),
        ]
    }

    pub fn add() -> Self {
        let prepare = |folder: &Path| {
            let photos = folder.join("in/photos");
            fs::create_dir(&photos).unwrap();
            for number in 0..PHOTOS {
                fs::write(
                    photos.join(format!("{number:03}.bmp")),
                    photo(number, 40, 30),
                )
                .unwrap();
            }
        };
        let line = "library add in/photos --catalogue out/photos.ravec";
        Self::new("library add", CATALOGUE, prepare, [line; 2])
    }

    pub fn mosaic() -> Self {
        let lines = [
            "mosaic in/target.bmp --catalogue in/photos.ravec -o out/mosaic.png --tiles 24x18 --tile-size 24x18 --min-repeat-distance 0",
            "mosaic in/target.bmp --catalogue in/photos.ravec -o out/mosaic.png --tiles 20x15 --tile-size 24x18 --min-repeat-distance 0",
        ];
        Self::new("mosaic", "mosaic.png", photo_catalogue, lines)
    }

    pub fn deep_zoom() -> Self {
        let lines = [
            "mosaic in/target.bmp --catalogue in/photos.ravec --deep-zoom out/zoom --tiles 24x18 --tile-size 32x24 --min-repeat-distance 0",
            "mosaic in/target.bmp --catalogue in/photos.ravec --deep-zoom out/zoom --tiles 20x15 --tile-size 32x24 --min-repeat-distance 0",
        ];
        Self::new("deep zoom", "zoom", photo_catalogue, lines)
    }

    pub fn offset() -> Self {
        let prepare =
            |folder: &Path| fs::write(folder.join("in/mesh.stl"), bumpy_sphere(48, 24)).unwrap();
        let lines = [
            "offset in/mesh.stl -o out/mesh.ply --distance 4% --tolerance 1% --memory 100MiB",
            "offset in/mesh.stl -o out/mesh.ply --distance 3% --tolerance 1% --memory 100MiB",
        ];
        Self::new("offset", "mesh.ply", prepare, lines)
    }

    pub fn convert() -> Self {
        let prepare =
            |folder: &Path| fs::write(folder.join("in/mesh.stl"), bumpy_sphere(200, 100)).unwrap();
        let lines = [
            "mesh convert in/mesh.stl -o out/mesh.3mf",
            "mesh convert in/mesh.stl -o out/mesh.3mf --from-unit inch",
        ];
        Self::new("mesh convert", "mesh.3mf", prepare, lines)
    }

    /// Three chunks of frames.
    pub fn clip() -> Self {
        let prepare = |folder: &Path| fs::write(folder.join("in/clip.y4m"), gray_clip()).unwrap();
        let lines = [
            "video convert in/clip.y4m out/clip.mp4",
            "video convert in/clip.y4m out/clip.mp4 --size 50%",
        ];
        Self::new("video convert", "clip.mp4", prepare, lines)
    }

    pub fn line(&self, which: usize) -> &[String] {
        &self.lines[which]
    }

    pub fn out(&self) -> PathBuf {
        self.folder.path().join("out")
    }

    pub fn output(&self) -> PathBuf {
        self.out().join(self.output)
    }

    pub fn inputs(&self) -> Content {
        content(&self.folder.path().join("in"))
    }

    pub fn is_catalogue(&self) -> bool {
        self.output == CATALOGUE
    }

    /// Removes the output and all that is beside it.
    pub fn remove_output(&self) {
        fs::remove_dir_all(self.out()).unwrap();
        fs::create_dir(self.out()).unwrap();
    }

    /// Asserts that the output is as it was before or the whole result of the line; a folder may be away.
    #[track_caller]
    pub fn assert_whole(&self, before: &Content, which: usize) {
        let Some(results) = &self.results else {
            let photos = catalogued(&self.output());
            assert!(
                photos.len() <= PHOTOS && photos.iter().all(|path| path.contains("/in/photos/"))
            );
            return;
        };
        let now = content(&self.output());
        let is_folder = self.output().extension().is_none();
        assert!(
            now == *before || now == results[which] || (is_folder && now.is_empty()),
            "{}: the output is neither as it was ({} files) nor whole ({} files), but {:?}",
            self.name,
            before.len(),
            results[which].len(),
            now.iter()
                .map(|(name, bytes)| (name, bytes.len()))
                .collect::<Vec<_>>(),
        );
    }

    /// Asserts that a run which nobody disturbed gave the result, and that nothing is beside it.
    #[track_caller]
    pub fn assert_done(&self, which: usize) {
        if let Some(results) = &self.results {
            assert!(
                content(&self.output()) == results[which],
                "{}: another result",
                self.name
            );
        } else {
            assert_eq!(catalogued(&self.output()).len(), PHOTOS);
            succeed(
                self.folder.path(),
                &words("library stats --catalogue out/photos.ravec"),
            );
        }
        assert_eq!(
            names(&self.out()),
            [self.output],
            "{} ({})",
            self.name,
            program().display()
        );
    }
}

/// 600 gray frames of a bar that moves.
fn gray_clip() -> Vec<u8> {
    let mut clip = b"YUV4MPEG2 W64 H48 F25:1 Cmono\n".to_vec();
    for number in 0..600 {
        clip.extend(b"FRAME\n");
        let pixels = (0..48 * 64).map(|at| {
            if at % 64 < number % 64 {
                220
            } else {
                at / 64 * 3
            }
        });
        clip.extend(pixels.map(|value| value as u8));
    }
    clip
}

const CATALOGUE: &str = "photos.ravec";

/// A picture, photos and their catalogue.
fn photo_catalogue(folder: &Path) {
    let photos = folder.join("in/photos");
    fs::create_dir(&photos).unwrap();
    for number in 0..TILES {
        fs::write(
            photos.join(format!("{number:02}.bmp")),
            photo(number, 80, 60),
        )
        .unwrap();
    }
    fs::write(folder.join("in/target.bmp"), photo(5, 160, 120)).unwrap();
    succeed(
        folder,
        &words("library add in/photos --catalogue in/photos.ravec"),
    );
}
