//! Clips with known truth: a filmed plane, moving shapes before it, cuts, light and noise.
//!
//! A clip is a list of shots. The background of a shot is one plane with a large picture on it, seen by a camera whose path
//! is a formula; shapes move over the plane on paths that are formulas too. So for each frame the homography of the
//! background, the outline and the alpha of each shape, the light, and the frame without shapes are known.
//!
//! ```
//! use ravec_raster::Size;
//! use ravec_scenes::Seed;
//! use ravec_scenes::clip::{ClipId, clip};
//!
//! // forty frames of a ball that rolls past; the frames may be asked for in any order
//! let clip = clip(ClipId::StillDisc, Size::new(64, 36)?, 40, Seed(1));
//! let (frame, truth) = (clip.frame(20), clip.frame_truth(20));
//! let ball = truth.shapes[0].disc.expect("the camera stands straight before the plane");
//! let covered: f32 = frame.alpha.pixels().iter().sum();
//! let area = std::f64::consts::PI * ball.radius_px * ball.radius_px;
//! assert!((f64::from(covered) / area - 1.0).abs() < 1e-3);
//! # Ok::<(), ravec_raster::SizeError>(())
//! ```
//!
//! Coordinates: pixels, x to the right, y down, the center of the first pixel at (0.5, 0.5); world pixels are those of the
//! plane. Colors are linear light.
//!
//! Guarantees: [`Clip::frame`] is a pure function of the clip and the index, with the same bytes on any number of threads; a
//! frame is `alpha·foreground + (1 − alpha)·plate`, exactly as computed in `f32`, before noise is added to the encoded
//! picture. Non-guarantees: linear light is not clipped, so light above white is possible where a gain asks for it; with a
//! shutter above 0 the homography and the outlines are those of the middle of the exposure, and alpha and plate are means
//! over it.
//!
//! Cost: the planes are painted when the clip is made, in seconds; then a frame of 640 × 360 takes about 30 ms of one core.
//! Memory: the planes, at most 384 MB each and far less at usual sizes, and one frame; none of it grows with the length.

mod camera;
mod catalog;
mod coat;
mod figure;
mod frame;
mod light;
mod ring;
mod sets;
mod shape;
mod track;
mod world;

pub use camera::{Camera, project};
pub use catalog::{ClipId, clip};
pub use frame::Frame;
pub use light::{FrameLight, Light};
pub use shape::{Disc, ShapeTruth};
pub use track::{Moment, SHAKE_WAVES, Track};
pub use world::{Features, Line, Quad, Round};

use crate::random::Seed;
use glam::{DMat3, DVec2};
use ravec_raster::Size;
use serde::{Deserialize, Serialize};
use shape::Shape;
use std::sync::Arc;
use world::World;

/// Frames a second of all clips.
pub const RATE_HZ: f64 = 25.0;

/// A sequence of frames with their truth.
#[derive(Debug, Clone)]
pub struct Clip {
    name: &'static str,
    size: Size,
    seed: Seed,
    shots: Vec<Shot>,
    /// Standard deviation of the Gaussian noise in [`Frame::stored`], in 8-bit steps of the encoded picture; 0 for none.
    pub noise_sigma: f64,
    /// Time that the shutter is open, as a share of the time between two frames, 0 to 1: more gives longer motion blur, and
    /// takes several times as long. At 0 each frame shows one moment.
    pub shutter: f64,
}

/// One shot.
#[derive(Debug, Clone)]
pub(crate) struct Shot {
    /// Index of its first frame.
    pub first: usize,
    /// Number of its frames.
    pub frames: usize,
    pub world: Arc<World>,
    pub camera: Camera,
    /// The first lies at the back.
    pub shapes: Vec<Shape>,
    pub light: Light,
}

/// Truth about a clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClipTruth {
    /// Name of the clip.
    pub clip: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Frames a second.
    pub rate_hz: f64,
    /// Seed of the clip.
    pub seed: Seed,
    /// Standard deviation of the noise, in 8-bit steps.
    pub noise_sigma: f64,
    /// Share of the time between two frames that the shutter is open.
    pub shutter: f64,
    /// Index of the first frame of each shot but the first.
    pub cuts: Vec<usize>,
    /// The shots.
    pub shots: Vec<ShotTruth>,
    /// Each frame; the last field, so that a program can write the frames one by one.
    pub frames: Vec<FrameTruth>,
}

/// Truth about a shot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ShotTruth {
    /// Index of its first frame.
    pub first: usize,
    /// Number of its frames.
    pub frames: usize,
    /// Extent of the picture on the plane, world pixels.
    pub extent: DVec2,
    /// Things of known place, in world pixels.
    pub features: Features,
}

