//! The folder with a page that zooms from the mosaic into its photos: its pieces, and the page in a browser.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

use ravec_catalogue::{Catalogue, CatalogueError, Mosaic, MosaicParams, Outputs, add, mosaic};
use ravec_media::{Limits, Picture, WriteOptions, read, write};
use ravec_mosaic::{ChooseParams, Crop, Rules};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, ResizeFilter, Size, Srgb, compare, resize};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// A photo that fades from one color to another.
fn photo(number: usize) -> Image<Srgb<u8>> {
    let tone = |i: usize| ((number * (37 + 22 * i) + 11 * i) % 200) as f64;
    Image::from_fn(Size::new(64, 48).unwrap(), |col, row| {
        let fade = 20.0 * ((col + number * row) as f64 / 40.0).sin();
        Srgb([0, 1, 2].map(|i| (tone(i) + 30.0 + fade) as u8))
    })
}

fn save(path: &Path, image: Image<Srgb<u8>>) {
    write(path, &Picture::from_image(image), &WriteOptions::default()).unwrap();
}

/// A folder with photos and their catalogue.
fn studio() -> (tempfile::TempDir, Catalogue) {
    let folder = tempfile::tempdir().unwrap();
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    for number in 0..40 {
        save(
            &photos.join(format!("number {number} <&>.png")),
            photo(number),
        );
    }
    let mut catalogue =
        Catalogue::open_or_make(&folder.path().join("photos.ravec"), &Progress::none()).unwrap();
    add(
        &mut catalogue,
        &[photos],
        &Limits::default(),
        &Progress::none(),
    )
    .unwrap();
    (folder, catalogue)
}

fn make(
    catalogue: &Catalogue,
    picture: Option<&Path>,
    zoom: &Path,
    progress: &Progress,
) -> Result<Mosaic, CatalogueError> {
    let params = MosaicParams {
        columns: 11,
        rows: Some(9),
        tile: Size::new(64, 48).unwrap(),
        crop: Crop::Never,
        rules: Rules {
            min_repeat_distance: 2.0,
            ..Rules::default()
        },
        choose: ChooseParams::default(),
        quality: 95,
        kept_bytes: 1 << 20,
        adaptive: None,
        pins: Vec::new(),
        bans: Vec::new(),
        preview_px: None,
    };
    let outputs = Outputs {
        picture,
        deep_zoom: Some(zoom),
    };
    let limits = Limits::default();
    mosaic(
        catalogue,
        &photo(5).into(),
        &outputs,
        &params,
        &limits,
        progress,
    )
}

/// The data in the page.
fn recorded(zoom: &Path) -> Value {
    let page = std::fs::read_to_string(zoom.join("index.html")).unwrap();
    let begin = "<script id=\"data\" type=\"application/json\">";
    let data = page.split_once(begin).unwrap().1;
    serde_json::from_str(data.split_once("</script>").unwrap().0).unwrap()
}

#[test]
fn all_pieces_are_there_and_each_level_is_the_half_of_the_next() {
    let (folder, catalogue) = studio();
    let (whole, zoom) = (folder.path().join("a.png"), folder.path().join("zoom"));
    let made = make(&catalogue, Some(&whole), &zoom, &Progress::none()).unwrap();
    let data = recorded(&zoom);
    assert_eq!((made.size.width(), made.size.height()), (704, 432));
    assert_eq!(
        (&data["width"], &data["height"]),
        (&704.into(), &432.into())
    );
    let dzi = std::fs::read_to_string(zoom.join("mosaic.dzi")).unwrap();
    assert!(
        dzi.contains("<Size Width=\"704\" Height=\"432\"/>") && dzi.contains("TileSize=\"256\"")
    );

    let mut finer: Option<Image<Srgb<u8>>> = None;
    let levels = data["levels"].as_u64().unwrap() as usize;
    let (mut width, mut height) = (704usize, 432usize);
    let mut files = 0;
    for level in (0..levels).rev() {
        let mut pixels = vec![Srgb([0u8; 3]); width * height];
        for row in 0..height.div_ceil(256) {
            for col in 0..width.div_ceil(256) {
                let piece = zoom.join(format!("mosaic_files/{level}/{col}_{row}.jpg"));
                let piece = read(&piece, &Limits::default())
                    .unwrap()
                    .convert::<Srgb<u8>>();
                files += 1;
                assert_eq!(piece.width(), (width - 256 * col).min(256));
                assert_eq!(piece.height(), (height - 256 * row).min(256));
                for (dy, line) in piece.rows().enumerate() {
                    let at = (256 * row + dy) * width + 256 * col;
                    pixels[at..][..line.len()].copy_from_slice(line);
                }
            }
        }
        let image = Image::from_vec(width, pixels).unwrap();
        let truth: Image<Srgb<u8>> = match &finer {
            None => read(&whole, &Limits::default()).unwrap().convert(),
            Some(finer) => {
                let light: Image<LinearRgb> = finer.convert();
                resize(&light, image.size(), ResizeFilter::Box).convert()
            }
        };
        // both have been through JPEG of quality 95; levels of odd sides, which are small, are not sampled quite as by a box
        let psnr = compare(&image, &truth).unwrap().psnr_db;
        let odd = width < 44;
        assert!(
            psnr > if odd { 20.0 } else { 32.0 },
            "level {level}: {psnr}"
        );
        (width, height) = (width.div_ceil(2), height.div_ceil(2));
        finer = Some(image);
    }
    assert_eq!(finer.unwrap().size(), Size::new(1, 1).unwrap());
    let count = walk(&zoom.join("mosaic_files"));
    assert_eq!(files, count, "no other files");
}

