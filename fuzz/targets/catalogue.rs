//! Catalogues of photos: files with any bytes, and valid databases whose rows say anything.

use super::{Outcome, limits};
use ravec::mosaic::Crop;
use ravec::progress::Progress;
use ravec::raster::{Image, Size, Srgb};
use ravec_catalogue::Catalogue;
use ravec_jobs::{Context, Operation as _, catalogue, mosaic};
use ravec_media::{Picture, WriteOptions, write};
use rusqlite::types::Value;
use rusqlite::{Connection, params_from_iter};
use serde_json::{Map, Value as Json};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::UNIX_EPOCH;
use tempfile::TempDir;

/// A folder with photos and an empty catalogue, whose bytes are kept.
struct Shelf {
    folder: TempDir,
    photos: Vec<PathBuf>,
    empty: Vec<u8>,
}

static SHELF: LazyLock<Shelf> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let photo = |number: usize| {
        let size = Size::new(18 + number, 16).expect("not empty");
        let image = Image::from_fn(size, |col, row| {
            Srgb([(col * 12) as u8, (row * 15) as u8, (number * 80) as u8])
        });
        let path = folder.path().join(format!("{number}.png"));
        write(&path, &Picture::from_image(image), &WriteOptions::default())
            .expect("a small photo can be written");
        path
    };
    let photos = (0..3).map(photo).collect();
    let path = folder.path().join("empty.ravec");
    drop(
        Catalogue::open_or_make(&path, &Progress::none()).expect("an empty catalogue can be made"),
    );
    let empty = fs::read(&path).expect("the catalogue is there");
    Shelf {
        folder,
        photos,
        empty,
    }
});

impl Shelf {
    /// The catalogue of a run, with nothing beside it that an earlier run left.
    fn catalogue(&self, content: &[u8]) -> PathBuf {
        for suffix in ["-journal", "-wal", "-shm"] {
            let _ = fs::remove_file(self.folder.path().join(format!("run.ravec{suffix}")));
        }
        let path = self.folder.path().join("run.ravec");
        fs::write(&path, content).expect("the folder can be written to");
        path
    }
}

/// Uses a file as a catalogue.
pub fn read_file(input: &[u8]) -> Outcome {
    used(&SHELF.catalogue(input))
}

/// Fills a catalogue with rows, a JSON array of objects from columns to values, and uses it.
///
/// Values are those of JSON; an array of numbers is a blob, and `{"blob": [n, v]}` one of n bytes v. A column `real` stands
/// for the path, the size and the time of a photo that is there. Rows that the schema refuses are left out.
pub fn read_rows(input: &[u8]) -> Outcome {
    let Ok(rows) = serde_json::from_slice::<Vec<Map<String, Json>>>(input) else {
        return Outcome::Refused;
    };
    let shelf = &*SHELF;
    let path = shelf.catalogue(&shelf.empty);
    fill(&path, &rows).expect("the empty catalogue takes rows");
    used(&path)
}

fn fill(path: &Path, rows: &[Map<String, Json>]) -> rusqlite::Result<()> {
    let mut connection = Connection::open(path)?;
    connection.pragma_update(None, "synchronous", "OFF")?;
    let transaction = connection.transaction()?;
    for row in rows.iter().take(32) {
        let mut values: Vec<(String, Value)> = Vec::new();
        for (name, value) in row {
            match (name.as_str(), value.as_u64()) {
                ("real", Some(number)) => values.extend(real(number as usize)),
                ("real", None) => {}
                _ => values.push((name.clone(), stored(value))),
            }
        }
        // a later value of a column counts
        values.reverse();
        values.sort_by(|a, b| a.0.cmp(&b.0));
        values.dedup_by(|a, b| a.0 == b.0);
        let is_name = |name: &str| {
            !name.is_empty() && name.bytes().all(|b| b.is_ascii_lowercase() || b == b'_')
        };
        if values.is_empty() || !values.iter().all(|(name, _)| is_name(name)) {
            continue;
        }
        let names: Vec<String> = values
            .iter()
            .map(|(name, _)| format!("\"{name}\""))
            .collect();
        let marks = vec!["?"; values.len()].join(", ");
        let insert = format!(
            "INSERT OR REPLACE INTO photo ({}) VALUES ({marks})",
            names.join(", ")
        );
        // a row that the schema refuses cannot occur in a catalogue
        let _ = transaction.execute(
            &insert,
            params_from_iter(values.into_iter().map(|(_, value)| value)),
        );
    }
    transaction.commit()
}

/// The columns of a photo that is there.
fn real(number: usize) -> Vec<(String, Value)> {
    let path = &SHELF.photos[number % SHELF.photos.len()];
    let metadata = path.metadata().expect("the photo is there");
    let modified = metadata
        .modified()
        .ok()
        .and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    let modified = modified.map_or(0, |since| since.as_nanos() as i64);
    vec![
        ("path".into(), Value::Text(path.display().to_string())),
        ("bytes".into(), Value::Integer(metadata.len() as i64)),
        ("modified".into(), Value::Integer(modified)),
    ]
}

fn stored(value: &Json) -> Value {
    match value {
        Json::Null => Value::Null,
        Json::Bool(value) => Value::Integer(i64::from(*value)),
        Json::Number(number) => match number.as_i64() {
            Some(number) => Value::Integer(number),
            None => Value::Real(number.as_f64().unwrap_or(f64::MAX)),
        },
        Json::String(text) => Value::Text(text.clone()),
        Json::Array(bytes) => Value::Blob(bytes.iter().map(byte).collect()),
        Json::Object(object) => match object
            .get("blob")
            .and_then(Json::as_array)
            .map(Vec::as_slice)
        {
            Some([length, fill]) => {
                let length = length.as_u64().unwrap_or_default().min(1 << 16) as usize;
                Value::Blob(vec![byte(fill); length])
            }
            _ => Value::Null,
        },
    }
}

fn byte(value: &Json) -> u8 {
    value.as_u64().unwrap_or_default() as u8
}

/// Counts, lists, chooses from and cleans the catalogue.
fn used(catalogue: &Path) -> Outcome {
    let context = Context::default();
    let stats = catalogue::Stats {
        catalogue: catalogue.to_path_buf(),
        params: catalogue::Plain::default(),
    };
    let outcome = Outcome::of(&stats.run(&context));
    let list = catalogue::List {
        catalogue: catalogue.to_path_buf(),
        params: catalogue::ListParams { all: true },
    };
    let _ = list.run(&context);
    let mut limited = Context::default();
    limited.limits = limits::pictures();
    for preview in [true, false] {
        let sides = |across, down| mosaic::Sides {
            across,
            down: Some(down),
        };
        let params = mosaic::Params {
            tiles: sides(3, 2),
            tile_size: Some(sides(6, 5)),
            crop: Crop::Center,
            min_repeat_distance: 0.0,
            rounds: 1,
            preview,
            ..mosaic::Params::default()
        };
        let mosaic = mosaic::Mosaic {
            input: SHELF.photos[0].clone(),
            catalogue: catalogue.to_path_buf(),
            output: Some(SHELF.folder.path().join("mosaic.png")),
            deep_zoom: None,
            params,
        };
        let _ = mosaic.run(&limited);
    }
    for dry_run in [true, false] {
        let clean = catalogue::Clean {
            catalogue: catalogue.to_path_buf(),
            params: catalogue::CleanParams { dry_run },
        };
        let _ = clean.run(&context);
    }
    assert!(
        SHELF.photos.iter().all(|photo| photo.exists()),
        "a photo is gone"
    );
    outcome
}
