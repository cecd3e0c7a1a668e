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
use ravec::planar::Homography;
use ravec::planar::track::TrackState;
use ravec::raster::{AnyImage, Image, Mask, Plane, Sample, Size, Srgb, Srgba};
use ravec::video_edit::Interpolator;
use serde::Deserialize;
use std::path::Path;
use std::sync::Arc;

/// The largest file of a track that is read, in bytes.
const MAX_TRACK_BYTES: u64 = 256 << 20;
/// Pixels that a plate may have more on each side.
const MAX_PAD_PX: usize = 1 << 14;
/// Alpha of the plate below which its color says nothing.
const MIN_SHARE: f32 = 0.5;

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

/// The same of several planes.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BareTracks {
    planes: Vec<BareTrack>,
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
    /// Reads a plane of a track.
    ///
    /// # Errors
    /// [`JobError::TrackFile`], [`JobError::Parameter`] for a plane that the file lacks.
    pub fn read(
        choice: &TrackChoice<'_>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let tracks = Self::read_all(choice, report, context)?;
        let planes = tracks.len();
        let index = choice.plane.checked_sub(1);
        index
            .and_then(|index| tracks.into_iter().nth(index))
            .ok_or_else(|| JobError::Parameter {
                field: "plane",
                value: format!("{}, and the track has {planes}", choice.plane),
                range: "the number of one of its planes",
            })
    }

    /// Reads all planes of a track as `ravec track` writes it, or of an object with nothing but `frame_from_reference`, or with a list
    /// `planes` of such objects. Where a plane is lost, its last known map is kept.
    ///
    /// # Errors
    /// [`JobError::TrackFile`].
    pub fn read_all(
        choice: &TrackChoice<'_>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Vec<Self>, JobError> {
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
        let bare = serde_json::from_str::<BareTrack>(&text)
            .map(|track| vec![track])
            .or_else(|_| serde_json::from_str::<BareTracks>(&text).map(|tracks| tracks.planes));
        if let Ok(bare) = bare {
            let tracks = bare
                .iter()
                .map(|track| Self::of_bare(track, choice.centers));
            return tracks.collect::<Result<_, _>>().map_err(failed);
        }
        let file = TrackFile::from_json(&text, context.max_frames).map_err(failed)?;
        let tracks = file.planes.into_iter().map(|track| Self {
            first: track.first,
            frame_from_reference: held(&track.frames),
            lost: (track.frames.iter())
                .map(|frame| frame.state == TrackState::Lost)
                .collect(),
            reference: track.reference,
        });
        Ok(tracks.collect())
    }

    fn of_bare(bare: &BareTrack, centers: PixelCenters) -> Result<Self, String> {
        let maps = bare.frame_from_reference.iter().enumerate();
        let maps = maps.map(|(frame, rows)| {
            Homography::from_matrix(DMat3::from_cols_array(rows).transpose())
                .map(|map| centers.read_map(&map))
                .map_err(|cause| {
                    let place = "`frame_from_reference` is no map between frames";
                    format!("frame {frame}: {place}: {cause}")
                })
        });
        let frame_from_reference: Vec<_> = maps.collect::<Result<_, _>>()?;
        if frame_from_reference.is_empty() {
            return Err("it has no frames".to_owned());
        }
        Ok(Self {
            first: 0,
            lost: vec![false; frame_from_reference.len()],
            frame_from_reference,
            reference: 0,
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

/// A background plate, prepared for views of about its scale.
pub(crate) struct ShotPlate {
    size: Size,
    pad_px: usize,
    /// Parts of the plate, the foremost first.
    parts: Vec<PlatePart>,
    /// The plate in all frames of a camera that stands still; its parts are dropped.
    still: Option<Arc<PlateInFrame>>,
}

/// The part of a plate that lies on a plane. It is prepared before frames are changed in parallel: a thread that prepared it on demand
/// could meet another frame that waits for it.
struct PlatePart {
    /// Pixels that belong to it and are not transparent.
    interpolator: Interpolator,
    /// Track of its plane; `None` for that of the shot.
    track: Option<ShotTrack>,
}

/// Files that say on which plane each pixel of a plate lies.
pub(crate) struct RegionFiles<'a> {
    pub regions: &'a Path,
    /// Track of the planes.
    pub track: &'a TrackChoice<'a>,
}

/// Pixels by which the part of a plane is enlarged where it is seen, so that no gap opens between planes that meet.
const SEAM_PX: f64 = 2.0;

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
        let interpolator = Interpolator::new(&encoded(picture), unknown.as_ref());
        let whole = PlatePart {
            interpolator,
            track: None,
        };
        Self {
            size: picture.size(),
            pad_px,
            parts: vec![whole],
            still: None,
        }
    }

    /// The plate for a camera that stands still, which shows it alike in all frames.
    ///
    /// # Errors
    /// [`JobError::Cancelled`].
    pub fn standing(mut self, context: &Context) -> Result<Self, JobError> {
        if let Some(size) = self.frame_size() {
            let shown = self.in_frame(&Homography::IDENTITY, 0, size, context)?;
            self.still = Some(shown);
            self.parts.clear();
        }
        Ok(self)
    }

    /// The same plate with its planes: gray values of the picture `regions` are their numbers in the track, from 1.
    ///
    /// # Errors
    /// [`JobError::SizesDiffer`], [`JobError::Parameter`] for a plane that the track lacks, those of reading.
    pub fn with_regions(
        mut self,
        plate: &Path,
        files: &RegionFiles<'_>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let picture = files::read(files.regions, report, context)?;
        let size = self.size;
        if picture.image.size() != size {
            return Err(JobError::SizesDiffer {
                a: plate.to_path_buf(),
                a_size: size,
                b: files.regions.to_path_buf(),
                b_size: picture.image.size(),
            });
        }
        let numbers: Image<Srgb<u8>> = picture.convert();
        let tracks = ShotTrack::read_all(files.track, report, context)?;
        let planes = tracks.len();
        let largest = numbers.pixels().iter().map(|pixel| pixel.0[0]).max();
        if let Some(number) = largest.filter(|&number| usize::from(number) > planes) {
            return Err(JobError::Parameter {
                field: "regions",
                value: format!("plane {number}, and the track has {planes}"),
                range: "a picture whose gray values are numbers of its planes",
            });
        }
        let Some(whole) = self.parts.first() else {
            return Ok(self);
        };
        let mut parts = Vec::new();
        for (index, track) in tracks.into_iter().enumerate() {
            let own = Mask::from_fn(size, |col, row| {
                usize::from(numbers[(col, row)].0[0]) == index + 1
            });
            if own.is_empty() {
                continue;
            }
            let own = own.dilate(SEAM_PX);
            let others = Mask::from_fn(size, |col, row| own.at(col, row) <= 0.0);
            parts.push(PlatePart {
                interpolator: whole.interpolator.without(&others),
                track: Some(track),
            });
        }
        if !parts.is_empty() {
            self.parts = parts;
        }
        Ok(self)
    }

    /// The size of the frames to which the plate belongs.
    pub fn frame_size(&self) -> Option<Size> {
        let side = |length: usize| length.checked_sub(2 * self.pad_px);
        Size::new(side(self.size.width())?, side(self.size.height())?).ok()
    }

    /// The plate in the frame `index` of this size, to which `frame_from_reference` leads. Parts on planes of their own follow
    /// their tracks, and the first plane is in front; a plane that its track lacks there is not known.
    ///
    /// # Errors
    /// [`JobError::Cancelled`].
    pub fn in_frame(
        &self,
        frame_from_reference: &Homography,
        index: u64,
        size: Size,
        context: &Context,
    ) -> Result<Arc<PlateInFrame>, JobError> {
        if let Some(still) = &self.still {
            return Ok(still.clone());
        }
        let mut front: Option<Image<[f32; 4]>> = None;
        for part in &self.parts {
            let map = match &part.track {
                Some(track) => track.map(index),
                None => Some(frame_from_reference),
            };
            let Some(map) = map else {
                continue;
            };
            let behind = self.warped(map, &part.interpolator, size, context)?;
            front = Some(match front {
                Some(front) => over(front, &behind),
                None => behind,
            });
        }
        let pixels = front.unwrap_or_else(|| Image::new(size, [0.0; 4]));
        let colors = pixels.map(|[r, g, b, share]| {
            let scale = if share > 1e-3 { 1.0 / share } else { 0.0 };
            [r * scale, g * scale, b * scale]
        });
        let known = pixels.map(|[_, _, _, share]| share.clamp(0.0, 1.0));
        Ok(Arc::new(PlateInFrame { colors, known }))
    }

    /// Colors times the share of what is known of the plate in a frame, and this share.
    fn warped(
        &self,
        frame_from_reference: &Homography,
        interpolator: &Interpolator,
        size: Size,
        context: &Context,
    ) -> Result<Image<[f32; 4]>, JobError> {
        let shift = Homography::from_translation(DVec2::splat(self.pad_px as f64));
        let shift = shift.unwrap_or(Homography::IDENTITY);
        let middle = DVec2::new(size.width() as f64, size.height() as f64) * 0.5;
        let plate_from_frame = (shift * frame_from_reference.inverse()).facing(middle);
        let progress = context.progress.silent();
        Ok(interpolator.seen(&plate_from_frame, &[middle], size, &progress)?)
    }
}

/// Colors times share of `front`, and of `behind` where `front` leaves a share.
fn over(mut front: Image<[f32; 4]>, behind: &Image<[f32; 4]>) -> Image<[f32; 4]> {
    for (pixel, behind) in front.pixels_mut().iter_mut().zip(behind.pixels()) {
        let open = 1.0 - pixel[3].clamp(0.0, 1.0);
        for (pixel, behind) in pixel.iter_mut().zip(behind) {
            *pixel += open * behind;
        }
    }
    front
}

/// Refuses a map of planes without the track that has them.
pub(crate) fn check_regions(regions: Option<&Path>, track: Option<&Path>) -> Result<(), JobError> {
    if regions.is_none() || track.is_some() {
        return Ok(());
    }
    Err(JobError::Parameter {
        field: "regions",
        value: "given".to_owned(),
        range: "left out without `track`",
    })
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