fn walk(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).unwrap();
    entries
        .map(|entry| {
            let path = entry.unwrap().path();
            if path.is_dir() { walk(&path) } else { 1 }
        })
        .sum()
}

#[test]
fn the_page_names_the_photo_of_each_tile_and_no_address() {
    let (folder, catalogue) = studio();
    let zoom = folder.path().join("zoom");
    let made = make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    let data = recorded(&zoom);
    let tiles = data["tiles"].as_array().unwrap();
    for (at, (path, place)) in made.photos.iter().zip(&made.places).enumerate() {
        let number = |i: usize| tiles[5 * at + i].as_u64().unwrap() as usize;
        assert_eq!(
            [number(0), number(1), number(2), number(3)],
            [place.col, place.row, place.width, place.height]
        );
        let name = path.file_name().unwrap().to_str().unwrap();
        assert_eq!(data["names"][number(4)], name);
    }
    let page = std::fs::read_to_string(zoom.join("index.html")).unwrap();
    for address in [
        "http:", "https:", "src=", "href=", "url(", "import", "fetch(", "XMLHttp",
    ] {
        assert!(!page.contains(address), "{address}");
    }
    assert_eq!(
        page.matches(".src = ").count(),
        1,
        "pieces are all that is loaded"
    );
    let files: Vec<_> = std::fs::read_dir(folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.starts_with('.'))
        .collect();
    assert_eq!(files, [""; 0], "no passing folder is left");
}

#[test]
fn an_older_page_is_replaced_and_a_run_that_stops_leaves_it_as_it_was() {
    let (folder, catalogue) = studio();
    let zoom = folder.path().join("deep/er");
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    std::fs::remove_file(zoom.join("index.html")).unwrap();
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    assert!(zoom.join("index.html").is_file());
    // an empty folder is as good as none
    let empty = folder.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    make(&catalogue, None, &empty, &Progress::none()).unwrap();
    assert!(empty.join("index.html").is_file());

    let before = content(folder.path());
    for look in (1..).step_by(97) {
        match make(&catalogue, None, &zoom, &Progress::cancelled_at(look)) {
            Err(CatalogueError::Cancelled(_)) => {
                assert_eq!(content(folder.path()), before, "{look}");
            }
            other => {
                other.unwrap();
                assert!(look > 300, "no look while pieces are written");
                break;
            }
        }
    }
}

/// All files, links and folders, with their content.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in walkdir::WalkDir::new(folder) {
        let entry = entry.unwrap();
        let kind = entry.file_type();
        let bytes = if kind.is_file() {
            std::fs::read(entry.path()).unwrap()
        } else {
            format!("{kind:?}").into_bytes()
        };
        found.insert(entry.into_path(), bytes);
    }
    found
}

fn refusal(catalogue: &Catalogue, zoom: &Path) -> String {
    let error = make(catalogue, None, zoom, &Progress::none()).unwrap_err();
    assert!(matches!(error, CatalogueError::Write(_)), "{error}");
    error.to_string()
}

