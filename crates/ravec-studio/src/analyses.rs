//! Tracks, plates, strokes and deformations of a clip, found beside the window: what edits need before they can show a frame.
//!
//! One thread a document goes through its analyses in their order, whenever they change, and runs those whose result is not known. A
//! change of the analysis that is running stops it; a change of later ones does not.
//!
//! Of a plate the result is its picture, of a track its file, both kept in memory under names of their own. A matte is not
//! written for the whole clip: its strokes are carried through it, and then any frame has its matte in a moment.

use crate::clip_forms::{self, ClipForms, forms_key};
use crate::document::{Document, Edit, EditId, is_result_name};
use crate::engine::{RunError, lock, source_key};
use crate::tools::measure_key;
use crate::tracking::Tracking;
use crate::worker::Worker;
use ravec::progress::{Progress, Update};
use ravec::raster::Size;
use ravec_jobs::matte::{FrameMattes, Spread};
use ravec_jobs::track::Track;
use ravec_jobs::{Context, JobError, Report, Step};
use ravec_media::Picture;
use ravec_video::FrameSource as _;
use serde_json::Value;
use std::cell::Cell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Pause between looks at a track that is measured for the canvas.
const LOOK: Duration = Duration::from_millis(30);

/// Pause between looks of the canvas at deformations that are settled.
const LOOK_FORMS: Duration = Duration::from_millis(250);

/// Pause after a change before it is carried through the shot.
const PAUSE: Duration = Duration::from_millis(400);

/// Result of an analysis.
#[derive(Clone)]
pub(crate) struct Found {
    /// Text that changes with the result.
    pub key: Arc<str>,
    /// Text that changes with the result, but not with strokes.
    pub unmarked: Arc<str>,
    /// Name of a track or a plate in the context of the [view](AnalysisView).
    name: PathBuf,
    /// The matte of any frame.
    pub mattes: Option<FrameMattes>,
    /// The deformations of frames, which are settled one after the other.
    pub forms: Option<Arc<ClipForms>>,
}

/// State of an analysis.
#[derive(Clone)]
pub(crate) enum AnalysisState {
    /// Its turn has not come, or it needs a result that is not there.
    Waiting,
    /// It runs: the phase, and its share that is done.
    Running(&'static str, f64),
    /// It has a result, with these warnings.
    Done(Vec<String>),
    /// It has none, for this reason.
    Failed(String),
}

/// Results that are there, for edits that need them.
#[derive(Clone)]
pub struct AnalysisView {
    version: u64,
    context: Context,
    /// By the output that the document gives them.
    results: Arc<HashMap<PathBuf, Found>>,
}

impl Default for AnalysisView {
    fn default() -> Self {
        Self {
            version: 0,
            context: Context::default().with_intermediates(),
            results: Arc::default(),
        }
    }
}

impl PartialEq for AnalysisView {
    /// Views of one document are equal if their versions are.
    fn eq(&self, other: &Self) -> bool {
        self.version == other.version
    }
}

impl std::fmt::Debug for AnalysisView {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "AnalysisView({})", self.version)
    }
}

impl AnalysisView {
    /// The context of the results, with another progress.
    pub(crate) fn context(&self, progress: &Progress) -> Context {
        let mut context = self.context.clone();
        context.progress = progress.clone();
        context
    }

    /// An edit whose paths lead to the results.
    ///
    /// # Errors
    /// The output of an analysis that is not there yet.
    pub(crate) fn resolved(&self, edit: &Edit, document: &Document) -> Result<Resolved, PathBuf> {
        let outputs: Vec<&str> = (document.enabled())
            .filter(|edit| edit.is_analysis())
            .flat_map(|edit| edit.output().into_iter().chain(edit.regions_output()))
            .collect();
        let mut resolved = Resolved {
            edit: edit.clone(),
            mattes: None,
            keys: String::new(),
        };
        let fields = resolved.edit.fields.iter_mut();
        for (_, value) in fields.filter(|(name, _)| !edit.is_output(name)) {
            let Some(path) = value.as_str().map(PathBuf::from) else {
                continue;
            };
            if let Some(found) = self.results.get(&path) {
                resolved.keys.push_str(&found.key);
                resolved.keys.push('\n');
                resolved.mattes = found.mattes.clone().or(resolved.mattes);
                *value = found.name.to_string_lossy().into_owned().into();
            } else if is_result_name(&path)
                || outputs.iter().any(|output| Path::new(output) == path)
            {
                return Err(path);
            }
        }
        Ok(resolved)
    }

