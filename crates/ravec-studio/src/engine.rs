//! Results of documents, computed beside the window.
//!
//! One worker thread a document. A new request cancels the one that is running; the last good picture stays until a newer one is
//! there. The results of edits are kept by what made them, so that a change of an edit computes this edit and later ones only.
//!
//! Guarantees: no call waits for the worker; a picture that is shown belongs to a request that was made, and pictures come in the
//! order of their requests.

use crate::document::{Document, Edit, EditId, result_name};
use crate::shown::Shown;
use ravec::progress::{Progress, Update};
use ravec_jobs::{Context, JobError};
use ravec_media::Picture;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Bytes of pixels that are kept in the cache.
const CACHE_BYTES: usize = 1 << 30;

/// An error of a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// The edit that failed; `None` if the source cannot be read.
    pub edit: Option<EditId>,
    /// One sentence.
    pub message: String,
}

/// Work that is going on.
#[derive(Debug, Clone, PartialEq)]
pub struct Busy {
    /// Phase of the work.
    pub phase: &'static str,
    /// Share of the phase that is done, 0 to 1.
    pub fraction: f64,
    /// Time since the request.
    pub elapsed: Duration,
}

/// State of the engine at a moment.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    /// The last good picture.
    pub picture: Option<Arc<Picture>>,
    /// The same, as a screen shows it.
    pub shown: Option<Arc<Shown>>,
    /// The source, as a screen shows it.
    pub before: Option<Arc<Shown>>,
    /// Columns and rows of the inputs of the edits.
    pub input_sizes: HashMap<EditId, [usize; 2]>,
    /// Number of the request that it belongs to, from 1.
    pub serial: u64,
    /// True if a newer picture was asked for and is not there.
    pub is_stale: bool,
    /// The work that is going on.
    pub busy: Option<Busy>,
    /// The error of the last request.
    pub failure: Option<Failure>,
}

#[derive(Default)]
struct State {
    /// The request that the worker takes next.
    next: Option<(u64, Document)>,
    /// Number of the last request.
    asked: u64,
    running: Option<(Progress, Instant)>,
    update: Option<Update>,
    result: Option<Evaluated>,
    serial: u64,
    failure: Option<Failure>,
    runs: u64,
    quits: bool,
}

struct Shared {
    state: Mutex<State>,
    wake: Condvar,
    /// Called when there is something new to show.
    repaint: Box<dyn Fn() + Send + Sync>,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Computes the results of one document.
pub struct Engine {
    shared: Arc<Shared>,
    worker: Option<JoinHandle<()>>,
}

impl Engine {
    /// An idle engine. `repaint` is called, from another thread, when there is something new.
    pub fn new(repaint: impl Fn() + Send + Sync + 'static) -> Self {
        let shared = Arc::new(Shared {
            state: Mutex::default(),
            wake: Condvar::new(),
            repaint: Box::new(repaint),
        });
        let own = shared.clone();
        let worker = std::thread::Builder::new().name("worker".to_owned());
        Self {
            shared,
            // without a thread nothing is computed, and the window still works
            worker: worker.spawn(move || work(&own)).ok(),
        }
    }

    /// Asks for the result of a document, in place of all earlier requests; the number of the request.
    pub fn request(&self, document: Document) -> u64 {
        let mut state = self.shared.state();
        state.asked += 1;
        let serial = state.asked;
        state.next = Some((serial, document));
        if let Some((progress, _)) = &state.running {
            progress.cancel();
        }
        self.shared.wake.notify_all();
        serial
    }

    /// Stops the work that is going on. The last good picture stays.
    pub fn cancel(&self) {
        let mut state = self.shared.state();
        state.next = None;
        if let Some((progress, _)) = &state.running {
            progress.cancel();
        }
    }

    /// The state now.
    pub fn snapshot(&self) -> Snapshot {
        let state = self.shared.state();
        let busy = state.running.as_ref().map(|(_, since)| Busy {
            phase: state.update.map_or("", |update| update.phase),
            fraction: state.update.map_or(0.0, |update| update.fraction()),
            elapsed: since.elapsed(),
        });
        Snapshot {
            picture: state.result.as_ref().map(|result| result.picture.clone()),
            shown: state.result.as_ref().map(|result| result.shown.clone()),
            before: state
                .result
                .as_ref()
                .and_then(|result| result.before.clone()),
            input_sizes: state
                .result
                .as_ref()
                .map(|result| result.input_sizes.clone())
                .unwrap_or_default(),
            serial: state.serial,
            is_stale: state.serial < state.asked,
            busy,
            failure: state.failure.clone(),
        }
    }