/// Intrusion into a page: its name, a word of the refusal, and the change.
type Intrusion<'a> = (&'a str, &'a str, &'a dyn Fn());

#[test]
fn a_folder_with_anything_else_in_it_is_refused_by_name_and_stays() {
    let (folder, catalogue) = studio();
    let zoom = folder.path().join("zoom");
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    let outside = folder.path().join("outside");
    std::fs::create_dir(&outside).unwrap();
    std::fs::write(outside.join("0_0.jpg"), "of somebody else").unwrap();
    let piece = "mosaic_files/0/0_0.jpg";
    let put = |name: &str, text: &str| std::fs::write(zoom.join(name), text).unwrap();
    let intrusions: &[Intrusion<'_>] = &[
        ("photo.jpg", "file", &|| put("photo.jpg", "x")),
        (".hidden", "file", &|| put(".hidden", "")),
        ("mosaic_files/a.jpg", "file", &|| {
            put("mosaic_files/a.jpg", "x");
        }),
        ("mosaic_files/0/1_0.jpg", "file", &|| {
            put("mosaic_files/0/1_0.jpg", "x");
        }),
        ("mosaic_files/0/00_0.jpg", "file", &|| {
            put("mosaic_files/0/00_0.jpg", "x");
        }),
        ("empty", "folder", &|| {
            std::fs::create_dir(zoom.join("empty")).unwrap();
        }),
        ("mosaic_files/99", "folder", &|| {
            std::fs::create_dir(zoom.join("mosaic_files/99")).unwrap();
        }),
        ("mosaic.dzi", "changed", &|| put("mosaic.dzi", "")),
        (piece, "changed", &|| {
            let mut bytes = std::fs::read(zoom.join(piece)).unwrap();
            *bytes.last_mut().unwrap() ^= 1;
            std::fs::write(zoom.join(piece), bytes).unwrap();
        }),
        (piece, "folder", &|| {
            std::fs::remove_file(zoom.join(piece)).unwrap();
            std::fs::create_dir(zoom.join(piece)).unwrap();
        }),
    ];
    let whole = content(&zoom);
    for (name, word, intrude) in intrusions {
        intrude();
        let before = content(folder.path());
        let text = refusal(&catalogue, &zoom);
        assert!(
            text.contains(name) && text.contains(word),
            "{name} {word}: {text}"
        );
        assert_eq!(content(folder.path()), before, "{name}");
        restore(&zoom, &whole);
    }
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
}

/// Makes a folder what it was.
fn restore(zoom: &Path, whole: &BTreeMap<PathBuf, Vec<u8>>) {
    std::fs::remove_dir_all(zoom).unwrap();
    for (path, bytes) in whole {
        if path.extension().is_some() {
            std::fs::write(path, bytes).unwrap();
        } else {
            std::fs::create_dir_all(path).unwrap();
        }
    }
}

#[cfg(unix)]
#[test]
fn links_and_pipes_in_a_page_are_refused_and_not_followed() {
    use std::os::unix::fs::symlink;
    let (folder, catalogue) = studio();
    let zoom = folder.path().join("zoom");
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    let whole = content(&zoom);
    // what is behind a link is exactly what the manifest lists
    let twin = folder.path().join("twin");
    make(&catalogue, None, &twin, &Progress::none()).unwrap();
    for name in [
        "mosaic_files",
        "mosaic_files/3",
        "mosaic_files/0/0_0.jpg",
        "index.html",
    ] {
        let path = zoom.join(name);
        if path.is_dir() {
            std::fs::remove_dir_all(&path).unwrap();
        } else {
            std::fs::remove_file(&path).unwrap();
        }
        symlink(twin.join(name), &path).unwrap();
        let before = content(folder.path());
        let text = refusal(&catalogue, &zoom);
        assert!(text.contains(name) && text.contains("link"), "{text}");
        assert_eq!(content(folder.path()), before);
        std::fs::remove_file(&path).unwrap();
        restore(&zoom, &whole);
    }
    for name in ["index.html", "pipe", "ravec-manifest.json"] {
        let path = zoom.join(name);
        let _ = std::fs::remove_file(&path);
        let made = Command::new("mkfifo").arg(&path).status().unwrap();
        assert!(made.success());
        let text = refusal(&catalogue, &zoom);
        assert!(text.contains(name), "{text}");
        std::fs::remove_file(&path).unwrap();
        restore(&zoom, &whole);
    }
}

