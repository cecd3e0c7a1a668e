//! Results of documents, computed beside the window.
//!
//! One worker thread a document. A new request cancels the one that is running; the last good picture stays until a newer one is
//! there. The results of edits are kept by what made them, so that a change of an edit computes this edit and later ones only.
//!
//! Guarantees: no call waits for the worker; a picture that is shown belongs to a request that was made, and pictures come in the
//! order of their requests.

mod cache;
mod evaluate;
mod frames;
mod shot;

use crate::analyses::AnalysisView;
use crate::content::{Content, View, Visible};
use crate::device::edit_context;
use crate::document::{Document, EditId, is_result_name};
use crate::painting::Painting;
use crate::shown::Shown;
use crate::worker::Worker;
use cache::Cache;
use evaluate::{Evaluated, evaluate};
use ravec::progress::{Progress, Update};
use ravec_jobs::Report;
use ravec_jobs::video::FramePlace;
use ravec_media::Picture;
use shot::OpenShots;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

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

/// A frame of a clip as the source of a request.
#[derive(Debug, Clone)]
pub struct SourceFrame {
    /// Its number and time.
    pub place: FramePlace,
    /// Its picture.
    pub picture: Arc<Picture>,
}

impl PartialEq for SourceFrame {
    /// Frames of one clip are equal if their numbers are.
    fn eq(&self, other: &Self) -> bool {
        self.place.number == other.place.number
    }
}

/// A document whose result is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// The document.
    pub document: Document,
    /// The frame of a clip that takes the place of the source.
    pub frame: Option<SourceFrame>,
    /// Stops by which results are shown brighter.
    pub exposure: f32,
    /// Analyses for the edits of a shot.
    pub analyses: AnalysisView,
}

impl Request {
    /// The result of a document whose source is a file.
    pub fn new(document: Document) -> Self {
        Self {
            document,
            frame: None,
            exposure: 0.0,
            analyses: AnalysisView::default(),
        }
    }
}

/// The input of an edit.
#[derive(Debug, Clone)]
pub struct EditInput {
    /// Text that changes with the content.
    pub key: Arc<str>,
    /// The content.
    pub content: Content,
}

/// State of the engine at a moment.
#[derive(Debug, Clone, Default)]
pub struct Snapshot {
    /// The last good result.
    pub result: Option<Visible>,
    /// Text that changes with the content of the last good result.
    pub key: Arc<str>,
    /// The source, as a canvas shows it.
    pub before: Option<View>,
    /// The inputs of the edits of the last good result, and of those that were run since.
    pub inputs: Arc<HashMap<EditId, EditInput>>,
    /// Reports of the edits of the last good result.
    pub reports: Arc<HashMap<EditId, Arc<Report>>>,
    /// Number of the frame of a clip that the result belongs to.
    pub frame: Option<u64>,
    /// Number of the request that it belongs to, from 1.
    pub serial: u64,
    /// True if a newer result was asked for and is not there.
    pub is_stale: bool,
    /// The work that is going on.
    pub busy: Option<Busy>,
    /// The error of the last request.
    pub failure: Option<Failure>,
}

impl Snapshot {
    /// The last good picture, as a screen shows it.
    pub fn shown(&self) -> Option<&Arc<Shown>> {
        self.result.as_ref()?.view.picture()
    }

    /// Columns and rows of the last good picture.
    pub fn size(&self) -> Option<[usize; 2]> {
        Some(self.shown()?.size())
    }
}

#[derive(Default)]
struct State {
    /// The request that the worker takes next.
    next: Option<(u64, Request)>,
    /// Number of the last request.
    asked: u64,
    running: Option<(Progress, Instant)>,
    update: Option<Update>,
    result: Option<Evaluated>,
    /// The request that the last good result belongs to.
    result_of: Option<Request>,
    /// The inputs of the edits of the last good result, and of those that were run since.
    inputs: Arc<HashMap<EditId, EditInput>>,
    serial: u64,
    failure: Option<Failure>,
    runs: u64,
    quits: bool,
}

impl State {
    /// The first edit that differs from those of the last good result, and its input.
    fn known_input(&self, request: &Request) -> Option<(EditId, EditInput)> {
        let (result, of) = (self.result.as_ref()?, self.result_of.as_ref()?);
        if of.document.source != request.document.source || of.frame != request.frame {
            return None;
        }
        let (mut done, mut wanted) = (of.document.links(), request.document.links());
        loop {
            let (done, wanted) = (done.next(), wanted.next()?);
            let input = match done {
                Some(done) if done == wanted => continue,
                Some(done) => self.inputs.get(&done.id)?.clone(),
                None => EditInput {
                    key: result.key.clone(),
                    content: result.visible.content.clone(),
                },
            };
            return Some((wanted.id, input));
        }
    }
}

struct Shared {
    state: Mutex<State>,
    wake: Condvar,
    /// The brush in the hand.
    painting: Arc<Mutex<Painting>>,
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
    _worker: Worker,
}

impl Engine {
    /// An idle engine. `repaint` is called, from another thread, when there is something new.
    pub fn new(repaint: impl Fn() + Send + Sync + 'static) -> Self {
        let shared = Arc::new(Shared {
            state: Mutex::default(),
            wake: Condvar::new(),
            painting: Arc::default(),
            repaint: Box::new(repaint),
        });
        let own = shared.clone();
        Self {
            shared,
            _worker: Worker::start("worker", move || work(&own)),
        }
    }

