//! Results of an edit of a shot for single frames, without the files that it would write.

use super::{Edit, ShotEdit, ShotFrames, drawn};
use crate::context::Context;
use crate::error::JobError;
use crate::matte::FrameMattes;
use crate::report::Report;
use crate::shot::is_deep;
use crate::step::Step;
use ravec::raster::{AnyImage, Size};

/// An edit of a shot whose inputs are open, for previews: `video remove`, `replace`, `enhance`, `paste` or
/// `overlay`.
///
/// ```no_run
/// use ravec::raster::Size;
/// use ravec_jobs::{Context, Step, video::edit::ShotPreview};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let step: Step = serde_json::from_str(
///     r#"{"operation": "video remove", "input": "a.y4m", "output": "b.y4m", "plate": "empty.png", "matte": "m.y4m"}"#,
/// )?;
/// let context = Context::default();
/// let frame = ravec_media::read("frame_40.png", &context.limits)?.image;
/// let preview = ShotPreview::open(&step, None, Size::new(640, 360)?, &context)?;
/// let result = preview.expect("removal is an edit of a shot").frame(40, &frame, &context)?;
/// # Ok(())
/// # }
/// ```
pub struct ShotPreview {
    frames: ShotFrames,
}

impl ShotPreview {
    /// True for an operation that has previews.
    pub fn exists_for(step: &Step) -> bool {
        matches!(
            step,
            Step::VideoRemove(_)
                | Step::VideoReplace(_)
                | Step::VideoEnhance(_)
                | Step::VideoPaste(_)
                | Step::VideoOverlay(_)
        )
    }

    /// Opens the inputs of an edit, but for its clip, whose frames have `size`; `None` for another operation. `live` takes the place
    /// of the file of the matte.
    ///
    /// # Errors
    /// Those of the operation.
    pub fn open(
        step: &Step,
        live: Option<FrameMattes>,
        size: Size,
        context: &Context,
    ) -> Result<Option<Self>, JobError> {
        let frames = match step {
            Step::VideoRemove(edit) => frames(&**edit, live, size, context)?,
            Step::VideoReplace(edit) => frames(&**edit, live, size, context)?,
            Step::VideoEnhance(edit) => frames(&**edit, live, size, context)?,
            Step::VideoPaste(edit) => frames(&**edit, live, size, context)?,
            Step::VideoOverlay(edit) => {
                let mut report = Report::new("preview", &());
                edit.frames(size, live, &mut report, context)?
            }
            _ => return Ok(None),
        };
        Ok(Some(Self { frames }))
    }

    /// The result for a frame: what the operation writes for it, up to the rounding of the matte in its file.
    ///
    /// # Errors
    /// Those of the operation.
    pub fn frame(
        &mut self,
        index: u64,
        image: &AnyImage,
        context: &Context,
    ) -> Result<AnyImage, JobError> {
        let ShotFrames { sides, edit } = &mut self.frames;
        let side = sides.of(index, image, context)?;
        let colors = edit.result(index, image, side, context)?;
        Ok(drawn(&colors, is_deep(image)))
    }
}

fn frames<E: ShotEdit>(
    operation: &E,
    live: Option<FrameMattes>,
    size: Size,
    context: &Context,
) -> Result<ShotFrames, JobError> {
    let mut report = Report::new("preview", &());
    let inputs = operation.edit_inputs();
    let (edit, alpha) = Edit::open(&inputs, size, live, &mut report, context)?;
    operation.frames(edit, alpha, &mut report, context)
}