    /// Number of operations that were run, to see what the cache saves.
    pub fn runs(&self) -> u64 {
        self.shared.state().runs
    }

    /// Waits until nothing is asked for or going on: for tests and exports.
    pub fn wait(&self) {
        let mut state = self.shared.state();
        while state.next.is_some() || state.running.is_some() {
            let pause = Duration::from_millis(20);
            let waited = self.shared.wake.wait_timeout(state, pause);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        self.shared.state().quits = true;
        self.cancel();
        self.shared.wake.notify_all();
        if let Some(worker) = self.worker.take() {
            // a panic of the worker was reported where it happened
            let _ = worker.join();
        }
    }
}

/// Takes requests until the engine is dropped.
fn work(shared: &Arc<Shared>) {
    let mut cache = Cache::default();
    loop {
        let (serial, document, progress) = {
            let mut state = shared.state();
            while state.next.is_none() && !state.quits {
                state = shared
                    .wake
                    .wait(state)
                    .unwrap_or_else(PoisonError::into_inner);
            }
            if state.quits {
                return;
            }
            let Some((serial, document)) = state.next.take() else {
                continue;
            };
            let sink = Arc::downgrade(shared);
            let progress = Progress::new(move |update| {
                if let Some(shared) = sink.upgrade() {
                    shared.state().update = Some(update);
                    (shared.repaint)();
                }
            });
            state.running = Some((progress.clone(), Instant::now()));
            state.update = None;
            (serial, document, progress)
        };
        let outcome = evaluate(&document, &progress, &mut cache, || {
            shared.state().runs += 1;
        });
        let mut state = shared.state();
        state.running = None;
        match outcome {
            Ok(result) => {
                state.result = Some(result);
                state.serial = serial;
                state.failure = None;
            }
            Err(None) => {}
            Err(Some(failure)) => {
                state.serial = serial;
                state.failure = Some(failure);
            }
        }
        drop(state);
        shared.wake.notify_all();
        (shared.repaint)();
    }
}

/// The result of a document.
#[derive(Clone)]
struct Evaluated {
    picture: Arc<Picture>,
    shown: Arc<Shown>,
    before: Option<Arc<Shown>>,
    input_sizes: HashMap<EditId, [usize; 2]>,
}

fn size_of(picture: &Picture) -> [usize; 2] {
    let size = picture.image.size();
    [size.width(), size.height()]
}

/// The result of a document; no failure for a cancelled run.
fn evaluate(
    document: &Document,
    progress: &Progress,
    cache: &mut Cache,
    mut on_run: impl FnMut(),
) -> Result<Evaluated, Option<Failure>> {
    let edits: Vec<&Arc<Edit>> = document.enabled().collect();
    // what the results behind each edit are made by
    let mut keys = vec![source_key(&document.source)];
    for edit in &edits {
        let fields = serde_json::to_string(&edit.fields).unwrap_or_default();
        let before = &keys[keys.len() - 1];
        keys.push(format!("{before}\n{} {fields}", edit.operation));
    }
    let known = (0..keys.len())
        .rev()
        .find_map(|k| Some((k, cache.get(&keys[k])?)));
    let (mut done, mut result) = if let Some(known) = known {
        known
    } else {
        let limits = Context::new(progress).limits;
        let read = ravec_media::read(&document.source, &limits);
        let picture = Arc::new(read.map_err(|error| {
            Some(Failure {
                edit: None,
                message: error.to_string(),
            })
        })?);
        let result = Cached::new(picture);
        cache.insert(&keys[0], result.clone());
        (0, result)
    };
    while done < edits.len() {
        let edit = edits[done];
        on_run();
        let failed = |message: String| {
            Some(Failure {
                edit: Some(edit.id),
                message,
            })
        };
        let picture = match run(edit, &result.picture, progress) {
            Ok(picture) => Arc::new(picture),
            Err(RunError::Edit(reason)) => return Err(failed(reason)),
            Err(RunError::Job(JobError::Cancelled)) => return Err(None),
            Err(RunError::Job(error)) => return Err(failed(error.to_string())),
        };
        done += 1;
        result = Cached::new(picture);
        cache.insert(&keys[done], result.clone());
    }
    let sizes = edits
        .iter()
        .zip(&keys)
        .filter_map(|(edit, key)| Some((edit.id, cache.get(key)?)));
    let input_sizes = sizes
        .map(|(id, input)| (id, size_of(&input.picture)))
        .collect();
    Ok(Evaluated {
        picture: result.picture,
        shown: result.shown,
        before: cache.get(&keys[0]).map(|source| source.shown),
        input_sizes,
    })
}

enum RunError {
    Edit(String),
    Job(JobError),
}

/// Runs one edit in memory.
fn run(edit: &Edit, input: &Picture, progress: &Progress) -> Result<Picture, RunError> {
    let (from, to) = (result_name(0), result_name(1));
    let step = edit.step(&from, &to).map_err(RunError::Edit)?;
    let context = Context::new(progress).with_intermediates();
    context.insert_picture(&from, input.clone());
    step.operation().run(&context).map_err(RunError::Job)?;
    context.picture(&to).map_err(RunError::Job)
}

/// Text that changes with the content of a file: its name, length and time.
fn source_key(path: &Path) -> String {
    let data = std::fs::metadata(path).ok();
    let length = data.as_ref().map(std::fs::Metadata::len);
    let modified = data.and_then(|data| data.modified().ok());
    format!("{} {length:?} {modified:?}", path.display())
}

/// Pictures by what made them, the ones that were used last.
#[derive(Default)]
struct Cache {
    entries: HashMap<String, Cached>,
    bytes: usize,
    clock: u64,
}

#[derive(Clone)]
struct Cached {
    picture: Arc<Picture>,
    shown: Arc<Shown>,
    bytes: usize,
    used: u64,
}

impl Cached {
    fn new(picture: Arc<Picture>) -> Self {
        let bytes = ravec::raster::with_image!(&picture.image, image => std::mem::size_of_val(image.pixels()));
        let shown = Arc::new(Shown::new(&picture.image));
        let drawn: usize = shown
            .levels
            .iter()
            .map(|level| 4 * level.pixels.len())
            .sum();
        Self {
            picture,
            shown,
            bytes: bytes + drawn,
            used: 0,
        }
    }
}

impl Cache {
    fn get(&mut self, key: &str) -> Option<Cached> {
        self.clock += 1;
        let cached = self.entries.get_mut(key)?;
        cached.used = self.clock;
        Some(cached.clone())
    }

