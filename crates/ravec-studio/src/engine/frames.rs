//! Frames of a clip on their way through the edits: conversions leave out and repeat some, and count the others anew.

use super::evaluate::{RunError, run_in_memory};
use super::shot::{OpenShots, ShotEdit};
use crate::analyses::AnalysisView;
use crate::content::Content;
use crate::document::{Document, Edit, EditId};
use ravec::progress::Progress;
use ravec::raster::AnyImage;
use ravec_jobs::video::{Conversion, FramePlace, convert};
use ravec_jobs::{JobError, Step};
use ravec_media::Picture;
use ravec_video::{ClipInfo, FrameTime, Rational};
use std::path::Path;
use std::sync::Arc;

/// The parameters of a conversion; `None` for other edits, and for one that makes no sense.
fn conversion_of(edit: &Edit) -> Option<convert::Params> {
    if !edit.is_conversion() {
        return None;
    }
    match edit.step(Path::new("@input"), Path::new("@output")) {
        Ok(Step::VideoConvert(operation)) => Some(operation.params),
        _ => None,
    }
}

/// The rate that the edits of a document give to the frames of its source, in place of the rate of their own.
pub(crate) fn input_rate(document: &Document) -> Option<Rational> {
    conversion_of(document.links().next()?)?.input_rate
}

/// A frame of a clip in front of one edit after the other.
pub(super) struct FrameAt {
    /// Its place in the input of the next edit; `None` once a conversion has left it out.
    place: Option<FramePlace>,
}

impl FrameAt {
    /// A frame of the source.
    pub fn in_source(mut place: FramePlace, document: &Document) -> Self {
        if let Some(rate) = input_rate(document) {
            place.interval = rate.recip().to_f64();
            place.seconds = place.number as f64 * place.interval;
        }
        Self { place: Some(place) }
    }

    /// Passes the next edit. Returns the inputs by which it applies to the frame, and the number of the frame in its input; `None` for
    /// an edit that needs the picture only.
    pub fn prepare(
        &mut self,
        edit: &Edit,
        document: &Document,
        analyses: &AnalysisView,
    ) -> Option<(ShotEdit, u64)> {
        if let Some(params) = conversion_of(edit) {
            // frames that are left out have the size of the others
            self.place = self.place.and_then(|place| place.behind(&params));
            return Some((ShotEdit::Converted(Box::new(params)), 0));
        }
        let Some(place) = self.place else {
            return Some((ShotEdit::LeftOut, 0));
        };
        let prepared = ShotEdit::of(edit, document, analyses, Some(place.number));
        prepared.map(|prepared| (prepared, place.number))
    }
}

/// A frame with its time.
type Timed = (FrameTime, Arc<Picture>);

/// An edit in a stream of frames.
struct Link<'a> {
    edit: &'a Edit,
    conversion: Option<(convert::Params, Conversion<Arc<Picture>>)>,
    /// Number of the next frame of its input.
    next: u64,
}

/// The edits before one, run on the frames of a clip in their order: with the same frames left out, repeated and counted as by an
/// export.
pub(crate) struct FrameStream<'a> {
    links: Vec<Link<'a>>,
    document: &'a Document,
    analyses: &'a AnalysisView,
    shots: OpenShots,
    rate: Option<f64>,
    has_ended: bool,
}

impl<'a> FrameStream<'a> {
    /// The edits before that with this number, on a clip with these properties.
    pub fn new(
        id: EditId,
        document: &'a Document,
        analyses: &'a AnalysisView,
        info: &ClipInfo,
    ) -> Self {
        let mut time_base = info.time_base;
        let mut rate = info.rate.map(Rational::to_f64);
        let mut links = Vec::new();
        for edit in document.links_before(id) {
            let conversion = conversion_of(edit).map(|params| {
                let conversion = Conversion::new(&params, time_base);
                if let Some(new) = params.rate {
                    time_base = new.recip();
                    rate = Some(new.to_f64());
                }
                (params, conversion)
            });
            links.push(Link {
                edit,
                conversion,
                next: 0,
            });
        }
        Self {
            links,
            document,
            analyses,
            shots: OpenShots::default(),
            rate,
            has_ended: false,
        }
    }

    /// Frames a second behind the edits, as far as known.
    pub fn rate(&self) -> Option<f64> {
        self.rate
    }

    /// True once no frame that follows changes what comes: [`finish`](Self::finish) gives the rest.
    pub fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// Takes the next frame of the clip, and gives those behind the edits that are settled by it.
    ///
    /// # Errors
    /// That of the first edit that fails.
    pub fn push(
        &mut self,
        time: FrameTime,
        image: AnyImage,
        progress: &Progress,
    ) -> Result<Vec<Arc<Picture>>, RunError> {
        self.pass(
            0,
            vec![(time, Arc::new(Picture::from_image(image)))],
            progress,
        )
    }

    /// The frames that are left at the end of the clip.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn finish(&mut self, progress: &Progress) -> Result<Vec<Arc<Picture>>, RunError> {
        let mut left = Vec::new();
        for index in 0..self.links.len() {
            if let Some((params, conversion)) = &mut self.links[index].conversion {
                let frames = conversion.finish();
                let frames = sized(frames, params, self.analyses, progress)?;
                left.extend(self.pass(index + 1, frames, progress)?);
            }
        }
        Ok(left)
    }

    /// Passes frames through the edits from one on.
    fn pass(
        &mut self,
        from: usize,
        mut frames: Vec<Timed>,
        progress: &Progress,
    ) -> Result<Vec<Arc<Picture>>, RunError> {
        for link in &mut self.links[from..] {
            if let Some((params, conversion)) = &mut link.conversion {
                let mut left = Vec::new();
                for (time, image) in frames {
                    let Some(settled) = conversion.push(time, image) else {
                        self.has_ended = true;
                        break;
                    };
                    left.extend(settled);
                }
                frames = sized(left, params, self.analyses, progress)?;
                continue;
            }
            let context = self.analyses.context(progress);
            for (_, picture) in &mut frames {
                let stopped = |_| RunError::Job(JobError::Cancelled);
                progress.check().map_err(stopped)?;
                let number = link.next;
                link.next += 1;
                let input = Content::Picture(picture.clone());
                let of = ShotEdit::of(link.edit, self.document, self.analyses, Some(number));
                let result = match of {
                    Some(of) => self.shots.result(&of, &input, number, &context)?,
                    None => run_in_memory(link.edit, &input, progress)?.0,
                };
                let Content::Picture(result) = result else {
                    return Err(RunError::Edit("this is a mesh".to_owned()));
                };
                *picture = result;
            }
        }
        Ok(frames.into_iter().map(|(_, picture)| picture).collect())
    }
}

/// Frames in the size that a conversion gives them.
fn sized(
    mut frames: Vec<Timed>,
    params: &convert::Params,
    analyses: &AnalysisView,
    progress: &Progress,
) -> Result<Vec<Timed>, RunError> {
    if params.size.is_some() {
        let context = analyses.context(progress);
        for (_, picture) in &mut frames {
            let sized = params.frame(&picture.image, &context);
            *picture = Arc::new(Picture::from_image(sized.map_err(RunError::Job)?));
        }
    }
    Ok(frames)
}