#[test]
fn a_manifest_that_nobody_wrote_is_refused() {
    let (folder, catalogue) = studio();
    let zoom = folder.path().join("zoom");
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    let path = zoom.join("ravec-manifest.json");
    let text = std::fs::read_to_string(&path).unwrap();
    std::fs::write(folder.path().join("victim.jpg"), "x").unwrap();
    let hash = blake3::hash(b"x").to_hex();
    let with = |name: &str| {
        let entry =
            format!("\"files\": {{ \"{name}\": {{ \"bytes\": 1, \"blake3\": \"{hash}\" }},");
        text.replacen("\"files\": {", &entry, 1)
    };
    let victim = folder.path().join("victim.jpg");
    for wrong in [
        with("../victim.jpg"),
        with("mosaic_files/../../victim.jpg"),
        with("mosaic_files/0/../../../victim.jpg"),
        with(victim.to_str().unwrap()),
        with("victim.jpg"),
        with("mosaic_files/0/0_0.jpg/"),
        with("mosaic_files//0_0.jpg"),
        with("mosaic_files/+1/0_0.jpg"),
        with("mosaic_files/1/4294967296_0.jpg"),
        with("ravec-manifest.json"),
        with(""),
        text.replace("\"version\": 1", "\"version\": 2"),
        text.replace("ravec-deep-zoom", "other"),
        text.replace("\"files\"", "\"more\": 1, \"files\""),
        text.replacen("\"bytes\": ", "\"bytes\": -", 1),
        text[..text.len() / 2].to_owned(),
        "[".repeat(1 << 20),
        String::new(),
    ] {
        std::fs::write(&path, &wrong).unwrap();
        let before = content(folder.path());
        let text = refusal(&catalogue, &zoom);
        assert!(text.contains("ravec-manifest.json"), "{text}");
        assert_eq!(content(folder.path()), before, "{wrong:.300}");
    }
    // a file that is much longer than any list is not read
    let long = std::fs::File::options().write(true).open(&path).unwrap();
    long.set_len(1 << 40).unwrap();
    assert!(refusal(&catalogue, &zoom).contains("ravec-manifest.json"));
    // hashes of other files: these are not of a page
    std::fs::write(&path, text.replace("\"blake3\": \"", "\"blake3\": \"0")).unwrap();
    assert!(refusal(&catalogue, &zoom).contains("was changed"));
    std::fs::remove_file(&path).unwrap();
    assert!(refusal(&catalogue, &zoom).contains("earlier versions; remove it yourself"));
    assert!(zoom.join("index.html").is_file());
}

#[cfg(unix)]
#[test]
fn a_link_to_a_folder_stays_and_what_it_leads_to_is_replaced() {
    use std::os::unix::fs::symlink;
    let (folder, catalogue) = studio();
    let (real, link) = (
        folder.path().join("elsewhere/real"),
        folder.path().join("link"),
    );
    symlink("elsewhere/real", &link).unwrap();
    for _ in 0..2 {
        make(&catalogue, None, &link, &Progress::none()).unwrap();
        assert!(link.symlink_metadata().unwrap().is_symlink());
        assert!(real.join("index.html").is_file());
        assert_eq!(recorded(&link)["title"], "link");
        assert_eq!(
            std::fs::read_dir(real.parent().unwrap()).unwrap().count(),
            1
        );
    }
    std::fs::write(real.join("more"), "x").unwrap();
    assert!(refusal(&catalogue, &link).contains("more"));
    symlink("turn", folder.path().join("turn")).unwrap();
    refusal(&catalogue, &folder.path().join("turn"));
}

