//! Mattes of single frames, with all that is known about a shot.

use super::Matte;
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::marks::{MarkSource, Marks, UNKNOWN};
use crate::report::Report;
use crate::shot::{RegionFiles, ShotPlate, ShotTrack, TrackChoice, encoded};
use crate::track::exclusions::{Exclusions, MaskFiles};
use ravec::matting::{
    Constraints, Matte as Solution, MattingError, PlateFrame, plate_matte, still_matte,
};
use ravec::planar::Homography;
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Image, Size, Srgba};
use std::path::Path;
use std::sync::Arc;

/// Frames in which strokes hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spread {
    /// Those in which they are drawn.
    OwnFrames,
    /// All to which they are carried.
    Clip,
}

/// The inputs of an operation [`Matte`], open: mattes of single frames in any order. Clones share what was read.
#[derive(Clone)]
pub struct FrameMattes {
    pub(super) matte: Matte,
    pub(super) plate: Option<Arc<ShotPlate>>,
    track: Option<Arc<ShotTrack>>,
    trimap: Option<Constraints>,
    pub(super) marks: Arc<Marks>,
}

impl FrameMattes {
    /// Reads plate, track, trimap and strokes for frames of this size.
    ///
    /// # Errors
    /// [`JobError::Read`], [`JobError::SizesDiffer`], [`JobError::TrackFile`], [`JobError::Strokes`], [`JobError::ReadClip`],
    /// [`JobError::Cancelled`].
    pub fn open(
        matte: &Matte,
        size: Size,
        spread: Spread,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let params = &matte.params;
        let plate = plate(matte, size, report, context)?;
        let trimap = trimap(matte, size, report, context)?;
        let track = match &matte.track {
            Some(path) => {
                let choice = TrackChoice {
                    path,
                    plane: params.plane,
                    centers: params.pixel_centers,
                };
                Some(ShotTrack::read(&choice, report, context)?)
            }
            None => None,
        };
        let files = MaskFiles {
            input: &matte.input,
            exclude: None,
            strokes: matte.strokes.as_deref(),
        };
        let pictures = Exclusions::open(&files, size, 0, report, context)?;
        let source = MarkSource {
            input: &matte.input,
            size,
            marks: &params.marks,
            pictures: &pictures.stroke_pictures(),
            carry: params.carry,
            centers: params.pixel_centers,
            track: track.as_ref(),
            track_path: matte.track.as_deref(),
        };
        let marks = match spread {
            Spread::OwnFrames => Marks::in_own_frames(&source)?,
            Spread::Clip => Marks::carried(&source, report, context)?,
        };
        Ok(Self {
            matte: matte.clone(),
            plate: plate.map(Arc::new),
            track: track.map(Arc::new),
            trimap,
            marks: Arc::new(marks),
        })
    }

    /// The map to a frame from the reference frame.
    pub(super) fn map(&self, index: u64) -> Result<Homography, JobError> {
        match &self.track {
            None => Ok(Homography::IDENTITY),
            Some(track) => track
                .map(index)
                .copied()
                .ok_or_else(|| JobError::TrackFile {
                    path: self.matte.track.clone().unwrap_or_default(),
                    reason: format!("it lacks frame {index}"),
                }),
        }
    }

    /// The output of the operation for a frame: alpha, or the foreground.
    ///
    /// # Errors
    /// Those of [`solve`](Self::solve).
    pub fn frame(
        &self,
        index: u64,
        image: &AnyImage,
        progress: &Progress,
        context: &Context,
    ) -> Result<AnyImage, JobError> {
        let found = self.solve(index, image, progress, context)?;
        Ok(self.matte.drawn(&found, image))
    }

    /// Alpha and foreground of a frame.
    ///
    /// # Errors
    /// [`JobError::TrackFile`] for a frame that the track lacks, [`JobError::Parameter`], [`JobError::Cancelled`].
    pub fn solve(
        &self,
        index: u64,
        image: &AnyImage,
        progress: &Progress,
        context: &Context,
    ) -> Result<Solution, JobError> {
        let map = self.map(index)?;
        let colors = encoded(image);
        let constraints = self
            .marks
            .constraints(index, &colors, &map, self.trimap.as_ref());
        let found = match (&self.plate, &constraints) {
            (Some(plate), constraints) => {
                let plate = plate.in_frame(&map, index, colors.size(), context)?;
                let input = PlateFrame {
                    known: Some(&plate.known),
                    strokes: constraints.as_ref(),
                    ..PlateFrame::new(&colors, &plate.colors)
                };
                plate_matte(&input, &self.matte.params.matte, progress)?.matte
            }
            (None, Some(constraints)) => still_matte(&colors, constraints, progress)?.matte,
            (None, None) => return Err(MattingError::Unmarked("foreground").into()),
        };
        Ok(found)
    }
}

/// Reads the plate of frames of this size.
fn plate(
    matte: &Matte,
    size: Size,
    report: &mut Report,
    context: &Context,
) -> Result<Option<ShotPlate>, JobError> {
    let Some(path) = &matte.plate else {
        return Ok(None);
    };
    let picture = files::read(path, report, context)?;
    let plate = ShotPlate::new(&picture.image, matte.params.pad);
    if plate.frame_size() != Some(size) {
        return Err(sizes_differ(matte, size, path, picture.image.size()));
    }
    let Some(track) = &matte.track else {
        return plate.standing(context).map(Some);
    };
    let Some(regions) = &matte.regions else {
        return Ok(Some(plate));
    };
    let track = TrackChoice {
        path: track,
        plane: matte.params.plane,
        centers: matte.params.pixel_centers,
    };
    let files = RegionFiles {
        regions,
        track: &track,
    };
    plate.with_regions(path, &files, report, context).map(Some)
}

/// Reads the trimap of a picture of this size.
fn trimap(
    matte: &Matte,
    size: Size,
    report: &mut Report,
    context: &Context,
) -> Result<Option<Constraints>, JobError> {
    let Some(path) = &matte.trimap else {
        return Ok(None);
    };
    let picture = files::read(path, report, context)?;
    if picture.image.size() != size {
        return Err(sizes_differ(matte, size, path, picture.image.size()));
    }
    let image: Image<Srgba<u8>> = picture.convert();
    Ok(Some(image.map(|Srgba([r, g, b, alpha])| {
        let gray = (u32::from(r) + u32::from(g) + u32::from(b)) / 3;
        if alpha < 128 { UNKNOWN } else { gray as u8 }
    })))
}

fn sizes_differ(matte: &Matte, size: Size, other: &Path, other_size: Size) -> JobError {
    JobError::SizesDiffer {
        a: matte.input.clone(),
        a_size: size,
        b: other.to_path_buf(),
        b_size: other_size,
    }
}
