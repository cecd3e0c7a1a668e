//! What goes wrong outside: nothing panics, and nothing is lost.

mod common;
#[path = "common/desk.rs"]
mod desk;

use desk::{click, drag, on_screen, settle};
use egui::{Key, Modifiers, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_media::{Picture, WriteOptions};
use ravec_studio::Studio;
use std::path::{Path, PathBuf};

/// Tools for pictures that need nothing but a click.
const TOOLS: [&str; 6] = [
    "Two-color view",
    "Brush",
    "Filter",
    "Retarget",
    "Rectify",
    "Complete",
];

fn photo(path: &Path, [width, height]: [usize; 2]) -> PathBuf {
    let image: Image<Srgb<u8>> = Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
        Srgb([(5 * col) as u8, (3 * row) as u8, 90])
    });
    let picture = Picture::from_image(AnyImage::from(image));
    ravec_media::write(path, &picture, &WriteOptions::default()).unwrap();
    path.to_path_buf()
}

fn studio(paths: Vec<PathBuf>) -> Harness<'static, Studio> {
    let mut harness = Harness::builder()
        .with_size(Vec2::new(1200.0, 800.0))
        .build_eframe(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, None);
            for path in &paths {
                studio.open(path);
            }
            studio
        });
    settle(&mut harness);
    harness
}

fn press(harness: &mut Harness<'_, Studio>, modifiers: Modifiers, key: Key) {
    harness.key_press_modifiers(modifiers, key);
    settle(harness);
}

fn edits(harness: &Harness<'_, Studio>) -> usize {
    harness
        .state()
        .document()
        .map_or(0, |document| document.edits.len())
}

#[test]
fn twenty_documents_keep_their_own_edits() {
    let folder = tempfile::tempdir().unwrap();
    let paths = (0..20).map(|k| photo(&folder.path().join(format!("{k:02}.png")), [40 + k, 30]));
    let mut harness = studio(paths.collect());
    assert_eq!(harness.state().documents(), 20);
    // every second document gets an edit
    for k in 0..20 {
        if k % 2 == 0 {
            click(&mut harness, "Two-color view");
        }
        press(&mut harness, Modifiers::CTRL, Key::Tab);
    }
    for k in 0..20 {
        assert_eq!(edits(&harness), usize::from(k % 2 == 0), "document {k}");
        let snapshot = harness.state().snapshot().unwrap();
        assert!(!snapshot.is_stale && snapshot.failure.is_none());
        let source = &harness.state().document().unwrap().source;
        let stem: usize = source
            .file_stem()
            .unwrap()
            .to_str()
            .unwrap()
            .parse()
            .unwrap();
        assert_eq!(snapshot.size(), Some([40 + stem, 30]));
        press(&mut harness, Modifiers::CTRL, Key::Tab);
    }
    for left in (0..20).rev() {
        press(&mut harness, Modifiers::COMMAND, Key::W);
        assert_eq!(harness.state().documents(), left);
    }
    press(&mut harness, Modifiers::COMMAND, Key::W);
    let reopen = Modifiers::COMMAND | Modifiers::SHIFT;
    press(&mut harness, reopen, Key::T);
    assert_eq!(harness.state().documents(), 1);
}

#[test]
fn a_folder_that_vanishes_is_a_sentence_and_the_picture_stays() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("inner");
    std::fs::create_dir(&inner).unwrap();
    let path = photo(&inner.join("photo.png"), [60, 40]);
    let mut harness = studio(vec![path.clone()]);
    click(&mut harness, "Two-color view");
    std::fs::remove_dir_all(&inner).unwrap();
    click(&mut harness, "Retarget");
    let snapshot = harness.state().snapshot().unwrap();
    assert_eq!(snapshot.size(), Some([60, 40]), "the last picture is shown");
    assert!(snapshot.failure.is_some());
    press(&mut harness, Modifiers::COMMAND, Key::S);
    click(&mut harness, "Save the project: Save");
    let (message, wrong) = harness.state().message().unwrap();
    assert!(wrong && message.contains("inner"), "{message}");
    assert_eq!(edits(&harness), 2);
    // it is back, and so is the result
    std::fs::create_dir(&inner).unwrap();
    photo(&path, [60, 40]);
    click(&mut harness, "Use Retarget");
    let snapshot = harness.state().snapshot().unwrap();
    assert!(snapshot.failure.is_none(), "{:?}", snapshot.failure);
    press(&mut harness, Modifiers::COMMAND, Key::S);
    if harness.query_by_label("Save the project: Save").is_some() {
        click(&mut harness, "Save the project: Save");
    }
    assert!(inner.join("photo.ravec.json").exists());
}

