//! From a clip and an index to a frame: plate, foreground, alpha, composite.

use crate::clip::shape::{Part, Shape, ring_in_frame};
use crate::clip::track::Moment;
use crate::clip::{Clip, Shot, ring};
use crate::damage::add_gaussian_noise;
use crate::paint::center;
use crate::random::Seed;
use glam::{DMat3, DVec2, Vec3, Vec4};
use ravec_raster::{Image, LinearRgb, Plane, Size, Srgb};
use rayon::prelude::*;

/// Moments that an open shutter averages: their distance stays below a pixel for motion of 8 pixels over the exposure.
const EXPOSURES: usize = 8;

/// A frame with what it is made of, in linear light without noise.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Its index in the clip.
    pub index: usize,
    /// The frame: `alpha·foreground + (1 − alpha)·plate`.
    pub picture: Image<LinearRgb>,
    /// Alpha of all moving shapes together, 0 to 1.
    pub alpha: Plane,
    /// Color of the shapes, not multiplied by alpha; black where alpha is 0.
    pub foreground: Image<LinearRgb>,
    /// The frame without shapes, in the same light.
    pub plate: Image<LinearRgb>,
    noise_sigma: f64,
    noise_seed: Seed,
}

impl Frame {
    /// The picture as a camera stores it: encoded in 8 bit, with the noise of the clip.
    pub fn stored(&self) -> Image<Srgb<u8>> {
        let image = self.picture.convert::<Srgb<u8>>();
        if self.noise_sigma > 0.0 {
            add_gaussian_noise(&image, self.noise_sigma, self.noise_seed)
        } else {
            image
        }
    }
}

impl Clip {
    /// A frame.
    ///
    /// Beyond the end of the clip the motion of the last shot goes on.
    pub fn frame(&self, index: usize) -> Frame {
        let shot = self.shot(index).1;
        let mut plate = self.mean_plate(index);
        let mut layer = self.mean_layer(index, shot, &shot.shapes);
        let (width, height) = (self.size.width(), self.size.height());
        let light = shot.frame_light(index);
        let black = LinearRgb([0.0; 3]);
        let mut picture = Image::new(self.size, black);
        let mut foreground = Image::new(self.size, black);
        let mut alpha = Plane::new(self.size, 0.0);
        picture
            .par_rows_mut()
            .zip(foreground.par_rows_mut())
            .zip(plate.par_rows_mut())
            .zip(alpha.par_rows_mut())
            .zip(layer.par_chunks_mut(width))
            .enumerate()
            .for_each(|(row, ((((picture, foreground), plate), alpha), layer))| {
                let (gain, offset) = light.of_row(row, height);
                let lit = |color: Vec3| color * gain + Vec3::splat(offset);
                for col in 0..width {
                    let cover = layer[col].w.min(1.0);
                    let back = lit(Vec3::from_array(plate[col].0));
                    let front = if cover > 0.0 {
                        lit(layer[col].truncate() / layer[col].w)
                    } else {
                        Vec3::ZERO
                    };
                    alpha[col] = cover;
                    plate[col] = LinearRgb(back.to_array());
                    foreground[col] = LinearRgb(front.to_array());
                    let mixed = composite(cover, foreground[col], plate[col]);
                    picture[col] = mixed;
                }
            });
        Frame {
            index,
            picture,
            alpha,
            foreground,
            plate,
            noise_sigma: self.noise_sigma,
            // not the seed of the picture itself: noise has nothing to do with it, nor with that of other frames
            noise_seed: self.seed.fork(1).fork(index as u64),
        }
    }

    /// Alpha of one shape as if it were alone, 0 to 1: what hides it lies in the alphas of the shapes after it.
    ///
    /// Nothing if the shot of the frame has no such shape.
    pub fn shape_alpha(&self, index: usize, shape: usize) -> Option<Plane> {
        let shot = self.shot(index).1;
        let layer = self.mean_layer(index, shot, shot.shapes.get(shape..=shape)?);
        let mut alpha = Plane::new(self.size, 0.0);
        for (alpha, color) in alpha.pixels_mut().iter_mut().zip(layer) {
            *alpha = color.w.min(1.0);
        }
        Some(alpha)
    }

    /// The moments that a frame averages, as delays in frames.
    fn delays(&self) -> Vec<f64> {
        let shutter = self.shutter.clamp(0.0, 1.0);
        if shutter == 0.0 {
            return vec![0.0];
        }
        let at = |k: usize| ((k as f64 + 0.5) / EXPOSURES as f64 - 0.5) * shutter;
        (0..EXPOSURES).map(at).collect()
    }