#[test]
fn what_a_killed_run_left_is_taken_back_or_completed() {
    let (folder, catalogue) = studio();
    let zoom = folder.path().join("zoom");
    let aside = folder.path().join(".ravec-zoom-a1B2c3D4.old");
    let other = folder.path().join(".ravec-zoom2-a1B2c3D4.old");
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    make(&catalogue, None, &other, &Progress::none()).unwrap();

    // killed between two renames: the old page comes back, also if the next run goes no further
    std::fs::rename(&zoom, &aside).unwrap();
    let stopped = make(&catalogue, None, &zoom, &Progress::cancelled_at(2));
    assert!(matches!(stopped, Err(CatalogueError::Cancelled(_))));
    assert!(zoom.join("index.html").is_file() && !aside.exists());

    // killed while the old page was removed
    make(&catalogue, None, &aside, &Progress::none()).unwrap();
    std::fs::remove_file(aside.join("mosaic_files/0/0_0.jpg")).unwrap();
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    assert!(!aside.exists());

    // somebody put a file there
    make(&catalogue, None, &aside, &Progress::none()).unwrap();
    std::fs::write(aside.join("mosaic_files/photo.jpg"), "x").unwrap();
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    assert_eq!(
        std::fs::read(aside.join("mosaic_files/photo.jpg")).unwrap(),
        b"x"
    );
    assert!(!aside.join("index.html").exists());

    // a living process is at work on it
    std::fs::remove_dir_all(&aside).unwrap();
    make(&catalogue, None, &aside, &Progress::none()).unwrap();
    if cfg!(unix) {
        let lock = std::fs::File::open(&aside).unwrap();
        lock.lock().unwrap();
        make(&catalogue, None, &zoom, &Progress::none()).unwrap();
        assert!(aside.join("index.html").is_file());
    }
    assert!(other.join("index.html").is_file(), "it has another place");
}

#[test]
fn pieces_of_a_page_are_no_photos() {
    let (folder, mut catalogue) = studio();
    let photos = folder.path().join("photos");
    make(&catalogue, None, &photos.join("zoom"), &Progress::none()).unwrap();
    let added = add(
        &mut catalogue,
        &[photos],
        &Limits::default(),
        &Progress::none(),
    )
    .unwrap();
    assert_eq!((added.new, added.unchanged, added.copies), (0, 40, 0));
    assert_eq!(added.unreadable, []);
}

/// Uses the page in a frame as somebody with a mouse and a keyboard would, and writes down what is seen.
const VISITOR: &str = include_str!("deep_zoom/visitor.html");

#[test]
fn in_a_browser_pointer_and_keys_lead_to_single_photos() {
    let browsers = ["chromium", "chromium-browser", "google-chrome"];
    let runs = |name: &&&str| Command::new(name).arg("--version").output().is_ok();
    let Some(browser) = browsers.iter().find(runs) else {
        eprintln!(
            "SKIPPED: there is no Chromium on this machine; the page was not tried in a browser"
        );
        return;
    };
    let (folder, catalogue) = studio();
    make(
        &catalogue,
        None,
        &folder.path().join("zoom"),
        &Progress::none(),
    )
    .unwrap();
    // the visitor looks at what the page knows, which its policy forbids, as anything that is not the page's own
    let page = folder.path().join("zoom/index.html");
    let text = std::fs::read_to_string(&page).unwrap();
    let (open, closed) = ("script-src 'unsafe-eval' 'sha256-", "script-src 'sha256-");
    assert_eq!(text.matches(closed).count(), 1);
    std::fs::write(&page, text.replace(closed, open)).unwrap();
    let visitor = folder.path().join("visitor.html");
    ravec_files::write_atomically(&visitor, |writer| {
        std::io::Write::write_all(writer, VISITOR.as_bytes())
    })
    .unwrap();
    let output = Command::new(browser)
        .args([
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--allow-file-access-from-files",
        ])
        // frames are drawn when they are dumped, so nothing may wait for them
        .arg("--force-prefers-reduced-motion")
        .args([
            "--window-size=1000,800",
            "--virtual-time-budget=20000",
            "--dump-dom",
        ])
        .arg(format!(
            "--user-data-dir={}",
            folder.path().join("profile").display()
        ))
        .arg(format!("file://{}", visitor.display()))
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let seen = text.split("SEEN").nth(1).unwrap_or_default();
    let seen: Value =
        serde_json::from_str(seen).unwrap_or_else(|_| panic!("the page said nothing: {text}"));
    for yes in [
        "hover", "painted", "centered", "close", "right", "spoken", "local",
    ] {
        assert_eq!(seen[yes], true, "{yes}: {seen}");
    }
    let zoomed = |name: &str| seen[name].as_f64().unwrap();
    assert!(zoomed("click") > 5.0 && zoomed("enter") > 5.0, "{seen}");
    assert!(
        (zoomed("back") - 1.0).abs() < 1e-6 && (zoomed("zero") - 1.0).abs() < 1e-6,
        "{seen}"
    );
    assert!(zoomed("plus") > 1.5 && zoomed("wheel") > 1.5, "{seen}");
}