    /// The picture of a plate, by its output in the document.
    pub(crate) fn picture(&self, output: &Path) -> Option<Arc<Picture>> {
        let found = self.results.get(output)?;
        self.context.picture(&found.name).ok().map(Arc::new)
    }

    /// The result of an edit.
    pub(crate) fn found(&self, edit: &Edit) -> Option<&Found> {
        self.results.get(&output_of(edit))
    }
}

/// An edit whose paths lead to results.
pub(crate) struct Resolved {
    pub edit: Edit,
    /// The matte, if it is one that is found frame by frame.
    pub mattes: Option<FrameMattes>,
    /// Keys of all results.
    pub keys: String,
}

#[derive(Default)]
struct State {
    /// The document that is to be looked at next.
    wanted: Option<Document>,
    /// The document that was given last.
    given: Option<Document>,
    states: HashMap<EditId, AnalysisState>,
    running: Option<(EditId, Progress)>,
    view: AnalysisView,
    /// True while the worker is on its way through a document.
    works: bool,
    quits: bool,
}

struct Shared {
    state: Mutex<State>,
    wake: Condvar,
    repaint: Arc<dyn Fn() + Send + Sync>,
}

/// Runs the analyses of one document.
pub(crate) struct Analyses {
    shared: Arc<Shared>,
    _worker: Worker,
}

/// True for an edit whose result is found here. A matte without an output of its own is one: the clip becomes its foreground. So is
/// retargeting, whose deformations depend on all frames.
fn is_found(edit: &Edit) -> bool {
    edit.is_analysis() || matches!(edit.operation.as_str(), "matte" | "retarget")
}

/// All that an analysis gives to other edits, by its names in the document: the result, and the map of planes of a plate.
fn outputs_of(edit: &Edit) -> impl Iterator<Item = PathBuf> + use<> {
    let regions = edit.regions_output().map(PathBuf::from);
    std::iter::once(output_of(edit)).chain(regions)
}

/// The output of an analysis in a document, or a name for the result of an edit without one.
fn output_of(edit: &Edit) -> PathBuf {
    edit.output()
        .map_or_else(|| format!("@found-{}", edit.id).into(), PathBuf::from)
}

/// The edits up to and including one, as far as they are not passed over.
fn up_to(document: &Document, id: EditId) -> Vec<&Arc<Edit>> {
    let mut found: Vec<_> = document.enabled().collect();
    let end = found.iter().position(|edit| edit.id == id);
    found.truncate(end.map_or(0, |end| end + 1));
    found
}

impl Analyses {
    /// Idle. `repaint` is called, from another thread, when there is something new.
    pub fn new(tracking: Arc<Tracking>, repaint: Arc<dyn Fn() + Send + Sync>) -> Self {
        let shared = Arc::new(Shared {
            state: Mutex::default(),
            wake: Condvar::new(),
            repaint,
        });
        let own = shared.clone();
        Self {
            shared,
            _worker: Worker::start("analyses", move || work(&own, &tracking)),
        }
    }

    /// Looks at a document, unless it is the one that was given last.
    pub fn update(&self, document: &Document) {
        let mut state = lock(&self.shared.state);
        if state.given.as_ref() == Some(document) {
            return;
        }
        if let Some((id, progress)) = &state.running
            && let Some(given) = &state.given
            && (given.source != document.source || up_to(given, *id) != up_to(document, *id))
        {
            progress.cancel();
        }
        state.given = Some(document.clone());
        state.wanted = Some(document.clone());
        self.shared.wake.notify_all();
    }

    /// Stops the analysis that is running; it stays without a result until it changes or is made [again](Self::again).
    pub fn stop(&self) {
        let state = lock(&self.shared.state);
        if let Some((_, progress)) = &state.running {
            progress.cancel();
        }
    }

    /// Runs analyses without a result once more.
    pub fn again(&self) {
        let mut state = lock(&self.shared.state);
        let failed = |state: &AnalysisState| matches!(state, AnalysisState::Failed(_));
        state.states.retain(|_, known| !failed(known));
        let given = state.given.clone();
        state.wanted = given;
        self.shared.wake.notify_all();
    }

    /// The state of an analysis.
    pub fn state(&self, id: EditId) -> AnalysisState {
        let state = lock(&self.shared.state);
        let known = state.states.get(&id).cloned();
        known.unwrap_or(AnalysisState::Waiting)
    }

    /// The results that are there.
    pub fn view(&self) -> AnalysisView {
        lock(&self.shared.state).view.clone()
    }

    /// True while an analysis runs or is about to.
    pub fn is_busy(&self) -> bool {
        let state = lock(&self.shared.state);
        state.wanted.is_some() || state.works
    }
}

