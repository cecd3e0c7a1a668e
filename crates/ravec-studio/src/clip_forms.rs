//! Deformations of the frames of a clip that is retargeted, found beside the window: with them a frame on the canvas has the
//! pixels that the frame of the export has.

use crate::analyses::AnalysisView;
use crate::document::{Document, Edit};
use crate::engine::{FrameChain, RunError, ShotEdit, files_key, lock, source_key};
use ravec::raster::Size;
use ravec::retarget::Deformation;
use ravec_jobs::retarget::ClipStream;
use ravec_jobs::video::FrameRange;
use ravec_jobs::{Context, JobError, Report, Step};
use ravec_video::{Clip, FrameSource as _, OpenOptions, Rational, VideoLimits};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Maximum number of bytes of frames that wait for their deformations, estimated.
const MAX_HELD_BYTES: f64 = (2_u64 << 30) as f64;

/// Maximum number of frames that have deformations: a few hundred megabytes.
const MAX_FRAMES: usize = 20_000;

/// Deformations of the frames of a clip, as far as they are settled.
pub(crate) struct ClipForms {
    /// Text that changes with the deformations.
    pub key: Arc<str>,
    settled: Mutex<Settled>,
}

#[derive(Default)]
struct Settled {
    /// Number of the first frame.
    first: u64,
    deformations: Vec<Arc<Deformation>>,
    is_complete: bool,
}

impl ClipForms {
    /// None yet.
    pub fn new(key: Arc<str>) -> Self {
        Self {
            key,
            settled: Mutex::default(),
        }
    }

    /// The deformation of a frame of the clip, once it is settled.
    pub fn of(&self, frame: u64) -> Option<Arc<Deformation>> {
        let settled = lock(&self.settled);
        let index = frame.checked_sub(settled.first)?;
        settled.deformations.get(index as usize).cloned()
    }

    /// True once all frames are settled.
    pub fn is_complete(&self) -> bool {
        lock(&self.settled).is_complete
    }

    /// The deformations of an edit in a document, if they are those of its present fields and inputs.
    pub fn of_edit(edit: &Edit, document: &Document, analyses: &AnalysisView) -> Option<Arc<Self>> {
        let forms = analyses.found(edit)?.forms.clone()?;
        (*forms.key == forms_key(edit, document, analyses)?).then_some(forms)
    }
}

/// Text that changes with the deformations of an edit; `None` while something that the edits before it need is not there.
pub(crate) fn forms_key(
    edit: &Edit,
    document: &Document,
    analyses: &AnalysisView,
) -> Option<String> {
    let mut key = source_key(&document.source, None);
    for before in document.links_before(edit.id) {
        let needs = if before.operation == "retarget" {
            ClipForms::of_edit(before, document, analyses).filter(|forms| forms.is_complete())?;
            String::new()
        } else {
            match ShotEdit::of(before, document, analyses, None) {
                Some(ShotEdit::Waits) => return None,
                needs => needs.map_or_else(String::new, |needs| needs.key().to_owned()),
            }
        };
        let fields = serde_json::to_string(&before.fields).unwrap_or_default();
        let files = files_key(before);
        key = format!("{key}\n{} {fields}\n{files}\n{needs}", before.operation);
    }
    let fields = serde_json::to_string(&edit.fields).unwrap_or_default();
    Some(format!("{key}\n{fields}\n{}", files_key(edit)))
}