    /// Asks for a result, in place of all earlier requests; the number of the request.
    pub fn request(&self, request: Request) -> u64 {
        let mut state = self.shared.state();
        if let Some((edit, input)) = state.known_input(&request) {
            Arc::make_mut(&mut state.inputs).insert(edit, input);
        }
        state.asked += 1;
        let serial = state.asked;
        state.next = Some((serial, request));
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
        let result = state.result.clone();
        let result = result.as_ref();
        Snapshot {
            result: result.map(|result| result.visible.clone()),
            key: result.map_or_else(|| "".into(), |result| result.key.clone()),
            before: result.and_then(|result| result.before.clone()),
            inputs: state.inputs.clone(),
            reports: result
                .map(|result| result.reports.clone())
                .unwrap_or_default(),
            frame: result.and_then(|result| result.frame),
            serial: state.serial,
            is_stale: state.serial < state.asked,
            busy,
            failure: state.failure.clone(),
        }
    }

    /// True while a request waits or is worked on.
    pub fn is_busy(&self) -> bool {
        let state = self.shared.state();
        state.next.is_some() || state.running.is_some()
    }

    /// Number of operations that were run, to see what the cache saves.
    pub fn runs(&self) -> u64 {
        self.shared.state().runs
    }

    /// Number of the last request, and of the one that the last result or failure belongs to.
    pub(crate) fn counts(&self) -> [u64; 2] {
        let state = self.shared.state();
        [state.asked, state.serial]
    }

    /// The brush in the hand, which the assistant moves.
    pub(crate) fn painting(&self) -> Arc<Mutex<Painting>> {
        self.shared.painting.clone()
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
    }
}

/// Takes requests until the engine is dropped.
fn work(shared: &Arc<Shared>) {
    let mut cache = Cache::default();
    let mut shots = OpenShots::default();
    loop {
        let (serial, request, progress) = {
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
            let Some((serial, request)) = state.next.take() else {
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
            (serial, request, progress)
        };
        let outcome = evaluate(
            &request,
            &progress,
            &mut cache,
            &mut shots,
            &shared.painting,
            |edit, input| {
                let mut state = shared.state();
                state.runs += 1;
                Arc::make_mut(&mut state.inputs).insert(edit, input.clone());
                drop(state);
                (shared.repaint)();
            },
        );
        let mut state = shared.state();
        state.running = None;
        match outcome {
            Ok(result) => {
                state.inputs = result.inputs.clone();
                state.result_of = Some(request);
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

pub(crate) use cache::source_key;
pub(crate) use evaluate::{RunError, files_key, run_in_memory};
pub(crate) use frames::{FrameStream, input_rate};
pub(crate) use shot::ShotEdit;

/// The value behind a lock, also after a panic of another thread.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs the recipe of a document as `ravec run` does, and writes `output`: the same bytes. Gives the files that were written,
/// which are more where edits have files of their own, such as tracks.
///
/// # Errors
/// One sentence.
pub fn export(
    document: &Document,
    output: &Path,
    progress: &Progress,
) -> Result<Vec<PathBuf>, String> {
    let recipe = document.recipe(output).map_err(|error| error.to_string())?;
    if recipe.steps.is_empty() {
        return Err("there is no edit to export".to_owned());
    }
    let context = edit_context(progress).with_intermediates();
    let mut written = Vec::new();
    for step in &recipe.steps {
        let report = step
            .operation()
            .run(&context)
            .map_err(|error| error.to_string())?;
        let files = report.outputs.iter().map(|file| PathBuf::from(&file.path));
        written.extend(files.filter(|path| !is_result_name(path)));
    }
    Ok(written)
}

#[cfg(test)]
#[allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]
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
        let [width, height] = snapshot.size().unwrap();
        (width, height)
    }

    #[test]
    fn a_change_computes_what_follows_from_it_only() {
        let folder = tempfile::tempdir().unwrap();
        let engine = Engine::new(|| {});
        let mut document = document(folder.path());
        engine.request(Request::new(document.clone()));
        engine.wait();
        assert_eq!(size_of(&engine.snapshot()), (32, 48));
        assert_eq!(engine.runs(), 2);
        let second = document.edits[1].with_param("sizes", json!(["75%x100%"]));
        document.replace(second);
        let serial = engine.request(Request::new(document.clone()));
        engine.wait();
        let snapshot = engine.snapshot();
        assert_eq!((size_of(&snapshot), snapshot.serial), ((48, 48), serial));
        assert_eq!(engine.runs(), 3);
        // back to what is known already
        document.edits.pop();
        engine.request(Request::new(document));
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
            engine.request(Request::new(document.clone()));
        }
        engine.wait();
        assert_eq!(size_of(&engine.snapshot()), (32, 48));
        let wrong = document.edits[1].with_param("saliency", json!(7));
        document.replace(wrong);
        engine.request(Request::new(document.clone()));
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
        engine.request(Request::new(Document::new("no/such.png")));
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
        ravec_jobs::Operation::run(&run, &ravec_jobs::Context::default()).unwrap();
        assert_eq!(
            std::fs::read(first).unwrap(),
            std::fs::read(second).unwrap()
        );
    }
}
