//! `video enhance`: a clip twice as large, whose plane comes from a sharp photo.

use super::{
    AlphaSource, Edit, EditFrame, EditInputs, EditOutput, FrameEdit, OpenEdit, ShotEdit,
    ShotFrames, ShotParams, SideData, SideInputs,
};
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::{Operation, paths};
use crate::plane::Quad;
use crate::report::Report;
use crate::shot::encoded;
use crate::video::{Encoding, clip_folders, clip_outputs};
use glam::{DVec2, dvec2};
use ravec::matting::Colors;
use ravec::planar::Homography;
use ravec::planar::track::{PhotoError, PhotoParams, locate_photo};
use ravec::raster::{AnyImage, Plane, Size, elliptic_gaussian_blur};
use ravec::video_edit::{Enhancement, Interpolator, Tone};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Enhance a clip by a sharp photo of its plane: twice as large, with people in front where they are
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Enhance {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png
    pub input: PathBuf,
    /// Output: a file, a folder that is there, or a pattern such as out_%04d.png
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Photo of the plane, of another camera, zoom or light
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub photo: PathBuf,
    /// Picture of the background, as ravec plate makes it: the photo is laid on it
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub plate: PathBuf,
    /// Matte of the foreground, as ravec matte makes it: a clip, or one picture for all frames
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    pub matte: PathBuf,
    /// Track of the background, as ravec track writes it to a .json file [default: the camera stands still]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub track: Option<PathBuf>,
    /// Map of the planes of a plate, as ravec plate --regions writes it: gray values are numbers of planes of the track
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE", requires = "track"))]
    #[serde(default)]
    pub regions: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec video enhance wall.y4m --track w.json --plate w.png --matte m.png --photo p.png -o big.y4m
  ravec video enhance wall.y4m --plate w.png --matte m.png --photo p.png --blur matched -o big.y4m

The place of the photo is found on the plate, and its colors are brought to those of the plate by a curve for each channel; each frame \
then has its own light. Where the photo ends, the enlarged frame goes on. With --blur matched, frames of a camera in motion or out of \
focus stay as blurred against the plate as they are; otherwise all frames are as sharp as the photo. The noise of the photo stays in \
it: clean a noisy one before, by ravec brush --mode clean --everywhere.

Figures: frames, photo_inliers, photo_sigma_px.";

/// Parameters of [`Enhance`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Geometry of the shot.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub shot: ShotParams,
    /// Corners of a rectangle on the plane in the reference frame: the photo is sought there [default: everywhere]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", allow_hyphen_values = true)
    )]
    pub quad: Option<Quad>,
    /// Blur of the photo in the frames
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = PhotoBlur::None))]
    pub blur: PhotoBlur,
    /// Encoding of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

/// Blur of the photo in the frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum PhotoBlur {
    /// None: all frames as sharp as the photo
    #[default]
    None,
    /// That of the frame against the plate, as of a camera in motion
    Matched,
}

impl Operation for Enhance {
    const NAME: &'static str = "video enhance";

    fn inputs(&self) -> Vec<&Path> {
        let mut inputs = paths(&self.input, [&self.track, &self.regions]);
        let others = [&self.photo, &self.plate, &self.matte];
        inputs.extend(others.map(PathBuf::as_path));
        inputs
    }

    fn outputs(&self) -> Vec<&Path> {
        clip_outputs(&self.output)
    }

    fn folders(&self) -> Vec<&Path> {
        clip_folders(&self.output)
    }

    /// Writes the enhanced clip.
    ///
    /// Figures: `frames`, `photo_inliers`, `photo_sigma_px`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::ResultSize`], [`JobError::Quad`], [`JobError::Outside`], [`JobError::Photo`], [`JobError::Read`],
    /// [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::SizesDiffer`], [`JobError::TrackFile`], [`JobError::ClipTooShort`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let mut report = Report::of(self, &self.params);
        let inputs = self.edit_inputs();
        let open = OpenEdit::new(self, &inputs, &mut report, context)?;
        let double = doubled(open.edit.size, context)?;
        let frames = self.frames(open.edit, open.alpha, &mut report, context)?;
        let files = EditOutput {
            size: Some(double),
            ..inputs.output(&open.output, "enhance")
        };
        frames.write(self, &files, open.clip, &mut report, context)?;
        Ok(report)
    }
}

/// Twice the size of a frame.
fn doubled(size: Size, context: &Context) -> Result<Size, JobError> {
    let (width, height) = (2 * size.width(), 2 * size.height());
    Size::new(width, height)
        .ok()
        .filter(|double| double.pixels() as u64 <= context.limits.max_pixels)
        .ok_or(JobError::ResultSize {
            width: width as f64,
            height: height as f64,
            remedy: "give a smaller clip",
        })
}