    fn insert(&mut self, key: &str, cached: Cached) {
        self.clock += 1;
        self.bytes += cached.bytes;
        let used = self.clock;
        if let Some(replaced) = self
            .entries
            .insert(key.to_owned(), Cached { used, ..cached })
        {
            self.bytes -= replaced.bytes;
        }
        while self.bytes > CACHE_BYTES && self.entries.len() > 1 {
            let oldest = self.entries.iter().min_by_key(|(_, cached)| cached.used);
            let Some(key) = oldest.map(|(key, _)| key.clone()) else {
                break;
            };
            if let Some(removed) = self.entries.remove(&key) {
                self.bytes -= removed.bytes;
            }
        }
    }
}

/// Runs the recipe of a document as `ravec run` does, and writes `output`: the same bytes.
///
/// # Errors
/// One sentence.
pub fn export(document: &Document, output: &Path, progress: &Progress) -> Result<PathBuf, String> {
    let recipe = document.recipe(output).map_err(|error| error.to_string())?;
    if recipe.steps.is_empty() {
        return Err("there is no edit to export".to_owned());
    }
    let context = Context::new(progress).with_intermediates();
    for step in &recipe.steps {
        step.operation()
            .run(&context)
            .map_err(|error| error.to_string())?;
    }
    Ok(output.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{AnyImage, Image, Size, Srgb};
    use serde_json::{Map, Value, json};

    fn photo(folder: &Path) -> PathBuf {
        let size = Size::new(64, 48).unwrap();
        let image: Image<Srgb<u8>> = Image::from_fn(size, |col, row| {
            Srgb([(3 * col) as u8, (4 * row) as u8, 90])
        });
        let path = folder.join("photo.png");
        let picture = Picture::from_image(AnyImage::from(image));
        ravec_media::write(&path, &picture, &ravec_media::WriteOptions::default()).unwrap();
        path
    }

    fn params(params: Value) -> Map<String, Value> {
        let mut fields = Map::new();
        fields.insert("params".to_owned(), params);
        fields
    }

    fn document(folder: &Path) -> Document {
        let mut document = Document::new(photo(folder));
        let mut clean = params(json!({"mode": "smooth"}));
        clean.insert("everywhere".to_owned(), true.into());
        document.push("brush", clean);
        document.push("retarget", params(json!({"sizes": ["50%x100%"]})));
        document
    }

    fn size_of(snapshot: &Snapshot) -> (usize, usize) {
        let size = snapshot.picture.as_ref().unwrap().image.size();
        (size.width(), size.height())
    }

    #[test]
    fn a_change_computes_what_follows_from_it_only() {
        let folder = tempfile::tempdir().unwrap();
        let engine = Engine::new(|| {});
        let mut document = document(folder.path());
        engine.request(document.clone());
        engine.wait();
        assert_eq!(size_of(&engine.snapshot()), (32, 48));
        assert_eq!(engine.runs(), 2);
        let second = document.edits[1].with_param("sizes", json!(["75%x100%"]));
        document.replace(second);
        let serial = engine.request(document.clone());
        engine.wait();
        let snapshot = engine.snapshot();
        assert_eq!((size_of(&snapshot), snapshot.serial), ((48, 48), serial));
        assert_eq!(engine.runs(), 3);
        // back to what is known already
        document.edits.pop();
        engine.request(document);
        engine.wait();
        assert_eq!(size_of(&engine.snapshot()), (64, 48));
        assert_eq!(engine.runs(), 3);
    }

    #[test]
    fn the_last_request_wins_and_the_last_good_picture_stays() {
        let folder = tempfile::tempdir().unwrap();
        let engine = Engine::new(|| {});
        let mut document = document(folder.path());
        for percent in [90, 80, 70, 60, 50] {
            let edit = document.edits[1].with_param("sizes", json!([format!("{percent}%x100%")]));
            document.replace(edit);
            engine.request(document.clone());
        }
        engine.wait();
        assert_eq!(size_of(&engine.snapshot()), (32, 48));
        let wrong = document.edits[1].with_param("saliency", json!(7));
        document.replace(wrong);
        engine.request(document.clone());
        engine.wait();
        let snapshot = engine.snapshot();
        assert_eq!(size_of(&snapshot), (32, 48));
        let failure = snapshot.failure.unwrap();
        assert_eq!(failure.edit, Some(document.edits[1].id));
        assert!(failure.message.contains("saliency"), "{}", failure.message);
    }

    #[test]
    fn a_source_that_is_missing_is_an_error() {
        let engine = Engine::new(|| {});
        engine.request(Document::new("no/such.png"));
        engine.wait();
        let failure = engine.snapshot().failure.unwrap();
        assert_eq!(failure.edit, None);
        assert!(failure.message.contains("such.png"), "{}", failure.message);
    }

    #[test]
    fn an_export_has_the_bytes_of_the_recipe() {
        let folder = tempfile::tempdir().unwrap();
        let document = document(folder.path());
        let (first, second) = (folder.path().join("a.png"), folder.path().join("b.png"));
        export(&document, &first, &Progress::none()).unwrap();
        let recipe = folder.path().join("recipe.json");
        std::fs::write(
            &recipe,
            document.recipe(&second).unwrap().to_json().unwrap(),
        )
        .unwrap();
        let run = ravec_jobs::recipe::Run {
            file: recipe,
            params: ravec_jobs::recipe::Params::default(),
        };
        ravec_jobs::Operation::run(&run, &Context::default()).unwrap();
        assert_eq!(
            std::fs::read(first).unwrap(),
            std::fs::read(second).unwrap()
        );
    }
}