impl Drop for Analyses {
    fn drop(&mut self) {
        let mut state = lock(&self.shared.state);
        state.quits = true;
        if let Some((_, progress)) = &state.running {
            progress.cancel();
        }
        self.shared.wake.notify_all();
    }
}

/// Goes through documents until the analyses are dropped.
fn work(shared: &Arc<Shared>, tracking: &Tracking) {
    // keys of runs that failed, so that these are not tried again and again
    let mut failed: HashMap<EditId, Arc<str>> = HashMap::new();
    loop {
        let document = {
            let mut state = lock(&shared.state);
            while state.wanted.is_none() && !state.quits {
                let woken = shared.wake.wait(state);
                state = woken.unwrap_or_else(PoisonError::into_inner);
            }
            if state.quits {
                return;
            }
            state.works = true;
            state.wanted.take()
        };
        if let Some(document) = document {
            go_through(shared, tracking, &document, &mut failed);
        }
        lock(&shared.state).works = false;
        (shared.repaint)();
    }
}

/// Runs the analyses of a document whose results are not known, until a newer document is there.
fn go_through(
    shared: &Arc<Shared>,
    tracking: &Tracking,
    document: &Document,
    failed: &mut HashMap<EditId, Arc<str>>,
) {
    let analyses = document.enabled().filter(|edit| is_found(edit));
    let analyses: Vec<_> = analyses.cloned().collect();
    {
        let mut state = lock(&shared.state);
        let ids: Vec<EditId> = analyses.iter().map(|edit| edit.id).collect();
        state.states.retain(|id, _| ids.contains(id));
        let outputs: Vec<_> = analyses.iter().flat_map(|edit| outputs_of(edit)).collect();
        let mut results = HashMap::clone(&state.view.results);
        results.retain(|path, _| outputs.contains(path));
        publish(&mut state, results);
    }
    for edit in &analyses {
        if lock(&shared.state).wanted.is_some() {
            return;
        }
        let outcome = if edit.operation == "retarget" {
            find_forms(shared, document, edit, failed)
        } else {
            run(shared, tracking, document, edit, failed)
        };
        let mut state = lock(&shared.state);
        state.running = None;
        let mut results = HashMap::clone(&state.view.results);
        let outputs = outputs_of(edit);
        match outcome {
            Outcome::Known => continue,
            Outcome::Found(found, warnings) => {
                results.extend(outputs.zip(found));
                let done = AnalysisState::Done(warnings);
                state.states.insert(edit.id, done);
            }
            Outcome::Waits => {
                outputs.for_each(|output| drop(results.remove(&output)));
                state.states.insert(edit.id, AnalysisState::Waiting);
            }
            Outcome::Later => {
                state.states.insert(edit.id, AnalysisState::Waiting);
            }
            Outcome::Failed(reason) => {
                outputs.for_each(|output| drop(results.remove(&output)));
                state.states.insert(edit.id, AnalysisState::Failed(reason));
            }
        }
        publish(&mut state, results);
        drop(state);
        (shared.repaint)();
    }
}

fn publish(state: &mut State, results: HashMap<PathBuf, Found>) {
    let same = results.len() == state.view.results.len()
        && results.iter().all(|(path, found)| {
            let known = state.view.results.get(path);
            known.is_some_and(|known| known.key == found.key)
        });
    if !same {
        state.view.version += 1;
        state.view.results = Arc::new(results);
    }
}

enum Outcome {
    /// The result is that of an earlier run.
    Known,
    /// The result, after it that of the map of planes, and warnings.
    Found(Vec<Found>, Vec<String>),
    /// Something that it needs is not there.
    Waits,
    /// A newer document is on its way. The last result stays.
    Later,
    Failed(String),
}

/// An analysis with the names that its results have in the context of the view.
struct Job {
    step: Step,
    /// Of the result, and of the map of planes.
    names: Vec<PathBuf>,
    key: Arc<str>,
    unmarked: Arc<str>,
}

