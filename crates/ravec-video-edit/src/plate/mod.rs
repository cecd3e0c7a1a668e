//! Background plates: a picture of the plane of a shot without what moves before it.
//!
//! ```text
//! first pass:  each frame is warped onto the plate and its exposure fitted to the median of some before
//!              some of them are kept: as many as memory allows
//! modes:       for each pixel the color around which its samples are densest
//!              where several are, those of frames that agree with the plate around (`coherent`)
//!              where marked foreground lasts, colors of the background around (`hidden`)
//! second pass: each frame again, its exposure fitted to the modes
//!              samples near the mode of their pixel are averaged
//! ```
//!
//! Modes are robust, averages of all frames are free of noise and of the rounding that the samples of the first pass have.

mod coherent;
mod hidden;
mod modes;
mod regions;

pub use regions::{joined_plate, plate_regions};

use crate::exposure::{Exposure, Pair, median};
use crate::interpolated::interpolated;
use crate::{Colors, VideoEditError};
use glam::DVec2;
use hidden::Mark;
use modes::{Samples, biweight};
use ravec_planar::Homography;
use ravec_progress::Progress;
use ravec_raster::{Image, Mask, Plane, Size};
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
/// Pixels of the plate at which exposures are compared, at most.
const MAX_PAIRS: usize = 20_000;
/// Layers to whose median the exposure of a frame is fitted.
const ANCHORS: usize = 7;
/// Share of samples near the mode below which a mean would be of little, and the mode itself is taken.
const MIN_WEIGHT: f32 = 0.05;

/// A frame of a shot on its way into a plate.
#[derive(Debug, Clone, Copy)]
pub struct ShotFrame<'a> {
    /// sRGB-encoded colors, 0 to 1.
    pub colors: &'a Colors,
    /// Map from the reference frame to this one.
    pub frame_from_reference: &'a Homography,
    /// Pixels that show foreground.
    pub foreground: Option<&'a Mask>,
    /// Those of them that belong to something that may cover a place most of the time.
    pub strokes: Option<&'a Mask>,
    /// Pixels that show the plane for certain.
    pub background: Option<&'a Mask>,
    /// True for the frame whose exposure the plate gets.
    pub is_reference: bool,
}

impl<'a> ShotFrame<'a> {
    /// A frame without marks.
    pub fn new(colors: &'a Colors, frame_from_reference: &'a Homography) -> Self {
        Self {
            colors,
            frame_from_reference,
            foreground: None,
            strokes: None,
            background: None,
            is_reference: false,
        }
    }
}

/// A background plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Plate {
    /// sRGB-encoded colors, 0 to 1, in the exposure of the reference frame. Places that were never seen hold the colors of their
    /// surroundings.
    pub colors: Colors,
    /// Pixels that some frame shows without foreground.
    pub seen: Mask,
    /// Certainty, 0 to 1: the share of the samples of a pixel that agree with its color, times `n / (n + 1)` for `n` samples that
    /// do. 0 where nothing was seen.
    pub certainty: Plane,
    /// Standard deviation of the samples that agree, in units of color: noise, and more where the map to the frames is wrong. 0 where
    /// nothing was seen.
    pub spread: Plane,
    /// Share of the samples of a pixel that agree with its color.
    pub agreement: Plane,
    /// Number of frames that show a pixel.
    pub samples: Plane,
}

/// Geometry of a plate: that of the reference frame, with `pad_px` pixels more on each side.
#[derive(Debug, Clone, Copy)]
struct Geometry {
    frame: Size,
    plate: Size,
    pad_px: usize,
}

impl Geometry {
    fn frame_from_plate(&self, frame: &ShotFrame<'_>) -> Homography {
        let shift = Homography::from_translation(DVec2::splat(-(self.pad_px as f64)))
            .unwrap_or(Homography::IDENTITY);
        let middle = DVec2::new(self.plate.width() as f64, self.plate.height() as f64) * 0.5;
        (*frame.frame_from_reference * shift).facing(middle)
    }

    fn stabilized(&self, frame: &ShotFrame<'_>) -> Result<Stabilized, VideoEditError> {
        if frame.colors.size() != self.frame {
            return Err(VideoEditError::SizesDiffer {
                found: frame.colors.size(),
                expected: self.frame,
            });
        }
        let map = self.frame_from_plate(frame);
        Ok(interpolated(
            frame.colors,
            frame.foreground,
            &map,
            self.plate,
        ))
    }

    /// Pixels of the plate whose center lies in a pixel of a mask of the frame.
    fn marked(&self, frame: &ShotFrame<'_>, mask: &Mask) -> Mask {
        let map = self.frame_from_plate(frame);
        Mask::from_fn(self.plate, |col, row| {
            let at = map.try_apply(DVec2::new(col as f64 + 0.5, row as f64 + 0.5));
            at.is_some_and(|at| {
                at.x >= 0.0
                    && at.y >= 0.0
                    && at.x < self.frame.width() as f64
                    && at.y < self.frame.height() as f64
                    && mask.at(at.x as usize, at.y as usize) > 0.5
            })
        })
    }
}

