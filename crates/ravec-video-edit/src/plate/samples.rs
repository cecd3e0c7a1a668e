//! The first pass: samples of the frames, and the modes of each pixel.

use super::hidden::{self, Mark};
use super::modes::Samples;
use super::on_plane::{Geometry, MAX_PAIRS, OnPlane, Stabilized, exposure_of, pairs_of};
use super::{PlateModes, ShotFrame, coherent};
use crate::VideoEditError;
use crate::exposure::{Exposure, median};
use ravec_progress::Progress;
use ravec_raster::{Image, Plane, Size};
use rayon::prelude::*;

/// Memory for the samples of the first pass, in bytes.
const MAX_SAMPLE_BYTES: usize = 400 << 20;
/// Frames of samples at least, whatever they take.
const MIN_LAYERS: usize = 8;
/// Frames of samples at most: more do not make a mode more certain.
const MAX_LAYERS: usize = 96;
/// Radius of a mode: in standard deviations of the noise, and what is added for inexact maps and blur, in steps of 8 bits.
const RADIUS_SIGMAS: f32 = 7.0;
const RADIUS_STEPS: f32 = 14.0;
/// Layers to whose median the exposure of a frame is fitted.
const ANCHORS: usize = 7;

/// Label of a pixel of a layer.
#[repr(u8)]
#[derive(Clone, Copy, PartialEq, Eq)]
enum Label {
    Empty = 0,
    Sample = 1,
    Background = 2,
}

/// A frame on the plate, in 8 bits.
type Layer = Image<[u8; 4]>;

/// The first pass over the frames of a shot.
#[derive(Clone)]
pub struct PlateSamples {
    geometry: Geometry,
    layers: Vec<Layer>,
    max_layers: usize,
    /// Number of frames, if it is known.
    total: Option<u64>,
    /// Distance of the frames that are kept.
    stride: u64,
    frames: u64,
    /// Pixels that strokes mark as foreground in some frame, and their colors in steps of 8 bits.
    marks: Vec<Mark>,
}

impl PlateSamples {
    /// Starts a plate of the size of a frame with `pad_px` pixels more on each side. `frames` is their number, if it is known.
    ///
    /// # Errors
    /// [`VideoEditError::PlateTooLarge`] if the sides overflow what an image may have.
    pub fn new(frame: Size, pad_px: usize, frames: Option<u64>) -> Result<Self, VideoEditError> {
        let too_large = || VideoEditError::PlateTooLarge { frame, pad_px };
        let side = |length: usize| pad_px.checked_mul(2)?.checked_add(length);
        let (width, height) = side(frame.width())
            .zip(side(frame.height()))
            .ok_or_else(too_large)?;
        let plate = Size::new(width, height).map_err(|_| too_large())?;
        let max_layers = (MAX_SAMPLE_BYTES / (4 * plate.pixels())).clamp(MIN_LAYERS, MAX_LAYERS);
        let stride = frames.unwrap_or(1).div_ceil(max_layers as u64).max(1);
        Ok(Self {
            geometry: Geometry {
                frame,
                plate,
                pad_px,
            },
            layers: Vec::new(),
            max_layers,
            total: frames,
            stride,
            frames: 0,
            marks: Vec::new(),
        })
    }

    /// Limits the samples so that `plates` plates, which are made at once, share the memory of one.
    #[must_use]
    pub fn sharing_memory(mut self, plates: usize) -> Self {
        self.max_layers = (self.max_layers / plates.max(1)).max(MIN_LAYERS);
        self.stride = self
            .total
            .unwrap_or(1)
            .div_ceil(self.max_layers as u64)
            .max(1);
        self
    }