impl ShotEdit for Enhance {
    fn edit_inputs(&self) -> EditInputs<'_> {
        EditInputs {
            input: &self.input,
            output: &self.output,
            plate: &self.plate,
            track: self.track.as_deref(),
            regions: self.regions.as_deref(),
            matte: &self.matte,
            params: &self.params.shot,
            encoding: &self.params.encoding,
        }
    }

    fn frames(
        &self,
        edit: Edit,
        alpha: AlphaSource,
        report: &mut Report,
        context: &Context,
    ) -> Result<ShotFrames, JobError> {
        let size = doubled(edit.size, context)?;
        let photo = self.photo_on_plane(edit.size, report, context)?;
        Ok(ShotFrames {
            sides: SideInputs {
                alpha: Some(alpha),
                ..SideInputs::default()
            },
            edit: Box::new(Frames {
                edit,
                photo,
                size,
                blur: self.params.blur,
            }),
        })
    }
}

/// Frames with the detail of a photo, at twice the size.
struct Frames {
    edit: Edit,
    photo: PhotoOnPlane,
    size: Size,
    blur: PhotoBlur,
}

impl FrameEdit for Frames {
    fn result(
        &self,
        index: u64,
        image: &AnyImage,
        side: SideData,
        context: &Context,
    ) -> Result<Colors, JobError> {
        let EditFrame {
            colors,
            alpha,
            map,
            blur,
            ..
        } = self.edit.frame(index, image, side.alpha, context)?;
        let half = Homography::from_scale(DVec2::splat(0.5)).unwrap_or(Homography::IDENTITY);
        let photo = &self.photo;
        let output_from_photo = half.inverse() * map * photo.reference_from_photo;
        let middle = output_from_photo.apply(photo.middle);
        let photo_from_output = output_from_photo.inverse().facing(middle);
        let progress = context.progress.silent();
        let mut photo =
            (photo.picture).seen(&photo_from_output, &[middle], self.size, &progress)?;
        if self.blur == PhotoBlur::Matched {
            photo = elliptic_gaussian_blur(&photo, blur.enlarged(2.0));
        }
        photo.for_each_row(|_, row| {
            for [r, g, b, share] in row {
                for value in [r, g, b] {
                    *value = value.clamp(0.0, 1.0);
                }
                *share = if *share > 0.999 { 1.0 } else { 0.0 };
            }
        });
        let enhancement = Enhancement {
            frame: &colors,
            alpha: &alpha,
            photo,
        };
        Ok(enhancement.result()?)
    }
}

/// A photo in the tone of the plate, and its place.
struct PhotoOnPlane {
    /// sRGB-encoded colors.
    picture: Interpolator,
    /// Middle of the photo.
    middle: DVec2,
    reference_from_photo: Homography,
}

impl Enhance {
    fn photo_on_plane(
        &self,
        frame: Size,
        report: &mut Report,
        context: &Context,
    ) -> Result<PhotoOnPlane, JobError> {
        let shot = &self.params.shot;
        let photo = files::read(&self.photo, report, context)?.image;
        // the plate is in the list of inputs already
        let plate = files::read(&self.plate, &mut Report::new("plate", &()), context)?.image;
        let shift = DVec2::splat(shot.pad as f64);
        let (width, height) = (frame.width() as f64, frame.height() as f64);
        let whole = [
            dvec2(0.0, 0.0),
            dvec2(width, 0.0),
            dvec2(width, height),
            dvec2(0.0, height),
        ];
        let given = self.params.quad.as_ref();
        let quad = given.map_or(Ok(whole), |quad| quad.check(shot.pixel_centers, frame))?;
        let quad = quad.map(|at| at + shift);
        let found = locate_photo(
            &photo,
            &plate,
            Some(quad),
            &PhotoParams::default(),
            &context.progress,
        );
        let found = found.map_err(|cause| match cause {
            PhotoError::Cancelled => JobError::Cancelled,
            cause => JobError::Photo {
                path: self.photo.clone(),
                cause,
            },
        })?;
        report.figures.insert("photo_inliers", found.inliers as f64);
        report.figures.insert("photo_sigma_px", found.sigma_px());
        let size = photo.size();
        let middle = dvec2(size.width() as f64, size.height() as f64) * 0.5;
        let picture = Interpolator::new(&encoded(&photo), None);
        drop(photo);
        let plate = encoded(&plate);
        let on_plate = found.frame_from_photo.apply(middle);
        let photo_from_plate = found.frame_from_photo.inverse().facing(on_plate);
        let progress = context.progress.silent();
        let laid = picture.seen(&photo_from_plate, &[on_plate], plate.size(), &progress)?;
        // what lies beyond the reference frame may be invented
        let pad = shot.pad;
        let in_frame = |col: usize, row: usize| {
            (pad..pad + frame.width()).contains(&col) && (pad..pad + frame.height()).contains(&row)
        };
        let share = Plane::from_fn(laid.size(), |col, row| {
            if in_frame(col, row) {
                laid[(col, row)][3]
            } else {
                0.0
            }
        });
        let laid: Colors = laid.map(|[r, g, b, _]| [r, g, b]);
        let tone = Tone::fit(&laid, &plate, &share)?;
        let back = Homography::from_translation(-shift).unwrap_or(Homography::IDENTITY);
        Ok(PhotoOnPlane {
            picture: picture.recolored(|color| tone.applied(color)),
            middle,
            reference_from_photo: back * found.frame_from_photo,
        })
    }
}
