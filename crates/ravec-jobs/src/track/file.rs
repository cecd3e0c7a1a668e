//! Tracks as files.
//!
//! A file is one object in JSON with lists that have one entry for each tracked frame, the first one for frame `first` of the clip:
//!
//! ```json
//! {
//!   "format": "ravec-track", "version": 1,
//!   "width": 640, "height": 480, "pixel_centers": "half",
//!   "reference": 0, "first": 0,
//!   "quad": [x0, y0, x1, y1, x2, y2, x3, y3],
//!   "corners": [[x0, y0, x1, y1, x2, y2, x3, y3], ...],
//!   "frame_from_reference": [[h0, h1, h2, h3, h4, h5, h6, h7, h8], ...],
//!   "state": ["tracked", "weak", "lost", ...],
//!   "sigma_px": [...], "inlier_share": [...], "visible": [...], "residual": [...],
//!   "gain": [...], "bias": [...], "keyframe": [...],
//!   "covariance": [[64 numbers, row by row, in the order of the corners], ...]
//! }
//! ```
//!
//! Matrices are row by row. With several planes the fields from `reference` on are in the objects of a list `planes`.
//! `sigma_px` follows from `covariance` and is not read. Points are in pixels, x right, y down, with pixel centers as
//! `pixel_centers` says: `half` or `integer`.
//!
//! Guarantees: a file that is written is read again as it was, to the rounding of a conversion between conventions. No panic on
//! any bytes; lists of other lengths than the others, numbers that are none, maps that have no inverse and unknown fields are
//! refused with a sentence.

use crate::pixel_centers::PixelCenters;
use glam::{DVec2, dvec2};
use ravec::planar::Homography;
use ravec::planar::track::{CornerCovariance, Track, TrackState, TrackedFrame};
use ravec::raster::Size;
use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Name of the format in the file.
const FORMAT: &str = "ravec-track";
/// Version that is written and read.
const VERSION: u32 = 1;
/// The largest file that is read: about 100 000 frames of a plane.
pub(super) const MAX_BYTES: u64 = 256 << 20;
/// Planes of a file: more make no sense in one shot.
pub(super) const MAX_PLANES: usize = 64;
/// The largest coordinate that is read, in pixels: beyond it a plane is nowhere near the picture.
const MAX_COORDINATE: f64 = 1e9;

/// Tracks of planes in one clip.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TrackFile {
    /// Convention of the points in the file.
    pub centers: PixelCenters,
    /// At least one, all of the same size of frames.
    pub planes: Vec<Track>,
}

/// An object of the file: the whole, or a plane in the list `planes`. Fields that it lacks are found out by their lengths.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Object {
    format: Option<String>,
    version: Option<u32>,
    width: Option<usize>,
    height: Option<usize>,
    pixel_centers: Option<PixelCenters>,
    planes: Option<Vec<Object>>,
    reference: u64,
    first: u64,
    quad: Option<[f64; 8]>,
    corners: Vec<[f64; 8]>,
    frame_from_reference: Vec<[f64; 9]>,
    state: Vec<TrackState>,
    sigma_px: IgnoredAny,
    inlier_share: Vec<f64>,
    visible: Vec<f64>,
    residual: Vec<f64>,
    gain: Vec<f64>,
    bias: Vec<f64>,
    keyframe: Vec<usize>,
    covariance: Vec<Vec<f64>>,
}

fn flat(points: [DVec2; 4]) -> [f64; 8] {
    let [a, b, c, d] = points;
    [a.x, a.y, b.x, b.y, c.x, c.y, d.x, d.y]
}

fn points(numbers: &[f64; 8]) -> [DVec2; 4] {
    [0, 2, 4, 6].map(|k| dvec2(numbers[k], numbers[k + 1]))
}

impl Object {
    /// True for an object that has fields of the whole file.
    fn is_whole(&self) -> bool {
        self.planes.is_some()
            || self.format.is_some()
            || self.version.is_some()
            || self.width.is_some()
            || self.height.is_some()
            || self.pixel_centers.is_some()
    }

