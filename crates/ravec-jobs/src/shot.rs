//! Maps of a track, and a background plate warped into a frame, for all edits of a tracked shot.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::pixel_centers::PixelCenters;
use crate::report::{FileReport, Report};
use crate::stabilize::held;
use crate::track::file::TrackFile;
use glam::{DMat3, DVec2};
use ravec::matting::Colors;
use ravec::planar::track::TrackState;
use ravec::planar::{Beyond, Homography, warp};
use ravec::raster::{AnyImage, Image, Mask, Plane, Sample, Size, Srgb, Srgba};
use ravec::video_edit::interpolated;
use serde::Deserialize;
use std::path::Path;

/// The largest file of a track that is read, in bytes.
const MAX_TRACK_BYTES: u64 = 256 << 20;
/// Pixels that a plate may have more on each side.
const MAX_PAD_PX: usize = 1 << 14;
/// Alpha of the plate below which its color says nothing.
const MIN_SHARE: f32 = 0.5;
/// Pixels of the plate for one of a frame, along each axis, above which they are averaged rather than interpolated.
const MAX_REDUCTION: f64 = 1.25;

/// Maps of a plane to the frames of a shot.
pub(crate) struct ShotTrack {
    /// Number of the first frame that has a map.
    first: u64,
    frame_from_reference: Vec<Homography>,
    /// Frames in which the plane is lost.
    lost: Vec<bool>,
    /// Number of the frame in which the plane is given.
    reference: u64,
}

/// A track of other programs: maps for all frames from the first one on.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BareTrack {
    frame_from_reference: Vec<[f64; 9]>,
}

/// Choice of a plane and convention of a [`BareTrack`].
pub(crate) struct TrackChoice<'a> {
    pub path: &'a Path,
    /// Number of the plane, from 1.
    pub plane: usize,
    /// Of files that do not state their own.
    pub centers: PixelCenters,
}

impl ShotTrack {
    /// Reads a track as `ravec track` writes it, or an object with nothing but `frame_from_reference`. Where the plane is lost, the
    /// last known map is kept.
    ///
    /// # Errors
    /// [`JobError::TrackFile`], [`JobError::Parameter`] for a plane that the file lacks.
    pub fn read(
        choice: &TrackChoice<'_>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let path = choice.path;
        let failed = |reason: String| JobError::TrackFile {
            path: path.to_path_buf(),
            reason,
        };
        let text = files::read_text_in(path, MAX_TRACK_BYTES, context)
            .map_err(|error| failed(error.to_string()))?;
        if !context.is_intermediate(path) {
            report.protect(path);
        }
        report.inputs.push(FileReport {
            path: path.display().to_string(),
            format: "json".to_owned(),
            ..FileReport::default()
        });
        if let Ok(bare) = serde_json::from_str::<BareTrack>(&text) {
            let maps = bare.frame_from_reference.iter().enumerate();
            let maps = maps.map(|(frame, rows)| {
                Homography::from_matrix(DMat3::from_cols_array(rows).transpose())
                    .map(|map| choice.centers.read_map(&map))
                    .map_err(|cause| {
                        let place = "`frame_from_reference` is no map between frames";
                        failed(format!("frame {frame}: {place}: {cause}"))
                    })
            });
            let frame_from_reference: Vec<_> = maps.collect::<Result<_, _>>()?;
            if frame_from_reference.is_empty() {
                return Err(failed("it has no frames".to_owned()));
            }
            return Ok(Self {
                first: 0,
                lost: vec![false; frame_from_reference.len()],
                frame_from_reference,
                reference: 0,
            });
        }
        let file = TrackFile::from_json(&text, context.max_frames).map_err(failed)?;
        let planes = file.planes.len();
        let plane = choice
            .plane
            .checked_sub(1)
            .and_then(|index| file.planes.into_iter().nth(index));
        let track = plane.ok_or_else(|| JobError::Parameter {
            field: "plane",
            value: format!("{}, and the track has {planes}", choice.plane),
            range: "the number of one of its planes",
        })?;
        Ok(Self {
            first: track.first,
            frame_from_reference: held(&track.frames),
            lost: (track.frames.iter())
                .map(|frame| frame.state == TrackState::Lost)
                .collect(),
            reference: track.reference,
        })
    }

    /// Map to a frame from the reference frame; `None` for a frame that the track lacks.
    pub fn map(&self, frame: u64) -> Option<&Homography> {
        let index = frame.checked_sub(self.first)?;
        self.frame_from_reference.get(usize::try_from(index).ok()?)
    }

    /// True where the plane was found in a frame.
    pub fn is_found(&self, frame: u64) -> bool {
        let index = frame.checked_sub(self.first);
        let index = index.and_then(|index| usize::try_from(index).ok());
        index.and_then(|index| self.lost.get(index)) == Some(&false)
    }

