//! The folder with a page that zooms from the mosaic into its photos: its pieces, and the page in a browser.

use ravec_library::{Catalogue, LibraryError, Mosaic, MosaicParams, Outputs, add, mosaic};
use ravec_media::{Limits, Picture, WriteOptions, read, write};
use ravec_mosaic::{ChooseParams, Crop, Rules};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, ResizeFilter, Size, Srgb, compare, resize};
use serde_json::Value;
use std::path::Path;
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
    let mut catalogue = Catalogue::open_or_make(&folder.path().join("photos.ravec")).unwrap();
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
) -> Result<Mosaic, LibraryError> {
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
fn told(zoom: &Path) -> Value {
    let page = std::fs::read_to_string(zoom.join("index.html")).unwrap();
    let begin = page.find("const data = ").unwrap() + "const data = ".len();
    let end = page[begin..].find(";\n").unwrap();
    serde_json::from_str(&page[begin..begin + end]).unwrap()
}

#[test]
fn all_pieces_are_there_and_each_level_is_the_half_of_the_next() {
    let (folder, catalogue) = studio();
    let (whole, zoom) = (folder.path().join("a.png"), folder.path().join("zoom"));
    let made = make(&catalogue, Some(&whole), &zoom, &Progress::none()).unwrap();
    let data = told(&zoom);
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
    let data = told(&zoom);
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
fn an_older_mosaic_is_replaced_and_other_folders_are_not() {
    let (folder, catalogue) = studio();
    let zoom = folder.path().join("deep/er");
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    std::fs::remove_file(zoom.join("index.html")).unwrap();
    make(&catalogue, None, &zoom, &Progress::none()).unwrap();
    assert!(zoom.join("index.html").is_file());
    let error = make(
        &catalogue,
        None,
        &folder.path().join("photos"),
        &Progress::none(),
    );
    let text = error.unwrap_err().to_string();
    assert!(
        text.ends_with("the folder has other files in it; name a new one"),
        "{text}"
    );
    // stopped while pieces are written: the old mosaic stays, and nothing else
    let before = walk(folder.path());
    let stopped = make(&catalogue, None, &zoom, &Progress::cancelled_at(800));
    assert!(matches!(stopped, Err(LibraryError::Cancelled(_))));
    assert_eq!(walk(folder.path()), before);
}

/// Uses the page in a frame as somebody with a mouse and a keyboard would, and writes down what is seen.
const VISITOR: &str = r#"<!doctype html><iframe id="frame" src="zoom/index.html" width="900" height="600"></iframe><pre id="seen"></pre>
<script>
const wait = (ms) => new Promise((done) => setTimeout(done, ms));
frame.onload = async () => {
  const page = frame.contentWindow, eye = (text) => page.eval(text), seen = {};
  const canvas = page.document.getElementById("view"), name = () => page.document.getElementById("name").textContent;
  const pointer = (type, x, y) => canvas.dispatchEvent(new page.PointerEvent(type, { clientX: x, clientY: y, pointerId: 1, button: 0 }));
  const key = async (key) => { page.dispatchEvent(new page.KeyboardEvent("keydown", { key })); await wait(600); };
  try {
    await wait(1000);
    seen.fit = eye("view.scale");
    const tile = eye("data.tiles.slice(5 * 30, 5 * 30 + 5)"), all = eye("data.names");
    const x = 450 + (tile[0] + tile[2] / 2 - eye("view.x")) * seen.fit, y = 300 + (tile[1] + tile[3] / 2 - eye("view.y")) * seen.fit;
    pointer("pointermove", x, y); await wait(200);
    seen.hover = name() === all[tile[4]] && name().length > 0;
    seen.painted = false;
    for (let turn = 0; turn < 50 && !seen.painted; turn += 1) {
      // without a screen nobody asks for frames when pictures have come
      eye("drawNow()");
      const pixel = canvas.getContext("2d").getImageData(450, 300, 1, 1).data;
      seen.painted = !(pixel[0] === 0x17 && pixel[1] === 0x19 && pixel[2] === 0x1c);
      if (!seen.painted) await wait(100);
    }
    pointer("pointerdown", x, y); pointer("pointerup", x, y); await wait(800);
    seen.click = eye("view.scale") / seen.fit;
    seen.centered = Math.abs(eye("view.x") - tile[0] - tile[2] / 2) < 1;
    pointer("pointermove", 450, 300); await wait(200);
    seen.close = name() === all[tile[4]];
    await key("Escape"); seen.back = eye("view.scale") / seen.fit;
    await key("+"); await key("ArrowRight"); seen.plus = eye("view.scale") / seen.fit; seen.right = eye("view.x > data.width / 2");
    await key("Enter"); seen.enter = eye("view.scale") / seen.fit; seen.spoken = name().length > 0;
    await key("0"); seen.zero = eye("view.scale") / seen.fit;
    canvas.dispatchEvent(new page.WheelEvent("wheel", { deltaY: -300, clientX: 450, clientY: 300, cancelable: true })); await wait(200);
    seen.wheel = eye("view.scale") / seen.fit;
    seen.local = page.performance.getEntriesByType("resource").every((entry) => entry.name.startsWith("file:"));
  } catch (error) { seen.error = String(error); }
  document.getElementById("seen").textContent = "SE" + "EN" + JSON.stringify(seen) + "NEES";
};
</script>"#;

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
    let visitor = folder.path().join("visitor.html");
    ravec_media::write_atomically(&visitor, |writer| {
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
    let seen = text.split("SEEN").nth(1);
    let seen = seen
        .and_then(|rest| rest.split("NEES").next())
        .unwrap_or_default();
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