    /// Checks the lists and makes a track of them.
    fn track(&self, size: Size, centers: PixelCenters, max_frames: u64) -> Result<Track, String> {
        let frames = self.corners.len();
        if frames == 0 {
            return Err("`corners` is missing: it needs an entry for every frame".to_owned());
        }
        if frames as u64 > max_frames {
            return Err(format!(
                "it has {frames} frames, more than the {max_frames} of `max_frames`"
            ));
        }
        for (name, length) in [
            ("frame_from_reference", self.frame_from_reference.len()),
            ("state", self.state.len()),
            ("inlier_share", self.inlier_share.len()),
            ("visible", self.visible.len()),
            ("residual", self.residual.len()),
            ("gain", self.gain.len()),
            ("bias", self.bias.len()),
            ("keyframe", self.keyframe.len()),
            ("covariance", self.covariance.len()),
        ] {
            if length != frames {
                return Err(format!(
                    "`{name}` has {length} entries, but `corners` has {frames}: each list needs one for every frame"
                ));
            }
        }
        let end = self.first.checked_add(frames as u64);
        if end.is_none_or(|end| !(self.first..end).contains(&self.reference)) {
            return Err(format!(
                "the reference frame {} is not among its frames, which are {frames} from {} on",
                self.reference, self.first
            ));
        }
        let quad = self.quad.as_ref().ok_or("`quad` is missing")?;
        let quad = centers.read_all(corners_of(quad, "`quad`")?);
        Homography::from_unit_square(quad)
            .map_err(|cause| format!("`quad` is no rectangle in perspective: {cause}"))?;
        let tracked = (0..frames).map(|at| {
            self.frame(at, quad, centers)
                .map_err(|reason| format!("frame {}: {reason}", self.first + at as u64))
        });
        Ok(Track {
            width: size.width(),
            height: size.height(),
            quad,
            reference: self.reference,
            first: self.first,
            frames: tracked.collect::<Result<_, _>>()?,
        })
    }

    fn frame(
        &self,
        at: usize,
        quad: [DVec2; 4],
        centers: PixelCenters,
    ) -> Result<TrackedFrame, String> {
        let corners = centers.read_all(corners_of(&self.corners[at], "`corners`")?);
        let rows = &self.frame_from_reference[at];
        let map = Homography::from_matrix(glam::DMat3::from_cols_array(rows).transpose())
            .map_err(|cause| format!("`frame_from_reference` is no map between frames: {cause}"))?;
        let middle = quad.iter().sum::<DVec2>() * 0.25;
        let map = centers.read_map(&map).facing(middle);
        for (name, value) in [
            ("inlier_share", self.inlier_share[at]),
            ("visible", self.visible[at]),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(format!("`{name}` is {value}, but must be 0 to 1"));
            }
        }
        for (name, value) in [
            ("residual", self.residual[at]),
            ("gain", self.gain[at]),
            ("bias", self.bias[at]),
        ] {
            if !value.is_finite() {
                return Err(format!("`{name}` is not a number"));
            }
        }
        Ok(TrackedFrame {
            state: self.state[at],
            frame_from_reference: map,
            corners,
            covariance: covariance_of(&self.covariance[at])?,
            inlier_share: self.inlier_share[at],
            visible: self.visible[at],
            residual: self.residual[at],
            gain: self.gain[at],
            bias: self.bias[at],
            keyframe: self.keyframe[at],
        })
    }
}

/// Writes the fields of a plane, a line for each frame of a list of lists.
fn write_plane(out: &mut String, indent: &str, track: &Track, centers: PixelCenters) {
    let frames = &track.frames;
    let numbers = |of: &dyn Fn(&TrackedFrame) -> f64| -> String {
        compact(&frames.iter().map(of).collect::<Vec<_>>())
    };
    let rows = |of: &dyn Fn(&TrackedFrame) -> String| -> String {
        let lines = frames
            .iter()
            .map(|frame| format!("{indent}  {}", of(frame)));
        format!("[\n{}\n{indent}]", lines.collect::<Vec<_>>().join(",\n"))
    };
    let states: Vec<_> = frames.iter().map(|frame| frame.state).collect();
    let keyframes: Vec<_> = frames.iter().map(|frame| frame.keyframe).collect();
    let map = |frame: &TrackedFrame| centers.write_map(&frame.frame_from_reference).to_rows();
    let fields = [
        ("reference", track.reference.to_string()),
        ("first", track.first.to_string()),
        ("quad", compact(&flat(centers.write_all(track.quad)))),
        (
            "corners",
            rows(&|frame| compact(&flat(centers.write_all(frame.corners)))),
        ),
        ("frame_from_reference", rows(&|frame| compact(&map(frame)))),
        ("state", compact(&states)),
        ("sigma_px", numbers(&TrackedFrame::sigma_px)),
        ("inlier_share", numbers(&|frame| frame.inlier_share)),
        ("visible", numbers(&|frame| frame.visible)),
        ("residual", numbers(&|frame| frame.residual)),
        ("gain", numbers(&|frame| frame.gain)),
        ("bias", numbers(&|frame| frame.bias)),
        ("keyframe", compact(&keyframes)),
        (
            "covariance",
            rows(&|frame| compact(&frame.covariance.as_flattened())),
        ),
    ];
    let fields = fields.map(|(name, value)| format!("{indent}\"{name}\": {value}"));
    out.push_str(&fields.join(",\n"));
    out.push('\n');
}