/// Colors of a frame on the plate, and 1 where there are some.
type Stabilized = Image<[f32; 4]>;

/// A frame on the plate of one of several planes.
struct OnPlane<'a> {
    /// Index of the plane.
    plane: usize,
    frame: &'a ShotFrame<'a>,
    stabilized: Stabilized,
    /// Colors of the plate and of the frame.
    pairs: Vec<Pair>,
}

/// Exposure of a frame that lies on the plates of several planes. It is the same on all; where a plane fills little of the frame,
/// most of what lies on its plate is of others, so that the plane counts that fits best.
fn exposure_of(planes: &[OnPlane<'_>]) -> Exposure {
    if let [on] = planes {
        return Exposure::fit(&on.pairs);
    }
    let most = planes.iter().map(|on| on.pairs.len()).max().unwrap_or(0);
    let enough = planes.iter().filter(|on| 2 * on.pairs.len() >= most);
    let fits = enough.map(|on| {
        let exposure = Exposure::fit(&on.pairs);
        (exposure.deviation(&on.pairs), exposure)
    });
    let best = fits.min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(Exposure::SAME, |(_, exposure)| exposure)
}

/// Colors of a frame on the plate beside colors that are known there.
fn pairs_of(
    stabilized: &Stabilized,
    colors: impl Fn(usize, usize) -> Option<[f32; 3]>,
) -> Vec<Pair> {
    let step = (stabilized.size().pixels() / MAX_PAIRS).isqrt().max(1);
    let mut pairs = Vec::new();
    for row in (step / 2..stabilized.height()).step_by(step) {
        for col in (step / 2..stabilized.width()).step_by(step) {
            let [r, g, b, share] = stabilized[(col, row)];
            if share == 0.0 {
                continue;
            }
            if let Some(plate) = colors(col, row) {
                let frame = [r, g, b];
                pairs.push(Pair { plate, frame });
            }
        }
    }
    pairs
}

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
    /// Every so many frames are kept.
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
                    let [r, g, b] =
                        color.map(|value| (255.0 * value).round().clamp(0.0, 255.0) as u8);
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
        Ok(PlateModes {
            geometry: self.geometry,
            radius: radius / 255.0,
            modes,
            sums: Image::new(size, [0.0; 4]),
            squares: Plane::new(size, 0.0),
            samples: Plane::new(size, 0.0),
            reference: Exposure::SAME,
        })
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

/// The second pass over the frames of a shot.
pub struct PlateModes {
    geometry: Geometry,
    /// Radius around a mode in which samples agree with it.
    radius: f32,
    /// Color of each mode; 0 in the last channel where nothing was seen.
    modes: Image<[f32; 4]>,
    /// Weighted sums of the samples that agree, and their weight.
    sums: Image<[f32; 4]>,
    /// Weighted sum of the squared distances of these samples to the mode, a channel.
    squares: Plane,
    /// Number of samples.
    samples: Plane,
    /// Exposure of the reference frame.
    reference: Exposure,
}

impl PlateModes {
    /// Takes the next frame.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn add(&mut self, frame: &ShotFrame<'_>) -> Result<(), VideoEditError> {
        Self::add_planes(std::slice::from_mut(self), &[Some(*frame)])
    }

    /// Takes the next frame of a shot of several planes, as [`PlateSamples::add_planes`] does.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn add_planes(
        planes: &mut [Self],
        frames: &[Option<ShotFrame<'_>>],
    ) -> Result<(), VideoEditError> {
        let mut on_planes = Vec::new();
        for (plane, (modes, frame)) in planes.iter().zip(frames).enumerate() {
            let Some(frame) = frame else {
                continue;
            };
            let stabilized = modes.geometry.stabilized(frame)?;
            let pairs = pairs_of(&stabilized, |col, row| {
                let [r, g, b, known] = modes.modes[(col, row)];
                (known > 0.0).then_some([r, g, b])
            });
            on_planes.push(OnPlane {
                plane,
                frame,
                stabilized,
                pairs,
            });
        }
        let exposure = exposure_of(&on_planes);
        for on in on_planes {
            planes[on.plane].take(on.frame, &on.stabilized, exposure);
        }
        Ok(())
    }

    /// Adds a frame that lies on the plate.
    fn take(&mut self, frame: &ShotFrame<'_>, stabilized: &Stabilized, exposure: Exposure) {
        if frame.is_reference {
            self.reference = exposure;
        }
        let scale = 1.0 / (self.radius * self.radius);
        self.sums
            .par_rows_mut()
            .zip(self.samples.par_rows_mut().zip(self.squares.par_rows_mut()))
            .zip(self.modes.par_rows().zip(stabilized.par_rows()))
            .for_each(|((sums, (samples, squares)), (modes, stabilized))| {
                let counts = samples.iter_mut().zip(squares);
                for (((sums, (samples, squares)), mode), [r, g, b, share]) in
                    sums.iter_mut().zip(counts).zip(modes).zip(stabilized)
                {
                    if *share == 0.0 {
                        continue;
                    }
                    let color = exposure.undone([*r, *g, *b]);
                    let distance = [0, 1, 2].map(|c| color[c] - mode[c]);
                    let weight = biweight(distance, scale);
                    let square: f32 = distance.iter().map(|value| value * value).sum();
                    *squares += weight * square / 3.0;
                    for (sum, value) in sums.iter_mut().zip(color) {
                        *sum += weight * value;
                    }
                    sums[3] += weight;
                    *samples += 1.0;
                }
            });
    }

    /// The plate.
    pub fn plate(self) -> Plate {
        let size = self.geometry.plate;
        let seen = |col: usize, row: usize| self.modes[(col, row)][3] > 0.0;
        let colors = Image::from_fn(size, |col, row| {
            let [r, g, b, _] = self.modes[(col, row)];
            let [sr, sg, sb, weight] = self.sums[(col, row)];
            let color = if weight > MIN_WEIGHT {
                [sr, sg, sb].map(|sum| sum / weight)
            } else {
                [r, g, b]
            };
            self.reference
                .applied(color)
                .map(|value| value.clamp(0.0, 1.0))
        });
        let agreement = Plane::from_fn(size, |col, row| {
            let (count, weight) = (self.samples[(col, row)], self.sums[(col, row)][3]);
            if seen(col, row) && count > 0.0 {
                (weight / count).min(1.0)
            } else {
                0.0
            }
        });
        let certainty = Plane::from_fn(size, |col, row| {
            let weight = self.sums[(col, row)][3];
            agreement[(col, row)] * weight / (weight + 1.0)
        });
        let spread = Plane::from_fn(size, |col, row| {
            let weight = self.sums[(col, row)][3];
            if seen(col, row) && weight > MIN_WEIGHT {
                (self.squares[(col, row)] / weight).sqrt()
            } else {
                0.0
            }
        });
        let seen = Mask::from_fn(size, seen);
        let colors = surrounded(&colors, &seen);
        Plate {
            colors,
            seen,
            certainty,
            spread,
            agreement,
            samples: self.samples,
        }
    }
}