/// Finds the deformations of all frames. `on_settled` is called when there are more.
///
/// # Errors
/// One sentence, or that of the operation.
pub(crate) fn find(
    edit: &Edit,
    document: &Document,
    analyses: &AnalysisView,
    forms: &ClipForms,
    on_settled: &dyn Fn(),
    context: &Context,
) -> Result<(), RunError> {
    let step = edit.without_side_outputs();
    let step = step.step(&document.source, Path::new("@output"));
    let Step::Retarget(operation) = step.map_err(RunError::Edit)? else {
        return Err(RunError::Edit("this edit does not retarget".to_owned()));
    };
    let range = range_before(edit, document).map_err(RunError::Edit)?;
    let mut clip = open(&document.source, context).map_err(RunError::Job)?;
    let info = clip.info().clone();
    let ticks = info.time_base.to_f64();
    let progress = context.progress.silent();
    let phase = (context.progress).phase("frames", info.frames.unwrap_or(1));
    let mut chain = FrameChain::new(edit.id, document, analyses);
    let mut stream: Option<ClipStream> = None;
    let mut origin = None;
    let read_error = |cause| {
        RunError::Job(JobError::ReadClip {
            path: document.source.clone(),
            cause,
        })
    };
    for number in 0.. {
        context
            .progress
            .check()
            .map_err(|_| RunError::Job(JobError::Cancelled))?;
        let Some(frame) = clip.next_frame().map_err(read_error)? else {
            break;
        };
        phase.advance(1);
        let start = frame.time.start;
        let seconds = (start - *origin.get_or_insert(start)) as f64 * ticks;
        if range.is_before(number, seconds) {
            continue;
        }
        if range.is_behind(number, seconds) || forms.is_full() {
            break;
        }
        let image = chain.result(number, frame.picture.into_image(), &progress)?;
        let stream = if let Some(stream) = &mut stream {
            stream
        } else {
            let rate = info.rate.map(Rational::to_f64);
            let size = image.size();
            check_memory(operation.params.look_ahead, rate, size).map_err(RunError::Edit)?;
            lock(&forms.settled).first = number;
            let mut report = Report::new("preview", &());
            let opened = ClipStream::open(&operation, size, rate, &mut report, context);
            stream.insert(opened.map_err(RunError::Job)?)
        };
        let settled = stream.push(image, &progress).map_err(RunError::Job)?;
        if !settled.is_empty() {
            forms.extend(settled);
            on_settled();
        }
    }
    if let Some(mut stream) = stream {
        forms.extend(stream.finish(&progress).map_err(RunError::Job)?);
    }
    lock(&forms.settled).is_complete = true;
    Ok(())
}

impl ClipForms {
    fn extend(&self, frames: Vec<ravec::retarget::clip::Settled>) {
        let deformations = frames
            .into_iter()
            .filter_map(|frame| frame.deformations.into_iter().next().map(Arc::new));
        lock(&self.settled).deformations.extend(deformations);
    }

    fn is_full(&self) -> bool {
        lock(&self.settled).deformations.len() >= MAX_FRAMES
    }
}

/// The frames that edits of whole clips before an edit leave.
fn range_before(edit: &Edit, document: &Document) -> Result<FrameRange, String> {
    let mut range = FrameRange::default();
    for (nth, before) in document
        .links_before(edit.id)
        .filter(|before| before.is_of_whole_clips())
        .enumerate()
    {
        let changes = |name| !before.param(name).is_null();
        if nth > 0 || ["size", "rate", "input_rate"].into_iter().any(changes) {
            return Err(
                "frames are shown as still pictures: move the edit before the one that changes the size or the rate"
                    .to_owned(),
            );
        }
        if let Some(text) = before.param("frames").as_str() {
            range = text.parse()?;
        }
    }
    Ok(range)
}

/// Refuses clips of which more frames would wait than memory should be taken for.
fn check_memory(look_ahead: f64, rate: Option<f64>, size: Size) -> Result<(), String> {
    // a look-ahead for content, and most of one for averages; 16 bits of color
    let held = 2.0 * look_ahead * rate.unwrap_or(25.0);
    if held * 3.0 * size.pixels() as f64 > MAX_HELD_BYTES {
        return Err(
            "frames are shown as still pictures: too many large frames lie within the look-ahead"
                .to_owned(),
        );
    }
    Ok(())
}

fn open(path: &Path, context: &Context) -> Result<Clip, JobError> {
    let options = OpenOptions {
        rate: None,
        limits: VideoLimits {
            pictures: context.limits.clone(),
            max_frames: context.max_frames,
        },
    };
    Clip::open(path, &options).map_err(|cause| JobError::ReadClip {
        path: path.to_path_buf(),
        cause,
    })
}