    /// Takes the next frame.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn add(&mut self, frame: &ShotFrame<'_>) -> Result<(), VideoEditError> {
        Self::add_planes(std::slice::from_mut(self), &[Some(*frame)])
    }

    /// Takes the next frame of a shot of several planes, whose plates have one exposure: the frame along each plane, or nothing where
    /// the plane is not found.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn add_planes(
        planes: &mut [Self],
        frames: &[Option<ShotFrame<'_>>],
    ) -> Result<(), VideoEditError> {
        let mut on_planes = Vec::new();
        for (plane, (samples, frame)) in planes.iter_mut().zip(frames).enumerate() {
            let Some(frame) = frame else {
                continue;
            };
            let marked = frame.foreground.is_some() || frame.background.is_some();
            let kept = samples.frames.is_multiple_of(samples.stride) || marked;
            samples.frames += 1;
            if kept {
                let stabilized = samples.geometry.stabilized(frame)?;
                let pairs = pairs_of(&stabilized, |col, row| samples.anchor(col, row));
                on_planes.push(OnPlane {
                    plane,
                    frame,
                    stabilized,
                    pairs,
                });
            }
        }
        let exposure = exposure_of(&on_planes);
        for on in on_planes {
            planes[on.plane].take(on.frame, &on.stabilized, &exposure)?;
        }
        Ok(())
    }

    /// Keeps a frame that lies on the plate.
    fn take(
        &mut self,
        frame: &ShotFrame<'_>,
        stabilized: &Stabilized,
        exposure: &Exposure,
    ) -> Result<(), VideoEditError> {
        let mut layer = Layer::new(self.geometry.plate, [0; 4]);
        layer
            .par_rows_mut()
            .zip(stabilized.par_rows())
            .for_each(|(layer, stabilized)| {
                for (layer, [r, g, b, share]) in layer.iter_mut().zip(stabilized) {
                    if *share == 0.0 {
                        continue;
                    }
                    let color = exposure.undone([*r, *g, *b]);
                    let [r, g, b] = color.map(|value| (255.0 * value + 0.5) as u8);
                    *layer = [r, g, b, Label::Sample as u8];
                }
            });
        if let Some(mask) = frame.strokes {
            let marked = self.geometry.marked(frame, mask);
            let whole = self.geometry.stabilized(&ShotFrame {
                foreground: None,
                ..*frame
            })?;
            for row in 0..marked.size().height() {
                for col in 0..marked.size().width() {
                    let [r, g, b, known] = whole[(col, row)];
                    if marked.at(col, row) > 0.0 && known > 0.0 {
                        let color = exposure.undone([r, g, b]).map(|value| 255.0 * value);
                        self.marks.push(Mark {
                            at: (col, row),
                            color,
                        });
                    }
                }
            }
        }
        if let Some(mask) = frame.background {
            let marked = self.geometry.marked(frame, mask);
            for (pixel, marked) in layer
                .pixels_mut()
                .iter_mut()
                .zip(marked.coverage().pixels())
            {
                if pixel[3] != Label::Empty as u8 && *marked > 0.0 {
                    pixel[3] = Label::Background as u8;
                }
            }
        }
        if self.layers.len() >= 2 * self.max_layers {
            let mut index = 0;
            self.layers.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.stride *= 2;
        }
        self.layers.push(layer);
        Ok(())
    }

    /// The median of some layers at a pixel, spread over all of them: what passes is in few, and errors do not add up.
    fn anchor(&self, col: usize, row: usize) -> Option<[f32; 3]> {
        let count = self.layers.len().min(ANCHORS);
        let mut values = [[0u8; ANCHORS]; 3];
        let mut found = 0;
        for index in 0..count {
            // the first one and the last one, too
            let at = index * (self.layers.len() - 1) / (count - 1).max(1);
            let [r, g, b, label] = self.layers[at][(col, row)];
            if label != Label::Empty as u8 {
                for (values, value) in values.iter_mut().zip([r, g, b]) {
                    values[found] = value;
                }
                found += 1;
            }
        }
        let last = found.checked_sub(1)?;
        Some(values.map(|mut values| {
            let values = &mut values[..found];
            values.sort_unstable();
            let middle = f32::from(values[last / 2]) + f32::from(values[found / 2]);
            middle / 510.0
        }))
    }

    /// Finds the modes.
    ///
    /// # Errors
    /// [`VideoEditError::NoFrames`], [`VideoEditError::Cancelled`].
    pub fn modes(self, progress: &Progress) -> Result<PlateModes, VideoEditError> {
        if self.layers.is_empty() {
            return Err(VideoEditError::NoFrames);
        }
        let noise = noise(&self.layers);
        self.modes_with(noise, progress)
    }

    /// Finds the modes along several planes. The noise is that of the plane along which frames differ least.
    ///
    /// # Errors
    /// As [`modes`](Self::modes).
    pub fn modes_of_planes(
        planes: Vec<Self>,
        progress: &Progress,
    ) -> Result<Vec<PlateModes>, VideoEditError> {
        if planes.iter().any(|samples| samples.layers.is_empty()) {
            return Err(VideoEditError::NoFrames);
        }
        let noises = planes.iter().map(|samples| noise(&samples.layers));
        let noise = noises.fold(f32::INFINITY, f32::min);
        let modes = planes.into_iter();
        modes
            .map(|samples| samples.modes_with(noise, progress))
            .collect()
    }

    /// Finds the modes of frames with this standard deviation of the noise, in steps of 8 bits.
    fn modes_with(self, noise: f32, progress: &Progress) -> Result<PlateModes, VideoEditError> {
        let radius = RADIUS_STEPS.hypot(RADIUS_SIGMAS * noise);
        let size = self.geometry.plate;
        let phase = progress.phase("modes", size.height() as u64);
        let mut modes = Image::new(size, [0.0f32; 4]);
        let mut share = Plane::new(size, 0.0);
        modes
            .par_rows_mut()
            .zip(share.par_rows_mut())
            .enumerate()
            .try_for_each_init(Samples::default, |samples, (row, (modes, share))| {
                progress.check()?;
                let mut guess = [128.0; 3];
                for (col, (mode, share)) in modes.iter_mut().zip(share).enumerate() {
                    self.collect(col, row, samples);
                    let Some(found) = samples.densest(guess, radius) else {
                        continue;
                    };
                    guess = found.color;
                    let [r, g, b] = found.color;
                    *mode = [r, g, b, 1.0];
                    *share = found.density / samples.len() as f32;
                }
                phase.advance(1);
                Ok::<(), VideoEditError>(())
            })?;
        let samples = |col: usize, row: usize| {
            let mut samples = Samples::default();
            self.collect(col, row, &mut samples);
            samples
        };
        coherent::make_coherent(&mut modes, &share, radius, &samples);
        progress.check()?;
        if !self.marks.is_empty() {
            hidden::uncover(&mut modes, &share, &self.marks, radius, &samples);
        }
        let modes = modes.map(|[r, g, b, known]| [r / 255.0, g / 255.0, b / 255.0, known]);
        Ok(PlateModes::new(self.geometry, modes, radius / 255.0))
    }

    /// Collects the samples of a pixel; those that strokes mark as background alone, if there are some.
    fn collect(&self, col: usize, row: usize, samples: &mut Samples) {
        samples.clear();
        for label in [Label::Background, Label::Sample] {
            for (index, layer) in self.layers.iter().enumerate() {
                let [r, g, b, stored] = layer[(col, row)];
                if stored == label as u8 {
                    samples.push([r, g, b].map(f32::from), index);
                }
            }
            if samples.len() > 0 {
                return;
            }
        }
    }
}

/// Standard deviation of the noise, in steps of 8 bits, from differences between layers that follow each other.
fn noise(layers: &[Layer]) -> f32 {
    let mut differences = Vec::new();
    for pair in layers.windows(2).step_by((layers.len() / 8).max(1)) {
        let step = (pair[0].size().pixels() / MAX_PAIRS).max(1);
        for (a, b) in pair[0].pixels().iter().zip(pair[1].pixels()).step_by(step) {
            if a[3] > 0 && b[3] > 0 {
                differences.extend((0..3).map(|c| f32::from(a[c].abs_diff(b[c]))));
            }
        }
    }
    1.4826 * median(differences) / std::f32::consts::SQRT_2
}