impl Job {
    fn new(edit: &Edit, resolved: Resolved, document: &Document) -> Result<Self, String> {
        let name = match edit.operation.as_str() {
            "track" => format!("@analysis-{}.json", edit.id),
            _ => format!("@analysis-{}", edit.id),
        };
        let mut mapped = resolved.edit;
        let mut names = vec![PathBuf::from(&name)];
        mapped.fields.insert("output".to_owned(), name.into());
        if edit.regions_output().is_some() {
            let regions = format!("@analysis-{}-regions", edit.id);
            names.push(PathBuf::from(&regions));
            mapped.fields.insert("regions".to_owned(), regions.into());
        }
        let step = mapped.step(&document.source, &names[0])?;
        let files = (step.operation().inputs().into_iter())
            .filter(|path| !is_result_name(path))
            .map(|path| source_key(path, None));
        let files: Vec<String> = files.collect();
        let rest = format!("{}\n{}", resolved.keys, files.join("\n"));
        let key_of = |edit: &Edit| -> Arc<str> {
            let fields = serde_json::to_string(&edit.fields).unwrap_or_default();
            format!("{fields}\n{rest}").into()
        };
        Ok(Self {
            step,
            names,
            key: key_of(&mapped),
            unmarked: key_of(&mapped.with_param("marks", Value::Null)),
        })
    }

    /// The results, in the order of their names.
    fn found(&self, mattes: Option<&FrameMattes>) -> Vec<Found> {
        let found = |name: &PathBuf| Found {
            key: self.key.clone(),
            unmarked: self.unmarked.clone(),
            name: name.clone(),
            mattes: mattes.cloned(),
            forms: None,
        };
        self.names.iter().map(found).collect()
    }
}

/// Runs one analysis, unless its result is known.
fn run(
    shared: &Arc<Shared>,
    tracking: &Tracking,
    document: &Document,
    edit: &Arc<Edit>,
    failed: &mut HashMap<EditId, Arc<str>>,
) -> Outcome {
    let before = document
        .edits
        .iter()
        .take_while(|other| other.id != edit.id);
    let is_link = |edit: &&Arc<Edit>| edit.enabled && !edit.is_analysis();
    if before.filter(is_link).count() > 0 {
        return Outcome::Failed(
            "this edit looks at the clip as it was opened: move it before the others".to_owned(),
        );
    }
    let view = lock(&shared.state).view.clone();
    let Ok(resolved) = view.resolved(&edit.without_side_outputs(), document) else {
        return Outcome::Waits;
    };
    let job = match Job::new(edit, resolved, document) {
        Ok(job) => job,
        Err(reason) => return Outcome::Failed(reason),
    };
    let is_known = |output: PathBuf| {
        let known = view.results.get(&output);
        known.is_some_and(|known| known.key == job.key)
    };
    if outputs_of(edit).all(is_known) {
        return Outcome::Known;
    }
    if let Some(reason) = known_failure(shared, edit.id, &job.key, failed) {
        return Outcome::Failed(reason);
    }
    if edit.operation == "matte" && !pause(shared) {
        return Outcome::Later;
    }
    let progress = begin(shared, edit.id);
    let context = view.context(&progress);
    let done = match &job.step {
        Step::Track(track) => {
            tracked(track, edit, tracking, &job.names[0], &context).map(|()| (None, Vec::new()))
        }
        Step::Matte(matte) => size_of(document, &context).and_then(|size| {
            let mut report = Report::new("matte", &());
            let mattes = FrameMattes::open(matte, size, Spread::Clip, &mut report, &context)?;
            Ok((Some(mattes), report.warnings))
        }),
        step => {
            let report = step.operation().run(&context);
            report.map(|report| (None, report.warnings))
        }
    };
    match done {
        Ok((mattes, warnings)) => Outcome::Found(job.found(mattes.as_ref()), warnings),
        Err(error) => failure(shared, edit.id, job.key, RunError::Job(error), failed),
    }
}

/// The reason for which an analysis failed that would run in the same way once more.
fn known_failure(
    shared: &Shared,
    id: EditId,
    key: &Arc<str>,
    failed: &HashMap<EditId, Arc<str>>,
) -> Option<String> {
    if failed.get(&id) != Some(key) {
        return None;
    }
    match lock(&shared.state).states.get(&id) {
        Some(AnalysisState::Failed(reason)) => Some(reason.clone()),
        _ => None,
    }
}

/// Records why an analysis has no result, unless it ended for a newer document.
fn failure(
    shared: &Shared,
    id: EditId,
    key: Arc<str>,
    error: RunError,
    failed: &mut HashMap<EditId, Arc<str>>,
) -> Outcome {
    let is_cancelled = matches!(error, RunError::Job(JobError::Cancelled));
    if is_cancelled && lock(&shared.state).wanted.is_some() {
        return Outcome::Later;
    }
    failed.insert(id, key);
    Outcome::Failed(match error {
        RunError::Job(JobError::Cancelled) => "it was stopped".to_owned(),
        RunError::Job(error) => error.to_string(),
        RunError::Edit(reason) => reason,
    })
}