/// Colors with those of the surroundings in places that were not seen (push and pull: Gortler et al., *The Lumigraph*, 1996).
fn surrounded(colors: &Colors, seen: &Mask) -> Colors {
    let weighted = Image::from_fn(colors.size(), |col, row| {
        let [r, g, b] = colors[(col, row)];
        if seen.at(col, row) > 0.0 {
            [r, g, b, 1.0]
        } else {
            [0.0; 4]
        }
    });
    pulled(&weighted).map(|[r, g, b, _]| [r, g, b])
}

/// Colors of weight 1 everywhere, from pixels that are multiplied by their weight.
fn pulled(pixels: &Image<[f32; 4]>) -> Image<[f32; 4]> {
    let (width, height) = (pixels.width(), pixels.height());
    let coarse = Size::new(width.div_ceil(2), height.div_ceil(2));
    let Some(coarse) = coarse.ok().filter(|_| width > 1 || height > 1) else {
        return pixels.map(|[r, g, b, weight]| {
            if weight > 0.0 {
                [r / weight, g / weight, b / weight, 1.0]
            } else {
                [0.0, 0.0, 0.0, 1.0]
            }
        });
    };
    let halved = Image::from_fn(coarse, |col, row| {
        let mut sums = [0.0f32; 4];
        for r in 2 * row..(2 * row + 2).min(height) {
            for c in 2 * col..(2 * col + 2).min(width) {
                for (sum, value) in sums.iter_mut().zip(pixels[(c, r)]) {
                    *sum += value;
                }
            }
        }
        let scale = 1.0 / sums[3].max(1.0);
        sums.map(|sum| sum * scale)
    });
    let filled = pulled(&halved);
    Image::from_fn(pixels.size(), |col, row| {
        let own = pixels[(col, row)];
        if own[3] >= 1.0 {
            return own;
        }
        let around = |at: usize, length: usize| {
            let near = at / 2;
            let far = if at.is_multiple_of(2) {
                near.saturating_sub(1)
            } else {
                (near + 1).min(length - 1)
            };
            [near, far]
        };
        let (cols, rows) = (around(col, filled.width()), around(row, filled.height()));
        let mut below = [0.0f32; 4];
        for (r, row_share) in rows.into_iter().zip([0.75, 0.25]) {
            for (c, col_share) in cols.into_iter().zip([0.75, 0.25]) {
                for (below, value) in below.iter_mut().zip(filled[(c, r)]) {
                    *below += row_share * col_share * value;
                }
            }
        }
        [0, 1, 2, 3].map(|k| own[k] + (1.0 - own[3]) * below[k])
    })
}