    /// Number of the reference frame.
    pub fn reference(&self) -> u64 {
        self.reference
    }
}

/// A background plate.
pub(crate) struct ShotPlate {
    colors: Colors,
    /// Transparent pixels.
    unknown: Option<Mask>,
    pad_px: usize,
}

/// A plate as one frame would show it.
pub(crate) struct PlateInFrame {
    pub colors: Colors,
    /// Share of certainty, 0 where the plate shows nothing.
    pub known: Plane,
}

impl ShotPlate {
    /// Takes a picture that is `pad_px` larger on each side than the reference frame. Transparent pixels are not known.
    pub fn new(picture: &AnyImage, pad_px: usize) -> Self {
        let unknown = picture.has_alpha().then(|| {
            let pixels: Image<Srgba<f32>> = picture.convert();
            Mask::from_fn(picture.size(), |col, row| {
                pixels[(col, row)].0[3] < MIN_SHARE
            })
        });
        Self {
            colors: encoded(picture),
            unknown: unknown.filter(|unknown| !unknown.is_empty()),
            pad_px,
        }
    }

    /// The size of the frames to which the plate belongs.
    pub fn frame_size(&self) -> Option<Size> {
        let side = |length: usize| length.checked_sub(2 * self.pad_px);
        let size = self.colors.size();
        Size::new(side(size.width())?, side(size.height())?).ok()
    }

    /// The plate in a frame of this size, to which `frame_from_reference` leads.
    ///
    /// # Errors
    /// [`JobError::Cancelled`].
    pub fn in_frame(
        &self,
        frame_from_reference: &Homography,
        size: Size,
        context: &Context,
    ) -> Result<PlateInFrame, JobError> {
        let shift = Homography::from_translation(DVec2::splat(self.pad_px as f64));
        let shift = shift.unwrap_or(Homography::IDENTITY);
        let middle = DVec2::new(size.width() as f64, size.height() as f64) * 0.5;
        let plate_from_frame = (shift * frame_from_reference.inverse()).facing(middle);
        let scale = plate_from_frame.jacobian(middle).determinant().abs().sqrt();
        let pixels = if scale < MAX_REDUCTION {
            context.progress.check()?;
            interpolated(&self.colors, self.unknown.as_ref(), &plate_from_frame, size)
        } else {
            let known = |at: (usize, usize)| {
                let unknown = self.unknown.as_ref();
                unknown.is_none_or(|unknown| unknown.at(at.0, at.1) <= 0.0)
            };
            let pixels = Image::from_fn(self.colors.size(), |col, row| {
                let [r, g, b] = self.colors[(col, row)];
                if known((col, row)) {
                    [r, g, b, 1.0]
                } else {
                    [0.0; 4]
                }
            });
            let progress = context.progress.silent();
            let nothing = Beyond::Pixel([0.0; 4]);
            warp(&pixels, &plate_from_frame, size, nothing, &progress)?
        };
        let colors = pixels.map(|[r, g, b, share]| {
            let scale = if share > 1e-3 { 1.0 / share } else { 0.0 };
            [r * scale, g * scale, b * scale]
        });
        let known = pixels.map(|[_, _, _, share]| share.clamp(0.0, 1.0));
        Ok(PlateInFrame { colors, known })
    }
}

/// Refuses planes before the first one.
pub(crate) fn check_plane(plane: usize) -> Result<(), JobError> {
    if plane > 0 {
        return Ok(());
    }
    Err(JobError::Parameter {
        field: "plane",
        value: "0".to_owned(),
        range: "at least 1",
    })
}

/// Refuses what is more than a plate can have on each side: more is a mistake, and sums of it stay far from overflow.
pub(crate) fn check_pad(pad_px: usize) -> Result<(), JobError> {
    if pad_px <= MAX_PAD_PX {
        return Ok(());
    }
    Err(JobError::Parameter {
        field: "pad",
        value: pad_px.to_string(),
        range: "at most 16384",
    })
}

/// Values of a picture as files hold them, 0 to 1.
pub(crate) fn encoded(image: &AnyImage) -> Colors {
    match image {
        AnyImage::Srgb8(image) => values(image),
        AnyImage::Srgb16(image) => values(image),
        other => values(&other.convert::<Srgb<f32>>()),
    }
}

fn values<T: Sample>(image: &Image<Srgb<T>>) -> Colors {
    image.map(|Srgb(values)| values.map(Sample::to_unit))
}

/// True for a picture of more than 8 bits.
pub(crate) fn is_deep(image: &AnyImage) -> bool {
    !matches!(image, AnyImage::Srgb8(_) | AnyImage::Srgba8(_))
}