/// The progress of an analysis that begins to run.
fn begin(shared: &Arc<Shared>, id: EditId) -> Progress {
    let progress = watched(shared, id);
    {
        let mut state = lock(&shared.state);
        state.running = Some((id, progress.clone()));
        let running = AnalysisState::Running("", 0.0);
        state.states.insert(id, running);
    }
    (shared.repaint)();
    progress
}

/// Finds the deformations of the frames of a clip that is retargeted, unless they are known. Those that are settled are published
/// on the way.
fn find_forms(
    shared: &Arc<Shared>,
    document: &Document,
    edit: &Arc<Edit>,
    failed: &mut HashMap<EditId, Arc<str>>,
) -> Outcome {
    let view = lock(&shared.state).view.clone();
    let Some(key) = forms_key(edit, document, &view) else {
        return Outcome::Waits;
    };
    let key: Arc<str> = key.into();
    let known = view.found(edit).and_then(|found| found.forms.clone());
    if known.is_some_and(|forms| forms.key == key && forms.is_complete()) {
        return Outcome::Known;
    }
    if let Some(reason) = known_failure(shared, edit.id, &key, failed) {
        return Outcome::Failed(reason);
    }
    if !pause(shared) {
        return Outcome::Later;
    }
    let progress = begin(shared, edit.id);
    let forms = Arc::new(ClipForms::new(key.clone()));
    let found = Found {
        key: key.clone(),
        unmarked: key.clone(),
        name: PathBuf::new(),
        mattes: None,
        forms: Some(forms.clone()),
    };
    {
        let mut state = lock(&shared.state);
        let mut results = HashMap::clone(&state.view.results);
        results.insert(output_of(edit), found.clone());
        state.view.results = Arc::new(results);
    }
    let last = Cell::new(Instant::now());
    let on_settled = || {
        if last.get().elapsed() > LOOK_FORMS {
            last.set(Instant::now());
            lock(&shared.state).view.version += 1;
            (shared.repaint)();
        }
    };
    let context = view.context(&progress);
    let done = clip_forms::find(edit, document, &view, &forms, &on_settled, &context);
    lock(&shared.state).view.version += 1;
    match done {
        Ok(()) => Outcome::Found(vec![found], Vec::new()),
        Err(error) => failure(shared, edit.id, key, error, failed),
    }
}

/// Leaves the processor to the hand for a moment: strokes come one after the other. False once a newer document is there.
fn pause(shared: &Arc<Shared>) -> bool {
    let is_awaited = |state: &mut State| state.wanted.is_none() && !state.quits;
    let state = lock(&shared.state);
    let woken = shared.wake.wait_timeout_while(state, PAUSE, is_awaited);
    let (state, _) = woken.unwrap_or_else(PoisonError::into_inner);
    state.wanted.is_none() && !state.quits
}

/// Progress that is shown as the state of an analysis.
fn watched(shared: &Arc<Shared>, id: EditId) -> Progress {
    let sink = Arc::downgrade(shared);
    Progress::new(move |update: Update| {
        let Some(shared) = sink.upgrade() else {
            return;
        };
        let mut state = lock(&shared.state);
        if let Some(AnalysisState::Running(phase, fraction)) = state.states.get_mut(&id) {
            (*phase, *fraction) = (update.phase, update.fraction());
        }
        drop(state);
        (shared.repaint)();
    })
}

/// Stores the file of a track: that which is measured for the canvas, or one of its own.
fn tracked(
    track: &Track,
    edit: &Edit,
    tracking: &Tracking,
    name: &Path,
    context: &Context,
) -> Result<(), JobError> {
    let planes = loop {
        context.progress.check()?;
        let Some(measurement) = tracking.measurement(&measure_key(edit)) else {
            break track.measure(&|_, _| (), context)?;
        };
        if let Some(measured) = lock(&measurement).track() {
            break vec![measured.as_ref().clone()];
        }
        if !lock(&measurement).runs() {
            // it has failed: the run says why
            break track.measure(&|_, _| (), context)?;
        }
        std::thread::sleep(LOOK);
    };
    context.insert_text(name, track.text(planes)?);
    Ok(())
}

/// Size of the frames of a document.
fn size_of(document: &Document, context: &Context) -> Result<Size, JobError> {
    let options = ravec_video::OpenOptions::default();
    let clip = ravec_video::Clip::open(&document.source, &options);
    let clip = clip.map_err(|cause| JobError::ReadClip {
        path: document.source.clone(),
        cause,
    })?;
    context.progress.check()?;
    Ok(clip.info().size)
}