/// Truth about a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameTruth {
    /// Its index.
    pub index: usize,
    /// Index of its shot.
    pub shot: usize,
    /// Maps (x, y, 1) in the world of the shot to the frame; serialized column by column.
    pub frame_from_world: DMat3,
    /// Its light.
    pub light: FrameLight,
    /// Features of the background in frame pixels: all lines, and those discs and rectangles that lie in the frame at least
    /// in part; none that lies behind the camera.
    pub features: Features,
    /// The moving shapes, from the back to the front.
    pub shapes: Vec<ShapeTruth>,
}

impl Clip {
    /// Name of the clip, as in [`ClipId::name`].
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Size of the frames.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Number of frames, at least 1.
    pub fn frames(&self) -> usize {
        self.shots.iter().map(|shot| shot.frames).sum()
    }

    /// Index of the first frame of each shot but the first.
    pub fn cuts(&self) -> Vec<usize> {
        self.shots[1..].iter().map(|shot| shot.first).collect()
    }

    /// Number of moving shapes in the shot of a frame.
    pub fn shapes(&self, index: usize) -> usize {
        self.shot(index).1.shapes.len()
    }

    /// The shot of a frame and its index; the last shot goes on beyond the end of the clip.
    pub(crate) fn shot(&self, index: usize) -> (usize, &Shot) {
        let after = self.shots.partition_point(|shot| shot.first <= index);
        // the first shot begins at frame 0
        (after - 1, &self.shots[after - 1])
    }

    /// Maps (x, y, 1) in the world of the frame's shot to the frame.
    ///
    /// Beyond the end of the clip the motion of the last shot goes on.
    pub fn frame_from_world(&self, index: usize) -> DMat3 {
        let shot = self.shot(index).1;
        shot.camera
            .frame_from_world(shot.moment(index, 0.0), self.size)
    }

    /// Maps the background of frame `b` to that of frame `a`; nothing across a cut.
    pub fn frame_from_frame(&self, a: usize, b: usize) -> Option<DMat3> {
        (self.shot(a).0 == self.shot(b).0)
            .then(|| self.frame_from_world(a) * self.frame_from_world(b).inverse())
    }

    /// Truth about a frame.
    pub fn frame_truth(&self, index: usize) -> FrameTruth {
        let (number, shot) = self.shot(index);
        let moment = shot.moment(index, 0.0);
        let frame_from_world = shot.camera.frame_from_world(moment, self.size);
        let mut features = shot.world.features.in_frame(&frame_from_world);
        features.discs.retain(|disc| self.meets(&disc.outline));
        features.quads.retain(|quad| self.meets(&quad.corners));
        FrameTruth {
            index,
            shot: number,
            frame_from_world,
            light: shot.frame_light(index),
            features,
            shapes: shot
                .shapes
                .iter()
                .map(|shape| shape.truth(&frame_from_world, moment))
                .collect(),
        }
    }

    /// Truth about the clip and all its frames.
    pub fn truth(&self) -> ClipTruth {
        let frames = (0..self.frames()).map(|index| self.frame_truth(index));
        ClipTruth {
            frames: frames.collect(),
            ..self.head()
        }
    }

    /// Truth about the clip without its frames: for programs that write [`Clip::frame_truth`] one by one.
    pub fn head(&self) -> ClipTruth {
        let shot = |shot: &Shot| ShotTruth {
            first: shot.first,
            frames: shot.frames,
            extent: shot.world.extent,
            features: shot.world.features.clone(),
        };
        ClipTruth {
            clip: self.name.to_owned(),
            width: self.size.width(),
            height: self.size.height(),
            rate_hz: RATE_HZ,
            seed: self.seed,
            noise_sigma: self.noise_sigma,
            shutter: self.shutter,
            cuts: self.cuts(),
            shots: self.shots.iter().map(shot).collect(),
            frames: Vec::new(),
        }
    }

    /// True if the box around points meets the frame.
    fn meets(&self, points: &[DVec2]) -> bool {
        let extent = DVec2::new(self.size.width() as f64, self.size.height() as f64);
        let low = points.iter().fold(DVec2::INFINITY, |a, &p| a.min(p));
        let high = points.iter().fold(DVec2::NEG_INFINITY, |a, &p| a.max(p));
        low.cmplt(extent).all() && high.cmpgt(DVec2::ZERO).all()
    }
}

impl Shot {
    /// The moment of a frame; `delay` is in frames.
    pub(crate) fn moment(&self, index: usize, delay: f64) -> Moment {
        let local = index.saturating_sub(self.first) as f64 + delay;
        Moment {
            share: if self.frames > 1 {
                local / (self.frames - 1) as f64
            } else {
                0.0
            },
            secs: local / RATE_HZ,
        }
    }

    pub(crate) fn frame_light(&self, index: usize) -> FrameLight {
        let local = index.saturating_sub(self.first);
        self.light.at(self.moment(index, 0.0), local, self.frames)
    }
}
