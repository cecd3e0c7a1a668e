//! Inputs of measurements: files as they are, and scenes in a temporary folder.

use super::script::Opened;
use ravec::progress::Progress;
use ravec_jobs::{Context, Step};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A folder that is removed in the end.
pub(super) struct Folder(PathBuf);

impl Folder {
    /// A new folder among the temporary ones.
    ///
    /// # Errors
    /// One sentence.
    pub fn create() -> Result<Self, String> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("ravec-studio-measure-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        Ok(Self(path))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // what cannot be removed is left to the system
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The file that a script opens, made if it is a scene. `base` is the folder of the script.
///
/// # Errors
/// One sentence.
pub(super) fn prepare(opened: &Opened, base: &Path, folder: &Folder) -> Result<PathBuf, String> {
    let Folder(folder) = folder;
    match opened {
        Opened::File(path) => Ok(base.join(path)),
        Opened::Scene {
            name,
            width,
            height,
            frames,
        } => {
            run(json!({
                "operation": "scenes",
                "out": folder,
                "params": {"scenes": [name], "width": width, "height": height, "frames": frames},
            }))?;
            let frames = folder.join(name);
            if !frames.is_dir() {
                return Ok(folder.join(format!("{name}.png")));
            }
            let clip = folder.join(format!("{name}.mp4"));
            run(json!({"operation": "video convert", "input": frames, "output": clip}))?;
            Ok(clip)
        }
        Opened::Torus { triangles } => {
            let path = folder.join("torus.off");
            let text = torus(*triangles);
            ravec_files::write_atomically(&path, |file| file.write_all(text.as_bytes()))
                .map_err(|error| format!("{}: {error}", path.display()))?;
            Ok(path)
        }
    }
}

fn run(step: Value) -> Result<(), String> {
    let step: Step = serde_json::from_value(step).map_err(|error| error.to_string())?;
    let context = Context::new(&Progress::none());
    step.operation()
        .run(&context)
        .map_err(|error| error.to_string())?;
    Ok(())
}

/// A torus of about this many triangles, as an OFF file.
fn torus(triangles: u32) -> String {
    let around = (f64::from(triangles).sqrt().round() as u32).max(4);
    let across = (around / 2).max(3);
    let mut text = format!("OFF\n{} {} 0\n", around * across, 2 * around * across);
    let turn = std::f64::consts::TAU;
    for i in 0..around {
        let u = turn * f64::from(i) / f64::from(around);
        for k in 0..across {
            let v = turn * f64::from(k) / f64::from(across);
            let radius = 2.0 + 0.7 * v.cos();
            let (x, y, z) = (radius * u.cos(), radius * u.sin(), 0.7 * v.sin());
            writeln!(text, "{x} {y} {z}").expect("a text takes all that is written");
        }
    }
    for i in 0..around {
        for k in 0..across {
            let at = |i: u32, k: u32| (i % around) * across + k % across;
            let [a, b, c, d] = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
            writeln!(text, "3 {a} {b} {c}\n3 {a} {c} {d}")
                .expect("a text takes all that is written");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_jobs::Operation as _;

    #[test]
    fn a_torus_is_a_closed_mesh_of_the_size_that_was_asked_for() {
        let folder = Folder::create().unwrap();
        let opened = Opened::Torus { triangles: 5000 };
        let path = prepare(&opened, Path::new(""), &folder).unwrap();
        let step = json!({"operation": "mesh check", "input": path, "params": {}});
        let step: Step = serde_json::from_value(step).unwrap();
        let Step::MeshCheck(check) = step else {
            panic!("another step");
        };
        let report = check.run(&Context::default()).unwrap();
        assert_eq!(report.passed, Some(true), "{report:?}");
        let count = torus(5000)
            .lines()
            .filter(|line| line.starts_with("3 "))
            .count();
        assert!(count.abs_diff(5000) < 300, "{count}");
    }

    #[test]
    fn a_scene_that_is_not_known_is_an_error_in_words() {
        let folder = Folder::create().unwrap();
        let opened = Opened::Scene {
            name: "nothing".to_owned(),
            width: 64,
            height: 64,
            frames: None,
        };
        let refused = prepare(&opened, Path::new(""), &folder).unwrap_err();
        assert!(refused.contains("nothing"), "{refused}");
    }
}