fn compact(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("lists of numbers and names are plain values")
}

fn corners_of(numbers: &[f64; 8], name: &str) -> Result<[DVec2; 4], String> {
    // also false for what is not a number
    if !numbers.iter().all(|number| number.abs() <= MAX_COORDINATE) {
        return Err(format!(
            "{name} has a coordinate that is not a number from -1e9 to 1e9"
        ));
    }
    Ok(points(numbers))
}

fn covariance_of(numbers: &[f64]) -> Result<CornerCovariance, String> {
    if numbers.len() != 64 {
        return Err(format!(
            "`covariance` has {} numbers, but 8 rows of 8 are needed",
            numbers.len()
        ));
    }
    if !numbers.iter().all(|number| number.is_finite()) {
        return Err("`covariance` has an entry that is not a number".to_owned());
    }
    let mut covariance = [[0.0; 8]; 8];
    for (row, numbers) in covariance.iter_mut().zip(numbers.chunks_exact(8)) {
        row.copy_from_slice(numbers);
    }
    if (0..8).any(|k| covariance[k][k] < 0.0) {
        return Err("`covariance` has a negative variance".to_owned());
    }
    Ok(covariance)
}

impl TrackFile {
    /// Size of the frames.
    pub fn size(&self) -> Option<(usize, usize)> {
        self.planes.first().map(|plane| (plane.width, plane.height))
    }

    /// Numbers of the frames from the first that any plane has to the last.
    pub fn range(&self) -> Range<u64> {
        let planes = self.planes.iter();
        let first = planes.clone().map(|plane| plane.first).min();
        let end = planes.map(|plane| plane.first + plane.frames.len() as u64);
        first.unwrap_or(0)..end.max().unwrap_or(0)
    }

    /// The file.
    pub fn to_json(&self) -> String {
        let (width, height) = self.size().unwrap_or_default();
        let mut text = format!(
            "{{\n  \"format\": \"{FORMAT}\",\n  \"version\": {VERSION},\n  \"width\": {width},\n  \"height\": {height},\n  \"pixel_centers\": {},\n",
            compact(&self.centers)
        );
        if let [plane] = &self.planes[..] {
            write_plane(&mut text, "  ", plane, self.centers);
        } else {
            text.push_str("  \"planes\": [\n");
            for (at, plane) in self.planes.iter().enumerate() {
                text.push_str("    {\n");
                write_plane(&mut text, "      ", plane, self.centers);
                let end = if at + 1 < self.planes.len() {
                    "    },\n"
                } else {
                    "    }\n"
                };
                text.push_str(end);
            }
            text.push_str("  ]\n");
        }
        text.push_str("}\n");
        text
    }

    /// Reads a file of at most `max_frames` frames a plane.
    ///
    /// # Errors
    /// A sentence for the user.
    pub fn from_json(text: &str, max_frames: u64) -> Result<Self, String> {
        let whole: Object = serde_json::from_str(text)
            .map_err(|error| format!("it is not in the form of a track: {error}"))?;
        if whole.format.as_deref() != Some(FORMAT) {
            return Err(format!("it is no track: it lacks \"format\": \"{FORMAT}\""));
        }
        if whole.version != Some(VERSION) {
            return Err(format!("it is not of version {VERSION}, which is needed"));
        }
        let (width, height) = (
            whole.width.unwrap_or_default(),
            whole.height.unwrap_or_default(),
        );
        let size = Size::new(width, height)
            .map_err(|_| format!("{width} x {height} is no size of frames"))?;
        let centers = whole.pixel_centers.unwrap_or_default();
        let planes = match &whole.planes {
            None => std::slice::from_ref(&whole),
            Some(planes) => {
                if !whole.corners.is_empty() {
                    return Err("it has `corners` beside `planes`".to_owned());
                }
                if planes.iter().any(Object::is_whole) {
                    return Err("a plane has fields of the whole file".to_owned());
                }
                &planes[..]
            }
        };
        if planes.is_empty() || planes.len() > MAX_PLANES {
            return Err(format!(
                "it has {} planes, but must have 1 to {MAX_PLANES}",
                planes.len()
            ));
        }
        let read = |(at, plane): (usize, &Object)| {
            plane
                .track(size, centers, max_frames)
                .map_err(|reason| match planes.len() {
                    1 => reason,
                    _ => format!("plane {}: {reason}", at + 1),
                })
        };
        let planes = planes.iter().enumerate().map(read);
        Ok(Self {
            centers,
            planes: planes.collect::<Result<_, _>>()?,
        })
    }
}

#[cfg(test)]
pub(super) mod tests;