#[test]
fn an_export_that_cannot_be_written_is_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let path = photo(&folder.path().join("photo.png"), [60, 40]);
    let mut harness = studio(vec![path.clone()]);
    click(&mut harness, "Two-color view");
    click(&mut harness, "Export…");
    let field = harness.get_by_role_and_label(egui::accesskit::Role::TextInput, "File");
    field.focus();
    field.type_text("/below-a-file");
    harness.step();
    harness.get_by_label("Export the result: Export").click();
    settle(&mut harness);
    let (message, wrong) = harness.state().message().unwrap();
    assert!(wrong && message.contains("below-a-file"), "{message}");
    assert!(!harness.state().is_busy());
}

/// The project of a process whose files cannot grow.
#[cfg(unix)]
const FULL_DISK: &str = "RAVEC_TEST_FULL_DISK";

/// The test runs its own second half in a process in which no file may become longer than nothing.
#[cfg(unix)]
#[test]
fn a_full_disk_is_a_sentence_and_nothing_is_lost() {
    if let Some(project) = std::env::var_os(FULL_DISK) {
        return save_and_export_on_a_full_disk(Path::new(&project));
    }
    let folder = tempfile::tempdir().unwrap();
    let path = photo(&folder.path().join("photo.png"), [60, 40]);
    let mut harness = studio(vec![path]);
    click(&mut harness, "Two-color view");
    press(&mut harness, Modifiers::COMMAND, Key::S);
    click(&mut harness, "Save the project: Save");
    let files = || {
        let entries = std::fs::read_dir(folder.path()).unwrap();
        let read = |path: PathBuf| (path.clone(), std::fs::read(path).unwrap());
        let mut files: Vec<_> = entries.map(|entry| read(entry.unwrap().path())).collect();
        files.sort();
        files
    };
    let before = files();
    assert_eq!(before.len(), 2);
    let name = "a_full_disk_is_a_sentence_and_nothing_is_lost";
    let output = std::process::Command::new("sh")
        .args(["-c", r#"trap "" XFSZ; ulimit -f 0 && exec "$0" "$@""#])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", name, "--nocapture"])
        .env(FULL_DISK, folder.path().join("photo.ravec.json"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    let failed = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{failed}");
    assert!(said.contains("1 passed"), "{said}");
    assert!(files() == before, "the project is as it was saved");
}

#[cfg(unix)]
fn save_and_export_on_a_full_disk(project: &Path) {
    let mut harness = studio(vec![project.to_path_buf()]);
    assert_eq!(edits(&harness), 1);
    click(&mut harness, "Filter");
    press(&mut harness, Modifiers::COMMAND, Key::S);
    let (message, wrong) = harness.state().message().unwrap();
    assert!(wrong && message.contains("photo.ravec.json"), "{message}");
    click(&mut harness, "Export…");
    click(&mut harness, "Export the result: Export");
    let (message, wrong) = harness.state().message().unwrap();
    assert!(wrong && message.contains(".png"), "{message}");
    // what was made is there still
    assert_eq!(edits(&harness), 2);
    let snapshot = harness.state().snapshot().unwrap();
    assert!(snapshot.failure.is_none() && !snapshot.is_stale);
}

#[test]
fn every_tool_stands_a_single_pixel() {
    let folder = tempfile::tempdir().unwrap();
    for tool in TOOLS {
        let path = photo(&folder.path().join("one.png"), [1, 1]);
        let mut harness = studio(vec![path]);
        click(&mut harness, tool);
        let way = [[0.5, 0.5], [0.9, 0.2]].map(|[x, y]| on_screen(&harness, x, y));
        drag(&mut harness, &way);
        press(&mut harness, Modifiers::NONE, Key::S);
        assert_eq!(edits(&harness), 1, "{tool}");
        press(&mut harness, Modifiers::COMMAND, Key::Z);
        assert!(harness.state().snapshot().unwrap().size().is_some());
    }
}
