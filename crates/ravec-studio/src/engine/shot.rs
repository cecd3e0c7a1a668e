//! Edits of a shot on single frames: those that need a plate, a matte or a track.

use super::cache::source_key;
use super::evaluate::RunError;
use crate::analyses::AnalysisView;
use crate::clip_forms::ClipForms;
use crate::content::Content;
use crate::device::edit_context;
use crate::document::{Document, Edit, is_result_name};
use ravec::raster::AnyImage;
use ravec::retarget::Deformation;
use ravec_jobs::matte::FrameMattes;
use ravec_jobs::video::convert;
use ravec_jobs::video::edit::ShotPreview;
use ravec_jobs::{Context, JobError, Step};
use ravec_media::Picture;
use std::path::Path;
use std::sync::Arc;

/// An edit of a shot with what it needs.
pub(crate) enum ShotEdit {
    /// Its inputs are not there yet: frames stay as they are.
    Waits,
    /// The foreground of the clip.
    Foreground { mattes: FrameMattes, key: String },
    /// A frame in another format.
    Retargeted {
        deformation: Arc<Deformation>,
        key: String,
    },
    /// The frame in another size, or as it is.
    Converted(Box<convert::Params>),
    /// The edit has no such frame, since a conversion leaves it out: it stays as it is.
    LeftOut,
    /// An edit with previews.
    Preview {
        step: Box<Step>,
        mattes: Option<FrameMattes>,
        key: String,
    },
}

impl ShotEdit {
    /// The edit for a frame of its input, if it is one of a shot; errors of its fields are left to the run. Without a frame, an edit
    /// that differs from frame to frame is none.
    pub fn of(
        edit: &Edit,
        document: &Document,
        analyses: &AnalysisView,
        frame: Option<u64>,
    ) -> Option<Self> {
        if edit.operation == "retarget" {
            let forms = ClipForms::of_edit(edit, document, analyses)?;
            return Some(Self::Retargeted {
                deformation: forms.of(frame?)?,
                key: forms.key.to_string(),
            });
        }
        if edit.operation == "matte" {
            let found = analyses.found(edit);
            let Some((found, mattes)) =
                found.and_then(|found| Some((found, found.mattes.as_ref()?)))
            else {
                return Some(Self::Waits);
            };
            return Some(Self::Foreground {
                mattes: mattes.clone(),
                key: found.key.to_string(),
            });
        }
        let (input, output) = (Path::new("@input"), Path::new("@output"));
        let step = edit.step(input, output).ok()?;
        if !ShotPreview::exists_for(&step) {
            return None;
        }
        let edit = edit.without_side_outputs();
        let Ok(resolved) = analyses.resolved(&edit, document) else {
            return Some(Self::Waits);
        };
        let step = resolved.edit.step(input, output).ok()?;
        let fields = serde_json::to_string(&edit.fields).unwrap_or_default();
        let files = step.operation().inputs();
        let files = files.into_iter().filter(|path| !is_result_name(path));
        let files: Vec<String> = files.map(|path| source_key(path, None)).collect();
        let key = format!(
            "{} {fields}\n{}\n{}",
            edit.operation,
            resolved.keys,
            files.join("\n")
        );
        Some(Self::Preview {
            step: Box::new(step),
            mattes: resolved.mattes,
            key,
        })
    }

    /// Text that changes with what it needs.
    pub fn key(&self) -> &str {
        match self {
            Self::Waits => "waits",
            Self::Converted(_) => "",
            Self::LeftOut => "left out",
            Self::Foreground { key, .. }
            | Self::Retargeted { key, .. }
            | Self::Preview { key, .. } => key,
        }
    }
}

/// Maximum number of edits whose inputs stay open.
const MAX_OPEN: usize = 6;

/// The edits whose inputs are open, so that the next frame takes no time for them.
#[derive(Default)]
pub(super) struct OpenShots {
    /// By what they depend on, the one used last at the end.
    open: Vec<(String, ShotPreview)>,
}

impl OpenShots {
    /// The result for a frame.
    pub fn result(
        &mut self,
        edit: &ShotEdit,
        input: &Content,
        frame: u64,
        context: &Context,
    ) -> Result<Content, RunError> {
        let Some(picture) = input.picture() else {
            return Ok(input.clone());
        };
        let image = &picture.image;
        let done = match edit {
            ShotEdit::Waits | ShotEdit::LeftOut => return Ok(input.clone()),
            ShotEdit::Converted(params) if params.size.is_none() => return Ok(input.clone()),
            ShotEdit::Converted(params) => params.frame(image, context),
            ShotEdit::Foreground { mattes, .. } => {
                mattes.frame(frame, image, &context.progress, context)
            }
            ShotEdit::Retargeted { deformation, .. } => {
                let device = edit_context(&context.progress).device;
                let warped = device.warp(deformation, image, &context.progress);
                warped.map_err(|cause| JobError::from_retargeting(Path::new(""), cause))
            }
            ShotEdit::Preview { step, mattes, key } => {
                self.preview(step, mattes.as_ref(), key, image, frame, context)
            }
        };
        let image = done.map_err(RunError::Job)?;
        Ok(Content::Picture(Arc::new(Picture::from_image(image))))
    }

    fn preview(
        &mut self,
        step: &Step,
        mattes: Option<&FrameMattes>,
        key: &str,
        image: &AnyImage,
        frame: u64,
        context: &Context,
    ) -> Result<AnyImage, JobError> {
        let key = format!("{key}\n{}", image.size());
        let mut preview = if let Some(at) = self.open.iter().position(|(of, _)| *of == key) {
            self.open.remove(at).1
        } else {
            let opened = ShotPreview::open(step, mattes.cloned(), image.size(), context)?;
            let Some(opened) = opened else {
                return Ok(image.clone());
            };
            opened
        };
        let done = preview.frame(frame, image, context);
        if self.open.len() == MAX_OPEN {
            self.open.remove(0);
        }
        self.open.push((key, preview));
        done
    }
}
