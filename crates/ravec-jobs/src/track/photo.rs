//! A photo of the plane, laid on the reference frame and from there on all.

use super::Track;
use super::file::TrackFile;
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::report::Report;
use crate::video::{open_clip, read_error};
use glam::dvec2;
use ravec::planar::track::{PhotoError, PhotoParams, PhotoPose, TrackParams, locate_photo};
use ravec::planar::{Beyond, Homography, warp};
use ravec::progress::Progress;
use ravec::raster::{Image, LinearRgba, PremulLinearRgba};
use ravec_media::Picture;
use ravec_video::FrameSource as _;
use serde_json::json;
use std::path::Path;

/// A photo with its place in the reference frame.
pub(super) struct Photo {
    image: Image<PremulLinearRgba>,
    reference_from_photo: Homography,
}

impl Photo {
    /// Finds the photo on the plane of the track, and records its place.
    ///
    /// # Errors
    /// [`JobError::Read`], [`JobError::ReadClip`], [`JobError::Photo`], [`JobError::Cancelled`].
    pub fn locate(
        operation: &Track,
        path: &Path,
        file: &TrackFile,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let [track] = &file.planes[..] else {
            return Err(super::wrong(
                "photo",
                &path.display(),
                "left out for several planes",
            ));
        };
        let picture = files::read(path, report, context)?;
        // the clip is in the list of inputs already
        let input = operation.input.as_path();
        let mut clip = open_clip(input, None, &mut Report::new("track", &()), context)?;
        clip.seek(track.reference).map_err(read_error(input))?;
        let frame = clip.next_frame().map_err(read_error(input))?;
        let frame = frame.ok_or_else(|| JobError::EmptyRange {
            path: input.to_path_buf(),
            range: track.reference.to_string(),
        })?;
        let params = PhotoParams {
            tracking: TrackParams {
                precision: operation.params.precision,
            },
            ..PhotoParams::default()
        };
        let found = report.time("photo", || {
            let frame = frame.picture.to_image();
            locate_photo(
                &picture.image,
                &frame,
                Some(track.quad),
                &params,
                &context.progress,
            )
        });
        let found = found.map_err(|cause| match cause {
            PhotoError::Cancelled => JobError::Cancelled,
            cause => JobError::Photo {
                path: path.to_path_buf(),
                cause,
            },
        })?;
        record(&found, &picture, file, report);
        Ok(Self {
            image: picture.convert(),
            reference_from_photo: found.frame_from_photo,
        })
    }

    /// Lays the photo over a frame.
    ///
    /// # Errors
    /// [`JobError::Cancelled`].
    pub fn draw(
        &self,
        image: &mut Image<LinearRgba>,
        frame_from_reference: &Homography,
        progress: &Progress,
    ) -> Result<(), JobError> {
        let photo_from_frame = (*frame_from_reference * self.reference_from_photo).inverse();
        let beyond = Beyond::Pixel(PremulLinearRgba([0.0; 4]));
        let laid = warp(
            &self.image,
            &photo_from_frame,
            image.size(),
            beyond,
            progress,
        )?;
        for (pixel, photo) in image.pixels_mut().iter_mut().zip(laid.pixels()) {
            let rest = 1.0 - photo.0[3];
            let [r, g, b, alpha] = pixel.0;
            if rest < 1.0 {
                // straight alpha of what lies below
                let below = rest * alpha;
                let alpha = photo.0[3] + below;
                let mixed = [r, g, b].map(|value| value * below);
                let color = [0, 1, 2].map(|k| (photo.0[k] + mixed[k]) / alpha);
                *pixel = LinearRgba([color[0], color[1], color[2], alpha]);
            }
        }
        Ok(())
    }
}

/// Adds the place of the photo to figures and result.
fn record(found: &PhotoPose, picture: &Picture, file: &TrackFile, report: &mut Report) {
    let size = picture.image.size();
    let (width, height) = (size.width() as f64, size.height() as f64);
    let corners = [
        dvec2(0.0, 0.0),
        dvec2(width, 0.0),
        dvec2(width, height),
        dvec2(0.0, height),
    ];
    let corners = corners.map(|corner| {
        let place = found.frame_from_photo.try_apply(corner);
        // behind the horizon there is no corner
        place.map(|place| file.centers.write(place).to_array())
    });
    for (name, figure) in [
        ("photo_inliers", found.inliers as f64),
        ("photo_sigma_px", found.sigma_px()),
    ] {
        report.figures.insert(name, figure);
    }
    if let Some(result) = &mut report.result {
        result["photo"] = json!({
            "reference_from_photo": file.centers.write_map(&found.frame_from_photo).to_rows(),
            "corners": corners,
            "state": found.state,
            "sigma_px": found.sigma_px(),
            "inliers": found.inliers,
            "inlier_share": found.inlier_share,
            "visible": found.visible,
            "gain": found.gain,
            "bias": found.bias,
        });
    }
}