    fn mean_plate(&self, index: usize) -> Image<LinearRgb> {
        let shot = self.shot(index).1;
        let delays = self.delays();
        let view = |delay: f64| {
            let moment = shot.moment(index, delay);
            shot.camera.frame_from_world(moment, self.size)
        };
        let middle = view(0.0);
        // a camera that stands still needs no mean
        let still = delays.iter().all(|&delay| view(delay) == middle);
        if still {
            return shot.world.render(&middle, self.size);
        }
        let share = 1.0 / delays.len() as f32;
        let mut mean = Image::new(self.size, LinearRgb([0.0; 3]));
        for delay in delays {
            let seen = shot.world.render(&view(delay), self.size);
            for (mean, seen) in mean.pixels_mut().iter_mut().zip(seen.pixels()) {
                let sum = Vec3::from_array(mean.0) + share * Vec3::from_array(seen.0);
                *mean = LinearRgb(sum.to_array());
            }
        }
        mean
    }

    /// Color times alpha, and alpha, of shapes over one another.
    fn mean_layer(&self, index: usize, shot: &Shot, shapes: &[Shape]) -> Vec<Vec4> {
        let delays = self.delays();
        let share = 1.0 / delays.len() as f32;
        let mut mean = vec![Vec4::ZERO; self.size.pixels()];
        for (number, &delay) in delays.iter().enumerate() {
            let moment = shot.moment(index, delay);
            let frame_from_world = shot.camera.frame_from_world(moment, self.size);
            if number == 0 && delays.len() == 1 {
                paint_shapes(&mut mean, self.size, shapes, &frame_from_world, moment);
                break;
            }
            let mut layer = vec![Vec4::ZERO; self.size.pixels()];
            paint_shapes(&mut layer, self.size, shapes, &frame_from_world, moment);
            for (mean, layer) in mean.iter_mut().zip(layer) {
                *mean += share * layer;
            }
        }
        mean
    }
}

/// The composite of a pixel: the identity that every frame keeps.
fn composite(alpha: f32, foreground: LinearRgb, plate: LinearRgb) -> LinearRgb {
    let channel = |c: usize| alpha * foreground.0[c] + (1.0 - alpha) * plate.0[c];
    LinearRgb([0, 1, 2].map(channel))
}

fn paint_shapes(
    layer: &mut [Vec4],
    size: Size,
    shapes: &[Shape],
    frame_from_world: &DMat3,
    moment: Moment,
) {
    for shape in shapes {
        let frame_from_shape = *frame_from_world * shape.world_from_shape(moment);
        for part in shape.parts(moment).iter() {
            paint_part(layer, size, part, &frame_from_shape);
        }
    }
}

fn paint_part(layer: &mut [Vec4], size: Size, part: &Part, frame_from_shape: &DMat3) {
    let Some(patch) =
        ring_in_frame(frame_from_shape, &part.ring).and_then(|ring| ring::cover(size, &ring))
    else {
        return;
    };
    let shape_from_frame = frame_from_shape.inverse();
    let height = patch.coverage.len() / patch.width;
    let middle = DVec2::new(
        patch.col as f64 + 0.5 * patch.width as f64,
        patch.row as f64 + 0.5 * height as f64,
    );
    let footprint = footprint(&shape_from_frame, middle);
    let rows = &mut layer[patch.row * size.width()..(patch.row + height) * size.width()];
    rows.par_chunks_mut(size.width())
        .zip(patch.coverage.par_chunks(patch.width))
        .with_min_len(16)
        .enumerate()
        .for_each(|(row, (pixels, coverage))| {
            for (col, &covered) in coverage.iter().enumerate().filter(|(_, c)| **c > 0.0) {
                let p = center(patch.col + col, patch.row + row);
                let h = shape_from_frame * p.extend(1.0);
                let color = part.coat.color(h.truncate() / h.z, footprint);
                let alpha = covered * part.opacity as f32;
                let under = pixels[patch.col + col];
                pixels[patch.col + col] = color.extend(1.0) * alpha + under * (1.0 - alpha);
            }
        });
}

/// The side of the square on a shape that a pixel stands for.
fn footprint(shape_from_frame: &DMat3, p: DVec2) -> f64 {
    let m = shape_from_frame;
    let h = *m * p.extend(1.0);
    let q = h.truncate() / h.z;
    let dx = (m.x_axis.truncate() - q * m.x_axis.z) / h.z;
    let dy = (m.y_axis.truncate() - q * m.y_axis.z) / h.z;
    dx.perp_dot(dy).abs().sqrt()
}
