//! Deformations of the frames of a clip that is retargeted, found beside the window: with them a frame on the canvas has the
//! pixels that the frame of the export has.

use crate::analyses::AnalysisView;
use crate::document::{Document, Edit};
use crate::engine::{FrameStream, RunError, ShotEdit, files_key, input_rate, lock, source_key};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Size};
use ravec::retarget::Deformation;
use ravec::retarget::clip::Settled;
use ravec_jobs::retarget::{ClipStream, Retarget};
use ravec_jobs::{Context, JobError, Report, Step};
use ravec_media::Picture;
use ravec_video::{Clip, FrameSource as _, OpenOptions, VideoLimits};
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
    settled: Mutex<Forms>,
}

#[derive(Default)]
struct Forms {
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

    /// The deformation of a frame of the input of the edit, once it is settled.
    pub fn of(&self, frame: u64) -> Option<Arc<Deformation>> {
        let frame = usize::try_from(frame).ok()?;
        lock(&self.settled).deformations.get(frame).cloned()
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
    let mut clip = open(document, context).map_err(RunError::Job)?;
    let info = clip.info().clone();
    let phase = (context.progress).phase("frames", info.frames.unwrap_or(1));
    let progress = context.progress.silent();
    let mut before = FrameStream::new(edit.id, document, analyses, &info);
    let mut retargeting = Retargeting {
        operation: &operation,
        rate: before.rate(),
        stream: None,
        progress: &progress,
        context,
    };
    let mut settle = |frames: Vec<Arc<Picture>>| {
        for picture in frames {
            let settled = retargeting.push(Arc::unwrap_or_clone(picture).image)?;
            if !settled.is_empty() {
                forms.extend(settled);
                on_settled();
            }
        }
        Ok(())
    };
    while !before.has_ended() && !forms.is_full() {
        let cancelled = |_| RunError::Job(JobError::Cancelled);
        progress.check().map_err(cancelled)?;
        let frame = clip.next_frame().map_err(|cause| {
            RunError::Job(JobError::ReadClip {
                path: document.source.clone(),
                cause,
            })
        })?;
        let Some(frame) = frame else {
            break;
        };
        phase.advance(1);
        let image = frame.picture.into_image();
        settle(before.push(frame.time, image, &progress)?)?;
    }
    settle(before.finish(&progress)?)?;
    forms.extend(retargeting.finish()?);
    lock(&forms.settled).is_complete = true;
    Ok(())
}

/// The retargeting of a clip, opened by its first frame.
struct Retargeting<'a> {
    operation: &'a Retarget,
    rate: Option<f64>,
    stream: Option<ClipStream>,
    progress: &'a Progress,
    context: &'a Context,
}

impl Retargeting<'_> {
    fn push(&mut self, image: AnyImage) -> Result<Vec<Settled>, RunError> {
        let stream = if let Some(stream) = &mut self.stream {
            stream
        } else {
            let size = image.size();
            check_memory(self.operation.params.look_ahead, self.rate, size)
                .map_err(RunError::Edit)?;
            let mut report = Report::new("preview", &());
            let opened =
                ClipStream::open(self.operation, size, self.rate, &mut report, self.context);
            self.stream.insert(opened.map_err(RunError::Job)?)
        };
        let settled = stream.push(image, self.progress);
        settled.map_err(RunError::Job)
    }

    fn finish(&mut self) -> Result<Vec<Settled>, RunError> {
        let settled = match &mut self.stream {
            Some(stream) => stream.finish(self.progress),
            None => Ok(Vec::new()),
        };
        settled.map_err(RunError::Job)
    }
}

impl ClipForms {
    fn extend(&self, frames: Vec<Settled>) {
        let deformations = frames
            .into_iter()
            .filter_map(|frame| frame.deformations.into_iter().next().map(Arc::new));
        lock(&self.settled).deformations.extend(deformations);
    }

    fn is_full(&self) -> bool {
        lock(&self.settled).deformations.len() >= MAX_FRAMES
    }
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

/// The clip of a document, at the rate that its first edit gives it.
fn open(document: &Document, context: &Context) -> Result<Clip, JobError> {
    let options = OpenOptions {
        rate: input_rate(document),
        limits: VideoLimits {
            pictures: context.limits.clone(),
            max_frames: context.max_frames,
        },
    };
    Clip::open(&document.source, &options).map_err(|cause| JobError::ReadClip {
        path: document.source.clone(),
        cause,
    })
}
